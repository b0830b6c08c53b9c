"""Choices ? : that FreeFEM does not take as they are written are refused, others are not."""

import pytest

from driver.errors import InputError
from driver.scene import choices, freefem, grammar, script, seal

SCENE = """include "scene.idp"
real graded = physical("graded", 1.);
int[int] many = [1, 2];
subdomains("2x1");
rectangle(0., 2., 0., 1.);
macro far() (1. - x) //
macro level() 3.*graded //
func slope = 2.*y;
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, VALUE, 0.) //
include "export.idp"
"""


@pytest.fixture
def scene(tmp_path):
    """scene(value): the scene with this load."""
    def write(value: str):
        path = tmp_path / "mine.edp"
        path.write_text(SCENE.replace("VALUE", value))
        return path

    return write


@pytest.mark.parametrize("value", [
    "(graded < 0.5 ? 0. : x)", "graded < 0.5 ? 0. : x", "3.*(graded < 0.5 ? 2.*pi : 1. + x) + y",
    "(graded < 0.5 ? sqrt(graded) : far)", "(level < 0.5 ? level : slope)",
    "(graded < 0.5 ? 0. : (x < 1. ? 0. : 1.))", "max((graded > 2. ? 0. : label), 0)",
    "x*(2.*(graded - 1.) < 0.5 ? 0. : N.y)"])
def test_a_second_value_that_freefem_loses_is_refused(scene, value):
    """Neither condition nor first value depend on the place, the second one does."""
    with pytest.raises(InputError, match=r"mine.edp line 12: of \(.* FreeFEM loses the second"):
        script.check_statements(scene(value))


@pytest.mark.parametrize("value", [
    "(graded >= 0.5 ? x : 0.)", "(graded < 0.5 ? 1. : 2.)", "(x < 0.5 ? 0. : graded)",
    "(graded < 0.5 ? far : x)", "(graded < 0.5 ? level : pi)", "(many[0] < x ? 0. : x)",
    "x*(graded < 0.5 ? 1. : level)", "(label == 1 ? 0. : x)", "(slope < 1. ? 0. : x)"])
def test_choices_that_freefem_takes_are_not(scene, value):
    assert not list(choices.losing(grammar.sources(scene(value))))


def test_expressions_with_a_name_are_looked_at_and_conditions_of_supports_are_not(scene):
    """The values of supports are not integrated."""
    path = scene("slope")
    text = path.read_text()
    path.write_text(text.replace("func slope = 2.*y;", "func slope = (graded < 1. ? 0. : y);"))
    assert [(macro.name, macro.line) for macro, _ in choices.losing(grammar.sources(path))] == [
        ("slope", 8)]
    path.write_text(text.replace("u2 = 0.)", "u2 = (graded < 1. ? 0. : y))"))
    assert not list(choices.losing(grammar.sources(path)))


def test_what_is_said_shows_the_choice_as_it_is_written(scene):
    value = "(2.*(graded - 1.) < 0.5 ? 0. : max(x, (y)^2))"
    (_, choice), = choices.losing(grammar.sources(scene(value)))
    assert choice == value[1:-1]


def test_a_choice_that_is_turned_round_is_its_value(scene, tmp_path):
    """As the refusal says: the same records as those of the value alone."""
    contents = set()
    for k, value in enumerate(("x", "(graded >= 0.5 ? x : 0.)")):
        path = scene(f"{value} + 0.*(far + level)")  # as what nothing reads is refused
        freefem.export(path, tmp_path / str(k), {"cells": "2"})
        contents.add(seal.read(tmp_path / str(k)).content)
    assert len(contents) == 1
