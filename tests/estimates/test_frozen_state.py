"""Adjoint problems and companions by themselves, on a dense dual matrix and a few numbers."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import OPEN, SLIP, STICK
from driver.contact.motion import ObstacleMotion
from driver.estimates import adjoint, companions, refinement
from driver.estimates.adjoint import Adjoint
from driver.estimates.between_steps import Strides
from driver.estimates.companions import Companions, _whole
from driver.estimates.levels import Levels, samples
from driver.feti.rigid_modes import RigidMode
from driver.march.friction_qp import FrictionQP
from driver.options import Settings

NODES, OWNED = 4, 10  # normal rows, then tangential ones, then two that glue


def frozen(status, coefficient=0.5, **operator) -> Adjoint:
    """Adjoint problems of four nodes that press by 2 each, and rub backward in the second."""
    rng = np.random.default_rng(1)
    root = rng.standard_normal((OWNED, 2 * OWNED))
    F = root @ root.T / OWNED
    node = np.arange(NODES)
    rows = SimpleNamespace(normal=node, normal_node=node, tangential=NODES + node,
                           tangential_node=node, pair=node,
                           coefficient=coefficient and np.full(NODES, coefficient))
    x = np.array([2.0, 2, 2, 2, 1, -1, 0.25, 1, 0.5, 0.5])
    of = object.__new__(Adjoint)
    of.system = None
    of.rows, of.step = rows, SimpleNamespace(index=1, multipliers=x, weights=np.zeros(1))
    of.operator = SimpleNamespace(**{
        "apply": lambda y: F @ y, "dot": np.dot, "minimum": lambda value: value, "owned": OWNED,
        "comm": MPI.COMM_SELF, "modes": 0, "structure": SimpleNamespace(patterns=1, total=1),
        "deformations": lambda *given: given, **operator})
    qp = object.__new__(FrictionQP)
    qp.operator, qp.bound, qp.scale = of.operator, 2 * np.linalg.norm(F, 2), None
    qp.size, qp.accelerators = np.linalg.norm, SimpleNamespace(preconditioner=None)
    of.solver = SimpleNamespace(qp=qp)
    of.F = F
    of._freeze(np.array(status))
    return of


def test_which_rows_act_in_a_frozen_state():
    """Open nodes do not; what slides has its friction by its pressure, with the sign it has."""
    of = frozen([STICK, SLIP, OPEN, SLIP])
    assert np.flatnonzero(of.upper == 0).tolist() == [2, 5, 6, 7]
    np.testing.assert_array_equal(of.ratio, [0, -0.5, 0, 0.5])
    assert of._coupled and not frozen([STICK, OPEN, OPEN, STICK])._coupled
    assert not frozen([SLIP] * 4, None).ratio.any()
    moved = np.arange(float(OWNED))
    np.testing.assert_allclose(of._followed(moved), [0, 1 - 2.5, 2, 3 + 3.5, 4, 5, 6, 7, 8, 9])


@pytest.mark.parametrize("status", [[STICK, SLIP, OPEN, SLIP], [STICK] * 4, [OPEN] * 4])
def test_adjoint_multipliers_solve_the_frozen_system(status):
    """K z + B' mu = e with B z given along the forces of nodes that slide: dense, to the tolerance
    of the repetition that couples friction.
    """
    of = frozen(status)
    moved = np.random.default_rng(2).standard_normal(OWNED)
    free = of.upper > 0
    along = np.eye(OWNED)
    along[of.rows.pair, of.rows.tangential] += of.ratio
    dense = np.zeros(OWNED)
    dense[free] = np.linalg.solve((along @ of.F)[np.ix_(free, free)], (along @ moved)[free])
    np.testing.assert_allclose(of._solve(moved), dense, atol=2e-2 * np.abs(dense).max())
    assert not of._solve(np.zeros(OWNED)).any()


def test_goals_of_quantities():
    """Resultants and peaks are forces over given displacements, slip a unit force that acts."""
    of = frozen([STICK] * 4)
    weight = np.array([1.0, 2.0, 4.0, 8.0])
    of.record = SimpleNamespace(
        signed_shares=lambda name, index: (1 if name == "normal_resultant" else -1) * weight,
        contact=SimpleNamespace(boundary=SimpleNamespace(weight=weight)),
        peak_nodes=lambda index: np.array([1, 2]), farthest_node=lambda index: 3)
    target, start, forces = of._goal("normal_resultant")
    np.testing.assert_array_equal(target, [1, 2, 4, 8, 0, 0, 0, 0, 0, 0])
    assert not start.any() and forces is None
    np.testing.assert_array_equal(of._goal("tangential_resultant")[0],
                                  [0, 0, 0, 0, -1, -2, -4, -8, 0, 0])
    np.testing.assert_allclose(of._goal("peak_pressure")[0], [0, 1 / 4, 1 / 8, *[0] * 7])
    target, start, forces = of._goal("slip")
    assert not target.any() and start.tolist() == [0] * 7 + [-1, 0, 0] and forces is None
    assert of._goal("contact_length") is None


def test_the_adjoint_of_a_displacement_is_a_unit_force_where_it_is_largest():
    """Along it; in the first subdomain of several that have it."""
    u = [np.array([1.0, 0, 3, -4]), np.array([3.0, -4, 0, 0])]
    of = frozen([STICK] * 4, displacements=lambda x, weights: u, structure=SimpleNamespace(
        subdomains=[SimpleNamespace(index=4), SimpleNamespace(index=5)], patterns=1))
    forces = of._at_largest()
    np.testing.assert_allclose(forces[0], [0, 0, 0.6, -0.8])
    assert not forces[1].any()


def test_forces_on_free_bodies_are_balanced_by_motions():
    """Multipliers that take a motion off the rows, as much as the work of forces misses."""
    motion = np.random.default_rng(3).standard_normal(OWNED)
    mode = RigidMode(0, np.array([0]), np.zeros(2), np.array([2.0, 0.0]), 0.0)
    subs = [SimpleNamespace(index=7, xy=np.zeros((2, 2))), SimpleNamespace(index=8, dofs=4)]
    of = frozen([STICK] * 4, modes=1, motions=[motion], structure=SimpleNamespace(
        patterns=1, total=9, first=0, rigid_modes=[mode], subdomains=subs))
    of.free = of._moved_freely()
    x = np.random.default_rng(4).standard_normal(OWNED)
    for forces in (None, [np.array([3.0, 9, 1, 9]), np.full(4, 99.0)]):
        balanced, moved = of._balanced(x, forces)
        work = 0.0 if forces is None else 8.0
        assert motion @ balanced == pytest.approx(work, abs=1e-2 * abs(motion @ x))
        np.testing.assert_allclose(of.F @ (balanced - x), moved[0] * motion,
                                   atol=1e-2 * abs(moved[0]) * np.abs(motion).max())
    assert frozen([STICK] * 4)._balanced(x, None)[0] is x


@pytest.mark.parametrize("corners, step, why, expected", [
    ("some", 1, "", adjoint.CORNERS), (None, None, "", adjoint.EARLIER), (None, 1, "law", "law"),
    (None, 1, "", "")])
def test_runs_without_adjoint_problems(monkeypatch, corners, step, why, expected):
    monkeypatch.setattr(adjoint, "Effects", lambda manifest: SimpleNamespace(
        no_bound=lambda: why, no_estimate=lambda weights: ""))
    found = adjoint.unsuited(SimpleNamespace(manifest=None), SimpleNamespace(
        rows=SimpleNamespace(corners=corners)), step and SimpleNamespace(weights=None))
    assert found == expected


# ------------------------------------------------------------------------------ companions

@pytest.mark.parametrize("steps, start, stride, expected", [
    (8, 0, 2, [0, 2, 4, 6, 8]), (7, 0, 2, [0, 1, 3, 5, 7]), (6, 0, 4, [0, 2, 6]),
    (7, 3, 2, [0, 1, 3, 5, 7]), (8, 3, 4, [0, 3, 4, 8]), (3, 0, 1, [0, 1, 2, 3])])
def test_every_other_time_from_the_last_one_back(steps, start, stride, expected):
    """And from where a cycle begins."""
    found = samples(SimpleNamespace(steps=steps, cycle_start=start), stride)
    assert found.tolist() == expected


@pytest.mark.parametrize("steps, strides", [(1, [1, 1, 1]), (2, [1, 2, 2]), (3, [1, 2, 2]),
                                            (4, [1, 2, 4])])
def test_strides_leave_a_step(steps, strides):
    of = Strides(None, SimpleNamespace(steps=steps), None)
    assert [of.up_to(wanted) for wanted in (1, 2, 4)] == strides


@pytest.mark.parametrize("steps, frictional, expected", [
    (3, True, None), (4, True, [1, 2, 4]), (5, True, None), (6, True, [1, 2]), (8, True, [1, 2, 4]),
    (18, True, [1, 2]), (19, True, None), (21, True, [1, 2, 4]), (5, False, [1, 2])])
def test_coarser_times_do_not_share_the_first_of_few_steps(steps, frictional, expected):
    """Of five steps every other one, from the last back, would leave the first; then more are made.
    """
    of, strides = object.__new__(Companions), []
    of.strides = SimpleNamespace(misses=lambda _: False)
    of.effects, of.base = SimpleNamespace(frictional=frictional), {}
    of.manifest, of.on_arrival = SimpleNamespace(steps=steps, cycle_start=0), 0.0
    of._values = lambda mesh, stride: strides.append(stride)
    of._parts, of._more_time = (lambda *_: strides), (lambda: None)
    assert of._time() == expected


@pytest.mark.parametrize("steps, part, more", [
    (8, 0.6, True), (8, 0.4, False), (20, 0.6, False)])
def test_what_was_slid_on_arrival_takes_more_steps(steps, part, more):
    """Fewer ones join it with more of the way in the air; of many three numbers tell."""
    of = object.__new__(Companions)
    of.strides, of.base = SimpleNamespace(misses=lambda _: False), {}
    of.effects, of.on_arrival = SimpleNamespace(frictional=True), part
    of.manifest = SimpleNamespace(steps=steps, cycle_start=0)
    of._values, of._parts = (lambda *_: None), (lambda *_: "fewer")
    of._more_time = lambda: "more"
    assert of._time() == ("more" if more else "fewer")


@pytest.mark.parametrize("base, nodes, mesh", [
    ({"h": 2.0}, 4, {}), ({"h": 2.0}, 5, {"h": 2.0}), ({"h": 2.0}, 0, {"h": 2.0}), ({}, 4, {}),
    ({"h": 2.0}, None, {"h": 2.0})])
def test_steps_are_compared_on_a_mesh_that_knows_of_contact(base, nodes, mesh):
    """On the run's own where the next one touches in fewer nodes than tell of it."""
    of = object.__new__(Companions)
    of.base, of.manifest = base, SimpleNamespace(element="P1")
    touched = None if nodes is None else SimpleNamespace(touch=SimpleNamespace(nodes=nodes))
    of.level = lambda *_, **__: touched
    assert of._telling() == mesh


