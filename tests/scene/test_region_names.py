"""Regions by the names that a gmsh file gives to its surfaces."""

import pytest

from driver.errors import InputError
from driver.scene import freefem

BLOCK = """Point(P1) = {X, 0, 0, h}; Point(P2) = {X + 1, 0, 0, h};
Point(P3) = {X + 1, 1, 0, h}; Point(P4) = {X, 1, 0, h};
Line(P1) = {P1, P2}; Line(P2) = {P2, P3}; Line(P3) = {P3, P4}; Line(P4) = {P4, P1};
Curve Loop(P1) = {P1:P4}; Plane Surface(P1) = {P1};
Physical Curve("foot of SIDE") = {P1}; Physical Curve("SIDE") = {P2};
"""
GEO = ("DefineConstant[ h = {1} ];\n"
       + "".join(BLOCK.replace("P", at).replace("X", x).replace("SIDE", name)
                 .replace(f"{at}hysical", "Physical").replace(f"{at}oint", "Point")
                 .replace(f"{at}lane", "Plane")
                 for at, x, name in (("1", "0", "left"), ("2", "3", "right")))
       + 'Physical Surface("core") = {11}; Physical Surface("case") = {21};\n')
SCENE = """include "scene.idp"
include "gmsh.idp"
mesh all = gmshBody("mine.geo", 0.5);
int core = gmshRegion("core");
addBody(trunc(all, region == core))
addBody(trunc(all, region == gmshRegion("case")))
macro young() (region == core ? 1000. : 2000.) //
macro poisson() 0.3 //
int left = gmshLabel("left"), right = gmshLabel("right");
macro support() on(left, u1 = 0., u2 = 0.) + on(right, u1 = 0., u2 = 0.) //
include "export.idp"
"""


def exported(folder, old="", new=""):
    assert old in SCENE
    (folder / "mine.geo").write_text(GEO)
    scene = folder / "mine.edp"
    scene.write_text(SCENE.replace(old, new))
    return freefem.export(scene, folder / "export", {})


def test_bodies_of_one_file_are_told_apart_by_the_names_of_their_surfaces(tmp_path):
    """gmsh numbers four curves before the surfaces, which are the regions 5 and 6."""
    made = exported(tmp_path)
    assert made.raw["bodies"] == 2 and made.raw["regions"] == [5, 6]
    assert made.label_names == {1: "foot of left", 2: "left", 3: "foot of right", 4: "right"}


@pytest.mark.parametrize("old, new, words", [
    ('gmshRegion("case")', 'gmshRegion("left")',
     'line 6: gmshRegion("left"): no physical surface has this name; names that the files give: '
     "core, case"),
    ('gmshRegion("case")', "2", "trunc needs a region that the mesh has"),
    ('mesh all', 'int early = gmshRegion("core");\nmesh all',
     'line 3: gmshRegion("core") stands before gmshBody, which reads the names'),
    ('include "gmsh.idp"\nmesh all = gmshBody("mine.geo", 0.5);', "mesh all = square(2, 2);",
     "the name 'gmshRegion' is not declared; it needs  include \"gmsh.idp\"")])
def test_what_names_no_region_is_refused(tmp_path, old, new, words):
    with pytest.raises(InputError) as refused:
        exported(tmp_path, old, new)
    assert words in str(refused.value)
