"""What a body between others grows by as it turns, since rotations are linear."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.states import OPEN, SLIP, ContactField
from driver.feti.rigid_modes import RigidMode
from driver.files import read_table
from driver.validity import swelling
from driver.validity.limits import QUESTIONABLE
from driver.vectors import turned_left

PLACES = np.array([[-0.1, -1.0], [0.1, -1.0], [-0.2, 1.0], [0.2, 1.0]])
PRESSED = np.array([[0.0, 1.0], [0.0, 1.0], [0.0, -0.5], [0.0, -1.5]])
RIGID = np.zeros((4, 2))  # what presses there is deformed by


def moved(turn: float, squeeze: float) -> np.ndarray:
    """Displacements of PLACES: a linear rotation, a shift, and the upper ones down by `squeeze`."""
    return turn * turned_left(PLACES) + [0.3, 0.1] - squeeze * (PLACES[:, 1:] > 0) * [0.0, 1.0]


@pytest.mark.parametrize("axes", [np.eye(2), np.array([[0.6, 0.8], [-0.8, 0.6]])])
@pytest.mark.parametrize("turn, squeeze", [(0.05, 0.02), (-0.02, 0.01), (0.0, 0.01)])
def test_growth_over_squeeze(axes, turn, squeeze):
    """A distance of 2 grows by turn^2, whatever the axes; the rest of the squeeze is the body's."""
    found = swelling.share(PLACES @ axes, moved(turn, squeeze) @ axes, PRESSED @ axes, turn, 0.0,
                           RIGID)
    assert found == pytest.approx(turn**2 / squeeze, rel=1e-9)


def test_what_turns_along_grows_as_much():
    """Jaws that turn with what they clamp squeeze it by nothing; nor does what presses from one
    side alone, as a floor that a turning block stands on.
    """
    u = moved(0.05, 0.02)
    assert swelling.share(PLACES, u, PRESSED, 0.05, 0.05, RIGID) == 0.0
    assert swelling.share(PLACES, u, PRESSED, 0.05, 0.03, RIGID) == pytest.approx(
        (0.05**2 - 0.03**2) / 0.02)
    assert swelling.share(PLACES[:2], u[:2], PRESSED[:2], 0.05, 0.0, RIGID[:2]) == 0.0
    faint = PRESSED * [[1], [1], [0.01], [0.01]]
    assert swelling.share(PLACES, u, faint, 0.05, 0.0, RIGID) == 0.0
    assert swelling.share(PLACES, np.zeros((4, 2)), PRESSED, 0.0, 0.0, RIGID) == 0.0


def test_what_temperature_lengthens_a_body_by_squeezes_it():
    """By a hundredth of its length of 2, as much as displacements tell: half the part is left."""
    found = swelling.share(PLACES, moved(0.05, 0.02), PRESSED, 0.05, 0.0, RIGID, 0.01)
    assert found == pytest.approx(0.05**2 / (0.02 + 0.02))


def test_what_presses_is_squeezed_too():
    """Rubber above is squeezed by four times as much as the body: a fifth is left of the part."""
    soft = RIGID.copy()
    soft[2:, 1] = 0.08
    found = swelling.share(PLACES, moved(0.05, 0.02), PRESSED, 0.05, 0.0, soft)
    assert found == pytest.approx(0.05**2 / (0.02 + 0.08))


def test_the_second_body_of_a_pair_is_held_by_it_too():
    """A body of two boundaries, one on an obstacle, the other the second of a pair, whose first one
    has the nodes: displacements and forces are those of the body, as if it had them itself.
    """
    turn, squeeze = 0.05, 0.02
    u = moved(turn, squeeze)
    other = np.array([[0.0, 0.4], [0.1, 0.5]])  # displacements of the upper body at its nodes
    normal = np.array([[0.0, -1.0]] * 4)  # outward of the lower body below, of the upper one above
    jump = other - u[2:]
    b = SimpleNamespace(gid=np.array([0, 1, 4, 5]), label=np.array([1, 1, 7, 7]), xy=PLACES,
                        paired=np.array([False, False, True, True]), normal=normal,
                        weight=np.ones(4))
    state = {ContactField.STATUS: np.full(4, SLIP),
             ContactField.SIGMA_N: -np.abs(PRESSED[:, 1]),
             ContactField.U_N: np.r_[u[:2] @ normal[0], jump @ normal[0]],
             ContactField.U_T: np.r_[0.0, 0.0, jump @ turned_left(normal[0])]}
    field = np.zeros((6, 2))
    field[[0, 1]], field[[4, 5]] = u[:2], other
    body, turns = np.array([0, 0, 0, 0, 1, 1]), np.array([turn, 0.01])
    found = swelling.of_bodies(b, state, field, body, turns, {7: [0]})
    (lower, nodes, more, _), (upper, *_) = found
    # by forces of 0.5 and 1.5 the upper body is deformed by -0.05 and 0.05 beside its mean
    assert lower == pytest.approx(turn**2 / (squeeze + 0.025)) and more == {"turn": turn}
    assert upper == 0.0 and nodes.tolist() == [0, 1, 2, 3]
    state[ContactField.STATUS][2:] = OPEN
    assert [part for part, *_ in swelling.of_bodies(b, state, field, body, turns, {7: [0]})] == [0]


