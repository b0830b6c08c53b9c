"""Contact linearized about displaced boundaries; gaps, normals and facing parts on curves, from
either side.
"""

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact import mortar
from driver.contact.side import Side, sagitta
from driver.energy_norm.energy import EnergyEstimator
from driver.march.problem import Problem
from driver.options import Settings
from driver.results.contact_state import ContactState
from driver.results.relinearization import linearized

@pytest.mark.slow  # two runs
def test_a_translation_of_one_body_leaves_the_result(solved):
    """The same end from two starts: the pin in the middle of the hole, or where it touches.

    On its way s = 0.5 the wall bends away from the tangents by s^2/2R = 0.0125 at 90 degrees, by a
    tenth of that at the ends of contact; it is pressed in by 0.1. The second linearization leaves
    s^4/8R^3 = 1e-5, a thousandth of that.
    """

    def quantities(**options):
        return np.array([solved("pin", h=1,
                                **options).summary["quantities"][name]
                         for name in ("peak_pressure", "normal_resultant",
                                      "contact_length")])

    apart = {}
    for kind in ("initial", "updated"):
        one, two = (quantities(linearization=kind, lowered=start) for start in (0.0, 0.5))
        apart[kind] = np.abs(one / two - 1)
        exact = two
    assert apart["initial"].max() > 0.01
    assert apart["updated"].max() < 5e-4
    # begins where it ends: little is left to linearize
    first = quantities(linearization="initial", lowered=0.5)
    assert np.abs(first / exact - 1).max() < apart["initial"].max()


@pytest.mark.slow
def test_either_side_may_have_the_contact_nodes(solved):
    """Once both boundaries lie on each other their normals agree, and so do the forces to second
    order in h/R = 0.05.

    In the initial geometry the pin's and the hole's normals are apart by the way of the pin over R,
    5 %."""

    def run(kind, side):
        return solved("pin", linearization=kind, side=side, lowered=0.5, down=1.2)

    force = {(kind, side): run(kind, side).summary["quantities"]["normal_resultant"]
             for kind in ("initial", "updated") for side in (1, 3)}
    assert abs(force["initial", 1] / force["initial", 3] - 1) > 5e-3
    assert abs(force["updated", 1] / force["updated", 3] - 1) < 1e-3


def second(first):
    """The problem linearized about its solution."""
    problem = Problem(first.manifest, first.structure, first.operator)
    return linearized(problem, Settings(linearization="updated"), MPI.COMM_SELF)


def moments(problem, step, moved):
    """Moments about the origin of the forces on both sides, at places displaced by `moved`;
    relative to their size.
    """
    c, sub = problem.structure.contact, problem.structure.subdomains
    gid, first = np.unique(np.concatenate([s.node_gid for s in sub]), return_index=True)
    place = (np.concatenate([s.xy for s in sub])
             + np.concatenate([u.reshape(-1, 2) for u in moved]))[first]
    x = place[np.searchsorted(gid, c.term_gid)]
    f = -(c.term_value * step.multipliers[c.normal_row][c.term_node])[:,
                                                                      None] * c.normal[c.term_node]
    moment = x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]
    return moment.sum() / (np.linalg.norm(x, axis=1)
                           * np.linalg.norm(f, axis=1)).sum(), f.sum(axis=0) / np.abs(f).sum()


def test_forces_balance_where_the_bodies_lie(built, steps_of):
    """Forces along the displaced normals, between places that face each other then, have no moment;
    those along the initial normals, of a pin that goes sideways, one of the part s/R = 0.02. The
    second linearization leaves its square."""
    first = built("pin", h=1, lowered=0.4, down=0.5, aside=0.4)
    problem = second(first)
    found = {}
    for kind, one in (("initial", first), ("updated", problem)):
        _, steps = steps_of(one)
        moved = one.operator.displacements(steps[-1].multipliers, steps[-1].weights)
        found[kind], resultant = moments(one, steps[-1], moved)
        assert np.abs(resultant).max() < 1e-12
    assert abs(found["initial"]) > 5e-3 and abs(found["updated"]) < 0.02**2


