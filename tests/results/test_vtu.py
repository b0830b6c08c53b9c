"""VTU files of a mesh: bytes of arrays, what is compressed and when, and what meshio reads."""

import base64
import zlib

import meshio
import numpy as np
import pytest

from driver.results import vtu
from driver.results.vtu import BLOCK, VtuMesh, attributes, encoded

RNG = np.random.default_rng(3)
DIGITS = RNG.standard_normal((3 * BLOCK // 32 + 7, 4))  # in which no compression finds anything


def decoded(text: bytes, kind=float) -> tuple[np.ndarray, list[int]]:
    """Values and compressed sizes of the blocks, as VTK's format says."""
    blocks = int(np.frombuffer(base64.b64decode(text[:8])[:4], np.uint32)[0])
    length = -(-4 * (3 + blocks) // 3) * 4
    _, size, last, *sizes = np.frombuffer(base64.b64decode(text[:length]), np.uint32).tolist()
    data, parts = base64.b64decode(text[length:]), []
    for k in sizes:
        parts.append(zlib.decompress(data[:k]))
        data = data[k:]
    assert not data and [len(part) for part in parts] == [size] * (blocks - 1) + [last]
    return np.frombuffer(b"".join(parts), kind), sizes


@pytest.mark.parametrize("level", [vtu.QUICK, vtu.SMALL])
def test_arrays_are_compressed_where_that_makes_them_smaller(level):
    """Half of the bytes at least: of a displacement's two components and a zero it is a third."""
    for digits in (DIGITS, np.column_stack([DIGITS[:, :2], 0 * DIGITS[:, 0]])):
        values, sizes = decoded(encoded(digits, level))
        assert np.array_equal(values, digits.ravel()) and len(sizes) > 2
        assert all(0 <= size - BLOCK < 50 for size in sizes[:-1])  # stored, with words about it
    flat = np.column_stack([DIGITS[:, 0], 0 * DIGITS[:, :3]])
    values, sizes = decoded(encoded(flat, level))
    assert np.array_equal(values, flat.ravel()) and max(sizes) < 0.4 * BLOCK
    values, sizes = decoded(encoded(np.arange(10), level), int)
    assert values.tolist() == list(range(10)) and len(sizes) == 1


def test_the_mesh_is_compressed_once_and_every_step_is_read(tmp_path, monkeypatch):
    made, one = [], vtu.encoded
    monkeypatch.setattr(vtu, "encoded",
                        lambda values, level: made.append(level) or one(values, level))
    points, triangles = RNG.standard_normal((6, 3)), np.array([[0, 1, 2], [3, 4, 5], [0, 2, 4]])
    mesh = VtuMesh(points, triangles, {"body": np.array([0, 1, 1])}, {"stress": ("xx", "yy")})
    assert made == [vtu.SMALL] * 5  # points, cells, their offsets and types, bodies
    for step in range(3):
        moved, stress = RNG.standard_normal((6, 3)), RNG.standard_normal((3, 2))
        made.clear()
        mesh.write(tmp_path / "step.vtu", {"displacement": moved} if step else {},
                   {"stress": stress})
        assert made == [vtu.QUICK] * (2 if step else 1)
        data = meshio.read(tmp_path / "step.vtu")
        assert np.array_equal(data.points, points)
        assert np.array_equal(data.cells_dict["triangle"], triangles)
        assert np.array_equal(data.cell_data["stress"][0], stress)
        assert data.cell_data["body"][0].tolist() == [0, 1, 1]
        assert not step or np.array_equal(data.point_data["displacement"], moved)
    assert [path.name for path in tmp_path.iterdir()] == ["step.vtu"]


def test_attributes_say_type_and_components():
    assert attributes("body", np.arange(3)) == 'type="Int64" Name="body"'
    assert attributes("s", np.zeros((2, 2)), ("a", "b")) == (
        'type="Float64" Name="s" ComponentName0="a" ComponentName1="b" NumberOfComponents="2"')
