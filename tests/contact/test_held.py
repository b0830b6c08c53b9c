"""Contact nodes between bodies that a support holds in one direction: what passes them on, and what
is refused.
"""

import re

import numpy as np
import pytest

from driver.contact import held, mortar
from driver.contact.side import Side
from driver.errors import InputError

# a block on a wider one that is pushed up, then sideways; supports of the block by parameters
TWO = """include "scene.idp"
units("mm", "MPa");
subdomains("auto");
border b(t=0, 1) { x = 1. + t; y = 1.; label = 5; }
border r(t=0, 1) { x = 2. + 0.1*t; y = 1. + 0.5*t; label = 2; }
border c(t=0, 1) { x = 2.1 - 1.1*t; y = 1.5; label = 3; }
border l(t=0, 1) { x = 1.; y = 1.5 - 0.5*t; label = 4; }
border b2(t=0, 1) { x = 3.*t; y = 0.; label = 11; }
border r2(t=0, 1) { x = 3. - 0.2*t; y = 1.*t; label = 12; }
border t2(t=0, 1) { x = 2.8 - 2.8*t; y = 1.; label = 16; }
border l2(t=0, 1) { x = 0.; y = 1. - t; label = 14; }
addBody(buildmesh(b(5) + r(3) + c(4) + l(3)))
addBody(buildmesh(b2(9) + r2(4) + t2(11) + l2(4)))
quasistatic(2.);
macro stepTimes() [1.] //
macro young() 1000. //
macro poisson() 0.3 //
macro displacement1() on(11, u1 = 0., u2 = 0.02) + {supports} //
macro displacement2() on(11, u1 = 0.1, u2 = 0.) + {supports} //
macro amplitude1(t) min(1., t) //
macro amplitude2(t) max(0., t - 1.) //
macro contactPair() 5, 16 //
{friction}
macro probeLabels() [3, 4, 5, 16, 11] //
include "export.idp"
"""
RUBS = "macro friction() 0.3 //"
ROLLER, LEVEL = "on(3, u2 = 0.) + on(4, u1 = 0.)", "on(3, u1 = 0., u2 = 0.) + on(4, u2 = 0.)"


def flat(n: int, y: float, up: bool) -> Side:
    """n edges over [0, 1]."""
    x, at = np.linspace(0, 1, n + 1), np.arange(n)
    edges = np.column_stack([at + 1, at] if up else [at, at + 1])
    return Side(np.column_stack([x, 0 * x + y]), edges,
                np.tile([0.0, 1.0 if up else -1.0], (n, 1)))


def lost(fixed: list, frictional=True, n=4, m=3) -> list[int]:
    """Nodes without a row, of n edges on m, for fixed (side, node, component)."""
    first, second = flat(n, 0.0, up=False), flat(m, 0.0, up=True)
    keys = np.sort([2 * (node + (n + 1) * side) + c for side, node, c in fixed])
    gids = np.arange(n + 1), n + 1 + np.arange(m + 1)
    facing = np.ones((n, m), bool)
    found, _ = held.lost_and_guided(first, second, gids, keys, first.nodal_normals(),
                                    np.full(n + 1, frictional), facing, None)
    return np.flatnonzero(found).tolist()


def test_nodes_are_held_along_what_the_other_body_can_follow():
    """By normal or tangent; not on a line of symmetry of both, nor along a smooth boundary."""
    assert lost([(0, 0, 1)]) == lost([(0, 0, 0)]) == [0] == lost([(0, 0, 1)], frictional=False)
    assert lost([(0, 0, 0)], frictional=False) == []
    assert lost([(0, 0, 0), (1, 0, 0)]) == lost([(0, 0, 1), (1, 0, 1)]) == []
    assert lost([(0, 0, 0), (1, 0, 1)]) == [0]
    assert lost([(0, 2, 1), (0, 3, 0), (0, 3, 1)]) == [2, 3]
    # whatever the ratio of the meshes at the common end
    assert lost([(0, 4, 0), (1, 9, 0)], m=9) == lost([(0, 4, 0), (1, 1, 0)], m=1) == []
    assert lost([(0, 0, 0), (1, 0, 0)], n=1, m=1) == []


def test_held_nodes_are_behind_what_their_places_meet():
    """A vertex and the end of a side, met from one or two edges, at a distance of 0.25; an end
    beyond the other side meets nothing.
    """
    first, second = flat(2, 0.0, up=False), flat(4, -0.25, up=True)
    second.xy[:, 0] *= 0.9
    facing, which = np.ones((2, 4), bool), np.array([True, True, False])
    node, of, part, away = held.met_by(first, second, which, facing, None)
    np.testing.assert_allclose(np.bincount(node, part, 3), [1, 1, 0])
    place = np.bincount(node, part * second.xy[of, 0], 3)
    np.testing.assert_allclose(place, [0, 0.5, 0], atol=1e-12)
    np.testing.assert_allclose(away, [0.25, 0.25, np.nan])
    *_, away = held.met_by(first, second, ~which, facing, None)
    np.testing.assert_array_equal(away, [np.nan, np.nan, np.inf])