@pytest.mark.slow
def test_the_second_problem_holds_at_its_own_configuration(built):
    """At the displacements it is linearized about a node has the room that there is between the
    displaced boundaries.
    """
    first = built("pin", h=1)
    problem = second(first)
    c = problem.structure.contact
    jump = np.zeros((len(c.gid), 2))
    np.add.at(jump, c.term_node,
              c.term_value[:, None] * c.about.u[np.searchsorted(c.about.gid, c.term_gid)])
    room = c.gap - (jump * c.normal).sum(axis=1)
    # the hole's circle about the origin seen from the displaced node along the normal; chords leave
    # h^2/8R
    now = c.xy + c.about.u[np.searchsorted(c.about.gid, c.gid)]
    across = (now * c.normal).sum(axis=1)
    wanted = -across + np.sqrt(across**2 - (now**2).sum(axis=1) + 10.5**2)
    open_ = wanted > 0.2  # elsewhere the hole is deformed
    assert open_.sum() > 20
    np.testing.assert_allclose(room[open_], wanted[open_], atol=2 * 1.3**2 / 8 / 10)
    weight = first.structure.contact.weight
    # stresses refer to the initial lengths
    np.testing.assert_allclose(weight.sum(), c.weight.sum(), rtol=1e-9)


@pytest.mark.slow  # three ranks; those of pairs are in test_scenes_bodies
def test_ranks_do_not_change_a_bit_of_the_second_linearization(solved):
    one, other = (solved("pin", h=1, linearization="updated", np=n) for n in (1, 3))
    for name in ("sigma_n", "u_n", "gap", "normal_x"):
        np.testing.assert_array_equal(one.contact[name], other.contact[name])


def test_without_pairs_there_is_nothing_to_linearize(solved):
    run = solved("model", cells=2, steps=1, linearization="updated")
    assert run.status == 2 and "contactPair" in run.reason


def test_the_error_bound_is_about_the_second_problem(built, steps_of):
    """Normals, facing parts and distances are those of its constraints; in the initial geometry
    normals are apart by 5 %.
    """
    first = built("pin", h=1, lowered=0.4, down=0.5, aside=0.4)
    problem = second(first)
    solver, steps = steps_of(problem)
    contact = ContactState(problem.operator, solver)
    estimator = EnergyEstimator(problem.operator, problem.manifest, contact, "equilibrated")
    fields = problem.operator.displacements(steps[-1].multipliers, steps[-1].weights)
    estimator.consider(steps[-1], contact.evaluate(steps[-1], fields), 1.0)
    ((_, found),) = estimator.estimates()
    assert 0 < found.total < 0.5 * found.norm and found.solver < 0.01 * found.total
    (pair,), c = estimator.bound._pairs(estimator.last[2]), problem.structure.contact
    body = estimator.body
    at = np.searchsorted(pair.first.vertex, np.searchsorted(body.gid, c.gid))
    np.testing.assert_allclose(pair.normal[at], c.normal, atol=1e-9)
    np.testing.assert_allclose(pair.gap[at], c.gap, rtol=1e-12)
    used = np.unique(c.term_gid[c.term_other & np.isin(c.term_node, np.flatnonzero(c.weight > 0))])
    other = pair.second.side.edges[np.unique(pair.parts.other)]
    met = np.unique(body.gid[pair.second.vertex[other]])
    assert np.isin(used, met).all()


# ---- curves --------------------------------------------------------------------------------------

@pytest.mark.slow
def test_gaps_are_those_of_the_smooth_curves(solved):
    """Chords lie h^2/8R = 0.0125 and 0.02 inside pin and hole, here and there, of 0.1 that the pin
    is pressed in: pressures of the polygons alternate between half and twice the right one. What is
    left is the elements' own error."""
    coarse = solved("pin", h=1, linearization="updated")
    fine = solved("pin", h=0.25, linearization="updated")
    for name, most in (("peak_pressure", 0.1), ("normal_resultant", 0.03),
                       ("contact_length", 0.03)):
        assert coarse.summary["quantities"][name] == pytest.approx(fine.summary["quantities"][name],
                                                                   rel=most)
    x, pressure = fine.contact["x"][-1], -fine.contact["sigma_n"][-1]
    # of 4.6; there the pressure is smooth and symmetric
    inside = (np.abs(x) < 3) & (fine.contact["y"][-1] < 0)
    design = np.column_stack([x[inside] ** k for k in (0, 2, 4)])
    fit = design @ np.linalg.lstsq(design, pressure[inside], rcond=None)[0]
    assert np.abs(pressure[inside] - fit).max() < 0.03 * pressure.max()


def test_sagitta_of_curves_and_corners():
    """h^2/8R on circles, whichever side the body is on, and none at corners and beside them."""
    rng = np.random.default_rng(4)
    for outward in (1.0, -1.0):
        side = uneven_arc(2.0, 20, 1.0, rng)
        edges = side.edges if outward > 0 else side.edges[:, ::-1]
        exact = 2.0 - np.sqrt(4.0 - side.length**2 / 4)
        # third order: angles of 0.1
        np.testing.assert_allclose(sagitta(side.xy, edges), outward * exact, rtol=0.02)
    square = np.array([[0.0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]])
    ring = np.column_stack([np.arange(8), np.roll(np.arange(8), -1)])
    assert np.abs(sagitta(square, ring)).max() < 1e-15
    wave = np.column_stack([np.arange(5.0), [0, 1, 0, 1, 0]])
    assert np.abs(sagitta(wave,
                                 np.column_stack([np.arange(4), np.arange(1, 5)]))[1:-1]).max() == 0



