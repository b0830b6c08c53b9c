"""Sides of a mesh's outline without a label where they should have one are said in warnings."""

import subprocess

import numpy as np
import pytest
from mpi4py import MPI

from driver.errors import InputError
from driver.scene import freefem
from driver.scene.loader import read_subdomains

SCENE = """include "scene.idp"
body = readmesh("mine.msh");
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro contact() 1 //
include "export.idp"
"""
SIDES = 8, 4  # squares of two triangles


def written(tmp_path, missing=(), unlabelled=(), label=None) -> str:
    """The scene on a strip without some triangles, and without some edges of its outline; `label`:
    what holes have. The number of a triangle on the lower side is twice that of its side.
    """
    n, m = SIDES
    triangles = []
    for j in range(m):
        for i in range(n):
            a, b, c, d = (j * (n + 1) + i + k for k in (1, 2, n + 3, n + 2))
            triangles += [(a, b, c), (a, c, d)]
    edges = [(i + 1, i + 2, 1) for i in range(n)]
    edges += [((j + 1) * (n + 1), (j + 2) * (n + 1), 2) for j in range(m)]
    edges += [(m * (n + 1) + i + 2, m * (n + 1) + i + 1, 3) for i in range(n)]
    edges += [((j + 1) * (n + 1) + 1, j * (n + 1) + 1, 4) for j in range(m)]
    edges = [edge for k, edge in enumerate(edges) if k not in unlabelled]
    if label is not None:
        edges += [(*side, label) for k in missing for side in zip(
            triangles[k], triangles[k][1:] + triangles[k][:1])]
    triangles = [corners for k, corners in enumerate(triangles) if k not in missing]
    lines = [f"{(n + 1) * (m + 1)} {len(triangles)} {len(edges)}"]
    lines += [f"{i} {j} 0" for j in range(m + 1) for i in range(n + 1)]
    lines += [" ".join(map(str, row)) for row in [(*corners, 0) for corners in triangles] + edges]
    (tmp_path / "mine.msh").write_text("\n".join(lines) + "\n")
    (tmp_path / "mine.edp").write_text(SCENE)
    return tmp_path / "mine.edp"


@pytest.mark.parametrize("missing, unlabelled, words", [
    ((24,), (), ["holes of a few sides without a label (1, the first at ("]),
    ((24, 25, 40), (), ["holes of a few sides without a label (1, the first at ("]),  # one hole
    ((24, 25, 44), (), ["holes of a few sides without a label (2, the first at ("]),
    ((), (3,), ["amid those of a label (1, the first at (3.5, 0) amid those of label 1)"]),
    ((), (3, 14), ["(2, the first at (3.5, 0) amid those of label 1)"]),
    ((6,), (3,), ["(2, the first at (3.5, 0) amid those of label 1)"]),  # a triangle at the rim
    ((42,), (4,), ["holes of a few sides", "amid those of a label"])])
@pytest.mark.some(3)
def test_what_is_missing_is_said(tmp_path, missing, unlabelled, words):
    scene = written(tmp_path, missing, unlabelled)
    notes = freefem.export(scene, tmp_path / "export", {}).notes
    assert len(notes) == len(words) and all(map(str.__contains__, notes, words))


@pytest.mark.parametrize("given", [
    {}, {"unlabelled": range(12, 20)}, {"unlabelled": (3, 4, 5)}, {"unlabelled": (0, 1)},
    {"unlabelled": (7, 8)}, {"missing": (24,), "label": 5}])
@pytest.mark.some(3)
def test_free_boundaries_and_holes_with_a_label_are_not(tmp_path, given):
    assert freefem.export(written(tmp_path, **given), tmp_path / "export", {}).notes == []


def test_notes_are_those_of_the_mesh_that_is_given(tmp_path):
    scene = written(tmp_path, missing=(24,))
    assert freefem.export(scene, tmp_path / "export", {"remesh": "0.5"}).notes


def test_a_mesh_without_any_label_says_so(tmp_path):
    with pytest.raises(InputError, match="labels are 0, as sides have that are given none"):
        freefem.export(written(tmp_path, unlabelled=range(24)), tmp_path / "export", {})


GEO = """Point(1) = {0, 0, 0, 1}; Point(2) = {4, 0, 0, 1}; Point(3) = {4, 4, 0, 1};
Point(4) = {0, 4, 0, 1}; Point(5) = {2, 2, 0, 1}; Point(6) = {3, 2, 0, 0.5};
Point(7) = {1, 2, 0, 0.5};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Circle(5) = {6, 5, 7}; Circle(6) = {7, 5, 6};
Curve Loop(1) = {1:4}; Curve Loop(2) = {5, 6}; Plane Surface(1) = {1, 2};
Physical Surface(1) = {1};
Physical Curve(1) = {1}; Physical Curve(3) = {3}; Physical Curve(4) = {4};
"""


def test_holes_that_gmsh_has_made_just_now_are_meant(tmp_path):
    """A circle of four sides without a label."""
    (tmp_path / "mine.geo").write_text(GEO.replace("0.5}", "2}"))
    scene = tmp_path / "mine.edp"
    scene.write_text(SCENE.replace("readmesh(\"mine.msh\")", "gmshBody(\"mine.geo\", 1.)").replace(
        "body", "include \"gmsh.idp\"\nbody", 1))
    assert freefem.export(scene, tmp_path / "export", {}).notes == []
    gmsh = ["gmsh", "-2", "-v", "0", "-format", "msh2", "mine.geo"]
    subprocess.run(gmsh, cwd=tmp_path, check=True)
    scene.write_text(scene.read_text().replace(".geo", ".msh"))
    assert "holes of a few sides" in freefem.export(scene, tmp_path / "again", {}).notes[0]


@pytest.mark.parametrize("physical", ["", "Physical Curve(2) = {2};"])
@pytest.mark.parametrize("given", [{"subdomains": "3"}, {"remesh": "0.5"}])
def test_sides_that_gmshload_leaves_out_are_free(tmp_path, physical, given):
    """Contact stays on its label: adaptmesh would give sides that are not listed another one.

    They are those of a rim, and without the second curve some of the outer one.
    """
    (tmp_path / "mine.geo").write_text(GEO + physical)
    subprocess.run(["gmsh", "-2", "-v", "0", "-format", "msh2", "mine.geo"], cwd=tmp_path,
                   check=True)
    scene = tmp_path / "mine.edp"
    scene.write_text('load "gmsh"\n' + SCENE.replace("readmesh", "gmshload"))
    manifest = freefem.export(scene, tmp_path / "export", given)
    subdomains = read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)
    assert set(manifest.labels) == {0, 1, 2, 3, 4} - ({2} if not physical else set())
    places = np.concatenate([sub.xy[sub.contact.node] for sub in subdomains if sub.contact])
    assert np.ptp(places[:, 0]) == 4 and not places[:, 1].any()
