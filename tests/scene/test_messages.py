"""Mistakes in scenes: one line with the line of the user's file, in the user's words.

What the text alone shows is said without FreeFEM. The rest is told by how FreeFEM fails.
"""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from driver.errors import InputError
from driver.scene import (compared, declarations, explain, freefem, grammar, pitfalls, run_time,
                          script, size)
from driver.scene.manifest import announced
from driver.scene.rooms import all_macros

SCENE = """include "scene.idp"
real F = physical("friction", 0.3);
units("mm", "MPa");
subdomains("2x1");
rectangle(0., 2., 0., 1.);
quasistatic(1.);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 2., -10.) //
macro amplitude1(t) t //
macro contact() 1 //
macro friction() F //
include "export.idp"
"""
SMALL = {"cells": "2", "steps": "2"}


@pytest.fixture
def accepted(named_scene):
    """accepted(text): the scene passes with this in place of its friction."""
    def check(text: str) -> None:
        pitfalls.check(named_scene("mine", SCENE.replace("macro friction() F //", text)), {})

    return check


@pytest.fixture
def said(tmp_path):
    """said((old, new), ...): the message for the scene with its text changed."""
    def check(*changes, parameters=None) -> str:
        text = SCENE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "mine.edp"
        path.write_text(text)
        with pytest.raises(InputError) as refusal:
            freefem.export(path, tmp_path / "export", SMALL if parameters is None else parameters)
        message = str(refusal.value)
        assert "\n" not in message and str(tmp_path) not in message
        return message

    return check


def place(message: str) -> int:
    """The line that a message names, of the user's file."""
    return int(re.search(r"mine.edp line (\d+)", message)[1])


def line_of(text: str) -> int:
    """The line of the scene with some text."""
    return next(number for number, line in enumerate(SCENE.splitlines(), 1) if text in line)


# ---- what the text shows -------------------------------------------------------------------------

@pytest.fixture
def without_freefem(monkeypatch):
    """Nothing is started."""
    monkeypatch.setattr(freefem.children, "run_child", None)


NAMED = ["young", "poisson", "support", "load1", "amplitude1", "contact", "friction"]


@pytest.mark.usefixtures("without_freefem")
@pytest.mark.parametrize("name", NAMED)
def test_a_macro_that_does_not_end(said, name):
    line = SCENE.splitlines()[line_of(f"macro {name}") - 1]
    message = said((line, line.removesuffix("//")))
    assert name in message and "//" in message and place(message) == line_of(f"macro {name}")


@pytest.mark.usefixtures("without_freefem")
@pytest.mark.parametrize("old, new, words", [
    ("-10.) //", "-10. //", "load1"), ("u2 = 0.) //", "u2 = 0.)) //", "support"),
    ("amplitude1(t) t", "amplitude1() 1.", "amplitude1(t)"),
    ("amplitude1(t) t", "amplitude1(t, s) t", "amplitude1(t)"),
    ("amplitude1(t) t", "amplitude1 t", "amplitude1(t)"),
    ("young() 1000.", "young(x) x", "young()"), ("contact() 1", "contact() ", "label"),
    ("rectangle(0., 2., 0., 1.);", "addBody(rectangle(0., 2., 0., 1.))", "addBody(square"),
    ("rectangle(0., 2., 0., 1.);", "body = rectangle(0., 2., 0., 1.);", "square"),
    ('physical("friction"', 'physical("out"', "out"),
    ('physical("friction"', 'physical("rtol"', "rtol"),
    ('physical("friction"', 'physical("steps"', "steps"),
    ('physical("friction"', 'physical("my friction"', "my friction"),
    ("real F", "real x = 1.; real F", "'x'"), ("real F", "real area = 1.; real F", "'area'"),
    ("real F", "int[int] traction(3); real F", "'traction'"),
    ('units("mm"', 'units("µm"', "µ"), ("MPa", "MPä", "ä"),
    ('include "export.idp"', 'include "export.idp"\ninclude "export.idp"', "second time"),
    ('include "export.idp"', 'include "export.idp"\nmacro gap() 0.1 //', "macro gap stands after"),
    ("rectangle(0., 2., 0., 1.);", "rectangle(0., (2., 0., 1.);", "'(' is not closed"),
    ("rectangle(0., 2., 0., 1.);", "rectangle(0., 2., 0., 1.]);", "a ']' too many, or the wrong"),
    ("quasistatic(1.);", "for (int i = 0; i < 2; ++i) { quasistatic(1.);", "'{' is not closed"),
    ("on(4, u1 = 0., u2 = 0.)", "on(4)", "on(4) holds no displacement"),
    ("macro contact", "/* macro contact", "not closed by */"),
    ("friction() F", "friction() (x > 1. and y < 1. ? F : 0.)", "it writes &&"),
    ("amplitude1(t) t", "amplitude1(t) (t < 1. ? t : t < 2. ? 1. : 0.)", "one ? : in"),
    ("amplitude1(t) t", "amplitude1(t) (t < 1. ? t < 0.5 ? 0. : 1. : 2.)", "in parentheses, as"),
    ("traction(3, 2., -10.) //", "traction(3, 2., 0.) // first\n  + traction(3, 0., -10.) //",
     "load1 ends with // in its line, and the next one begins with +"),
    # of what does not begin its line no text would be seen
    ("macro load1() ", "real one = 1.; macro load1() ", "the macro load1 must begin its line"),
    ("macro load1() ", "NewMacro load1() ", "not by NewMacro"),
    ('include "export.idp"', 'real one = 1.; include "export.idp"', "include must begin its line"),
    ("macro contact() 1 //", "macro contact() 1 // macro gap() 0.1 //",
     "gap stands in a comment, behind the // that ends the macro contact"),
    ("friction() F", "friction() F*(1. + z)", "z in friction is FreeFEM's third coordinate"),
    ("2., -10.", "2.*x**2, -10.", "powers are x^2"), ("0.3 //", "3/10 //", "is 0: write 3./10"),
    ("amplitude1(t) t", "amplitude1(t) t^(1/2)", "is 0: write 1./2"),
    ("u1 = 0., u2", "u1 = 0,5, u2", "support has 5 behind what on(...) prescribes"),
    ("macro contact() 1", "macro stepTimes() [ ] //\nmacro contact() 1",
     "the list of stepTimes is empty: it expects [t1, t2, ...]"),
])
def test_what_the_text_shows(said, old, new, words):
    message = said((old, new))
    extra = new.startswith("include") and new.count("\n")  # the second one is too many
    assert words in message and place(message) == line_of(old) + extra


def test_quotients_that_are_meant():
    """Whole ones, those of reals, and the sizes of arrays that are declared as whole numbers."""
    for code in ("10/2", "2.*1/3", "1./3", "x/3", "(x + 1)/2", "x^1/2", "int n = 7/2;", "pi/2"):
        assert not script._statement_fault(code), code


def test_semicolons_that_end_no_statement(tmp_path):
    """Loops have them between brackets, and borders of several pieces, one of FreeFEM's own ways
    to draw a polygon; statements do not.
    """
    path = tmp_path / "mine.edp"
    for code in ("for (int i = 0; i < 4; ++i) corners[i] = 1;",
                 "border side(t = 0, 1; i) { x = t; y = i; label = i + 1; }",
                 "border  side (t=0, 1; i) {x = (1 - t); y = 0;}",
                 "border side(t = 0, pi; i) { x = cos(t); y = i; }",
                 "border side(t = 0, max(1., 2.)*F; i) { x = t; y = i; }",
                 "border side\n(t = 0, 1;\n i) { x = t; y = i; }",
                 "for\n  (int i = 0; i < 4; ++i) corners[i] = 1;",
                 'string s = "a ( \\\n b [";'):
        path.write_text(SCENE.replace("quasistatic", f"{code}\nquasistatic"))
        grammar.check(path)
        script.check_names(path)
    for code in ("real a = (1.;", "border side(t = 0, 1 { x = t; y = 0; }"):
        path.write_text(f"{SCENE}\n{code}\n")
        with pytest.raises(InputError, match=rf"line {SCENE.count(chr(10)) + 2}: a '\(' is not"):
            grammar.check(path)


def test_strings_and_comments_are_no_code(tmp_path):
    """Whatever they contain: brackets, each other's marks, marks of block comments."""
    path = tmp_path / "mine.edp"
    text = [r'string s = "a(b; \" [ // {";', 'cout << "see http://there" << F << endl;',
            "//**** a title ****/ of one line (", "//************", 'real a = physical("a", 1.);',
            "//***********/", "/* a bracket", "   of two lines ( ; */ real b = 2.;"]
    path.write_text(SCENE.replace("quasistatic", "\n".join([*text, "quasistatic"])))
    grammar.check(path)
    script.check_names(path)
    script.check_statements(path)
    assert grammar.parameters(path).keys() == {"friction", "a"}
    names = [name for _, name in grammar.declared(grammar.sources(path)[0])]
    assert names == ["F", "s", "a", "b"]


def test_choices_that_brackets_keep_apart():
    """One in each expression, of which a line may have several."""
    for code in ("(t < 1. ? t : (t < 2. ? 1. : 2.))", "max((t < 1. ? 1. : 2.), (t > 1. ? 3. : 4.))",
                 "real a = t < 1. ? 1. : 2., b = 3.; real c = a > b ? a : b;",
                 "[t < 1. ? 0. : 1., t > 1. ? 0. : 1.]",
                 'macro stiff() (a == "b" ? 1.*((x - 1.) < 2.) : (a == "c" ? 1.*(y < 0.3)',
                 ": abs(x) > 1. ? 1. : 2.))", "(t < 1. ? 0. : 1.) + (t > 1. ? 0. : 1.)"):
        assert not script._statement_fault(code), code


