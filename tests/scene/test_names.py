"""Names: FreeFEM has one space of them, which scenes and the library share."""

import re

import pytest

from driver import environment
from driver.errors import InputError
from driver.scene import freefem, grammar, rooms, script

TYPES = ("int|real|bool|string|mesh|varf|matrix|ifstream|ofstream|"
         "Ci|Li|Mi|Qi|Oi|Vi|Nodal|Cellwise|PartSpace|GroupPart|Sizes")
# FreeFEM's own, and what scenes write loads and supports in
TAKEN = {"label", "labels", "region", "area", "lambda", "max", "x", "y",
         "N", "u1", "u2", "v1", "v2"}
HERE = ('include "export.idp"', 'NAME\ninclude "export.idp"')


def library() -> str:
    """Code of the library but for what single scenes include, without comments and strings."""
    return "\n".join(grammar.without_texts(path.read_text())
                     for path in sorted(environment.LIBRARY.rglob("*.idp"))
                     if path.name not in ("two-discs.idp", "model-body.idp"))


def local_names() -> list[str]:
    """Names that the library declares in braces, as arguments of functions, forms and macros."""
    found = set()
    for line in re.sub(r"\bfunc \w+ \w+", "", library()).splitlines():
        for kind in re.finditer(rf"\b(?:{TYPES})\b(?:\[[^\]]*\])?([^;{{}}]*)", line):
            found.update(script.declared_names(kind[1]))
        for arguments in re.findall(r"\b(?:varf|macro) \w+\(([^)]*)\)", line):
            found.update(re.findall(r"[A-Za-z]\w*", arguments))
    return sorted(name for name in found
                  if name[0].isalpha() and not name.startswith("lib")
                  and name not in TAKEN and name not in TYPES.split("|")
                  and name not in rooms.vocabulary() and not script.declared_by_library(name))


# Every macro multiplies its content by ONE.
PLANE = """include "scene.idp"
DECLARATIONS
subdomains("2x2");
rectangle(0., 2., 0., 1.);
quasistatic(2.);
real slipRange = 0.1;
macro young() (x < 1 ? 3e9 : 2e9)*ONE //
macro poisson() 0.3*ONE //
macro support() on(4, u1 = 0.*ONE, u2 = 0.*ONE) //
macro load1() traction(3, x*ONE, -10e7*ONE) //
macro load2() pressure(2, 10e3*y*ONE) //
macro bodyForce2() [x*ONE, y*ONE] //
macro thermal1() 1e-4*x*ONE //
macro pointLoad1() [2., 1., 10.*ONE, 5.*ONE] //
macro displacement2() on(4, u1 = 1e-3*y*ONE) //
macro amplitude1(time) 3*time*ONE //
macro amplitude2(time) time^2*ONE //
macro contact() 1 //
macro gap() 1e-3*x*ONE //
macro friction() 0.3*(1 + x)*ONE //
macro slipFactor(slid) (1 - slid*ONE) //
macro initialX() 1e-4*x*ONE //
macro initialY() 1e-4*y*ONE //
include "export.idp"
"""
BODIES = """include "scene.idp"
DECLARATIONS
subdomains("piece");
addBody(square(4, 2, [2*x, y]))
int[int] lowerLabels = [11, 12, 13, 14];
addBody(square(3, 2, [2*x, y - 1], label = lowerLabels))
macro piece() (x < 1 ? 0 : 1)*ONE //
macro c11() 3e9*(1 + x)*ONE //
macro c12() 1e9*(1 + x)*ONE //
macro c13() 1e8*(1 + x)*ONE //
macro c22() 2e9*(1 + x)*ONE //
macro c23() 1e8*(1 + x)*ONE //
macro c33() 1e9*(1 + x)*ONE //
macro support() on(11, u1 = 0.*ONE, u2 = 0.*ONE) //
macro load1() traction(3, x*ONE, -10e7*ONE) //
macro contact() 12 //
macro contactPair() 1, 13 //
macro curved() 3, 13 //
macro obstacle(atX, atY) (2.1 - atX + 0.1*atY^2)*ONE //
macro pairGap() 1e-3*x*ONE //
macro tresca() 1e5*(1 + y)*ONE //
include "export.idp"
"""
DEFAULT = ("plane-P1", "bodies-P1")
CASES = [pytest.param(scene, element, id=f"{name}-{element}",
                      marks=[pytest.mark.slow] * (f"{name}-{element}" not in DEFAULT))
         for name, scene, elements in (("plane", PLANE, ("P1", "P2", "P2-mixed")),
                                       ("bodies", BODIES, ("P1", "P2")))
         for element in elements]


