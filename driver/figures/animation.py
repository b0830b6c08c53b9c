"""Deformation, stress and contact status over time as animation.gif (ANIMATE=yes)."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageColor

from ..errors import InputError
from ..files import renamed
from .body import draw_deformed, magnification, obstacles_room, status_nodes
from .reading import Run, field_files, read_mesh, read_run
from .style import STATUS, canvas

NAME = "animation.gif"
DPI = 100
MOST = 60  # frames; of longer histories every k-th step, the last one included
DURATION, PAUSE = 4.0, 1.0  # seconds of the whole, and of the last frame


def draw_animation(directory: Path) -> Path:
    """Write ``<directory>/figures/animation.gif`` and return its path.

    Raises InputError for a run without fields.
    """
    directory = Path(directory)
    files = field_files(directory)
    if not files:
        raise InputError(f"{directory} has no fields to animate: FIELDS=yes writes them")
    run = read_run(directory)
    every = -(-(len(files) - 1) // MOST)
    meshes = [read_mesh(path, time) for time, path in [*files[:0:-every], files[0]][::-1]]
    times = min(magnification(run, mesh) for mesh in meshes[1:])
    top = max(np.percentile(mesh.von_mises, 99.5) for mesh in meshes)
    moved = np.concatenate([mesh.xy + times * mesh.displacement for mesh in meshes])
    box = np.array([moved.min(axis=0), moved.max(axis=0)])
    room = obstacles_room(run, meshes, times, box)
    frames = _alike([_frame(run, mesh, times, float(top), box, room) for mesh in meshes])
    (directory / "figures").mkdir(exist_ok=True)
    path = directory / "figures" / NAME
    each = round(1000 * DURATION / len(frames))
    with renamed(path) as hidden:
        frames[0].save(hidden, format="GIF", save_all=True, append_images=frames[1:], loop=0,
                       duration=[*[each] * (len(frames) - 1), round(1000 * PAUSE)])
    return path


def _frame(run: Run, mesh, times: float, top: float, box: np.ndarray,
           room: np.ndarray | None) -> Image.Image:
    """The picture of one step."""
    figure = canvas(lambda figure: draw_deformed(figure, run, mesh, times, top, box,
                                                 status_nodes, room), 12)
    figure.set_dpi(DPI)
    figure.canvas.draw()
    return Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB")


def _alike(pictures: list[Image.Image]) -> list[Image.Image]:
    """The pictures as frames of one size: what is below the headings stays where it is."""
    width, height = (max(sizes) for sizes in zip(*(picture.size for picture in pictures)))
    frames = []
    for picture in pictures:
        frame = Image.new("RGB", (width, height), "white")
        frame.paste(picture, (0, height - picture.height))
        frames.append(_quantized(frame))
    return frames


def _quantized(picture: Image.Image) -> Image.Image:
    """The RGB picture in 256 colours of its own, those of contact nodes among them.

    Nodes are too few pixels for their colours to have a place in the palette: swatches of the size
    of the picture give them one.
    """
    swatches = Image.new("RGB", (picture.width, picture.height * (1 + len(STATUS))))
    swatches.paste(picture)
    for k, colour in enumerate(STATUS.values(), 1):
        swatches.paste(ImageColor.getrgb(colour),
                       (0, k * picture.height, picture.width, (k + 1) * picture.height))
    return picture.quantize(palette=swatches.quantize(colors=256), dither=Image.Dither.NONE)
