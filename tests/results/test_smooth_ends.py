"""Ends of contact boundaries: corners of the outline, or places where a label ends on a smooth one.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import OPEN, STICK
from driver.results.smooth_ends import smooth_ends
from driver.results.touch import Touch


def ends_of(turn: float) -> np.ndarray:
    """Contact on nodes 1, 2, 3 of a straight row, in two subdomains; before 1 the outline goes on
    straight, after 3 it turns by an angle.
    """
    place = np.array([[0.0, 0], [1, 0], [2, 0], [3, 0],
                      [3 + np.cos(turn), np.sin(turn)]])
    own = ([0, 1, 2], [2, 3, 4])
    subs = [SimpleNamespace(node_gid=np.array(gids), xy=place[gids]) for gids in own]
    outer = np.array([[0, 1, 5], [1, 2, 8], [2, 3, 8], [4, 3, 5], [4, 0, 7]])
    contact = SimpleNamespace(gid=np.array([1, 2, 3]))
    structure = SimpleNamespace(subdomains=subs, outer_edges=outer,
                                contact=SimpleNamespace(declared=contact))
    nodes = {"arc": np.arange(3.0), "xy": place[1:4], "chain": np.zeros(3, int)}
    return smooth_ends(structure, nodes, MPI.COMM_SELF)


@pytest.mark.parametrize("degrees, smooth", [(0, True), (30, True), (-30, True), (36, False),
                                             (90, False), (-120, False)])
def test_a_label_may_end_where_the_outline_goes_on(degrees, smooth):
    """A corner turns by 34 degrees or more, as between the nodes of a boundary."""
    assert ends_of(np.deg2rad(degrees)).tolist() == [True, False, smooth]


@pytest.mark.parametrize("smooth, cornered", [
    ([False] * 5, True), ([True, False, False, False, False], False),
    ([False, False, False, False, True], True)])
def test_force_where_a_label_ends_on_a_smooth_outline_is_at_no_corner(smooth, cornered):
    """On finer meshes it moves along the label: nothing is claimed by halvings of its elements."""
    zero, pressure = np.zeros(5), np.array([1.0, 0, 0, 0, 0])
    nodes = {"arc": np.arange(5.0), "xy": np.column_stack([np.arange(5.0), zero]), "gap": zero,
             "chain": zero.astype(int), "weight": zero + 1, "middle": zero > 0,
             "mirrored": zero > 0, "paired": zero > 0, "smooth_end": np.array(smooth)}
    steps = {"sigma_n": -pressure, "sigma_t": zero, "u_n": zero, "u_t": zero, "slip": zero,
             "status": np.where(pressure > 0, STICK, OPEN)}
    touch = Touch.of(nodes, {name: column[None] for name, column in steps.items()}, 0, 0)
    assert touch.cornered == cornered
