"""Numbers and texts as people write them elsewhere: 0,3, 210 000, 30 %, 0.1mm, 'mm'."""

import pytest

from driver.errors import InputError
from driver.scene import explain, freefem, numerals

SCENE = """include "scene.idp"
real F = physical("friction", 0.3);
units("mm", "MPa");
subdomains("2x1");
rectangle(0., 2., 0., 1.);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 2., -10.) //
macro contact() 1 //
macro friction() F //
include "export.idp"
"""


@pytest.mark.parametrize("code, number", [
    ("0,3", "0,3"), ("(region == 2 ? 210 000 : 70e3)", "210 000"), ("1'000'000", "1'000"),
    ("(3, 0., -100,5)", "100,5"), ("0.3", ""), ("min(1., 2*t)", ""), ("[1, 2]", ""), ("7 // 3", ""),
    ("traction(3, 2., -10.)", ""), ("1.5*t", ""), ("x > 2 && y < 3", "")])
def test_a_comma_or_a_blank_inside_a_number_is_named(code, number):
    said = numerals.pointless(code)
    assert said == "" if not number else said.startswith(f"; is {number} one number?")


@pytest.mark.parametrize("code, token, found", [
    ("on(4,1,u1=0.,u2==)", ")", False), ("1,2 3", "3", False), (" = 1,2", "=", False),
    ("210,5", "5", True), ("210 000", "000", True)])
def test_labels_without_blanks_are_no_number_with_a_comma(code, token, found):
    assert bool(numerals.pointless(code, token)) == found


@pytest.mark.parametrize("call, found", [
    ('rectangle(0,2,0,"a");', False), ("rectangle(0,2,0,1,2);", False),
    ("rectangle(0, 2, 0, 1, 2);", False),
    ("rectangle(0., 2,5, 0., 1.);", True), ("rectangle(0,5, 2,5, sin(1.), 1.);", True)])
def test_commas_of_a_call_are_asked_about_if_they_are_too_many(call, found):
    assert ("one number?" in explain._form(call)) == found


@pytest.mark.parametrize("code, token, words", [
    ("units('mm', 'MPa');", "'", 'texts stand in double quotes: "mm"'),
    ('real F = physical("friction", 30%);', ")", "write 30 % as 0.3"),
    ("subdomains(4x2);", "x2", 'it takes a text: subdomains("4x2")'),
    ("int k = n % 2;", ";", "")])
def test_a_line_that_is_not_understood_says_what_to_write(code, token, words):
    said = explain._of_line(code, token)
    assert words in said and bool(said) == bool(words)


@pytest.mark.parametrize("token, content, words", [
    ("=", " = 1000.", "without a ="), ("=", "on(4, u1 = 0., = 0.)", ""),
    (",", "on(4, u1 = 0.), on(3, u2 = 0.)", "terms are added"),
    (",", "on(4, u1 = 0.,, u2 = 0.)", ""), (",", "(x > 1 ? 0.1, 0.2)", "")])
def test_a_token_has_a_hint_where_it_stands_for_a_mistake_alone(token, content, words):
    said = explain._hint(token, content)
    assert words in said and bool(said) == bool(words)


def test_calls_of_the_gmsh_part_show_their_form():
    assert 'gmshBody("file.geo", h)' in explain._form('body = gmshBody("mine.geo");')
    assert 'gmshNumber("name", value)' in explain._form('gmshNumber("h", "fine");')
    assert explain._form("body = mine(3);") == ""


@pytest.mark.parametrize("old, new, words", [
    ("-10.)", "-10,5)", "it is traction(label, px, py); is 10,5 one number?"),
    ("young() 1000.", "young() 210 000", "is 210 000 one number?"),
    ("young() 1000.", "young() = 1000.", "without a ="),
    (".) //\nmacro contact", ".), pressure(3, 1.) //\nmacro contact", "terms are added: on("),
    ("friction() F", "friction() 0.3mm", "numbers have no unit; units(...) names those")])
@pytest.mark.some(1)
def test_freefem_s_words_are_followed_by_a_remedy(tmp_path, old, new, words):
    assert old in SCENE
    scene = tmp_path / "mine.edp"
    scene.write_text(SCENE.replace(old, new))
    with pytest.raises(InputError) as refused:
        freefem.export(scene, tmp_path / "export", {})
    assert words in str(refused.value) and "mine.edp line " in str(refused.value)


def test_a_text_that_is_no_name_gets_no_call_of_gmshlabel(tmp_path):
    scene = tmp_path / "mine.edp"
    scene.write_text(SCENE.replace("macro friction()", 'macro gap() "0.1" //\nmacro friction()'))
    assert explain._by_name(scene, "gap") == ""
    scene.write_text(SCENE.replace("contact() 1", 'contact() "low side"'))
    assert 'int low = gmshLabel("low side");' in explain._by_name(scene, "contact")
