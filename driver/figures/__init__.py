"""Last stage: draw the figures of a run from the files it left, never from the solver.

Every figure is 16 cm wide, written as .png into ``<run>/figures``, as .pdf too where it is drawn
again (`redraw`). A figure for which the scene declares nothing (no contact, no friction, a static
problem) is not drawn. Signs are those of contact.csv: n is the outward normal of the body, t is n
turned by +90 degrees, sigma_n <= 0 is compression.

The pictures of a study, of the hard cases and of the benchmark are drawn by the module of their
name, beside the tables that they left; `redraw` draws either again. Nothing here knows more than
the files say.
"""

from .gallery import compose, draw_run, wanted
from .reading import read_run

__all__ = ["compose", "draw_run", "read_run", "wanted"]
