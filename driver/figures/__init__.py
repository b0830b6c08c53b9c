"""Last stage: draw the figures of a run from the files it left, never from the solver.

Every figure is 16 cm wide, written as .png and .pdf into ``<run>/figures``. A figure for which the scene
declares nothing (no contact, no friction, a static problem) is not drawn. Signs are those of contact.csv:
n is the outward normal of the body, t is n turned by +90 degrees, sigma_n <= 0 is compression.
"""

from .gallery import compose, draw_run, wanted
from .reading import Run, contact_boundaries, read_run, read_table, select
from .scales import Scale, scale_for
from .style import BLUE, GREEN, INCH, INK, ORANGE, RED, STYLE, WIDTH, place_header, write

__all__ = ["BLUE", "GREEN", "INCH", "INK", "ORANGE", "RED", "STYLE", "WIDTH", "Run", "Scale", "compose",
           "contact_boundaries", "draw_run", "place_header", "read_run", "read_table", "scale_for", "select", "wanted",
           "write"]
