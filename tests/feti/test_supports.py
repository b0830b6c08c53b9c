"""Fixed dofs of the body from those that its subdomains know of."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.feti.supports import fixed_dofs


def subdomain(nodes, fixed, values):
    """Nodes with their numbers in the body, dofs node by node, values (patterns, fixed)."""
    dof = np.arange(2 * len(nodes))
    return SimpleNamespace(node_gid=np.array(nodes), dof_node=dof // 2, dof_component=dof % 2,
                           fixed=np.array(fixed), fixed_values=np.array(values, float))


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("moved", [2.0, -2.0])
def test_a_vertex_of_support_and_displacement_does_not_depend_on_the_cut(first, moved):
    """Vertex 7 ends a clamped side, which one subdomain has, and a displaced one, which the other
    has: its second component moves whichever is numbered first, as in one subdomain with both.
    """
    clamped = subdomain([3, 7], [0, 1, 2, 3], [[0, 0, 0, 0], [0, 0, 0, 0]])
    displaced = subdomain([9, 7], [1, 3], [[0, 0], [moved, moved]])
    both = [clamped, displaced]
    keys, values = fixed_dofs(SimpleNamespace(patterns=["load", "displacement"]),
                              [both[first], both[1 - first]], MPI.COMM_SELF)
    assert dict(zip(keys.tolist(), values[:, 1])) == {6: 0, 7: 0, 14: 0, 15: moved, 19: moved}
    assert not values[:, 0].any()
