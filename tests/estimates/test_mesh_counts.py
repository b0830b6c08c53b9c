"""How much coarser meshes are than each other."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.estimates.mesh_counts import contact_ratios, elements


def mesh(sides: int, triangles: int = 8):
    """A body of two subdomains with so many sides on contact label 3, one of them in the second."""
    subs = [SimpleNamespace(triangles=range(triangles), edge_label=np.full(sides - 1, 3)),
            SimpleNamespace(triangles=range(triangles), edge_label=np.array([3, 4, 4]))]
    return SimpleNamespace(manifest=SimpleNamespace(contact_labels=[3]),
                           operator=SimpleNamespace(comm=MPI.COMM_SELF),
                           structure=SimpleNamespace(subdomains=subs))


@pytest.mark.parametrize("sides, found", [
    ((40, 20, 10), [2.0, 2.0]), ((24, 18, 16), [24 / 18, 18 / 16]), ((24, 12, 11), [2.0, 12 / 11]),
    ((6, 4, 3), [2.0, 4 / 3]), ((24, 24), [2.0])])
def test_a_scene_may_limit_the_sides_of_its_contact(sides, found):
    """As max(16, ...) does; rounding to three quarters is none, nor are meshes with equal sides."""
    problems = [mesh(count) for count in sides]
    assert contact_ratios(problems, [2.0] * (len(sides) - 1)) == pytest.approx(found)
    assert elements(problems[0]).tolist() == [16, sides[0]]


def test_without_contact_sizes_tell():
    problems = [mesh(9), mesh(5)]
    for problem in problems:
        problem.manifest.contact_labels = []
    assert contact_ratios(problems, [2.0]) == [2.0]