def test_units_that_can_be_none(tmp_path):
    """Numbers and exchanged names are refused with the line; odd names that could be meant not."""
    path = tmp_path / "mine.edp"
    path.write_text(SCENE)
    for length, stress, words in (("mm", "3", '"3" is a number'), ("1e3", "Pa", "is a number"),
                                  ("MPa", "mm", '"MPa" is no unit of length'),
                                  ("m", "mm", '"mm" is no unit of stress'),
                                  ("mm", "kN", '"kN" is no unit of stress')):
        with pytest.raises(InputError, match=words) as refusal:
            script.check_units(path, SimpleNamespace(units={"length": length, "stress": stress}))
        assert place(str(refusal.value)) == line_of("units")
    (tmp_path / "units.idp").write_text('units("3", "Pa");\n')  # the file that is to be changed
    path.write_text('include "units.idp"\n')
    with pytest.raises(InputError, match=r"^units\.idp line 1: units: "):
        script.check_units(path, SimpleNamespace(units={"length": "3", "stress": "Pa"}))
    for length, stress in (("1", "1"), ("-", "-"), ("a", "E"), ("in", "psi"), ("mm", "N/mm^2")):
        script.check_units(path, SimpleNamespace(units={"length": length, "stress": stress,
                                                        "forces": "all"}))


@pytest.mark.usefixtures("without_freefem")
@pytest.mark.parametrize("content, words", [
    (b"", "empty"), (b"// nothing\n/* real a;\n*/\n", "empty"), (bytes(range(256)), "text"),
    (b"\xef\xbb\xbf" + SCENE.encode(), "byte order mark"), (SCENE.encode("utf-16"), "text"),
    (SCENE.replace('include "scene.idp"', "").encode(), "scene.idp")])
def test_files_that_are_no_scene(tmp_path, content, words):
    path = tmp_path / "mine.edp"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        freefem.export(path, tmp_path / "export", {})
    assert not (tmp_path / "export").exists()


@pytest.mark.usefixtures("without_freefem")
@pytest.mark.parametrize("second", ["first.idp", "second.idp"])
def test_files_that_include_each_other(tmp_path, second):
    """Or one itself: FreeFEM reads them until it has no more files."""
    path = tmp_path / "mine.edp"
    path.write_text(SCENE.replace('include "scene.idp"',
                                  'include "scene.idp"\ninclude "first.idp"'))
    (tmp_path / "first.idp").write_text('include "second.idp"\n')
    (tmp_path / "second.idp").write_text(f'real k = 1.;\ninclude "{second}"\n')
    with pytest.raises(InputError, match=f'^second.idp line 2: include "{second}" leads back'):
        freefem.export(path, tmp_path / "export", {})
    # one that two files include, with itself in a comment
    (tmp_path / "second.idp").write_text('real k = 1.;\n/*\ninclude "second.idp"\n*/\n')
    path.write_text(path.read_text() + 'include "second.idp"\n')
    grammar.sources(path)
    assert script._code(path).count("real k = 1.;") == 2


def test_every_shipped_scene_passes():
    for path in (*freefem.SCENES.glob("*.edp"), *freefem.SCENES.glob("hard/*.edp")):
        grammar.check(path)


def test_what_is_no_mistake(tmp_path):
    """Comments in any encoding, macros over several lines, code that is commented out."""
    path = tmp_path / "mine.edp"
    text = SCENE.replace("2., -10.", "2.,\n    -10.").replace(
        "real F", "/* macro load1() traction(3,\n*/\nfunc real g(real x, real N) { real y = x; "
        "return y; }\nreal F")
    path.write_bytes("// Körper\n".encode("latin1") + text.replace("\n", "\r\n").encode())
    freefem.export(path, tmp_path / "export", SMALL)


def test_parameters_may_have_capitals(tmp_path):
    path = tmp_path / "mine.edp"
    path.write_text(SCENE.replace('physical("friction"', 'physical("E_Modul"'))
    manifest = freefem.export(path, tmp_path / "export", {**SMALL, "e_modul": "0.7"})
    assert manifest.parameters["E_Modul"] == 0.7


def test_names_of_freefem_are_what_the_library_has_undeclared():
    """Every name of a value or function that the library reads and nowhere declares is known."""
    code = "\n".join(grammar.without_texts(path.read_text())
                     for path in freefem.environment.LIBRARY.rglob("*.idp"))
    for name in ("x", "y", "N", "area", "hTriangle", "lenEdge", "nTonEdge", "pi", "P1dc1", "P2dc",
                 "label", "region", "nuTriangle"):
        assert re.search(rf"\b{name}\b", code) and name in grammar.BUILT_IN


# ---- what FreeFEM trips over ---------------------------------------------------------------------

@pytest.mark.parametrize("old, new, words", [
    ("traction(3, 2., -10.)", "100.", "load1"),  # the wrong kind
    ("contact() 1", 'contact() "bottom"', "contact"),
    ("traction(3, 2., -10.)", "traction(3, -10.)", "traction(label, px, py)"),
    ("traction(3, 2., -10.)", "pressure([2, 3], 10.)", "as in pressure(2, ...) + pressure(3, ...)"),
    ("traction(3, 2., -10.)", "tracton(3, 2., -10.)", "did you mean traction"),
    ("traction(3, 2., -10.)", "bodyForce([0., -2.])", "did you mean bodyForce1"),
    ("traction(3, 2., -10.)", "traction(3, 2., q)", "'q'"),
    ("friction() F", "friction() F;", "before token ;: the content of a macro ends at its //"),
    ('subdomains("2x1")', 'subdomains("two")', "subdomains expects NxM"),
    ("macro load1", "macro load10", "load10: its number is one from 1 to 9"),
    ("traction(3, 2., -10.)", "int1d(Ti, 3)(u1*v1)", "and springs by macro foundation() label //"),
    ('physical("friction"', "physical(friction", "a name that belongs in quotes"),
    ("quasistatic(1.);", "quasistatic(1.); quasistatic(2.);", "is called twice"),
    ("rectangle(0., 2., 0., 1.);", "body = square(2, 2); rotate(30.);", "turn meshes by movemesh"),
    ("friction() F //", "friction() F // \nmacro probeLabels() 3, 4 //",
     "expects brackets around its numbers: macro probeLabels() [3, 4] //"),
    ("friction() F //", "friction() F // \nmacro probeLabels() F //",  # so many zeros
     "expects brackets around its numbers: macro probeLabels() [F] //"),
    ("rectangle(0., 2., 0., 1.);", "int[int] up = [1, 2, 3]; body = square(2, 2, label = up);",
     "up has 3 labels, but a square has four sides"),
    ("u1 = 0., u2", "ux = 0., u2", "displacements are u1, u2, along x, y or r, z"),
    ("amplitude1(t) t", "amplitude1(s) t", "argument of an amplitude"),
    ("quasistatic(1.)", "quasistatic()", "arguments of a wrong number or kind: quasistatic(T)"),
    ("quasistatic(1.)", 'int n = whole("sides", 6)', 'kind: whole("name", default, least)'),
    ('units("mm", "MPa");', 'units("mm");', 'units("m", "Pa")  the scene'),
    ("rectangle(0., 2., 0., 1.)", "rectangle(2., 1.)", "rectangle(x0, x1, y0, y1)"),
    ("rectangle(0., 2., 0., 1.);", "rectangle(0., 2., 0., 1.); addBody(square(3, 3))",
     "give each body by addBody(mesh)"),
    # numbers that are none
    ("-10.)", "1./0.)", "load1"), ("-10.)", "1e400)", "load1"), ("-10.)", "sqrt(-x - 1))", "load1"),
    ("amplitude1(t) t", "amplitude1(t) sqrt(t - 0.5)", "amplitude1"),
    ("amplitude1(t) t", "amplitude1(t) 1./(t - 0.5)", "amplitude1"),
    ("amplitude1(t) t", "amplitude1(t) (t > 0.76 && t < 0.99 ? 1e400 : t)",
     "amplitude1 is no finite number at the time 0.7"),  # between steps
    ("young() 1000.", "young() 0./0.", "young"), ("young() 1000.", "young() 1e400", "young"),
    ("poisson() 0.3", "poisson() 0.5", "region 0: of a material that keeps its volume take 0.4999"),
    ("poisson() 0.3", "poisson() 0.51", "poisson = 0.51 is not between -1 and 0.5 in region 0"),
    ("friction() F", "friction() F*t", "'t'"),  # not where it is an argument
    ("friction() F", "friction() sqrt(x - 1)", "friction"), ("() F", "() 1e400", "friction"),
    # what has no meaning together
    ("macro friction() F //", "macro friction() F // \nmacro pairGap() 0.1 //", "contactPair"),
    ("macro friction() F //", "macro friction() F // \nmacro amplitude3(t) t //", "amplitude3"),
    ("u2 = 0.) //", "u2 = 0.1) //", "displacement1"), ("traction(3,", "traction(33,", "33"),
    ("contact() 1", "contact() 11", "11"),
    ("macro poisson() 0.3 //", "macro c11() 1. // \nmacro poisson() 0.3 //", "young and c11"),
    ("rectangle(0., 2., 0., 1.);", "rectangle(0., 2., 0., 1.); rectangle(0., 1., 0., 1.);",
     "twice"),
    ("rectangle(0., 2., 0., 1.);", "rectangle(0., 1e400, 0., 1.);", "finite"),
    ("u2 = 0.) //", "u2 = 0.) on(2, u1 = 0.) //", "terms are added: on(...) + on(...)"),
    ("traction(3, 2., -10.)", 'pressure(3, "10")', "load1 is given a text in quotes"),
    ("quasistatic(1.);", "quasistatic(int1d(body, 3)(1.));", "a mesh that has not been made"),
    ("friction() F //", "largeSliding() yes //", "largeSliding cannot be  yes: it expects largest"),
])
@pytest.mark.some(2)
def test_what_freefem_trips_over(said, old, new, words):
    message = said((old, new))
    assert words in message
    assert place(message) == line_of(old) + any(
        f"// \nmacro {name}" in new for name in ("a", "pairG", "probeL"))


