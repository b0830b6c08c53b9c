"""Labels that two gmsh files name differently, as gmsh numbers names from 1 in every file."""

import pytest

from driver.errors import InputError
from driver.scene import freefem

GEO = """DefineConstant[ h = {2} ];
Point(1) = {XX0, 0, 0, h}; Point(2) = {XX1, 0, 0, h};
Point(3) = {XX1, 1, 0, h}; Point(4) = {XX0, 1, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1:4}; Plane Surface(1) = {1};
Physical Curve("NAME") = {1}; Physical Curve("side") = {2, 4}; Physical Surface("body") = {1};
"""
SCENE = """include "scene.idp"
include "gmsh.idp"
addBody(gmshBody("one.geo", 0.5))
FIRST
addBody(gmshBody("two.geo", 0.5))
SECOND
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro contact() 1 //
include "export.idp"
"""
ASKED = 'int low = gmshLabel("foot");'


def exported(folder, first="", second="", names=("foot", "head")):
    """The manifest of two bodies whose bottoms have the label 1 and these names."""
    for file, name, x in zip(("one", "two"), names, (0, 3)):
        geo = GEO.replace("XX0", str(x)).replace("XX1", str(x + 1)).replace("NAME", name)
        (folder / f"{file}.geo").write_text(geo)
    scene = folder / "mine.edp"
    scene.write_text(SCENE.replace("FIRST", first).replace("SECOND", second))
    return freefem.export(scene, folder / "export", {})


@pytest.mark.parametrize("first, second", [(ASKED, ""), ("", ASKED)])
def test_a_name_of_a_shared_label_is_refused(tmp_path, first, second):
    with pytest.raises(InputError, match=r'gmshLabel\("foot"\): label 1 is called .head. in another'
                                         r'.*Physical Curve\("foot", 101\)'):
        exported(tmp_path, first, second)


def test_a_label_has_all_of_its_names(tmp_path):
    assert exported(tmp_path).label_names == {1: "foot / head", 2: "side"}


def test_the_same_name_in_two_files_is_one(tmp_path):
    made = exported(tmp_path, "", ASKED, ("foot", "foot"))
    assert made.label_names == {1: "foot", 2: "side"}
