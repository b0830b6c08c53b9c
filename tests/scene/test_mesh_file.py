"""What is said of mesh files over which FreeFEM's readmesh stumbles."""

import pytest

from driver.errors import InputError
from driver.scene import freefem, mesh_file

# three by two vertices, four triangles counterclockwise, the outline's edges
VERTICES = ["0 0 0", "1 0 0", "2 0 0", "0 1 0", "1 1 0", "2 1 0"]
TRIANGLES = ["1 2 5 0", "1 5 4 0", "2 3 6 0", "2 6 5 0"]
EDGES = ["1 2 1", "2 3 1", "3 6 2", "6 5 3", "5 4 3", "4 1 4"]


def msh(vertices=(), triangles=(), edges=()) -> str:
    """A mesh as FreeFEM writes it, with lines added to those of the three kinds."""
    parts = [[*VERTICES, *vertices], [*TRIANGLES, *triangles], [*EDGES, *edges]]
    return "\n".join([" ".join(str(len(part)) for part in parts), *sum(parts, [])]) + "\n"


def medit(dimension: str = "2") -> str:
    """The mesh by keywords."""
    parts = {"Vertices": VERTICES, "Edges": EDGES, "Triangles": TRIANGLES}
    lines = ["MeshVersionFormatted 2", "Dimension", dimension]
    for name, part in parts.items():
        lines += [name, str(len(part)), *part]
    return "\n".join([*lines, "End", ""])


FAULTS = [
    (msh(["9 9 0"]), "vertices that no triangle uses (1, the first at (9, 9))"),
    (msh().replace("1 2 5 0", "2 1 5 0"), "run clockwise (1, the first at (0.666667, 0.333333))"),
    (msh(["1 0 0"]).replace("2 3 6 0", "7 3 6 0"), "two vertices (1, the first at (1, 0))"),
    (msh(triangles=["5 1 2 0"]), "a triangle twice, at (0.666667, 0.333333)"),
    (msh(["1.4 -1 0"], ["1 7 2 0", "7 3 2 0", "2 7 6 0"]), "a side of 3 triangles, at (1.5, 0.5)"),
    (msh(edges=["2 1 7"]), "an edge twice, at (0.5, 0), with the labels 1 and 7"),
    (msh(edges=["1 3 7"]), "an edge that is no side of a triangle, at (1, 0)"),
    (msh(["0.6 0.4 0", "3 0 0", "3 1 0"], ["7 8 9 0"]), "triangles that overlap, as at (0.6, 0.4)"),
    (msh(["1 0.5 0"], ["1 7 5 0"]).replace("1 2 5 0", "1 2 7 0"),
     "a vertex on a side that is not its triangles', at (1, 0.5)"),
    (msh().replace("2 1 0", "nan 1 0"), "vertices that are no numbers (1, the first is number 6)"),
    (msh().replace("2 1 0", "two 1 0"), "what is no number among its vertices"),
    (msh().replace("6 5 3", "6 8 3"), "an edge, number 4, of vertices that are not there"),
    (msh().replace("6 4 6", "7 4 6"), "ends before the last of its 7 vertices, 4 triangles and 6"),
    ("", "is empty"), ("$MeshFormat\n4.1 0 8\n", "read it by  gmshBody(")]


@pytest.mark.parametrize("text, words", FAULTS)
def test_what_is_wrong_is_said_with_its_place(tmp_path, text, words):
    path = tmp_path / "mine.msh"
    path.write_text(text)
    assert words in mesh_file.judged(path)


def test_files_of_keywords(tmp_path):
    path = tmp_path / "mine.mesh"
    for text, words in ((medit("3"), "is a mesh in space"),
                        (medit().replace("2 6 5 0", "2 5 6 0"), "run clockwise"),
                        (medit().replace("Triangles\n4", "Triangles\n9"), "its 9 Triangles")):
        path.write_text(text)
        assert words in mesh_file.judged(path)


@pytest.mark.parametrize("name, text", [("good.msh", msh()), ("good.mesh", medit()),
                                        ("good.xyz", "whatever it is")])
def test_nothing_is_said_of_good_files_and_other_kinds(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert mesh_file.judged(tmp_path / name) == ""


def test_only_where_freefem_stumbles(tmp_path):
    scene = tmp_path / "mine.edp"
    scene.write_text('include "scene.idp"\nbody = readmesh("none.msh");\n')
    assert mesh_file.fault("assert", 3, scene, tmp_path) == ""
    assert (mesh_file.fault("", -11, scene, tmp_path)
            == "mine.edp line 2: none.msh is not there: paths are relative to the scene")


def test_a_vertex_without_triangle_is_named_though_freefem_is_killed(tmp_path):
    (tmp_path / "mine.msh").write_text(msh(["9 9 0"]))
    scene = tmp_path / "mine.edp"
    scene.write_text('include "scene.idp"\nbody = readmesh("mine.msh");\nmacro young() 1. //\n'
                     'macro poisson() 0.3 //\nmacro support() on(4, u1 = 0., u2 = 0.) //\n'
                     'macro contact() 1 //\ninclude "export.idp"\n')
    with pytest.raises(InputError, match=r"^mine.edp line 2: mine.msh has vertices that no tri"):
        freefem.export(scene, tmp_path / "export", {})