def test_what_fails_behind_the_last_body_is_not_the_bodys(said):
    """It is in a line further on; within the body it is in one of the library's."""
    bodies = ("rectangle(0., 2., 0., 1.);", "addBody(square(2, 2, [x, {y}]))")
    behind = said((bodies[0], bodies[1].replace("{y}", "y")),
                  ("macro friction", "assert(1 == 2);\nmacro friction"))
    assert "FreeFEM failed in mine.edp" in behind and place(behind) == line_of("macro friction")
    assert "an assert that does not hold" in behind
    within = said((bodies[0], bodies[1].replace("{y}", "y/(x - x)")))
    assert "this body cannot be made" in within and place(within) == line_of("rectangle")


def test_a_label_that_freefem_takes_for_none_is_refused(said):
    body = "int[int] sides = [1, -1, 3, 4]; body = square(2, 2, label = sides);"
    assert "has the label -1, by which FreeFEM itself means" in said(
        ("rectangle(0., 2., 0., 1.);", body))


def test_a_law_of_slip_needs_a_range(said):
    law = "macro friction() F //\nmacro slipFactor(s) (1. - s) //\nreal slipRange = -1.;"
    assert "slipRange is -1: it must be positive" in said(("macro friction() F //", law))


@pytest.mark.parametrize("changes, words, place_of", [
    (("quasistatic(1.);", ""), "amplitude1 is a history, but the scene has no time: call",
     "amplitude1"),
    (("rectangle(0., 2., 0., 1.);", "body = square(2, 2); addBody(square(3, 3))"),
     "body is set to another mesh, which would be left out: give each body by addBody(mesh)",
     "rectangle"),
    (("rectangle(0., 2., 0., 1.);", "body = square(3, 3); addBody(square(3, 3, [2*x, y]))"),
     "body is set to another mesh", "rectangle"),
    (("rectangle(0., 2., 0., 1.);", "body = square(3, 3); addBody(movemesh(body, [x + 2., y]))"),
     "body is set to another mesh", "rectangle"),
    (("rectangle(0., 2., 0., 1.);",
      "body = square(3, 3); addBody(change(body, fregion = x > 0.5))"),
     "body is set to another mesh", "rectangle")])
def test_what_would_be_left_out_in_silence(said, changes, words, place_of):
    message = said(changes, parameters={})
    assert words in message and place(message) == line_of(place_of)


def test_a_body_may_be_called_body_and_added(tmp_path):
    path, added = tmp_path / "mine.edp", "body = square(2, 2); addBody(body)"
    path.write_text(SCENE.replace("rectangle(0., 2., 0., 1.);", added))
    export = freefem.export(path, tmp_path / "export", {"subdomains": "2", "steps": "1"})
    assert export.bodies == 1


def test_a_statement_without_its_end_is_found(said):
    """FreeFEM names the next statement, which comes behind all macros."""
    assert f"line {line_of('quasistatic')} may lack its ;" in said(("(1.);", "(1.)"))


def test_a_token_in_a_line_of_the_library_is_that_of_a_macro(said):
    """The line has the scene's own words in it; the message names where they stand."""
    message = said(("2., -10.", "2., -10.%%x"))
    assert "FreeFEM does not understand load1 before token %" in message
    assert place(message) == line_of("macro load1")


BODY = ("rectangle(0., 2., 0., 1.);", "{}")


@pytest.mark.parametrize("text, words", [
    ("body = square(2, 2); body = movemesh(body, [x, y*1e-8]);", "nearly flat"),
    ("body = square(2, 2); body = movemesh(body, [x, y + 2*(y < 0.7)*(y > 0.2)]);", "movemesh"),
    ("addBody(square(2, 2)) addBody(square(int(0.2), 1))", "far too large"),
    ("border a(t=0, 1) { x = t; y = t*t; label = 1; } body = buildmesh(a(5));", "close a curve"),
    ('body = readmesh("none.msh");', "none.msh is not there"), ("", "rectangle(...)")])
@pytest.mark.some(3)
def test_bodies_that_are_none(said, text, words):
    assert words in said((BODY[0], text), parameters={})


def test_a_border_that_cannot_be_meshed_is_named_where_it_is(said):
    """A slit that is too thin: FreeFEM says the line that draws the first border."""
    drawn = """border a(t=0, 2*pi) {x = 9*cos(t); y = 9*sin(t); label = 1;}
border b(t=-1, 1) {x = t; y = 1e-3*(1 - t^2); label = 2;}
border c(t=1, -1) {x = t; y = -1e-3*(1 - t^2); label = 3;}

body = buildmesh(a(60) + b(20) + c(20));"""
    message = said((BODY[0], drawn), parameters={})
    assert place(message) == line_of(BODY[0]) + 4 and "cannot work with" in message
    message = said((BODY[0], drawn.replace("t; y = -1e-3", "t; y = 1./(t - t) - 1e-3")),
                   parameters={})
    assert place(message) == line_of(BODY[0]) + 2 and "division by zero" in message


@pytest.mark.parametrize("name, value", [
    ("subdomains", "999999x999999"), ("subdomains", "4294967297"), ("cells", "1000000"),
    ("steps", "1000000000")])
def test_absurd_numbers_are_refused_at_once(said, name, value):
    assert name in said(parameters={**SMALL, name: value})


@pytest.mark.parametrize("code", ["exit(0);\n", ""])
def test_a_scene_that_exports_nothing(said, code):
    assert "export.idp" in said(('include "export.idp"\n', code))


def test_errors_behind_the_export_are_not_a_macros(said):
    message = said(('include "export.idp"\n', 'include "export.idp"\nreal a = 1./0.;\n'))
    assert place(message) == line_of("export.idp") + 1 and "amplitude" not in message


def test_every_macro_with_a_kind_is_put_where_it_is_expected(tmp_path):
    """Names that the scene and the rooms have in common with the table of kinds."""
    declarations.write(tmp_path)
    text = (tmp_path / declarations.MESSAGES / "contents.idp").read_text()
    known = {name for macro in all_macros() for name in macro.names}
    checked = set(re.findall(r"libContent(\w+)\(", text))
    assert checked <= known and {"load1", "load9", "gap", "friction", "c33", "support"} <= checked


def test_traces_name_what_is_evaluated():
    output = "evaluating: load1\nevaluating: young\n"
    assert run_time.EVALUATING.findall(output) == ["load1", "young"]


DISC = (("rectangle(0., 2., 0., 1.);",
         "border half(t=0, pi) { x = cos(t); y = sin(t); label = 3; }\n"
         "border low(t=pi, 2*pi) { x = cos(t); y = sin(t); label = 1; }\n"
         "body = buildmesh(half(6) + low(6));"),
        ("on(4, u1 = 0., u2 = 0.)", "on(3, u1 = 0., u2 = 0.)"), ('subdomains("2x1");\n', ""))


@pytest.mark.parametrize("declared, words", [
    ("macro obstacle(x, y) (x + 2.) //", "faces away from the obstacle: give it a label"),
    ("macro obstacle(x, y) (-1. - y) //", "turn its sign round: it is positive where the body is"),
    ("macro contactNormal() [0., 1.] //", "turn its sign round: it points from the body"),
])
@pytest.mark.parametrize("more", [{"subdomains": "1"}, {"subdomains": "3", "element": "P2"}])
def test_a_contact_normal_that_points_into_the_body(said, declared, words, more):
    """A lower half disc: part of it faces a wall on the left, all of it an obstacle below."""
    message = said(*DISC, ("macro contact() 1 //", f"macro contact() 1 //\n{declared}"),
                   parameters={"steps": "2", **more})
    assert words in message and "of the body on label 1 at (" in message
    assert "mine.edp line 14: " in message  # of the macro


@pytest.mark.parametrize("body", [(), DISC])
def test_a_label_that_faces_away_is_told_of_one_that_does_not(said, body):
    """Of a rectangle, and of a disc, whose upper half no obstacle below can touch."""
    message = said(*body[:1], *body[2:], ("on(4, u1 = 0., u2 = 0.)", "on(4, u1 = 0.)") if not body
                   else ("on(4, u1 = 0., u2 = 0.)", "on(3, u1 = 0.)"),
                   ("macro contact() 1 //",
                    "macro contact() 1, 3 //\nmacro obstacle(x, y) (y + 1.) //"),
                   parameters={"steps": "2"})
    assert "label 3 faces away from the obstacle, which label 1 faces" in message


def test_each_side_of_a_corner_faces_the_obstacle(said):
    """A label round a square of single sides, all of whose nodes are corners."""
    message = said(("rectangle(0., 2., 0., 1.);",
                    "int[int] one = [1, 1, 1, 1]; body = square(1, 1, [2*x, y], label = one);"),
                   ('subdomains("2x1");\n', ""), ("traction(3", "traction(1"),
                   ("on(4, u1 = 0., u2 = 0.)", "on(1, u2 = 0.)"),
                   ("macro contact() 1 //",
                    "macro contact() 1 //\nmacro contactNormal() [0., -1.] //"),
                   parameters={"steps": "2", "subdomains": "1"})
    assert "does not point out of the body on label 1 at (" in message