def test_of_places_only_what_they_meet_counts():
    """Of a quadratic side's ends and middles, by an edge of the other; none beyond its end."""
    first, second = flat(2, 0.0, up=False), flat(4, 0.0, up=True)
    second.xy[:, 0] *= 0.9
    node, of, value, _ = mortar.met_at_nodes(first, second)
    met = {k: np.bincount(of[node == k], value[node == k], 5) / (node == k).sum() * 2
           for k in (0, 1)}
    np.testing.assert_allclose(met[0], [1, 0, 0, 0, 0], atol=1e-12)
    assert met[1] @ second.xy[:, 0] == pytest.approx(0.5) and 2 not in node


def test_an_edge_between_held_nodes_is_refused():
    first, labels = flat(3, 0.0, up=False), np.array([5, 5, 7])
    pairs = [(5, 16), (7, 26)]
    apart = np.array([True, False, True, False])
    held.check_passed_on(first, labels, apart, apart, pairs, False)
    stands = np.ones(4, bool)
    held.check_passed_on(first, labels, ~stands, stands, pairs, False)  # nothing moves there
    for both, advice in ((False, "name 26 first"), (True, "elsewhere than on their contact")):
        with pytest.raises(InputError, match=r"boundary 7 .* \(0.833333, 0\), where 26 can move: "
                           f".*{advice}"):
            held.check_passed_on(first, labels, np.array([False, False, False, True]),
                                 np.array([True, False, True, True]), pairs, both)
    with pytest.raises(InputError, match="boundary 7 .*, where what it meets can move: name what"):
        held.check_passed_on(first, labels, np.array([False, False, False, True]),
                             np.array([True, False, True, True]), [*pairs, (7, 36)], False)


@pytest.mark.parametrize("element", ["P1", pytest.param("P2", marks=pytest.mark.slow)])
@pytest.mark.parametrize("supports", [ROLLER, LEVEL], ids=["roller", "level"])
def test_the_other_body_feels_what_the_tables_report(solved, scene_of, supports, element):
    """Forces of either body add up to nothing, to the balance that FRICTION_RTOL leaves."""
    run = solved(scene_of("two", supports), steps=4, element=element)
    assert run.status == 0, run.reason
    force = {row["probe"]: np.array([row["force_x"], row["force_y"]])
             for row in run.summary["probes"]}
    scale = np.abs(force["label11"]).max()
    assert np.abs(force["label16"] + force["label11"]).max() < 1e-5 * scale
    assert np.abs(force["label5"] + force["label16"]).max() < 1e-5 * scale
    assert np.abs(sum(force[k] for k in ("label3", "label4", "label5"))).max() < 1e-5 * scale
    assert force["label16"][1] < -1 and abs(force["label16"][0]) > 1


@pytest.mark.parametrize("supports, friction", [
    ("on(5, u2 = 0.)", RUBS), ("on(5, u2 = 0.)", ""), ("on(3, u2 = 0.) + on(5, u1 = 0.)", RUBS)])
def test_a_side_that_is_held_as_a_whole_is_refused(solved, scene_of, supports, friction):
    """Else one body would pass through the other, or not feel its friction."""
    run = solved(scene_of("whole", supports, friction), steps=2)
    assert run.status == 2 and "where 16 can move: name 16 first" in run.reason


def test_what_holds_a_smooth_side_along_itself_is_no_matter(solved, scene_of):
    run = solved(scene_of("smooth", "on(3, u2 = 0.) + on(5, u1 = 0.)", ""), steps=2)
    assert run.status == 0 and run.summary["quantities"]["normal_resultant"] > 1


@pytest.fixture(scope="module")
def scene_of(named_scene):
    """scene_of(name, supports, friction): path of TWO."""
    def get(name: str, supports: str, friction: str = RUBS):
        text = TWO.replace("{supports}", supports).replace("{friction}", friction)
        return named_scene(f"{name}-{abs(hash((supports, friction)))}", text)

    return get


@pytest.mark.parametrize("aside, found", [(0.0, [[], [0]]), (1e-3, [[], [0]]), (0.1, [[0], []])])
def test_nodes_on_a_line_of_symmetry_are_guided(aside, found):
    """Displaced normals tilt: the place of such a node lies a little beside the other body's."""
    first, second = flat(4, 0.0, up=False), flat(3, 0.0, up=True)
    first.xy[:, 0] += aside
    gids, keys = (np.arange(5), 5 + np.arange(4)), np.array([0, 10])
    both = held.lost_and_guided(first, second, gids, keys, first.nodal_normals(),
                                np.ones(5, bool), np.ones((4, 3), bool), 1.0)
    assert [np.flatnonzero(of).tolist() for of in both] == found


