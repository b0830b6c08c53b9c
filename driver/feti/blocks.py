"""Products with block-diagonal matrices of many small dense blocks, one per subdomain.

Blocks that many members share become dense products with many columns. Blocks of their own are
padded with zeros to one of a few shapes and multiplied by one call for each shape: on unstructured
meshes every subdomain has its own block, and a call for each would cost more than its arithmetic.

A member's result must not depend on which other members a rank has, not even in the last bit. BLAS
may round differently for different shapes, so these are fixed: shared blocks are taken BLOCK
members at a time, padded shapes follow from the block alone, and whether a block is shared is the
same on every rank (`LocalClass.shared`).

Symmetric blocks of their own that are large wait for memory in products: they are kept and read by
half.
"""

import numpy as np

from .halves import Half

BLOCK = 4  # members per dense product with a shared block
STEP = 4  # padded sizes are multiples of this
LARGE = 100  # rows from which a call for a half takes less time than a padded product


def by_half(matrix: np.ndarray | Half, shared: bool) -> np.ndarray | Half:
    """A symmetric `matrix` (m, m) as BlockDiagonal keeps it best, `shared` by members or not."""
    stays = shared or len(matrix) < LARGE or isinstance(matrix, Half)
    return matrix if stays else Half(matrix)


def whole(kept: np.ndarray | Half) -> np.ndarray:
    """(m, m) all of a matrix that may be kept by half."""
    return kept.whole() if isinstance(kept, Half) else kept


class BlockDiagonal:
    """y_s = x_s M_s for the members s of all classes; x and y stacked class by class.

    `blocks` are the matrices of the classes as they are kept here.
    """

    def __init__(self, classes: list, matrices: list[np.ndarray | Half], source: str, target: str):
        """`matrices` (m, n) of every class; `source`, `target` name its slices of x and y."""
        self.shared = [(len(c.members), getattr(c, source), getattr(c, target), M)
                       for c, M in zip(classes, matrices) if c.shared and M.size]
        self.halves = [(M, first, place) for c, M in zip(classes, matrices) if isinstance(M, Half)
                       for first, place in _places(c, [len(M)] * 2, source, target)]
        alone, first = {}, {}
        for k, (c, M) in enumerate(zip(classes, matrices)):
            if not (c.shared or isinstance(M, Half)) and M.size:
                padded = tuple(-(-size // STEP) * STEP for size in M.shape)
                members = alone.setdefault(padded, [])
                first[k] = padded, len(members)
                members += [(*at, M) for at in _places(c, M.shape, source, target)]
        kept = {shape: _Padded(shape, members) for shape, members in sorted(alone.items())}
        self.padded, self.blocks = list(kept.values()), list(matrices)
        for k, (shape, place) in first.items():
            rows, columns = matrices[k].shape
            self.blocks[k] = kept[shape].matrices[place, :rows, :columns]

    def put(self, k: int, matrix: np.ndarray) -> None:
        """Replace the block of class k, which is not shared, by one of the same shape."""
        if isinstance(self.blocks[k], Half):
            self.blocks[k].replace(matrix)
        else:
            self.blocks[k][...] = matrix

    def multiply(self, x: np.ndarray, y: np.ndarray, add: bool = False) -> None:
        """Overwrite y, or add to it. Blocks without rows or columns leave y as it is."""
        for k, source, target, M in self.shared:
            rows, out = x[source].reshape(k, -1), y[target].reshape(k, -1)
            if add:
                out += blocked(rows, M)
            else:
                blocked(rows, M, out)
        for batch in self.padded:
            batch.multiply(x, y, add)
        for half, first, target in self.halves:
            if not add:
                y[target : target + len(half)] = 0.0
            half.add_product(x, first, y, target)


def _places(c, shape, source: str, target: str) -> list[tuple[int, int]]:
    """First entries in x and y of every member of a class, in their order."""
    x, y = getattr(c, source).start, getattr(c, target).start
    return [(x + k * shape[0], y + k * shape[1]) for k in range(len(c.members))]


class _Padded:
    """Blocks of their own that share a padded shape."""

    def __init__(self, shape: tuple[int, int], members: list[tuple]):
        self.matrices = np.zeros((len(members), *shape))
        self.take = np.zeros((len(members), 1, shape[0]), np.int64)  # padding: any entry times zero
        picked, places = [], []
        for k, (first, target, M) in enumerate(members):
            m, n = M.shape
            self.matrices[k, :m, :n] = M
            self.take[k, 0, :m] = first + np.arange(m)
            self.take[k, 0, m:] = first
            picked.append(k * shape[1] + np.arange(n))
            places.append(target + np.arange(n))
        self.picked, self.places = np.concatenate(picked), np.concatenate(places)

    def multiply(self, x: np.ndarray, y: np.ndarray, add: bool) -> None:
        """As BlockDiagonal.multiply, for these blocks."""
        values = np.matmul(x[self.take], self.matrices).ravel()[self.picked]
        y[self.places] = y[self.places] + values if add else values


def blocked(rows: np.ndarray, matrix: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """rows @ matrix, (k, m) @ (m, n), in blocks of BLOCK rows, into `out` (k, n) if given."""
    (count, m), n = rows.shape, matrix.shape[1]
    out = np.empty((count, n)) if out is None else out
    whole = count - count % BLOCK
    np.matmul(rows[:whole].reshape(-1, BLOCK, m), matrix, out=out[:whole].reshape(-1, BLOCK, n))
    if whole < count:
        last = np.zeros((BLOCK, m))
        last[: count - whole] = rows[whole:]
        out[whole:] = (last @ matrix)[: count - whole]
    return out