def test_more_steps_that_agree_by_chance_tell_no_less_than_their_distance(monkeypatch):
    """Of a quantity of first order a run in one step errs by 8/7 of its distance from one in eight,
    also where that and those in four and two agree; the safety of 1.2 is for the other mesh.
    """
    monkeypatch.setattr(companions, "finer", lambda *_: 8)
    of, name = object.__new__(Companions), "slip"
    of.base, of.manifest = {"h": 2.0}, SimpleNamespace(
        steps=1, element="P1", t_end=1.0, between={})
    of.strides = SimpleNamespace(motion=None)
    of.values, of.levels = {name: 1.0}, SimpleNamespace(problem=lambda **_: None)
    of._telling = lambda: of.base
    of._values = lambda mesh, stride=8: {name: 1.0 if stride == 8 else 4.0}
    assert of._more_time()[name].error == pytest.approx(1.2 * 8 / 7 * (4.0 - 1.0))


@pytest.mark.parametrize("frictional, history, stride", [
    (True, [0, 1, 0, 1, 0], 1), (True, [0, 1, 2, 3, 4], 2), (False, [0, 1, 0, 1, 0], 2)])
def test_coarse_meshes_see_the_turns_of_a_history(frictional, history, stride):
    """Every second time would miss them, and with friction the end depends on the way."""
    manifest = SimpleNamespace(steps=4, t_end=1.0, between={1: history})
    of = Strides(SimpleNamespace(frictional=frictional), manifest, None)
    assert of.of_coarse_meshes == stride