def uneven_arc(radius, n, outward, rng):
    """n chords, of lengths up to 1 : 4, of a quarter circle about the origin; the body lies inside
    if `outward` is 1.
    """
    angle = np.linspace(0, np.pi / 2, n + 1)
    angle[1:-1] += rng.uniform(-0.3, 0.3, n - 1) * angle[1]
    middle = (angle[1:] + angle[:-1]) / 2
    edges = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    return Side(radius * np.column_stack([np.cos(angle), np.sin(angle)]), edges,
                       outward * np.column_stack([np.cos(middle), np.sin(middle)]))


def test_normals_are_right_to_second_order_on_uneven_meshes():
    """Here, on a circle, exactly; on an ellipse they err by the square of the length."""
    rng = np.random.default_rng(1)
    side = uneven_arc(2.0, 12, 1.0, rng)
    np.testing.assert_allclose(side.nodal_normals()[1:-1], side.xy[1:-1] / 2, atol=1e-14)
    errors = []
    for n in (16, 64):
        worst = []
        for _ in range(10):
            side = uneven_arc(1.0, n, 1.0, rng)
            xy = side.xy * [2.0, 1.0]
            t = np.diff(xy, axis=0)
            normal = np.column_stack([t[:, 1], -t[:, 0]]) / np.linalg.norm(t, axis=1)[:, None]
            exact = xy / [4.0, 1.0]
            exact /= np.linalg.norm(exact, axis=1)[:, None]
            worst.append(np.abs(Side(xy, side.edges, normal).nodal_normals()
                                - exact)[1:-1].max())
        errors.append(np.mean(worst))
    assert errors[1] < errors[0] / 10  # 16 at order 2, 4 at order 1


def test_gaps_seen_from_either_side_agree_to_second_order():
    rng, errors = np.random.default_rng(2), []
    for n in (16, 64):
        apart = []
        for _ in range(10):
            inner, outer = uneven_arc(1.0, n, 1.0, rng), uneven_arc(1.1, 3 * n // 2, -1.0, rng)

            def free(side):
                return np.zeros(len(side.xy), bool)

            one, two = mortar.couple(inner, outer, free(inner)), mortar.couple(outer, inner,
                                                                               free(outer))
            at = [np.arctan2(*side.xy.T[::-1]) for side in (inner, outer)]
            apart.append(np.abs(np.interp(at[0], at[1], two.gap) - one.gap)[2:-2].max())
        errors.append(np.mean(apart))
    assert errors[1] < errors[0] / 8


def test_a_common_rotation_turns_normals_and_nothing_else():
    rng = np.random.default_rng(3)
    sides = uneven_arc(1.0, 9, 1.0, rng), uneven_arc(1.1, 14, -1.0, rng)
    c, s = np.cos(2.0), np.sin(2.0)
    turn = np.array([[c, s], [-s, c]])  # of rows
    turned = [Side(side.xy @ turn + [7.0, -3.0], side.edges, side.edge_normal @ turn)
              for side in sides]
    one, two = (mortar.couple(*both, np.zeros(10, bool)) for both in (sides, turned))
    np.testing.assert_allclose(two.normal, one.normal @ turn, atol=1e-14)
    for name in ("weight", "gap", "value"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), atol=1e-12)
    assert np.array_equal(two.of, one.of)


def test_a_round_body_faces_what_is_before_it_only():
    """Normals have a focus inside: from there every edge would do, and the wall behind has normals
    that fit as well.
    """
    angle = np.linspace(0, 2 * np.pi, 64)[:-1]
    ring = np.column_stack([np.arange(63), np.roll(np.arange(63), -1)])
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for shift in ([0.3, -0.35], [-0.01, 0.49]):
        sides = []
        for xy, outward in ((10.0 * circle + shift, 1.0), (10.5 * circle[:, ::-1], -1.0)):
            middle = xy[ring].mean(axis=1) - (shift if outward > 0 else 0.0)
            sides.append(Side(xy, ring,
                                     outward * middle / np.linalg.norm(middle, axis=1)[:, None]))
        found = mortar.couple(*sides, np.zeros(63, bool))
        assert found.weight.sum() == pytest.approx(sides[0].length.sum(), rel=1e-6)
        assert np.abs(found.gap).max() < 1.05
