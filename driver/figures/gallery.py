"""All the figures of a run: which there are, and how they are composed and written."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from .. import processes
from ..files import FIGURES
from .body import contact_window, contact_zoom, deformed
from .contact import contact_normal, contact_status, contact_tangential
from .convergence import adaptivity, convergence, iterated
from .cycles import cycles
from .geometry import geometry
from .history import force_displacement, history, load_histories, loading, loops
from .reading import Run, read_run
from .style import KINDS, canvas, write


def wanted(run: Run) -> dict:
    """The figures that the run has something to show for, in the order in which they are drawn."""
    steps = len(run.history["step"]) if run.history else 0
    touching = run.contact is not None
    moving = run.quasistatic and steps > 1
    choice = {
        geometry: run.boundary is not None and run.first is not None,
        loading: moving and bool(load_histories(run)),
        deformed: run.last is not None,
        contact_zoom: contact_window(run) is not None,
        contact_normal: touching,
        contact_tangential: touching and run.friction,
        contact_status: touching and run.quasistatic and len(np.unique(run.contact["step"])) > 1,
        force_displacement: moving and bool(loops(run)),
        cycles: run.cycles is not None,
        history: touching and moving,
        convergence: run.convergence is not None and iterated(run.convergence),
        adaptivity: (run.adaptivity is not None and run.first is not None
                     and np.isfinite(run.adaptivity["relative"]).all()),
    }
    return {draw.__name__: draw for draw, yes in choice.items() if yes}


def compose(name: str, run: Run) -> Figure:
    """The finished figure `name` of a run, laid out and not yet written."""
    return canvas(lambda figure: wanted(run)[name](figure, run), 12)


def draw_run(directory: Path, kinds: tuple[str, ...] = tuple(KINDS),
             cores: int = processes.CORES) -> list[Path]:
    """Draw all figures of a run directory into its folder ``figures``, on `cores` at once; returns
    the files written.

    PDFs take as long again as bitmaps: a run leaves them out of `kinds`, `redraw` makes them.
    Figures of an earlier run that this one has nothing to show for are removed. Raises InputError
    if the directory holds no run.
    """
    directory = Path(directory)
    run = read_run(directory)
    folder = directory / "figures"
    folder.mkdir(exist_ok=True)
    names = list(wanted(run))
    for name in set(FIGURES) - set(names):
        for kind in ("png", "pdf"):
            (folder / f"{name}.{kind}").unlink(missing_ok=True)
    processes.share(lambda name: write(compose(name, run), folder, name, kinds), names,
                    cores)
    return [folder / f"{name}.{kind}" for name in names for kind in kinds]