@pytest.mark.slow
@pytest.mark.parametrize("scene, element", CASES)
@pytest.mark.some(1)
def test_scenes_may_use_every_local_name_of_the_library(tmp_path, scene, element):
    """Numbers 1 with these names, as factors of all that a scene declares, change no bit."""
    names = local_names()
    assert {"a", "b", "k", "p", "s", "t", "n", "first", "size", "count"} <= set(names)
    one = f"({'*'.join(names)})"
    contents = []
    for folder, factor in (("plain", "1."), ("named", one)):
        declarations = "".join(f"real {name} = 1.;\n" for name in names)
        path = tmp_path / f"{folder}.edp"
        path.write_text(scene.replace("DECLARATIONS", declarations if factor == one else "")
                        .replace("ONE", factor))
        manifest = freefem.export(path, tmp_path / folder, {"element": element})
        contents.append(manifest.seal.content)
    assert len(names) > 150 and contents[0] == contents[1]


def test_names_that_users_choose(variant, exported, tmp_path):
    usual = "turn = 1., part = 2., group = 3., mark = 4., points = 5., corner = 6., segment = 7."
    scene = variant("usual-names", (HERE[0], 'int t = 2, k = 3;\nreal p = 0., s = 1., first = 2.;\n'
                                    f"real {usual}, slopeX = 8., steepness = 9.;\n"
                                    'func real history(real t) { return t*s; }\n' + HERE[0]))
    freefem.export(scene, tmp_path, {"cells": "2"})
    plain = exported("model", cells=2)
    for name in ("block-0.bin", "manifest.json"):
        assert (tmp_path / name).read_bytes() == (plain / name).read_bytes()


@pytest.mark.parametrize("line, name", [
    ("real body = 1; int t = 2;", "body"), ("int parts;", "parts"),
    ("real[int] loads(3);", "loads"), ("real gid = 1;", "gid"), ("real nodeX = 1.;", "nodeX"),
    ("int patterns = 1;", "patterns"), ("real steps = 3;", "steps"),
    ("macro gid() 1. //\nreal z = gid;", "gid"), ("macro h() 1. //\nreal z = h;", "h"),
    ("macro rigidX() 1. //", "rigidX"),
    ("func int evaluateAmplitude(int k, real[int] & v) { v = 1.; }", "evaluateAmplitude"),
    ("func real known(real z) { return z; }", "known"),
])
def test_names_of_the_library_are_refused(tmp_path, variant, line, name):
    scene = variant(f"taken-{name}", (HERE[0], HERE[1].replace("NAME", line)))
    number = scene.read_text().splitlines().index(line.splitlines()[0]) + 1
    said = f"line {number}: the name '{name}' is the library's own; choose another"
    with pytest.raises(InputError) as refusal:
        freefem.export(scene, tmp_path, {"cells": "2"})
    assert str(refusal.value) == f"{scene.name} {said}"


def test_a_name_that_the_scene_declares_twice(tmp_path, variant):
    scene = variant("twice", (HERE[0], HERE[1].replace("NAME", "real zz = 1;\nreal zz = 2;")))
    with pytest.raises(InputError, match="twice.edp line .*The identifier zz exists"):
        freefem.export(scene, tmp_path, {"cells": "2"})


def global_names() -> list[str]:
    """Every macro, function and variable of the library, but for what scenes call or declare."""
    code = library()
    found = set(re.findall(r"^\s*macro (\w+)", code, re.MULTILINE))
    for declarators in re.findall(script.DECLARATION, code, re.MULTILINE):
        found.update(script.declared_names(declarators))
    return sorted(name for name in found if not name.startswith("lib")
                  and name not in {*rooms.vocabulary(), *TAKEN, *TYPES.split("|"), "u", "v"})


