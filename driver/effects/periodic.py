"""Periodic boundaries: the second side of each pair moves as the first one (contact/joints.py)."""

from . import ESTIMATE, tie


class Room(tie.Room):
    """Ties across the translation that takes one side to the other."""

    summary = {"periodic": True}
    estimates, why = ESTIMATE, "equilibrated stresses do not extend across periodic boundaries"
    periodic = True
