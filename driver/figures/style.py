"""Look and size of every picture, the place above its axes, and how it is composed and written."""

import re
from collections.abc import Callable
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..files import renamed

INCH = 1 / 2.54  # inches in a centimetre
WIDTH = 16  # centimetres
PAD = 0.06  # inches around the title and the legend
DPI = 200  # of bitmaps

# Okabe and Ito's palette keeps its contrasts for colour-blind readers.
BLUE, ORANGE, GREEN, RED, INK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#222222"
SKY, PURPLE, GREY = "#56B4E9", "#CC79A7", "#777777"
STATUS = {"open": "#C8C8C8", "stick": BLUE, "slip": ORANGE}  # of contact nodes, in every figure

STYLE = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9,
    "legend.fontsize": 8, "xtick.labelsize": 8, "ytick.labelsize": 8,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "lines.linewidth": 1.3, "lines.markersize": 3.2, "axes.formatter.useoffset": False,
    "hatch.linewidth": 0.5, "pdf.fonttype": 42, "figure.constrained_layout.h_pad": 0.05,
}


def status_name(status: str, friction: bool) -> str:
    """A status in a legend; without friction a closed node is in contact only."""
    return "contact" if status != "open" and not friction else status


def literal(text: str) -> str:
    """A name that a scene gives, none of whose signs begins a formula."""
    return text.replace("$", r"\$")


def _bitmap(figure: Figure, path: Path) -> None:
    figure.canvas.print_png(path)  # where savefig would draw twice


def _document(figure: Figure, path: Path) -> None:
    figure.savefig(path, format="pdf", dpi=300, metadata={"CreationDate": None})


KINDS = {"png": _bitmap, "pdf": _document}  # how a figure is written


def canvas(draw: Callable[[Figure], None], height: float, width: float = WIDTH,
           layout: str = "constrained") -> Figure:
    """The figure of `width` by `height` centimetres that `draw(figure)` fills, not yet written."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width * INCH, height * INCH), dpi=DPI, layout=layout)
        FigureCanvasAgg(figure)
        draw(figure)
        lay_out(figure)
        # frozen, so that the bitmap and the PDF are the same picture
        figure.set_layout_engine("none")
    return figure


def lay_out(figure: Figure) -> None:
    """Place the axes as they will be drawn, where the figure leaves it to a layout engine.

    `Figure.draw_without_rendering` does so as well, and then all that drawing needs but the
    colours, which takes half as long again.
    """
    engine = figure.get_layout_engine()
    if figure.axes and engine is not None:
        engine.execute(figure)


def write(figure: Figure, folder: Path, name: str,
          kinds: tuple[str, ...] = tuple(KINDS)) -> list[Path]:
    """Write ``<folder>/<name>.png`` and ``.pdf``, or one of the `kinds`; returns their paths."""
    paths = []
    for kind in kinds:
        path = folder / f"{name}.{kind}"
        with renamed(path) as hidden, matplotlib.rc_context(STYLE):
            KINDS[kind](figure, hidden)
        paths.append(path)
    return paths


def header(figure: Figure, caption: str, identity: str, handles: list,
           handlelength: float = 1.8) -> None:
    """Title, a line on what is shown, and a legend in few rows, stacked above the axes."""
    _written(figure, caption, fontsize=10)
    _written(figure, identity, fontsize=8, color="0.35")
    columns = len(handles)
    while handles:
        figure.legend(handles=handles, loc="upper center", ncols=columns, frameon=False,
                      borderpad=0, handlelength=handlelength, columnspacing=1.4, borderaxespad=0)
        if columns == 1 or _fits(figure.legends[0], figure):
            break
        figure.legends[0].remove()
        columns -= 1
    place_header(figure)


def _written(figure: Figure, text: str, **look) -> None:
    """A text at the top of a figure, in as many lines as its width asks for.

    Formulas and what stands in parentheses stay whole.
    """
    artist = figure.text(0.5, 1, text, ha="center", va="top", multialignment="center", **look)
    if _fits(artist, figure):
        return
    words = re.findall(r"\([^()$]*\)|(?:\\\$|\$[^$]*\$|[^ $])+", text)
    artist.set_text(words[0])
    for word in words[1:]:
        before = artist.get_text()
        artist.set_text(f"{before} {word}")
        if not _fits(artist, figure):
            artist.set_text(f"{before}\n{word}")


def _fits(artist, figure: Figure) -> bool:
    """Whether a text or a legend is no wider than the figure."""
    width = artist.get_window_extent(figure.canvas.get_renderer()).width
    return width <= figure.bbox.width - 2 * PAD * figure.dpi


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