def test_macros_of_the_library_are_known_before_freefem_runs(tmp_path, monkeypatch):
    """FreeFEM would replace such a variable by the macro, wherever it is put after its definition.
    """
    monkeypatch.setattr(freefem.children, "run_child", None)
    macros = set(re.findall(r"^\s*macro (\w+)", library(), re.MULTILINE)) & set(global_names())
    assert {"nodeX", "muLame", "measured", "rigidX"} <= macros
    path = tmp_path / "mine.edp"
    for name in macros | {"evaluating"}:
        path.write_text(PLANE.replace("DECLARATIONS", f"real {name} = 1.;"))
        with pytest.raises(InputError, match=f"mine.edp line 2: the name '{name}' is the library"):
            freefem.export(path, tmp_path / "export", {})


def test_names_of_freefem_that_declarations_read_are_refused(tmp_path, monkeypatch):
    """`int region = 1;` made a body all of one material: (region == 1 ? ...) is true everywhere."""
    monkeypatch.setattr(freefem.children, "run_child", None)
    path = tmp_path / "mine.edp"
    for name in grammar.BUILT_IN:
        path.write_text(PLANE.replace("DECLARATIONS", f"int {name} = 1;"))
        with pytest.raises(InputError, match=f"mine.edp line 2: the name '{name}' is FreeFEM's"):
            freefem.export(path, tmp_path / "export", {})
    assert {"region", "label", "nuTriangle"} <= grammar.BUILT_IN


@pytest.mark.slow
@pytest.mark.parametrize("scene", [PLANE, BODIES], ids=["plane", "bodies"])
def test_a_name_of_the_library_is_refused_or_changes_no_bit(tmp_path, scene):
    """Global names alone: what the library has in braces is put to the test above."""
    path, contents, refused = tmp_path / "mine.edp", set(), 0
    for name in ["myOwn", *global_names()]:
        path.write_text(scene.replace("DECLARATIONS", f"real {name} = 1.;")
                        .replace("ONE", f"(1. + 0.*{name})"))
        try:
            contents.add(freefem.export(path, tmp_path / name, {}).seal.content)
        except InputError as refusal:
            refused += 1
            assert f"mine.edp line 2: the name '{name}' is" in str(refusal)
    assert len(contents) == 1 and refused > 150


@pytest.mark.parametrize("old, new, words", [
    ("macro gap() 1e-3*x*ONE //", "real gap = 1e-3;\nmacro gap() gap //",
     "line 20: the macro gap contains itself"),
    ("macro young() (x < 1 ? 3e9 : 2e9)*ONE //", "macro E() young //\nmacro young() E //",
     "line 7: the macro E contains itself"),
    ("real slipRange", "real young = 3e9;\nreal slipRange",
     "line 6: 'young' is also a macro, in line 8, which stands for it from there on"),
    ("macro amplitude2(time) time^2*ONE //", "func real amplitude2(real t) { return t; }",
     "nothing reads 'amplitude2': what a scene declares is given by macros: macro amplitude2(t)"),
])
def test_variables_with_the_name_of_a_declaration(tmp_path, old, new, words):
    path = tmp_path / "mine.edp"
    assert old in PLANE
    path.write_text(PLANE.replace(old, new).replace("DECLARATIONS", "").replace("*ONE", ""))
    with pytest.raises(InputError) as refusal:
        freefem.export(path, tmp_path / "export", {})
    assert words in str(refusal.value) and "mine.edp line" in str(refusal.value)


def test_moduli_of_mixed_elements_may_be_of_any_names(tmp_path):
    """Forms of the library have the names p and q for functions, too."""
    contents = []
    for name, young in (("plain", "2."), ("named", "p*q")):
        path = tmp_path / f"{name}.edp"
        path.write_text(f"""include "scene.idp"
subdomains("2x1");
rectangle(0., 2., 0., 1.);
real p = 1., q = 2.;
macro young() {young} //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1.) //
include "export.idp"
""")
        contents.append(freefem.export(path, tmp_path / name, {
            "element": "P2-mixed", "cells": "2"}).seal.content)
    assert contents[0] == contents[1]
