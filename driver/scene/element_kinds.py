"""The kinds of elements that a run may be asked for."""

NODES = {"P1": 3, "P2": 6, "P2-mixed": 7}  # of a triangle
# a smooth solution's error in the energy norm falls like h to this power
DEGREE = {"P1": 1, "P2": 2, "P2-mixed": 2}