@pytest.mark.parametrize("old, new, words", [
    ("macro amplitude1(t) t //", "macro amplitude1(t) min(1, 2*t) //", "write min(1., 2*t)"),
    ("macro young() 1000. //", "macro young() max(y + 1., 2) //", "write max(y + 1., 2.)"),
    ("quasistatic(1.);", "quasistatic(1.);\nreal E = 1. + min(3, F);", "write min(3., F)"),
    ("rectangle(0., 2., 0., 1.);", "body = square(2, 2, [2*x, y], label = [5, 6, 7, 8]);",
     "int[int] sides = [5, 6, 7, 8]; and  label = sides"),
    ("quasistatic(1.);", "border end(t=0, 1) { x = t; y = 0.; }\nquasistatic(1.);",
     "'end' is a word of FreeFEM's own: choose another name"),
])
def test_the_remedy_is_said(said, old, new, words):
    assert words in said((old, new))


TWO = (("rectangle(0., 2., 0., 1.);", "addBody(square(2, 2, [2*x, y]))\n"
        "int[int] above = [5, 6, 7, 8];\n"
        "addBody(square(2, 2, [2*x, 1. + y], label = above, region = 0))"),
       ("macro contact() 1 //", "macro contactPair() 5, 3 //"), ("traction(3", "traction(7"),
       ('subdomains("2x1");\n', ""), ("1000. //", "(stiff ? 10. : 1000.) //"),
       ("macro young", "macro stiff() (region == 1) //\nmacro young"))


def test_regions_that_no_mesh_has(said, tmp_path):
    """Both bodies would be of the lower one's material; with a region for the upper one it runs."""
    message = said(*TWO, parameters={"steps": "2"})
    assert "young asks for the region, but all of the mesh is region 0" in message
    path = tmp_path / "mine.edp"
    path.write_text(path.read_text().replace("region = 0", "region = 1"))
    assert freefem.export(path, tmp_path / "two", {"steps": "2"}).regions == [0, 1]


@pytest.mark.parametrize("formula, helper, words", [
    ("(label == 7 ? 0.3 : 0.1)", "", "friction asks for label 7, which no boundary of the mesh "
     "has, whose labels are 1, 2, 3, 4"),
    ("(7 != label ? 0.3 : 0.1)", "", "friction asks for label 7"),
    ("(glued ? 0.3 : 0.1)", "macro glued() (label == 7) //\n", "glued asks for label 7"),
    ("(label != -7 ? 0.3 : 0.1)", "", "friction asks for label -7"),
    ("(-7 == label || x < 1 ? 0.3 : 0.1)", "", "friction asks for label -7")])
def test_numbers_that_no_label_has(said, formula, helper, words):
    """The comparison is true nowhere: all would have the other value, without a word."""
    assert words in said(("macro friction() F //", f"{helper}macro friction() {formula} //"))


def test_an_argument_called_label_is_no_label(tmp_path):
    """What it is compared with here are numbers of regions."""
    path = tmp_path / "mine.edp"
    text = SCENE
    for old, new in (('subdomains("2x1");\nrectangle(0., 2., 0., 1.);',
                      "body = square(2, 2, [2*x, y], region = 9);"),
                     ("macro amplitude1(t) t //", "macro amplitude1(t) t //\n"
                      "macro heavy(label) (label == 9 ? -1. : 0.) //\n"
                      "macro bodyForce1() [0., heavy(region)] //")):
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    assert freefem.export(path, tmp_path / "export", {"steps": "2"}).regions == [9, 9]


@pytest.mark.parametrize("formula, helper, words", [
    ("(label = 1 ? 0.3 : 0.1)", "", "friction sets label by a single =; what compares has two: "
     "label == ..."),
    ("(glued ? 0.3 : 0.1)", "macro glued() (x <= 2. && label= 1) //\n", "glued sets label by a"),
    ("(x = 1. ? 0.3 : 0.1)", "", "friction sets x by a single ="),
    ("min(1., (0.5 < x < 1. ? 0.3 : 0.1))", "", "friction compares three things at once, which "
     "FreeFEM takes one after the other: 0.5<x<1.; write  a < b && b < c"),
    ("(label == 1 || 2 ? 0.3 : 0.1)", "", "friction has 2 as a condition, which is the same "
     "everywhere: label==1||2; each side compares"),
    ("mu", "int k = 2, mu = physical(\"mu\", 0.3);\n", "as an int mu loses its decimals: write  "
     "real mu = physical(...)")])
def test_mistakes_that_freefem_takes_for_something_else(said, formula, helper, words):
    """They make one value of all places: friction vanished without a word."""
    assert words in said(("macro friction() F //", f"{helper}macro friction() {formula} //"))


@pytest.mark.parametrize("macro", ["planeStress() no", "axisymmetric() 0", "preload() False",
                                   "planeStress() 0.0"])
def test_what_any_content_declares_is_not_taken_back_by_its_content(said, macro):
    words = said(("macro friction() F //", f"macro friction() F //\nmacro {macro} //"))
    assert f"{macro.partition('(')[0]} holds whatever its content, also this one" in words


@pytest.mark.parametrize("load, integral", [
    ("int1d(body, 3)(-10.*v2)", "int1d(body,3)"), ("int2d(body)(-v2)", "int2d(body)"),
    ("traction(2, 1., 0.) + int1d(Ti)(-v2)", "int1d(Ti)"),
    ("int1d(Ti, qforder = 3)(v1)", "int1d(Ti,qforder=3)"), ("int2d(Ti)(-v2)", "int2d(Ti)")])
def test_loads_are_no_integrals_that_depend_on_the_subdomains(said, load, integral):
    """Quadratic elements took that of a mesh of the scene once for every subdomain, or not at all.
    """
    words = said(("traction(3, 2., -10.)", load))
    assert f"load1 has the integral {integral}(...)" in words and "write traction(label" in words


def test_what_loads_call_is_no_such_integral_either(said):
    words = said(("macro load1() traction(3, 2., -10.)",
                  "macro down(l, p) int1d(body, l)(-p*v2) //\nmacro load1() down(3, 10.)"))
    assert "down has the integral int1d(body,l)(...)" in words


def test_integrals_behind_a_name_of_their_own_are_such_too(said):
    words = said(("macro load1() traction(3, 2., -10.)",
                  "macro down() (-10.*v2) //\nmacro load1() int1d(body, 3)(down)"))
    assert "load1 has the integral int1d(body,3)(...)" in words


@pytest.mark.parametrize("macro, number", [
    ("load2() traction(3, 0., -10./int1d(Ti, 3)(1.))", "int1d(Ti,3)"),
    ("load2() int1d(Ti, 3)(-10./int1d(Ti, 3)(1.)*v2)", "int1d(Ti,3)"),
    ("bodyForce1() [0., -10./int2d(Ti)(1.)]", "int2d(Ti)")])
def test_numbers_are_no_integrals_over_a_subdomain(said, macro, number):
    """Each of four subdomains along the label took the whole force: its sum was four times that."""
    words = said(("macro friction() F //", f"macro friction() F //\nmacro {macro} //"))
    assert f"{macro.partition('(')[0]} has the number {number}(...), which every subdomain" in words


@pytest.mark.parametrize("load", [
    "traction(3, 0., -10./int1d(body, 3)(1.))", "int1d(Ti, 3, qforder = 3)(-10.*v2)",
    "int1d(Ti, 3)(down) //\nmacro down() (-10.*v2)",
    "down(3, -10.*v2) //\nmacro down(l, q) int1d(Ti, l)(q)"])
def test_loads_of_each_subdomain_and_numbers_in_them_are_not_refused(accepted, load):
    accepted(f"macro load2() {load} //\nmacro friction() F //")


@pytest.mark.parametrize("macro, word", [
    ("amplitude1(t) (t*x)", "x"), ("amplitude2(t) (label == 3 ? t : 1.)", "label"),
    ("slipFactor(s) (1. - s*y)", "y"), ("displacementFactor(s) (region == 1 ? 1. : s)", "region"),
    ("stepTimes() [0.5*x]", "x"), ("pointLoad1() [2., 1., x, 0.]", "x"),
    ("amplitude1(t) (t*N.y)", "N.y"), ("amplitude1(t) (x*int1d(body, 3)(t))", "x")])
def test_what_is_the_same_at_every_place_asks_for_none(said, macro, word):
    """FreeFEM has the x of any place that it has come to before."""
    name = macro.partition("(")[0]
    assert f"{name} asks for {word}, but is the same at every place" in said(
        ("macro friction() F //", f"macro friction() F //\nmacro {macro} //"))


@pytest.mark.parametrize("macro, word", [
    ("young() (label == 1 ? 2e3 : 1e3)", "label"), ("bodyForce1() [0., N.y]", "N.y"),
    ("thermal1() 1e-4*(label == 1)", "label"), ("piece() (label == 3)", "label")])
def test_what_is_inside_a_body_asks_for_nothing_of_boundaries(said, macro, word):
    """FreeFEM took one of the two numbers for the whole body."""
    name = macro.partition("(")[0]
    place_of = "macro young() 1000. //" if name == "young" else "macro friction() F //"
    more = f"macro {macro} //" + ("" if name == "young" else f"\n{place_of}")
    assert f"{name} asks for {word}, which boundaries alone have" in said((place_of, more))