def stacked(held: bool, free: bool, turn: float = 0.05, squeeze: float = 0.02) -> list[float]:
    """Parts of squeeze of a body 0 on an obstacle, under a body 1 that is `free` of supports, and
    is or is not `held` down by another obstacle at its node 6.
    """
    u = moved(turn, squeeze)
    down = np.array([0.0, -1.0])  # outward of body 0 below and of body 1 towards body 0
    normal = np.vstack([[down] * 4, -down])[:4 + held]
    jump = np.zeros((2, 2)) - u[2:]
    b = SimpleNamespace(gid=np.array([0, 1, 4, 5] + [6] * held),
                        label=np.array([1, 1, 7, 7] + [9] * held),
                        xy=np.vstack([PLACES, [0.0, 2.0]])[:4 + held],
                        paired=np.array([False, False, True, True] + [False] * held),
                        normal=normal, weight=np.ones(4 + held))
    state = {ContactField.STATUS: np.full(4 + held, SLIP),
             ContactField.SIGMA_N: np.append(-np.abs(PRESSED[:, 1]), [-1.0] * held),
             ContactField.U_N: np.r_[u[:2] @ down, jump @ down, [0.0] * held],
             ContactField.U_T: np.r_[0.0, 0.0, jump @ turned_left(down), [0.0] * held]}
    field = np.zeros((7, 2))
    field[[0, 1]] = u[:2]
    up = RigidMode(1, np.array([1]), np.zeros(2), np.array([0.0, 1.0]), 0.0)
    modes = {1: [up]} if free else {}
    found = swelling.of_bodies(b, state, field, np.array([0, 0, 0, 0, 1, 1, 1]),
                               np.array([turn, 0.0]), {7: [0]}, modes)
    return [part for part, *_ in found]


@pytest.mark.parametrize("held, free, squeezed", [(False, True, False), (False, False, True),
                                                  (True, True, True)])
def test_what_is_free_to_give_way_squeezes_by_its_loads(held, free, squeezed):
    """A plate that rests on a roller rises as it turns; one that a support or an obstacle above
    keeps down does not.
    """
    assert stacked(held, free)[0] == pytest.approx(0.05**2 / 0.02 if squeezed else 0.0)


# of radius R, its sides below and above in finer edges
DISC = """border low(t=-3*pi/4, -pi/4) { x = R*cos(t); y = R*sin(t); label = 1; }
border right(t=-pi/4, pi/4) { x = R*cos(t); y = R*sin(t); label = 2; }
border high(t=pi/4, 3*pi/4) { x = R*cos(t); y = R*sin(t); label = 3; }
border left(t=3*pi/4, 5*pi/4) { x = R*cos(t); y = R*sin(t); label = 4; }
"""
PLATE = """include "scene.idp"
real R = 5., turn = physical("turn", 0.06);
units("mm", "MPa");
int n = 12;
""" + DISC + """addBody(buildmesh(low(2*n) + right(n/3) + high(2*n) + left(n/3)));
int[int] sides = [11, 12, 13, 14];
addBody(square(24, 4, [-5 + 10*x, R + 3*y], label = sides));
quasistatic(2.);
macro young() 210e3 //
macro poisson() 0.3 //
macro contact() 1 //
macro contactPair() 11, 3 //
macro obstacle(x, y) (y + R) //
macro friction() 0.3 //
macro displacement1() on(12, u1 = 2.*R*turn) //
macro amplitude1(t) max(0., t - 1.) //
macro load2() pressure(13, 20.) //
macro amplitude2(t) min(1., t) //
macro stepTimes() [1.] //
include "export.idp"
"""


def test_a_roller_under_a_plate_with_a_load_is_ok(solved, tmp_path):
    """The load alone makes the force, 20 MPa on 10 mm, whatever the roller grows by."""
    (tmp_path / "plate.edp").write_text(PLATE)
    run = solved(tmp_path / "plate.edp", steps=2)
    assert run.summary["validity"]["largest_swelling"] == 0.0
    assert "turning" not in run.summary["validity"]["reason"]
    assert run.history["contact_y"][-1] == pytest.approx(200.0)