# half of a rounded punch on a block, held on the line of symmetry of both, or the whole of them
SYMMETRIC = """include "scene.idp"
real mirror = physical("mirror", 0.);
int[int] above = [17, 2, 9, 1], below = [8, 2, 31, 7];
mesh punch = square(5, 4, [x, 0.04*x*x + y], label = above);
mesh block = square(8, 6, [2*x, -1.5 + 1.5*y], label = below);
if (mirror > 0) {
  mesh left = movemesh(punch, [-x, y]);
  punch = punch + left;
  left = movemesh(block, [-x, y]);
  block = block + left;
}
addBody(punch)
addBody(block)
quasistatic(1.);
macro young() (y > 0 ? 1000. : 3000.) //
macro poisson() 0.3 //
macro support() on(8, u1 = 0., u2 = 0.) + on(9, u1 = 0.) + on(1, u1 = 0.) + on(7, u1 = 0.) //
macro displacement1() on(9, u2 = -0.1) //
macro contactPair() 17, 31 //
macro friction() 0.3 //
include "export.idp"
"""
WHOLE = (" + on(1, u1 = 0.) + on(7, u1 = 0.)", "")


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("order", ["17, 31", "31, 17"])
@pytest.mark.parametrize("follows", ["", "macro largeSliding() 1. //\n"])
@pytest.mark.some(2)
def test_a_line_of_symmetry_of_both_bodies_has_no_friction(scene, solved, element, order, follows):
    """Half a model is half of the whole one: the shear of a node on the line is zero.

    It had been the bound of Coulomb's law, by what the node's multiplier does to the next one.
    """
    text = SYMMETRIC.replace("macro contactPair() 17, 31", f"{follows}macro contactPair() {order}")
    half, whole = (solved(scene(text, *more, name=name), ELEMENT=element, STEPS=3,
                          MIRROR=len(more)).contact
                   for name, more in (("half", ()), ("whole", (WHOLE,))))
    one, other = (np.argsort(of["x"][0])[-np.count_nonzero(half["x"][0] >= 0) :]
                  for of in (half, whole))
    assert np.array_equal(half["x"][0, one], whole["x"][0, other])
    assert not half["sigma_t"][:, one[0]].any()
    for name in ("sigma_n", "sigma_t", "u_t", "slip"):
        found, wanted = half[name][:, one], whole[name][:, other]
        # steps end where residuals are 1e-6 of forces and deformations; of a bent boundary the
        # normal on the line is that of one side, and its tractions are turned by some 0.016
        off = 1e-5 if order.startswith("31") and not follows else 0.02
        assert np.abs(found - wanted).max() <= off * np.abs(wanted).max(), name


SLANTED = """include "scene.idp"
int[int] above = [17, 2, 9, 1], below = [8, 2, 31, 7];
mesh one = square(4, 2, [2*x, 0.1*x + y*(1 - 0.1*x)], label = above);
mesh other = square(4, 2, [2*x, -1 + y*(1 + 0.1*x)], label = below);
addBody(one)
addBody(other)
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0.) + on(7, u1 = 0.) + on(8, u2 = 0.) //
macro load1() pressure(2, 5.) + pressure(9, 5.) //
macro contactPair() 17, 31 //
macro friction() 0.4 //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_slanted_boundary_that_meets_a_line_of_symmetry(scene, solved, element):
    """Under the same pressure all over sigma_n is that pressure, and nothing rubs: the normal and
    the tangential row of the node on the line had shared the one displacement that it has.
    """
    found = solved(scene(SLANTED), ELEMENT=element).contact
    assert np.abs(found["sigma_n"] + 5).max() < 1e-6 * 5 and np.abs(found["sigma_t"]).max() < 5e-6


# a stiff pad that is pressed by 0.1 and slides over an end that a support holds, of the first label
OVER = """include "scene.idp"
int[int] below = [8, 2, 31, 7], above = [17, 3, 9, 1];
addBody(square(8, 2, [-2 + 4*x, -1 + y], label = below)) bodyMaterial("block", 1., 0.3);
addBody(square(2, 1, [-1.5 + x, y], label = above)) bodyMaterial("pad", 1e4, 0.3);
quasistatic(1.);
macro support() on(8, u1 = 0., u2 = 0.) + on(7, u1 = 0., u2 = 0.) //
macro displacement1() on(9, u1 = 0., u2 = -0.1) //
macro amplitude1(t) min(1., 4*t) //
macro displacement2() on(9, u1 = -1., u2 = 0.) //
macro amplitude2(t) t //
macro contactPair() 31, 17 //
macro largeSliding() 2. //
include "export.idp"
"""


@pytest.mark.slow
def test_a_held_end_that_is_reached_by_sliding_is_inside(scene, solved):
    """It faces nothing in the first steps: the same places are told of in all of them."""
    run = solved(scene(OVER), STEPS=4)
    assert run.status == 0, run.reason
    said, = (line for line in run.summary["warnings"] if "inside the obstacle or other" in line)
    assert "boundary 31 at (-2, 0)" in said and "name 17 first" in said
    assert re.search("by ([0-9.]+) in step 4", said)[1].startswith("0.1")
