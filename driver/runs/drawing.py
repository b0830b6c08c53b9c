"""The figures of a run, drawn when it is done or while its errors are estimated."""

import contextlib
from pathlib import Path

from .. import processes
from .request import Request

SMALL = 100_000  # nodes of a body up to which there is the memory for both at once


def draw(directory: Path, cores: int = processes.CORES) -> None:
    """The figures, as bitmaps: PDFs take as long again, and `make figures` makes them."""
    from ..figures import draw_run

    draw_run(directory, ("png",), cores)


@contextlib.contextmanager
def drawn_aside(directory: Path, request: Request, nodes: int, ranks: int):
    """Draw on another core while a block estimates errors; gives what waits for the figures and
    says whether they are drawn.

    Nothing is drawn where ranks keep the cores busy, or where figures show more than the run.
    """
    if (not request.figures or request.refined or ranks > 1 or processes.CORES == 1
            or nodes > SMALL):
        yield lambda: False
        return
    with processes.aside(lambda: draw(directory, 1)) as done:
        yield done