def test_coarse_meshes_see_the_turns_of_obstacles():
    """Of which loads know nothing."""
    shift = np.zeros((5, 1, 2))
    shift[:, 0, 0] = [0, 1, 1, 1, 1]
    none, still = np.zeros((5, 1)), np.zeros((1, 2))
    motion = ObstacleMotion(np.arange(5.0), none, shift, none, still, still, still)
    manifest = SimpleNamespace(steps=4, t_end=4.0, between={})
    of = Strides(SimpleNamespace(frictional=True), manifest, motion)
    assert of.of_coarse_meshes == 1
    shift[:, 0, 0] = np.arange(5)
    assert of.of_coarse_meshes == 2


def test_a_cycle_with_other_steps_has_its_mesh_and_those_steps():
    """From its export where nothing else is asked for; else by the sizes the cycle before left."""
    of, asked = object.__new__(Levels), []
    of.folder, of.refined = Path("runs"), [Path("first"), Path("second")]
    of.exported = lambda *words: asked.append(words)
    of._assemble({"cycle": 1, "sampling": 4})
    of._assemble({"cycle": 0, "sampling": 4})
    (_, changes, sizes, key), (_, _, none, _) = asked
    assert changes == {"sampling": 4} and sizes == Path("first") / refinement.STEM and none is None
    assert key == (("cycle", 1), ("sampling", 4))


