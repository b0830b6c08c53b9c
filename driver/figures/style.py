"""Look and size of every picture, the place above its axes, and how it is written."""

import os
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

INCH = 1 / 2.54  # inches in a centimetre
WIDTH = 16 * INCH
PAD = 0.06  # inches around the title and the legend

# Okabe and Ito's palette keeps its contrasts for colour-blind readers.
BLUE, ORANGE, GREEN, RED, INK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#222222"

STYLE = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9,
    "legend.fontsize": 8, "xtick.labelsize": 8, "ytick.labelsize": 8,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "lines.linewidth": 1.3, "lines.markersize": 3.2, "axes.formatter.useoffset": False,
    "hatch.linewidth": 0.5, "pdf.fonttype": 42, "figure.constrained_layout.h_pad": 0.05,
}


def place_header(figure: Figure) -> None:
    """Stack title, identity and legend from the top down and leave the rest to the axes."""
    inches = figure.get_figheight()
    top = 1 - PAD / inches
    for artist in (*figure.texts, *figure.legends):
        if artist in figure.legends:
            artist.set_bbox_to_anchor((0.5, top), transform=figure.transFigure)
        else:
            artist.set_position((0.5, top))
        height = artist.get_window_extent(figure.canvas.get_renderer()).height / figure.dpi
        top -= (height + PAD) / inches
    figure.get_layout_engine().set(rect=(0, 0, 1, top))


def write(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write .png and .pdf under temporary names and rename them; returns the final paths."""
    paths = []
    for kind, dpi, metadata in (("png", 150, {}), ("pdf", 300, {"CreationDate": None})):
        path, temporary = folder / f"{name}.{kind}", folder / f".{name}.{kind}.part"
        with matplotlib.rc_context(STYLE):
            figure.savefig(temporary, format=kind, dpi=dpi, metadata=metadata)
        os.replace(temporary, path)
        paths.append(path)
    return paths
