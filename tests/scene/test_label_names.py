"""Names of labels: numbers that a scene gives a name, and borders."""

from types import SimpleNamespace

import pytest

from driver.errors import InputError
from driver.scene import compared, label_names

SCENE = """include "scene.idp"
border low(t=0, 2) { x = t; y = 0.; label = 7; }
border rest(t=0, 3) { x = (t < 1 ? 2 : (t < 2 ? 4 - 2*t : 0));
                      y = (t < 1 ? t : (t < 2 ? 1 : 3 - t)); label = 31 + int(t); }
border hole(t=2*pi, 0) { x = 1 + 0.2*cos(t); y = 0.5 + 0.2*sin(t); }
int wall = 55, side = 31;
int[int] walls = [31, 55];
int moved = 55;
moved = 33;
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(31, u1 = 0., u2 = 0.) //
macro contact() 7 //
macro friction() 0.3 //
body = buildmesh(low(8) + rest(24) + hole(9));
include "export.idp"
"""
MESH = SimpleNamespace(labels=[3, 7, 31, 32, 33], regions=[0, 0], contact_pairs=[])
SUPPORT, FRICTION = "support() on(31, u1 = 0., u2 = 0.)", "friction() 0.3"


@pytest.fixture
def checked(named_scene):
    """checked(old, new): the checks of names of the scene with its text changed."""
    def check(old: str, new: str) -> None:
        assert old in SCENE
        scene = named_scene("mine", SCENE.replace(old, new, 1))
        label_names.check_borders(scene)
        label_names.check_fixed(scene, MESH)
        compared.check(scene, MESH)

    return check


@pytest.mark.parametrize("old, new, words", [
    (SUPPORT, "support() on(low, u1 = 0.)", "line 12: support names the border low"),
    (SUPPORT, SUPPORT + " //\nmacro displacement1() on(rest, u1 = 0.1)",
     "line 13: displacement1 names the border rest"),
    (FRICTION, "friction() (label == low ? 0.3 : 0.)", "line 14: friction names the border low"),
    (FRICTION, "friction() (here ? 0.3 : 0.) //\nmacro here() (label == low)",
     "line 15: here names the border low")])
def test_borders_that_set_labels_do_not_stand_for_them(checked, old, new, words):
    """FreeFEM counts borders: low is 1, whatever its label, and on(1, ...) would hold nothing."""
    with pytest.raises(InputError, match=words):
        checked(old, new)


@pytest.mark.parametrize("old, new, words", [
    (SUPPORT, "support() on(wall, u1 = 0.)", r"line 12: on\(wall, ...\) names label 55"),
    (SUPPORT, "support() on(31, 55, u1 = 0.)", r"on\(55, ...\) names no boundary"),
    (SUPPORT, "support() on(31, u1 = 0.)\n + on(walls, u2 = 0.)", r"line 13: on\(walls, ...\)"),
    (SUPPORT, "support() on(walls[1], u1 = 0.)", r"on\(walls\[1\], ...\) names label 55"),
    (SUPPORT, SUPPORT + " //\nmacro displacement2() on(7, wall, u1 = 1.)", "line 13: .*label 55"),
    (SUPPORT, "support() fixed(55) //\nmacro fixed(l) on(l, u1 = 0., u2 = 0.)",
     r"line 12: fixed\(55\) names no boundary"),
    (SUPPORT, "support() both(31, wall) //\nmacro both(k, l) fixed(k) + fixed(l) //\n"
              "macro fixed(l) on(l, u1 = 0.)", r"line 12: both\(31,wall\) names label 55"),
    (FRICTION, "friction() (label == wall ? 0.3 : 0.)", "friction asks for label 55"),
    (FRICTION, "friction() (wall != label ? 0.3 : 0.)", "friction asks for label 55")])
def test_names_of_labels_that_the_mesh_lacks_are_refused(checked, old, new, words):
    """FreeFEM ignores such a condition: the body would be held less than declared."""
    with pytest.raises(InputError, match=words):
        checked(old, new)


@pytest.mark.parametrize("old, new", [
    (SUPPORT, "support() on(side, walls[0], hole, u1 = 0.)"),
    (SUPPORT, SUPPORT + " //\nborder u1(t=0, 1) { x = t; y = 3.; label = 5; }"),
    (SUPPORT, "support() on(moved, u1 = 0.)"),
    (SUPPORT, "support() fixed(32) //\nmacro fixed(wall) on(wall, u1 = 0., u2 = 0.)"),
    (SUPPORT, SUPPORT + "//\nvarf other(u, v) = on(99, u = 1.);"),
    (FRICTION, "friction() (label == side || label == moved ? 0.3 : 0.)"),
    (FRICTION, "friction() (x > wall ? 0.3 : 0.)")])
def test_names_of_labels_that_there_are_are_not_refused(checked, old, new):
    """Also of borders that keep their place in the order as their label, and of changed numbers."""
    checked(old, new)