def test_what_histories_call_asks_for_no_place_either(said):
    words = said(("macro friction() F //", "macro friction() F //\n"
                  "macro ramp(t) (x > 0 ? t : 1.) //\nmacro amplitude1(t) ramp(t) //"))
    assert "mine.edp line" in words and "ramp asks for x" in words


@pytest.mark.parametrize("helper, name, obstacle", [
    ("macro bump() (0.1*x) //", "bump", "obstacle(x, y) (y - bump + 1.)"),
    ("func bump = 0.1*x;", "bump", "obstacle(x, y) (y - bump + 1.)"),
    ("func real bump(real a) { return 0.1*a + x; }", "bump", "obstacle(x, y) (y - bump(x))"),
    ("fespace Wide(body, P1); Wide bump = x;", "bump", "obstacleInTime(x, y, t) (y - t*bump)"),
    ("", "obstacle", "obstacle(a, b) (b - 0.1*x + 1.)")])
def test_obstacles_ask_for_no_place_but_their_arguments(said, helper, name, obstacle):
    """Beside the place at hand it would be the same there, and so would the contact normal."""
    words = said(("macro friction() F //", f"macro friction() F //\n{helper}\nmacro {obstacle} //"))
    assert f"{name} asks for x, which is not among its arguments" in words


@pytest.mark.parametrize("helper, obstacle", [
    ("macro bump(x) (0.1*x) //", "(y - bump(x) + 1e-3*label)"),
    ("func real bump(real a) { real x = 0.1*a; return x; }", "(y - bump(x))"),
    ("fespace Wide(body, P1); Wide bump = x;", "(y - bump(x, y) - int1d(body, 3)(x))")])
def test_obstacles_whose_helpers_have_arguments_are_not_refused(accepted, helper, obstacle):
    accepted(f"macro friction() F //\n{helper}\nmacro obstacle(x, y) {obstacle} //")


def test_a_variable_in_place_of_a_macro_is_refused_beside_a_parameter_of_its_name(said):
    """SCENE reads physical("friction", 0.3)."""
    words = said(("macro friction() F //", "real friction = F;"))
    assert "nothing reads 'friction': what a scene declares is given by macros" in words


def test_a_formula_in_place_of_a_macro_is_refused(said):
    words = said(("macro young() 1000. //", "func young = 1000. + x;"))
    assert "nothing reads 'young': what a scene declares is given by macros: macro young()" in words
    assert place(words) == 7


@pytest.mark.parametrize("old, new, words", [
    ("macro young() 1000. //", "macro young() (nuTriangle < 9 ? 1e3 : 2e3) //",
     "young asks for nuTriangle, which"),
    ("macro young() 1000. //", "macro young() stiff //\nfunc stiff = 1e3*(1 + nuEdge);",
     "stiff asks for nuEdge"),
    ("macro friction() F //", "macro friction() (F*(1. + 0.1*randreal1())) //",
     "friction calls randreal1, which is")])
def test_what_subdomains_count_by_themselves_is_no_declaration(said, old, new, words):
    """Triangles have other numbers in each subdomain: pressures depended on the cut by a tenth."""
    assert words in said((old, new))


@pytest.mark.parametrize("text", [
    "fespace V(body, P1); V v = randreal1();\nmacro friction() (F*v(x, y)) //",
    "macro friction() F //\nmacro piece() nuTriangle //"])
def test_numbers_of_the_whole_mesh_and_those_drawn_once_are_not_refused(accepted, text):
    accepted(text)


def test_functions_that_histories_call_ask_for_no_place(said):
    words = said(("macro friction() F //", "macro friction() F //\nfunc ramp = x/2.;\n"
                  "macro amplitude1(t) (t*ramp) //"))
    assert "mine.edp line 14: ramp asks for x, but is the same at every place" in words


@pytest.mark.parametrize("macro", ["amplitude1(x) (x*x)", "amplitude1(t) (t*table.x)",
                                   "amplitude1(t) x(t)", "obstacleX(t) (label == 3 ? t : 0.)",
                                   "amplitude1(t) (t/int1d(body, 3) ((x + 1.)*y)/2.)",
                                   "amplitude1(t) (t*int2d(body)(2*pi*x))"])
def test_names_like_those_of_places_are_not_refused(accepted, macro):
    accepted(f"macro friction() F //\nmacro {macro} //")


@pytest.mark.parametrize("text", [
    'int n = physical("ratio", 1.5)*10;', 'int on = physical("share", 0.5) > 0.2, k = 3;',
    'int n = physical("number", 12);',
    "macro said() { bool a = x < 1.; bool b = y < 1.; cout << a << b << endl; } //\nsaid;"])
def test_what_is_no_mistake_is_not_refused(accepted, text):
    accepted(f"{text}\nmacro friction() (said ? F : F) //")


@pytest.mark.parametrize("helper, words", [
    ('real mu = physical("mu", 0.3), low = physical("Mu", 0.2);', "the parameters mu and Mu differ "
     "by capitals alone, and MU= would set one of them"),
    ('int mu = physical("mu", 1);', "as an int mu loses its decimals")])
def test_mistakes_that_only_an_option_shows(said, tmp_path, helper, words):
    """Without it the scene means what it says."""
    changes = ("macro friction() F //", f"{helper}\nmacro friction() mu //")
    assert words in said(changes, parameters=SMALL | {"mu": "0.5"})
    freefem.export(tmp_path / "mine.edp", tmp_path / "export", SMALL)


@pytest.mark.parametrize("name, parameters, words", [
    ("Cells", SMALL, "the parameters cells and Cells differ"),
    ("Steps", {}, "a parameter cannot be called Steps")])
def test_parameters_of_the_library_have_no_doubles(said, name, parameters, words):
    """A size that is given, as for companions, would have set the scene's own number alone."""
    assert words in said(("macro friction() F //", f'real high = physical("{name}", 2.);\n'
                          "macro friction() F //"), parameters=parameters)


@pytest.mark.parametrize("formula", [
    "(x > 1. == y > 0.5 ? 0.3 : 0.1)", "(x < 1. != y < 0.5 || label == 1 ? 0.3 : 0.1)",
    "(x <= 1. || x >= 0. && label != 4 ? 0.3 : 0.1)", "(3 - -1 == label ? 0.3 : 0.1)",
    "(x < 1. ? (y < 1. ? 0.3 : 0.2) : 0.)", "0.3*(x > 0.)*(x < 1.) + 0.1*(k > 0 || x > 0.)",
    "(label == 10*k - 9 ? 0.3 : 0.1)", "(10*k - 9 == label ? 0.3 : 0.1)",
    "(label + 10 == 11 ? 0.3 : 0.1)", "(11 == label + 10 ? 0.3 : 0.1)"])
def test_numbers_in_sums_are_not_judged(tmp_path, formula):
    path = tmp_path / "mine.edp"
    path.write_text(SCENE.replace("macro friction() F //",
                                  f"int k = 1;\nmacro friction() {formula} //"))
    assert freefem.export(path, tmp_path / "export", SMALL).steps


@pytest.mark.parametrize("value, words", [
    ("1e300", "expects a number between -1e300 and 1e300, not '1e300'"),
    ("1e", "expects a number, not '1e'"), ("0.3.1", "expects a number, not '0.3.1'")])
def test_what_is_no_number_and_what_is_too_large_a_one(said, value, words):
    assert words in said(parameters=SMALL | {"friction": value})


ABOVE = (("rectangle(0., 2., 0., 1.);", "int[int] above = [5, 6, 7, 8];\n"
          "addBody(square(2, 2, [2*x, y]))\naddBody(square(3, 2, [2*x, 1. + y], label = above))"),
         ("macro contact() 1 //", "macro contactPair() 5, 3 //"), ("traction(3", "traction(7"),
         ('subdomains("2x1");\n', ""))


@pytest.mark.parametrize("law, words", [
    ("friction() (label == 3 ? 0.3 : 0.)", "friction asks for label 3, the second of a contactPair,"
     " whose nodes are those of the first: write label == 5"),
    ("friction() F //\nmacro glued() (3 == label) //\nmacro cohesion() (glued ? 0.3 : 0.)",
     "glued asks for label 3, the second"),
    ("friction() F //\nmacro pairGap() (label == 3 ? 0.1 : 0.)", "pairGap asks for label 3, the")])
def test_contact_laws_that_ask_for_a_second_label(said, law, words):
    """They are evaluated on first ones alone, and had been zero without a word."""
    message = said(*ABOVE, ("friction() F", law), parameters={"steps": "2"})
    assert words in message and place(message)


@pytest.mark.parametrize("law, words", [
    ("friction() (label == 3 ? 0.3 : 0.)", "friction asks for label 3, where "
     "there is no contact, and not for 1, where it is: what it says of label 3 counts nowhere"),
    ("friction() F //\nmacro glued() (2 == label) //\nmacro cohesion() (glued ? 0.3 : 0.)",
     "glued asks for label 2, where there is no"),
    ("friction() F //\nmacro gap() (label == 2 || label == 3 ? 0.1 : 0.)", "gap asks for label 2"),
    ("friction() F //\nmacro foundation() 2 //\nmacro foundationNormal() (label == 1 ? 9. : 0.)",
     "foundationNormal asks for label 1, where there is no foundation, and not for 2"),
    ("friction() F //\nmacro foundation() 2 //\nmacro foundationNormal() (label == 2 ? 9. : 0.)",
     ""),
    ("friction() (label == 1 ? 0.1 : (label == 2 ? 0.2 : 0.))", ""),
    ("friction() (label != 2 ? 0.1 : 0.)", ""),
    ("friction() (label == bottom ? 0.1 : (label == 3 ? 0.2 : 0.)) //\nint bottom = 1; //", ""),
    ("friction() (label < 2 || label == 3 ? 0.1 : 0.)", ""),
    ("friction() (bottomSide ? 0.1 : (rightSide ? 0.2 : 0.)) //\n"
     "macro bottomSide() (label == 1) //\nmacro rightSide() (label == 2)", "")])
