"""What a contact node does, and the names of the quantities that are known there in every step."""

import enum


class ContactStatus(enum.IntEnum):
    """What a contact node does at the end of a step; the names in tables are those in lower case.

    Without friction nothing can hold a node that touches: it slips.
    """

    OPEN = 0
    STICK = 1
    SLIP = 2


class ContactField(enum.StrEnum):
    """Quantities of the contact nodes in one step, in the order of contact.csv."""

    U_N = "u_n"
    U_T = "u_t"
    SLIP = "slip"
    SIGMA_N = "sigma_n"
    SIGMA_T = "sigma_t"
    BOUND = "bound"
    STATUS = "status"


STATUS_NAMES = tuple(status.name.lower() for status in ContactStatus)
OPEN, STICK, SLIP = (int(status) for status in ContactStatus)  # plain numbers, see equations.py