def test_what_lowers_each_part_is_said():
    """The mesh by half a size or twice as many cells, all else by its own option."""
    of = object.__new__(Companions)
    of.settings, of.jumps = Settings(rtol=1e-6, friction_rtol=1e-4), None
    of.levels, of.effects = SimpleNamespace(refined=()), SimpleNamespace(quasistatic=True)
    for knob, size, words in (("h", 0.5, "H=0.25"), ("cells", 6, "CELLS=12"),
                              ("remesh", 1.0, "REMESH=0.5")):
        of.knob, of.manifest = knob, SimpleNamespace(steps=5, parameters={knob: size},
                                                between={})
        assert of.remedies() == {"mesh": words, "time": "STEPS=10", "friction":
                                 "FRICTION_RTOL=1e-05", "solver": "RTOL=1e-07"}
    of.levels.refined = (1, 2)
    assert of.remedies()["mesh"] == "ADAPT=3"


def test_tighter_companions_tell_what_tolerances_leave():
    """Twice their distance, for every step that they leave out and for the size of their mesh."""
    of = object.__new__(Companions)
    of.settings, of.base, of.ratios = Settings(rtol=1e-6, primal_rtol=1e-5), {"h": 1}, [2.5]
    of.strides, asked = Strides(None, SimpleNamespace(steps=3), None), []
    of.values, of.given = {"slip": 0.0, "normal_resultant": 0.0}, {"normal_resultant"}
    of.notes = []

    def run(settings, stride, **mesh):
        asked.append((settings.rtol, settings.primal_rtol, stride, mesh))
        return SimpleNamespace(values=dict.fromkeys(of.values, 1.0 + settings.rtol))

    of.levels = SimpleNamespace(run=run)
    found = of._algebraic({"rtol": 1e-3}, {"rtol": 1e-5, "primal_rtol": 1e-7})
    assert asked == [(1e-3, 1e-5, 2, {"h": 1}), (1e-5, 1e-7, 2, {"h": 1})]
    assert found["slip"].error == pytest.approx(2 * 2 * 2.5 * (1e-3 - 1e-5))
    # forces that loads give do not add up over steps, nor answer to the size of elements
    assert found["normal_resultant"].error == pytest.approx(2 * (1e-3 - 1e-5))
    of.base = {}
    assert of._algebraic({"rtol": 1e-3}, {})["slip"].error == 0.0
    of._settled = lambda stride, settings: None
    assert of._algebraic({}, {})["slip"].error is None


def test_pairs_of_runs_count_up_to_the_first_that_failed():
    assert _whole([(1, 2), (2, 3)]) == [(1, 2), (2, 3)]
    assert _whole([(1, 2), (2, None), (3, 4)]) == [(1, 2)]