@pytest.mark.some(5)
def test_contact_laws_that_ask_for_labels_without_contact_alone(tmp_path, law, words):
    """A number mistyped is zero everywhere; one of several may have its contact left out."""
    path = tmp_path / "mine.edp"
    path.write_text(SCENE.replace("friction() F", law))
    manifest = freefem.export(path, tmp_path / "export", SMALL)
    said = compared.asked_elsewhere(path, manifest)
    assert len(said) == bool(words) and words in "".join(said)
    del manifest.rooms["friction"]  # as where it is left out: then nobody reads it
    left = compared.asked_elsewhere(path, manifest)
    assert left == [line for line in said if ": friction asks" not in line]


@pytest.mark.parametrize("law, words", [
    ("gap() (label == 5 ? 0.1 : 0.)", "gap asks for label 5, where there is no contact with an "
     "obstacle, and not for 1"),
    ("obstacleX(t) (label == 5 ? t : 0.)", "obstacleX asks for label 5"),
    ("pairGap() (label == 1 ? 0.1 : 0.)", "pairGap asks for label 1, where there is no contact of "
     "a pair's first side, and not for 5"),
    ("gap() (label == 1 ? 0.1 : 0.)", ""), ("pairGap() (label == 5 ? 0.1 : 0.)", ""),
    ("cohesion() (label == 5 ? 0.1 : 0.)", "")])
@pytest.mark.some(3)
def test_gaps_of_obstacles_and_of_pairs_that_ask_for_one_anothers_labels(tmp_path, law, words):
    path, text = tmp_path / "mine.edp", SCENE
    for old, new in (*ABOVE, ("friction() F //", f"friction() F //\nmacro {law} //"),
                     ("macro support() on(4, u1 = 0., u2 = 0.) //", "macro contact() 1 //")):
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)
    said = compared.asked_elsewhere(path, freefem.export(path, tmp_path / "export", {"steps": "2"}))
    assert len(said) == bool(words) and words in "".join(said)


def test_a_first_label_of_several_pairs_is_named_once(tmp_path):
    path, text = tmp_path / "mine.edp", SCENE
    law = "macro pairGap() (label == 1 ? 0.1 : 0.) //"
    for old, new in (*ABOVE, ("friction() F //", f"friction() F //\n{law}"),
                     ("contactPair() 5, 3 //", "contactPair() 5, 3, 5, 2 //")):
        text = text.replace(old, new, 1)
    path.write_text(text)
    said, = compared.asked_elsewhere(path, freefem.export(path, tmp_path / "export",
                                                          {"steps": "2"}))
    assert "and not for 5, where it is" in said


def test_laws_that_ask_for_first_labels_and_loads_for_any(tmp_path):
    path, text = tmp_path / "mine.edp", SCENE
    for old, new in (*ABOVE, ("friction() F", "friction() (label == 3 || label == 5 ? F : 0.)"),
                     ("traction(7, 2., -10.)", "traction(7, (label == 3 ? 1. : 2.), -10.)")):
        text = text.replace(old, new, 1)
    path.write_text(text)
    assert freefem.export(path, tmp_path / "export", {"steps": "2"}).contact_pairs == [[5, 3]]


def test_a_region_beyond_those_of_the_meshes(said):
    """Of two bodies, regions 0 and 1."""
    changes = [(old, new.replace("region = 0", "region = 1").replace("region == 1", "region == 3"))
               for old, new in TWO]
    message = said(*changes, parameters={"steps": "2"})
    assert "stiff asks for region 3, which no part of the mesh has, whose regions are 0 to 1" in (
        message)


def test_what_another_rank_refuses_is_said(tmp_path):
    """The last of two subdomains alone has the place: rank 0 has nothing to say."""
    path = tmp_path / "mine.edp"
    path.write_text(SCENE.replace("macro friction() F //", "macro friction() (1.5 - x) //"))
    with pytest.raises(InputError, match="friction is negative on label 1"):
        freefem.export(path, tmp_path / "export", SMALL, ranks=2)


@pytest.mark.parametrize("times, steps", [("[0.5, 1.]", 20), ("[1/3.]", 21), ("[0.15, 0.11]", 100)])
def test_steps_end_at_the_times_that_a_scene_lists(tmp_path, times, steps):
    """The least number from 20 on; STEPS goes before."""
    path = tmp_path / "mine.edp"
    path.write_text(SCENE.replace("macro young()", f"macro stepTimes() {times} //\nmacro young()"))
    assert freefem.export(path, tmp_path / "least", {"cells": "1"}).steps == steps
    assert freefem.export(path, tmp_path / "given", {"cells": "1", "steps": "3"}).steps == 3


SIZED = (*((old, new.replace("half(6) + low(6)", "half(int(3/h)) + low(int(3/h))"))
           for old, new in DISC),
         ('units("mm", "MPa");', 'units("mm", "MPa");\nreal h = meshSize(0.25);'))


def test_a_mesh_that_no_memory_holds_is_refused_at_once(said):
    """From how two coarse ones grow; in magnitude the area over that of equilateral triangles."""
    message = said(*SIZED, parameters={"h": "1e-6", "steps": "2"})
    number = re.match(r"H=1e-6 would make a mesh of about (\S+) triangles, more than the 2e\+07",
                      message)
    assert 0.1 < float(number[1]) / (np.pi / (0.433 * 1e-12)) < 10


def _of_size(tmp_path, h: str, **options):
    """Export of the sized disc with elements of size `h`."""
    path, text = tmp_path / "mine.edp", SCENE
    for old, new in SIZED:
        text = text.replace(old, new, 1)
    path.write_text(text)
    parameters = {"h": h, "steps": "2", "subdomains": "auto"}
    return freefem.export(path, tmp_path / "export", parameters, **options)


@pytest.mark.slow
def test_a_small_size_that_memory_holds_is_only_counted(tmp_path):
    """And what can be done while FreeFEM works is done in the second try as well."""
    seen = []

    def meanwhile() -> bool:
        seen.append(announced(tmp_path / "export") is not None)
        return True

    manifest = _of_size(tmp_path, "0.008", meanwhile=meanwhile)
    assert manifest.parameters["h"] == 0.008 and "counted" not in manifest.parameters
    assert any(seen)
    # about as many pieces as cost least; what a piece may have more of them is half a piece
    assert 2 * manifest.nodes / manifest.subdomains == pytest.approx(1e4, rel=0.05)


@pytest.mark.slow  # a mesh of 390,000 dofs
def test_pieces_of_large_bodies_are_larger(tmp_path):
    """By the third root of the size: 1.25 times at 390,000 dofs."""
    manifest = _of_size(tmp_path, "0.004")
    dofs = 2 * manifest.nodes
    assert dofs / manifest.subdomains == pytest.approx(1e4 * (dofs / 2e5) ** (1 / 3), rel=0.02)
    assert dofs > 3e5


@pytest.mark.parametrize("given, words", [
    ({"fricton": "1"}, "unknown parameter FRICTON; this scene reads FRICTION, SUBDOMAINS, STEPS, "
                       "ELEMENT, CELLS; did you mean FRICTION?"),
    ({"steps": "2.5"}, "STEPS expects a whole number of at least 1, not '2.5'"),
    ({"subdomains": "4by2"}, "SUBDOMAINS expects NxM (structured)")])
def test_options_are_named_as_users_give_them(said, given, words):
    assert said(parameters=given) == f"mine.edp: {words}" or words in said(parameters=given)


def test_what_no_scene_reads_is_refused_before_it_is_meshed(said, monkeypatch):
    """FreeFEM tells where names are made as it reads the scene."""
    made = 'physical("friction", 0.3)', 'physical("fric" + "tion", 0.3)'
    assert "this scene reads FRICTION, " in said(made, parameters={"fricton": "1"})
    monkeypatch.setattr(freefem, "_run", None)
    assert "did you mean FRICTION?" in said(parameters={"fricton": "1"})


def test_what_the_solver_says_of_an_option_has_no_line_of_the_scene(tmp_path):
    path = tmp_path / "mine.edp"
    path.write_text(SCENE)
    reason = "QUANTITY=torque: the scene has no such quantity; it has contact_length"
    assert explain.placed(reason, path) == reason


@pytest.mark.parametrize("name", ["mine.edp", "all mine.edp"])
def test_a_line_of_the_scene_is_said_once(tmp_path, name):
    """A search for an accuracy ends with what one of its runs was refused for."""
    path = tmp_path / name
    path.write_text(SCENE)
    once = explain.placed("contact on label 3 is not known", path)
    assert re.match(rf"{name} line \d+: contact on", once)
    assert explain.placed(once, path) == once


def test_a_list_of_labels_may_be_a_variable(tmp_path):
    (tmp_path / "mine.edp").write_text(SCENE.replace(
        "macro friction", "int p = 3; int[int] p1 = [p, 1];\nmacro probeLabels() p1 //\n"
                          "macro friction"))
    assert "probeLabels() p1" in grammar.read(tmp_path / "mine.edp")
    grammar.check(tmp_path / "mine.edp")


