"""VTU files: VTK's XML format for unstructured meshes, with compressed binary arrays.

What the files of a mesh have in common, most of their bytes, is compressed once. Stresses have
digits that no compression finds anything in: such arrays are stored, in the same format.
"""

import base64
import sys
import zlib
from pathlib import Path

import numpy as np

from ..files import renamed

BLOCK = 2**15  # bytes that are compressed at a time
# of its first block, which an array loses by compression at least, else it is stored: digits of
# two components beside a zero would lose a third, and take a quarter of the time of a file for it
GAIN = 0.5
STORED, QUICK, SMALL = 0, 1, 6  # zlib's levels; of digits both leave the same
KINDS = {"f": "Float64", "i": "Int64"}
TYPES = {1: 1, 2: 3, 3: 5, 6: 22}  # VTK's numbers of vertices, lines and triangles by their nodes


def attributes(name: str, values: np.ndarray, components: tuple[str, ...] = ()) -> str:
    """Type, name and components of an array (n,) or (n, k), `components` being their names."""
    names = "".join(f'ComponentName{k}="{word}" ' for k, word in enumerate(components))
    number = f'NumberOfComponents="{values.shape[1]}" ' if values.ndim == 2 else ""
    return f'type="{KINDS[values.dtype.kind]}" Name="{name}" {names}{number}'.rstrip()


def encoded(values: np.ndarray, level: int) -> bytes:
    """An array's bytes: numbers and sizes of its blocks, then these, each part in base64.

    Compressed by zlib's `level`, if at all.
    """
    data = np.ascontiguousarray(values).tobytes()
    blocks = [data[k : k + BLOCK] for k in range(0, len(data), BLOCK)]
    first = blocks[0] if blocks else b""
    if len(zlib.compress(first, level)) > (1 - GAIN) * len(first):
        level = STORED
    packed = [zlib.compress(block, level) for block in blocks]
    last = len(blocks[-1]) if blocks else 0
    header = np.array([len(blocks), BLOCK, last, *map(len, packed)], np.uint32)
    return base64.b64encode(header.tobytes()) + base64.b64encode(b"".join(packed))


def in_space(pairs: np.ndarray) -> np.ndarray:
    """(n, 3) vectors in space from those in the plane (n, 2)."""
    return np.column_stack([pairs, np.zeros(len(pairs))])


class VtuMesh:
    """Files of a mesh of n points and m cells of one kind, in numbers of 8 bytes."""

    def __init__(self, points: np.ndarray, cells: np.ndarray, cell_data: dict[str, np.ndarray],
                 components: dict[str, tuple[str, ...]]):
        """`points` (n, 3), `cells` (m, 1, 2, 3 or 6) in VTK's order, `cell_data` (m,) by name.

        `components` are the names of those of arrays that have some.
        """
        self.components = components
        # without cells: what arrays there are
        self.cell_data = {name: values[:0].copy() for name, values in cell_data.items()}
        count, nodes = cells.shape
        self._head = (
            '<VTKFile type="UnstructuredGrid" version="0.1" '
            f'byte_order="{sys.byteorder.capitalize()}Endian" compressor="vtkZLibDataCompressor">\n'
            f'<UnstructuredGrid>\n<Piece NumberOfPoints="{len(points)}" NumberOfCells="{count}">\n'
        ).encode()
        layout = {"connectivity": cells.ravel(), "offsets": nodes * np.arange(1, count + 1),
                  "types": np.full(count, TYPES[nodes])}
        self._mesh = [b"<Points>\n", *self._arrays({"Points": points}, SMALL),
                      b"</Points>\n<Cells>\n", *self._arrays(layout, SMALL), b"</Cells>\n"]
        self._cells = self._arrays(cell_data, SMALL)

    def write(self, path: Path, points: dict[str, np.ndarray],
              cells: dict[str, np.ndarray]) -> None:
        """A file with data of points and cells, besides the mesh's own; never there in part."""
        parts = [self._head, *self._mesh]
        if points:
            parts += [b"<PointData>\n", *self._arrays(points, QUICK), b"</PointData>\n"]
        parts += [b"<CellData>\n", *self._arrays(cells, QUICK), *self._cells, b"</CellData>\n",
                  b"</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"]
        with renamed(path) as hidden, open(hidden, "wb") as file:
            file.writelines(parts)

    def _arrays(self, data: dict[str, np.ndarray], level: int) -> list[bytes]:
        """The elements of arrays (n,) or (n, k) by name, compressed by zlib's `level`."""
        parts = []
        for name, values in data.items():
            of = attributes(name, values, self.components.get(name, ()))
            values = values.astype(f"{values.dtype.kind}8", copy=False)
            parts += [f'<DataArray {of} format="binary">'.encode(), encoded(values, level),
                      b"</DataArray>\n"]
        return parts