ROLLER = """include "scene.idp"
real R = 5., turn = physical("turn", 0.04);
units("mm", "MPa");
int n = 24;
""" + DISC + """body = buildmesh(low(2*n) + right(n/3) + high(2*n) + left(n/3));
quasistatic(2.);
macro young() 210e3 //
macro poisson() 0.3 //
macro contact() 1, 3 //
macro obstacle(x, y) (label == 1 ? y + R : R - y) //
macro obstacleY(t) (label == 3 ? -0.01*min(1., t) : 0.) //
macro obstacleX(t) (label == 3 ? 2.*R*turn*max(0., t - 1.) : 0.) //
macro friction() 0.3 //
macro stepTimes() [1.] //
include "export.idp"
"""


@pytest.mark.parametrize("turn, verdict", [(0.0, "ok"), (0.02, "questionable"), (0.06, "invalid")])
def test_a_roller_between_plates_is_judged(solved, tmp_path, turn, verdict):
    """Rolling changes no force; the growth of its diameter 2R, R turn^2, adds to the squeeze of
    0.01, and is 0.17 and 0.64 of both. The force should stay, and is too large by a part of it.
    """
    (tmp_path / "roller.edp").write_text(ROLLER)
    run = solved(tmp_path / "roller.edp", steps=4, turn=turn)
    entry, growth = run.summary["validity"], 5.0 * turn**2
    assert entry["verdict"] == verdict
    share = growth / (growth + 0.01)
    # contact is a side long or two: its place, by which sides lengthen, errs by parts of one
    assert entry["largest_swelling"] == pytest.approx(share, rel=0.15, abs=1e-4)
    assert bool(turn) == ("turning" in entry["reason"])
    force = -run.history["resultant_n"]
    before = force[np.argmin(np.abs(run.history["time"] - 1.0))]
    assert (1 - before / force[-1] > share / 2) == bool(turn)


HEATED = """include "scene.idp"
units("mm", "MPa");
border above(t = 0, pi) { x = 3.*cos(t); y = 2.*sin(t); label = 3; }
border under(t = pi, 2*pi) { x = 3.*cos(t); y = 2.*sin(t); label = 1; }
border hole(t = 2*pi, 0) { x = 0.6 + 0.7*cos(t); y = 0.2 + 0.7*sin(t); label = 5; }
body = buildmesh(above(27) + under(27) + hole(13));
macro young() 1000. //
macro poisson() 0.3 //
macro contact() 1, 3 //
macro obstacle(x, y) (label == 1 ? y + 2. : 2. - y) //
macro pointSpring() [3., 0., 1., 1.] //
macro thermal1() (0.004*(1. + 0.1*x)) //
include "export.idp"
"""


@pytest.mark.parametrize("options", [{"element": "P1"}, {"element": "P2", "subdomains": "3",
                                                         "np": "2"}])
def test_what_temperature_presses_grows_by_that(solved, tmp_path, options):
    """An ellipse that touches two plates is squeezed by what it would grow by if it were free,
    0.004 of its height, beside which a turn by 1e-4 is nothing; no place moves along the force.
    """
    (tmp_path / "heated.edp").write_text(HEATED)
    entry = solved(tmp_path / "heated.edp", **options).summary["validity"]
    assert 0 < entry["largest_swelling"] < 1e-4 and entry["verdict"] == "ok"


BELT = """include "scene.idp"
real R = 50., F = 0.3;
units("mm", "MPa");
body = square(52, 2, [(R + y)*cos(pi*(1 - x)), (R + y)*sin(pi*(1 - x))]);
macro young() 20000. //
macro poisson() 0.3 //
macro load1() traction(4, 0., -10.) //
macro displacement2() on(2, u2 = -1.) //
macro contact() 1 //
macro obstacle(x, y) (sqrt(x^2 + y^2) - R) //
macro friction() F //
macro probeLabels() [2] //
include "export.idp"
"""


def test_a_belt_is_not_squeezed_by_its_drum(solved, tmp_path):
    """It goes round by 1/50, which presses it on the drum no more than the forces at its ends do:
    T2 = T1 exp(F pi), which is true on a mesh of 52 chords to some hundredths.
    """
    (tmp_path / "belt.edp").write_text(BELT)
    run = solved(str(tmp_path / "belt.edp"))
    force, = read_table(run.directory / "probes.csv")["force_y"]
    assert -force == pytest.approx(10 * np.exp(0.3 * np.pi), rel=0.05)
    valid = run.summary["validity"]
    assert valid["verdict"] == "ok" and 0.0 < valid["largest_swelling"] < QUESTIONABLE[
        "largest_swelling"]