def test_labels_that_are_names_are_said_to_be_none(said):
    message = said(("macro contact() 1 //", "border bottom(t=0, 1) { x = t; y = 0; }\n"
                                            "macro contact() bottom //"))
    assert "the macro contact cannot be  bottom: it expects label" in message


def test_conditions_need_a_boundary(said):
    message = said(("on(4, u1 = 0., u2 = 0.)", "on(u1 = 0., u2 = 0.)"))
    assert place(message) == line_of("macro support") and "names no boundary" in message


@pytest.mark.parametrize("times, words", [
    ("[0.5, 2.]", "no step ends at 2: the history goes from 0 to 1"),
    ("[-0.5]", "no step ends at -0.5"), ("[1.5]", "no step ends at 1.5"),
    ("[pi/10]", "no number of equal steps up to 400"),
    ("[0.1234567]", "no number of equal steps up to 400")])
def test_times_that_no_step_can_end_at(said, times, words):
    added = f"macro stepTimes() {times} //\nmacro contact() 1 //"
    message = said(("macro contact() 1 //", added), parameters={"cells": "2"})
    assert words in message and place(message) == line_of("macro contact")


def test_an_obstacle_without_slope_gives_no_direction(said):
    message = said(("macro contact() 1 //", "macro contact() 1 //\nmacro obstacle(x, y) 1. //"))
    assert "obstacle cannot be evaluated" in message and "no direction" in message


@pytest.mark.parametrize("formula, words", [
    ("1./(x - x)", "cannot be evaluated: a division by zero"),
    ("sqrt(-1. - x)", "is no finite number on label 1 at (0, 0)")])
def test_initial_displacements_that_are_none_are_named(said, formula, words):
    added = f"macro contact() 1 //\nmacro initialY() {formula} //"
    assert f"initialY {words}" in said(("macro contact() 1 //", added))


@pytest.mark.parametrize("reason, line", [
    ("the boundaries 1 and 3 of a contact pair do not face each other, or a support holds", 3),
    ("the tied boundaries 1 and 5 do not face each other", 4),
    ("the factor of the friction coefficient is negative at slip 2", 5),
    ("parts of a body share no edge", None)])
def test_what_the_solver_refuses_has_a_line_too(tmp_path, reason, line):
    path = tmp_path / "mine.edp"
    path.write_text("// four\nmacro contact() 9 //\nmacro contactPair() 1, 3 //\n"
                    "macro tie() 1, 5 //\nmacro friction() 1. //\nmacro other() 2 //\n")
    placed = f"mine.edp line {line}: {reason}" if line else reason
    assert explain.placed(reason, path) == placed


@pytest.mark.parametrize("number, where", [(2, "mine.edp line 2 "), (62, "mine.edp ")])
def test_a_line_of_the_library_is_none_of_the_scene(tmp_path, number, where):
    """FreeFEM counts lines in the file that it is in, and does not say in which."""
    path = tmp_path / "mine.edp"
    path.write_text("// three\nmesh Th = square(2, 2);\n// lines\n")
    message = explain.failure(f"Fatal error in the mesh generator 5\ncurrent line = {number}\n",
                              5, path, tmp_path, lambda: "")
    assert message.startswith(f"FreeFEM failed in {where}(exit 5)")


def test_of_many_errors_the_first_and_the_last_are_said(tmp_path):
    """FreeFEM has one of every border of an outline that runs the wrong way round."""
    path = tmp_path / "mine.edp"
    path.write_text("mesh Th = buildmesh(a(1));\n")
    printed = "".join(f"Error in border {k}: wrong direction\n" for k in range(12))
    message = explain.failure(f"{printed}Fatal error 777\ncurrent line = 1\n", 8, path, tmp_path,
                              lambda: "")
    assert message.endswith("(Error in border 0: wrong direction; 11 more; Fatal error 777)")


def test_triangles_that_overlap_are_said_to(tmp_path):
    """A file of a mesh with a node beyond its neighbours, as readmesh sees it."""
    path = tmp_path / "mine.edp"
    path.write_text("mesh Th = readmesh(name);\n")
    printed = "Exec error :  Buildmesh : bamg2msh missing vertices\ncurrent line = 1\n"
    assert "triangles that are flat or overlap" in explain.failure(printed, 8, path, tmp_path,
                                                                   lambda: "")


def test_what_a_plugin_prints_when_it_is_loaded_is_no_reason(tmp_path):
    path = tmp_path / "mine.edp"
    path.write_text("exit(3);\n")
    printed = "ConnectedComponents n_name_param2\ncurrent line = 1\n"
    assert explain.failure(printed, 3, path, tmp_path, lambda: "").endswith("(exit 3): no message")


def test_a_limit_of_the_shell_is_no_fault_of_a_statement(tmp_path):
    """The file that FreeFEM writes may not grow as large: the scene is not asked which it was."""
    message = explain.failure("", -25, freefem.find_scene("tutorial"), tmp_path, pytest.fail)
    assert "ulimit -f" in message and "amplitude" not in message


# ---- gmsh ----------------------------------------------------------------------------------------

GEO = """DefineConstant[ h = {1}, length = {2} ];
Point(1) = {0, 0, 0, h}; Point(2) = {length, 0, 0, h}; Point(3) = {2, 1, 0, h};
Point(4) = {0, 1, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1:4}; Plane Surface(1) = {1};
Physical Curve(1) = {1}; Physical Curve(3) = {3}; Physical Curve(4) = {4};
Physical Surface(1) = {1};
"""
SECOND = """Point(5) = {2, 0, 0, h}; Point(6) = {3, 0, 0, h}; Point(7) = {3, 1, 0, h};
Point(8) = {2, 1, 0, h}; Line(5) = {5, 6}; Line(6) = {6, 7}; Line(7) = {7, 8}; Line(8) = {8, 5};
Curve Loop(2) = {5:8}; Plane Surface(2) = {2}; Physical Surface(2) = {2};
"""
MESHED = (('include "scene.idp"', 'include "scene.idp"\ninclude "gmsh.idp"'),
          ("subdomains(\"2x1\");\nrectangle(0., 2., 0., 1.);", 'body = gmshBody("mine.geo", 0.5);'))


@pytest.mark.parametrize("geo, words", [
    (GEO + SECOND, "mine.geo has two points in the same place, (2, "),
    # as gmsh finds the ends of pieces of oblique lines, to 1e-11 of the whole
    (GEO + SECOND.replace("{2, ", "{2.0000000001, "),
     "places with two vertices (3, the first at (2, 0))"),
    # the second body lies between the nodes of the first one
    (GEO + SECOND.replace(", 0, 0, h", ", 0.1, 0, h").replace(", 1, 0, h", ", 0.7, 0, h"),
     "what gmshBody loads has a vertex on a side that is not its triangles', at (2, "),
    (GEO + SECOND.replace("{2, ", "{2.00000003, "), "the body is not connected: its piece at"),
    # a notch from above, 3e-8 wide
    (GEO.replace("Line(3) = {3, 4};", "Point(5) = {1.00000003, 1, 0, h}; Point(6) = {1, 0.5, 0, h};"
                 " Point(7) = {1, 1, 0, h};\nLine(3) = {3, 5}; Line(5) = {5, 6}; Line(6) = {6, 7};"
                 " Line(7) = {7, 4};").replace("{1:4}", "{1:3, 5:7, 4}"),
     "nearer to one another than a ten-millionth"),
    (GEO.replace("1:4", "1:3"), "gmsh cannot mesh mine.geo"),
    (GEO.replace("Physical Curve(3) = {3};", ""), "the numbers of their Physical Curve"),
    (GEO.replace("\nPhysical Surface(1) = {1};\n", " Physical Surface(1) = {1};"),
     "the last line of mine.geo has no line end"),
    (GEO.replace("Physical Surface(1) = {1};", ""), "give its surfaces a Physical Surface"),
    (GEO.replace("Physical Curve(1) = {1}; Physical Curve(3) = {3}; Physical Curve(4) = {4};", ""),
     "give its curves a Physical Curve"),
    (GEO + "Physical Surface(9) = {1};\n", "there twice, in the physical surfaces 1 and 9"),
    (GEO + "Physical Curve(8) = {3, 4};\n", "there twice, in the physical curves "),
    (GEO + "Mesh.ElementOrder = 2;", "elements that are no straight edges and triangles"),
    (GEO + "Mesh.RecombineAll = 1;", "elements that are no straight edges and triangles"),
    (GEO.replace("{2, 1, 0, h}", "{2, 1, 0.1, h}").replace("{0, 1, 0, h}", "{0, 1, 0.1, h}"),
     "points at different z")])
@pytest.mark.some(2)
def test_what_gmsh_makes_is_judged(said, tmp_path, geo, words):
    (tmp_path / "mine.geo").write_text(geo)
    assert words in said(*MESHED, parameters={"steps": "2"})


@pytest.mark.slow  # three seconds of gmsh
def test_gmsh_does_not_mesh_for_ever(said, tmp_path):
    (tmp_path / "mine.geo").write_text(GEO)
    fine = 'gmshSeconds = 3; body = gmshBody("mine.geo", 1e-6);'
    message = said(MESHED[0], (MESHED[1][0], fine), parameters={"steps": "2"})
    assert place(message) == 5 and re.search(r"a mesh of about [3-6]e\+12 triangles", message)


