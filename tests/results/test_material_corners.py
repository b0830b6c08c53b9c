"""Where materials meet on a contact boundary pressures grow as they do at an end of contact."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import OPEN, SLIP, STICK
from driver.results import quantities as q
from driver.results.material_corners import material_corners
from driver.results.touch import Touch

COUNT = 9


def corners_of(right: float, meets: bool = False) -> np.ndarray:
    """Two triangles on nodes 0, 1, 2 of the boundary, in subdomains of their own, the second one
    of a stiffness `right` times that of the first; node 3 of another body `meets` node 1.
    """
    laws = [np.eye(3)[None], right * np.eye(3)[None]]
    subs = [SimpleNamespace(node_gid=np.array(gids), elements=np.array([[0, 1, 2]]), elasticity=law)
            for gids, law in zip(([0, 1, 4], [1, 2, 4]), laws)]
    gids = np.array([0, 1, 2])
    declared = SimpleNamespace(gid=gids, term_node=gids, term_gid=gids, term_value=np.ones(3))
    if meets:
        declared = SimpleNamespace(gid=gids[:1] + 3, term_node=np.zeros(2, int),
                                   term_gid=np.array([3, 1]), term_value=np.array([1.0, -1.0]))
    structure = SimpleNamespace(subdomains=subs, contact=SimpleNamespace(declared=declared))
    return material_corners(structure, MPI.COMM_SELF)


@pytest.mark.parametrize("right, found", [(1.0, False), (1.4, False), (1.6, True), (1e-3, True)])
def test_materials_meet_where_the_stiffness_jumps(right, found):
    """From one triangle at a node to the next, be they in one subdomain or in two."""
    assert corners_of(right).tolist() == [False, found, False]


def test_materials_of_the_other_body_meet_as_well():
    """Pressure between two bodies is the same on both."""
    assert corners_of(100.0, meets=True).tolist() == [True]


def line(top: int, corner: int, shear: float = 0.3) -> tuple[dict, dict]:
    """A boundary in contact with its largest pressure at node `top`, materials meet at another."""
    x, none = np.arange(float(COUNT)), np.zeros(COUNT, bool)
    pressure = np.where(x == top, 4.0, 1.0)
    nodes = {"arc": x, "xy": np.column_stack([x, 0 * x]), "gap": 0 * x, "chain": 0 * x.astype(int),
             "weight": x >= 0, "middle": none, "mirrored": none, "paired": none,
             "material_corner": x == corner}
    steps = {"sigma_n": -pressure, "sigma_t": shear * pressure, "u_n": 0 * x, "u_t": 0 * x,
             "slip": np.where(x == top, 1.0, 0.0),
             "status": np.full(COUNT, SLIP if shear else STICK)}
    return nodes, {name: column[None] for name, column in steps.items()}


@pytest.mark.parametrize("top, corner, singular", [(4, 4, True), (4, 5, True), (4, 6, False)])
def test_pressures_where_materials_meet_may_be_infinite(top, corner, singular):
    """Next to the corner, as next to an end; not farther away."""
    nodes, steps = line(top, corner)
    assert q.singular_places(nodes, steps, 0) == (("peak_pressure",) if singular else ())


def test_without_friction_and_a_body_that_yields_there_is_no_corner():
    """The mirror image goes on with both materials; nor is there one where nothing touches."""
    nodes, steps = line(4, 4, shear=0.0)
    assert q.singular_places(nodes, steps, 0) == ()
    assert q.singular_places(nodes | {"paired": np.ones(COUNT, bool)}, steps, 0) != ()
    nodes, steps = line(4, 4)
    steps["status"][0, 4] = OPEN
    assert not q.corners_of_materials(nodes, steps, 0).any()


def test_growth_at_corners_of_materials_limits_orders_as_that_at_ends():
    """Their place and pressure are among the ends; slip that is largest there is slip at an end."""
    touch = Touch.of(*line(4, 4), 0, 0)
    assert [4.0, 0.0] in touch.ends[:, :2].tolist() and touch.way_at_end
    other = Touch.of(*line(4, 6), 0, 0)
    assert len(other.ends) == 3 and not other.way_at_end
