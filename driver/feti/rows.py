"""Rows of the constraint matrix B (Haslinger, Vlach, Dostal, SNA'07): kinds, and local rows.

* gluing: u_c(a, i) - u_c(a, j) = 0 at every interface node a that is no corner (non-redundant, as
  such a node belongs to exactly two subdomains i < j), for every displacement component c that is
  not fixed;
* normal and tangential contact: n.u and t.u at every contact node, corners included, t being n
  turned by +90 degrees; between two bodies u is the mortar jump of contact/mortar.py;
* joined: either component of such a jump where boundaries are joined for good (contact/joints.py).
"""

from dataclasses import dataclass

import numpy as np


class RowKind:
    """Kinds of a dual row, plain numbers: NumPy drops interrupts while it sees what others are."""

    COUNT = 4
    GLUING, NORMAL, TANGENTIAL, JOINED = range(COUNT)


@dataclass
class LocalRows:
    """Rows that act on one subdomain: row r reads sign_r * sum_k coefficient_rk u[dof_rk].

    The width w is 2, or that of the widest row between bodies; shorter rows end with zeros.
    """

    row: np.ndarray  # (m,) global dual row
    sign: np.ndarray  # (m,) +1/-1 on gluing rows, 1 on contact rows, 0 on another subdomain's own
    dof: np.ndarray  # (m, w)
    coefficient: np.ndarray  # (m, w), zero on fixed dofs
    fixed_part: np.ndarray  # (m, w): what was removed from `coefficient` there
    scaling: np.ndarray  # (m,) entry of B_D: sign times the stiffness weight

    def fixed_share(self, fixed: np.ndarray, values: np.ndarray, dofs: int) -> np.ndarray:
        """(m,) contribution of prescribed displacements to the rows."""
        u = np.zeros(dofs)
        u[fixed] = values
        return (self.fixed_part * u[self.dof]).sum(axis=1)


def contact_row_numbers(contact) -> np.ndarray:
    """(n + m,) dual rows of a ContactBoundary: normal, then tangential ones, by node."""
    numbers = np.concatenate([contact.normal_row, contact.tangential_row])
    return numbers[numbers >= 0]