def test_an_element_size_that_takes_long_is_meshed_where_it_can_be(tmp_path):
    """No second is enough for gmsh to start."""
    (tmp_path / "mine.geo").write_text(GEO)
    scene = tmp_path / "mine.edp"
    hasty = 'gmshSeconds = 1e-9; body = gmshBody("mine.geo", 0.5);'
    text = SCENE.replace(*MESHED[0]).replace(MESHED[1][0], hasty)
    scene.write_text(text.replace("gmshSeconds = 1e-9", 'exec("true")'))
    usual = freefem.export(scene, tmp_path / "usual", {"steps": "2"})
    scene.write_text(text)
    assert freefem.export(scene, tmp_path / "hasty", {"steps": "2"}).nodes == usual.nodes


def test_labels_have_the_names_that_gmsh_knows(said, tmp_path):
    geo = GEO.replace("Physical Curve(1)", 'Physical Curve("bottom side", 7)')
    (tmp_path / "mine.geo").write_text(geo.replace("Physical Curve(3)", 'Physical Curve("top", 3)'))
    message = said(*MESHED, parameters={})
    assert "no boundary with label 1; its labels are 0, 3 'top', 4, 7 'bottom side' (" in message


NAMED = GEO.replace("Curve(1)", 'Curve("foot", 7)').replace("Curve(4)", 'Curve("left side", 1)')


def test_labels_are_given_by_the_names_that_gmsh_knows(tmp_path):
    (tmp_path / "mine.geo").write_text(NAMED)
    scene, text = tmp_path / "mine.edp", SCENE.replace(*MESHED[0]).replace(*MESHED[1])
    scene.write_text(text.replace("quasistatic", 'int low = gmshLabel("foot"), side = gmshLabel('
                                  '"left side");\nquasistatic').replace("on(4", "on(side")
                     .replace("contact() 1", "contact() low"))
    made = freefem.export(scene, tmp_path / "export", {"steps": "2"})
    assert made.contact_labels == [7] and set(made.labels) >= {1, 3, 7}
    assert made.label_names == {1: "left side", 7: "foot"}


@pytest.mark.parametrize("call, words", [
    ('gmshLabel("toe")', 'gmshLabel("toe"): no physical curve has this name; names that the files '
                         'give: left side, foot'),
    ('gmshLabel("foot"); body = gmshBody("mine.geo", 0.5)', "stands before gmshBody, which reads")])
def test_a_name_that_gmsh_does_not_know_is_refused(said, tmp_path, call, words):
    (tmp_path / "mine.geo").write_text(NAMED)
    late = "gmshBody" in call
    message = said(MESHED[0], (MESHED[1][0], "" if late else MESHED[1][1]),
                   ("quasistatic", f"int low = {call};\nquasistatic"))
    assert words in message and place(message) == 6


@pytest.mark.parametrize("old, new, line", [
    ("on(4", 'on("left side"', 9), ("traction(3", 'traction("left side"', 10),
    ("contact() 1", 'contact() "left side"', 12)])
@pytest.mark.some(1)
def test_a_name_in_the_place_of_a_label_gets_its_call(said, old, new, line):
    message = said((old, new))
    assert message.endswith('given by  int left = gmshLabel("left side");  after gmshBody')
    assert place(message) == line


def test_a_geometry_that_leaves_no_mesh_does_not_get_that_of_the_body_before(said, tmp_path):
    (tmp_path / "mine.geo").write_text(GEO)
    (tmp_path / "exit.geo").write_text(GEO + 'Mesh 2; Save "own.msh"; Exit;\n')
    bodies = 'addBody(gmshBody("mine.geo", 0.5))\naddBody(gmshBody("exit.geo", 0.5))'
    message = said(MESHED[0], (MESHED[1][0], bodies), parameters={})
    assert message.startswith("mine.edp line 6: gmsh leaves no mesh of exit.geo")


def test_a_mesh_of_freefem_is_none_of_gmsh(said, tmp_path):
    (tmp_path / "mine.msh").write_text("3 1 3\n0 0 0\n1 0 0\n0 1 0\n1 2 3 0\n1 2 1\n")
    message = said(MESHED[0], (MESHED[1][0], 'body = gmshBody("mine.msh", 1.);'), parameters={})
    assert message.endswith('is a mesh of FreeFEM\'s own: load it by  readmesh("mine.msh")')


@pytest.mark.parametrize("name", ["mine.geo", "other.msh", "another"])
def test_a_mesh_that_is_not_there_is_said_to_be(said, name):
    message = said(MESHED[0], (MESHED[1][0], f'body = gmshBody("{name}", 0.5);'),
                   parameters={"steps": "2"})
    assert message == f"mine.edp line 5: {name} is not there: paths are relative to the scene"


def test_a_number_that_no_geometry_reads_is_refused(said, tmp_path):
    (tmp_path / "mine.geo").write_text(GEO)
    wrong = ("body =", 'gmshNumber("lenght", 3.);\nbody =')
    message = said(*MESHED, wrong, parameters={})
    assert "reads the number lenght; did you mean length?" in message


def test_numbers_of_geometries_put_together_are_not_judged(tmp_path):
    (tmp_path / "mine.geo").write_text('Include "other.geo";\n')
    scene = tmp_path / "mine.edp"
    scene.write_text('gmshNumber("anything", 3.);\nbody = gmshBody("mine.geo", h);\n')
    script.check_gmsh_numbers(scene)


@pytest.mark.parametrize("code, refused", [
    ("real h = meshSize(0.5); // h of the soil\nbody = square(4, 4);", True),
    ("real a = 2., h = meshSize(0.5);\nbody = square(4, 4);", True),
    ("real h = meshSize(0.5);\nbody = square(a/h, 4);", False),
    ("real h = meshSize(0.5);\nmacro edges() int(1./h) //\nbody = square(edges, 4);", False),
    ("body = square(1./meshSize(0.5), 4);", False)])
def test_an_element_size_that_nothing_reads_is_refused(tmp_path, code, refused):
    scene = tmp_path / "mine.edp"
    scene.write_text(f'include "scene.idp"\n{code}\ninclude "export.idp"\n')
    if not refused:
        script.check_sizes(scene)
        return
    with pytest.raises(InputError, match="mine.edp line 2: nothing reads h, the element size from"):
        script.check_sizes(scene)


# ---- meshes that are counted ---------------------------------------------------------------------

@pytest.mark.parametrize("order", [1.0, 2.0])
def test_triangles_of_a_small_size_are_foretold_by_how_their_number_grows(order):
    """Scenes with the numbers 100 (0.1/h)^order: the one asked for is refused from 2e7 on."""
    def trial(parameters):
        return f"triangles: {round(100 * (0.1 / float(parameters['h'])) ** order)}"

    said, limit = "to be counted: 0.1", 0.1 * (100 / size.MOST) ** (1 / order)
    assert size.check(said, {"h": f"{1.1 * limit:.12g}"}, trial)
    with pytest.raises(InputError, match="would make a mesh of about 2e.07 triangles"):
        size.check(said, {"h": f"{limit / 1.1:.12g}"}, trial)
    assert not size.check("", {"h": "1"}, trial)


LAYERS = """border a(t=0, 4) { x = 2*(t < 1 ? t : (t < 2 ? 1 : (t < 3 ? 3 - t : 0)));
                     y = (t < 1 ? 0 : (t < 2 ? t - 1 : (t < 3 ? 1 : 4 - t))); label = 1 + int(t); }
border middle(t=0, 1) { x = 2*t; y = 0.5; label = 9; }
body = buildmesh(a(16) + middle(4));"""


def test_labels_that_a_mesh_has_are_those_of_its_boundary(said):
    """Not those of lines between its parts."""
    message = said(('subdomains("2x1");', 'subdomains("2");'),
                   ("rectangle(0., 2., 0., 1.);", LAYERS), ("contact() 1", "contact() 8"),
                   parameters={})
    assert message.endswith("no boundary with label 8; its labels are 1, 2, 3, 4")


@pytest.mark.parametrize("declared", [
    "contact() 9", "contact() 1 //\nmacro load2() traction(9, 0., 1.)",
    "contact() 1 //\nmacro contactPair() 3, 9", "contact() 1 //\nmacro probeLabels() [9]",
    "contact() 1 //\nmacro foundation() 9 //\nmacro foundationNormal() 1."])
@pytest.mark.some(1)
def test_labels_of_lines_inside_a_body(said, declared):
    """Two layers in one mesh: the line between them is a boundary of nothing, though a cut along it
    would make one of it. With the line dropped the label is none.
    """
    changes = (('subdomains("2x1");', 'subdomains("2");'), ("rectangle(0., 2., 0., 1.);", LAYERS),
               ("contact() 1", declared))
    message = said(*changes, parameters={})
    place = re.search(r"label 9 is that of a line inside the body, at \((.*?), (.*?)\)", message)
    assert 0 < float(place[1]) < 2 and float(place[2]) == 0.5
    held = said(*changes[:2], ("on(4, u1", "on(9, u1"), parameters={})
    assert "on(9, ...) names no boundary of the mesh, whose labels are 1, 2, 3, 4" in held
    dropped = ("macro young", "body = change(body, rmInternalEdges = 1);\nmacro young")
    assert "no boundary with label 9" in said(*changes, dropped, parameters={})


def test_labels_of_loads_are_whole_numbers(said):
    """FreeFEM would drop their decimals, and load the label that is left."""
    assert "no boundary with label 3.7" in said(("traction(3,", "traction(3.7,"))


def test_a_rectangle_beside_bodies_is_said_before_their_materials(said):
    message = said(("quasistatic", 'bodyMaterial("one", 1e3, 0.3);\naddBody(square(2, 2))\n'
                    'bodyMaterial("two", 1e3, 0.3);\nquasistatic'), parameters={})
    assert "rectangle(...) and addBody(...) are both called" in message and place(message) == 5
