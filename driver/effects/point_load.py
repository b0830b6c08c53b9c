"""Forces at vertices of the mesh."""

from . import NONE, LoadEffect


class Room(LoadEffect):
    """Patterns given at nodes."""

    estimates, why = NONE, "the energy under a point load is infinite"
