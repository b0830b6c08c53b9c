"""The benchmark's own arithmetic: targets, the assembled problem, roofline counts, peers on the
same QP."""

import sys

import numpy as np
import pytest
from conftest import load_response

from driver.bench import direct, factorization, geometry, peers, ranks, roofline, suite, tao
from driver.bench.workbench import Report, Workbench, child, in_turn, march, ratios
from driver.errors import InputError
from driver.feti.rows import RowKind
from driver.files import read_rows
from driver.march.step import StepFailed
from driver.scene import freefem


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    made = Workbench(tmp_path_factory.mktemp("bench"))
    yield made
    made.close()


def test_targets_and_spread(tmp_path, capsys):
    report = Report("part")
    assert report.add("time", [3.0, 1.0, 2.0], "s", "<= 2") == 2.0
    report.add("gain", 1.5, "", ">= 1.7")
    report.add("count", 7)
    report.skip("no peer")
    report.write(tmp_path / "report.csv")
    rows = read_rows(tmp_path / "report.csv")
    assert [row["met"] for row in rows] == ["yes", "no", "", "skipped"]
    assert [row["spread"] for row in rows] == ["1.00", "", "", ""]
    assert rows[1]["target"] == ">= 1.7"


def test_taken_in_turn_and_ratios_by_round():
    order = []
    found = in_turn({"a": lambda: order.append("a"), "b": lambda: order.append("b") or 2.0}, 2)
    assert order == ["a", "b", "a", "b"]
    assert found["b"] == [2.0, 2.0] and ratios([2.0, 9.0], [1.0, 3.0]) == [2.0, 3.0]


def test_assembled_problem_moves_like_the_torn_one(bench):
    """Without contact forces FETI-DP with glued interfaces and the assembled problem are the same
    body."""
    problem = bench.problem("4x2", cells=4)
    K, loads = factorization.assembled(problem.structure)
    u = np.linalg.solve(K.toarray(), loads[0])
    operator, gluing = problem.operator, problem.structure.row_kind == RowKind.GLUING
    F = np.column_stack([operator.apply(e) for e in np.eye(operator.owned)])
    d, glued = load_response(operator, np.ones(1)), np.zeros(operator.owned)
    glued[gluing] = np.linalg.solve(F[gluing][:, gluing], d[gluing])
    # the largest corner displacement is one entry of u, to rounding times the condition number
    corners = np.abs(operator.coarse_displacements(glued, np.ones(1))).max()
    assert np.abs(np.abs(u) - corners).min() <= 1e-9 * np.abs(u).max()


@pytest.mark.parametrize("scene, element", [("tutorial", "P2"), ("bracket", "P1")])
@pytest.mark.some(1)
def test_plain_script_moves_like_the_suite_without_contact(tmp_path, scene, element):
    """Supports, prescribed motion, traction, body force, histories, materials: the same equations.
    """
    h, dofs = geometry.size(scene, element, 1000, tmp_path, 2.0)
    assert 950 <= dofs <= 1050
    # two direct solutions, each rounded a condition number times
    assert geometry.difference(scene, element, h, tmp_path) < 1e-9


@pytest.mark.parametrize("scene", ["joint", "thermal", "model"])
def test_scenes_whose_linear_problem_the_plain_script_does_not_know(scene):
    with pytest.raises(InputError, match="is no scene of one body"):
        direct.text(freefem.find_scene(scene), "P1")


def test_flops_of_a_product(bench):
    operator = bench.problem("4x2", cells=4).operator
    rows = [len(local.row) for local in operator.structure.rows]
    corners = [len(number) for number in operator.structure.corner_global]
    assert roofline.work(operator)["flops"] == sum(
        2 * m * m + 4 * m * n for m, n in zip(rows, corners))


@pytest.mark.parametrize("name", ["blmvm", "tron"])
def test_peers_reach_the_tolerance_on_the_same_problem(bench, name):
    operator, d, bounds, solver = tao.problem_of(bench, "4x2")
    products, converged = tao.theirs(name, operator, d, bounds, solver.qp.bound)
    assert converged and products > 10
    assert tao.ours(operator, d, bounds, solver) < products


def test_the_block_on_an_own_mesh_is_the_model_example(solved, tmp_path):
    """The same resultants as on equal pieces, to what so coarse meshes leave open."""
    scene = peers._own_mesh(tmp_path)  # pylint: disable=protected-access
    own = solved(str(scene), loading="nonmonotone", h=0.05, steps=4, friction=0.3)
    pieces = solved("model", loading="nonmonotone", cells=10, steps=4)
    assert own.summary["parameters"]["subdomains"] == "auto"
    for name in ("resultant_n", "resultant_t"):
        a, b = own.history[name][-1], pieces.history[name][-1]
        assert abs(a - b) <= 0.02 * abs(b)


def test_a_solver_that_uses_too_many_products_has_failed(bench, monkeypatch):
    monkeypatch.setattr(tao, "LIMIT", 20)
    operator, d, bounds, solver = tao.problem_of(bench, "4x2")
    assert tao.theirs("blmvm", operator, d, bounds, solver.qp.bound) == (20, False)


def test_a_run_that_fails_is_no_measurement(bench):
    with pytest.raises(StepFailed, match="no fixed point"):
        march(bench.problem("4x2", cells=4), max_fixed_point=1)


@pytest.mark.slow
def test_message_volume_and_counts_do_not_depend_on_who_measures(bench):
    one, two = (ranks.run(bench, "4x2", 4, p, 1)[0] for p in (1, 2))
    assert one["counts"] == two["counts"]
    assert one["bytes"] == {"rows": 0, "coarse": 0, "dot": 0}
    # two halves of 4x2, cut between the two layers: four interfaces of three inner nodes, two
    # components, there and back
    assert two["bytes"]["rows"] == 4 * 3 * 2 * 8 * 2
    assert two["bytes"]["dot"] == 8 * 8


@pytest.mark.parametrize("options",
                         [{"parts": "product"}, {"large": "perhaps"}, {"loading": "monotone"}])
def test_refusals(options, tmp_path):
    with pytest.raises(InputError):
        suite.run_bench({**options, "out": str(tmp_path / "bench")})


def test_memory_of_a_child_is_its_own_alone():
    """Whatever the process that asks has in memory: 300 MiB here."""
    held = np.ones(40_000_000)
    (_, little), (_, more) = (child([sys.executable, "-c", code])
                              for code in ("pass", "x = b'1' * (100 << 20)"))
    assert little < 50 and 90 < more - little < 110 and held[0] == 1


def test_a_child_that_fails_says_why():
    with pytest.raises(RuntimeError, match="failed: .*nothing doing"):
        child([sys.executable, "-c", "raise SystemExit('nothing doing')"])
