"""The table of options: one line says all about an option, and everything else follows it."""

import dataclasses
import re
import subprocess
import sys

import pytest

from driver import cli, environment, options
from driver.arguments import parse_pairs
from driver.bench import suite as bench
from driver.errors import InputError
from driver.hard import suite as hard
from driver.runs.request import Request
from driver.runs.run import Run
from driver.scene import element_kinds
from driver.studies import table
from driver.studies.accuracy import stopping, sweeps


def test_every_option_stands_once_and_is_complete():
    keys = [(command, option.name) for option in options.TABLE for command in option.commands]
    assert len(keys) == len(set(keys))
    assert {command for command, _ in keys} == set(options.COMMANDS)
    for option in options.TABLE:
        assert option.name == option.name.lower() and option.help and option.kind.shown
        assert option.required or option.default_text, option.name


def test_an_effect_left_out_is_undeclared(solved):
    """In the run and in those beside it that estimate its errors, not only in the export."""
    run = solved("model", cells=2, subdomains="2x1", steps=2, without="friction", errors="yes")
    twin = solved("model-frictionless", cells=2, subdomains="2x1", steps=2, errors="yes")
    assert run.summary["effects"]["friction"] == "none" and run.summary["errors"]["quantities"]
    assert run.summary["sizes"] == twin.summary["sizes"]
    assert not run.contact["sigma_t"].any() and run.contact["sigma_n"].any()
    wrong = solved("model", without="frictoin")
    assert wrong.status == 2 and "frictoin" in wrong.reason and "\n" not in wrong.reason


@pytest.mark.parametrize("option", [option for option in options.TABLE if not option.otherwise],
                         ids=lambda option: f"{option.commands[0]} {option.name}")
def test_defaults_read_as_on_the_command_line(option):
    """What help shows as default gives the default; paths there are relative to the checkout."""
    if option.required:
        return
    value = option.read(option.default_text)
    if option.name == "out":
        value = environment.ROOT / value
    assert value == option.default and type(value) is type(option.default)


def test_choices_are_those_that_their_readers_know():
    assert options.find("run", "element").kind.choices == tuple(element_kinds.NODES)
    assert options.find("table", "method").kind.choices == tuple(table.METHODS)
    assert options.find("table", "rows").kind.choices == tuple(map(str, table.ROWS))
    assert options.find("accuracy", "rows").kind.choices == tuple(map(str, stopping.ROWS))
    assert options.find("accuracy", "effort").kind.choices == tuple(sweeps.EFFORTS)
    drawn = {"random"}  # from seeds, no list
    assert all(hard.cases(family) for family in set(hard.FAMILIES) - drawn)
    assert "products" in bench.PARTS


def test_settings_are_the_solvers_part_of_the_table():
    fields = {field.name: (field.type, field.default)
              for field in dataclasses.fields(options.Settings)}
    assert fields == {option.name: (type(option.default), option.default)
                      for option in options.SETTINGS}


def test_commands_are_entries_and_targets():
    assert set(cli.ENTRIES) == {*options.COMMANDS, "solve"}
    makefile = (environment.ROOT / "Makefile").read_text()
    targets = re.search("^COMMANDS := (.*)$", makefile, re.MULTILINE)[1].split()
    assert {*targets, "figures", "report"} == set(options.COMMANDS)


def test_help_names_every_option_and_loads_nothing_heavy():
    code = "import sys, driver.options; print('numpy' in sys.modules, driver.options.usage())"
    done = subprocess.run([sys.executable, "-c", code], cwd=environment.ROOT, capture_output=True,
                          text=True, check=True)
    heavy, text = done.stdout.split(" ", 1)
    assert heavy == "False" and max(map(len, text.splitlines())) <= 120
    for option in options.TABLE:
        assert f"{option.name.upper()}={option.kind.shown}" in text
    for command in options.COMMANDS.values():
        assert re.search(rf"^{command.name} +{re.escape(command.help)}$", text, re.MULTILINE)


def test_reference_has_a_row_for_every_option():
    rows = [line for line in options.reference().splitlines() if line.startswith("| `")]
    assert len(rows) == len(options.TABLE)
    for row, option in zip(rows, options.TABLE):
        cells = re.split(r"(?<!\\)\|", row)[1:-1]
        assert len(cells) == 6 and cells[0].strip() == f"`{option.name.upper()}`"


@pytest.mark.parametrize("command, words, reason", [
    ("effects", "SCENE=model FIGURES=no", "the study decides on FIGURES itself"),
    ("accuracy", "SCENE=model ADAPT=1", "the study decides on ADAPT itself"),
    ("study", "SCENE=model RESUME=no", "RESUME belongs to single runs"),
    ("effects", "SCENE=model WITHOUT=gap", "the study decides on WITHOUT itself"),
    ("run", "SCENE=model WITHOUT=gap,", "WITHOUT=gap, lacks a name"),
    ("study", "FRICTION=0.3", "make study needs SCENE="),
    ("model", "SCENE=punch", "make model decides on SCENE itself"),
    ("saddle", "RTOL=1e-3", "the matrix does not depend on RTOL"),
    ("run", "SCENE=model ACCURACY=1% STEPS=3", "ACCURACY chooses STEPS itself"),
    ("run", "SCENE=model INNER_RTOL=2", "relative: it must be positive, at most 1, not .2."),
    ("run", "SCENE=model ELEMENT=P3", "ELEMENT must be one of P1, P2, P2-mixed, not 'P3'"),
    ("table", "OUT=here", "make table has no option OUT; it has NP, HOSTS, ROWS, METHOD, FRESH"),
    ("table", "ROWS=1,7", "ROWS expects some of 1,2,3,4,5, not '7'"),
    ("table", "NP=0", "NP expects a number of ranks from 1 to "),
    ("hard", "FAST=perhaps", "FAST must be yes or no, not 'perhaps'"),
    ("hard", "JOBS=many", "JOBS expects a number of processes, not 'many'"),
    ("bench", "PARTS=product", "PARTS expects some of products,"),
    ("bench", "PARTS=tao,", "PARTS expects some of .* not ''"),
])
def test_refusals(command, words, reason):
    with pytest.raises(InputError, match=reason):
        options.read(command, parse_pairs(words.split()))


@pytest.mark.parametrize("cycles", ["jump", "jump 1%", "10 jump", "until settled"])
def test_a_search_compares_runs_of_the_same_cycles(cycles):
    """Jumps, and whether cycles settle, depend on mesh and steps."""
    given = {"scene": "mindlin", "accuracy": "1%"}
    with pytest.raises(InputError, match="give their number"):
        Run.from_pairs({**given, "cycles": cycles})
    assert Run.from_pairs({**given, "cycles": "10"}).settings["cycles"] == "10"


def test_given_options_are_sorted():
    words = "SCENE=model Steps=4 ACCURACY=2%,slip"
    with pytest.raises(InputError, match="ACCURACY chooses STEPS"):
        options.read("run", parse_pairs(words.split()))
    words = "SCENE=model UNIQUENESS=no LOADING=monotone FRICTION=0.5 ACCURACY=2%,slip FIELDS=no"
    given = options.read("run", parse_pairs(words.split()))
    assert given.settings == {"uniqueness": "no"}
    assert given.parameters == {"loading": "monotone", "friction": "0.5"}
    assert given["accuracy"] == (0.02, "slip") and given["fields"] is False and given["np"] is None


def test_lists_keep_their_order_and_lose_repetitions():
    assert options.read("hard", {"family": "scale,contact,scale"})["family"] == ["scale", "contact"]


def test_requests_survive_their_file(tmp_path):
    """Ranks of their own get what this process would have used."""
    run = Run.from_pairs({"scene": "model", "max_products": "70", "without": "friction"})
    request = Request.of(run, refined=("a", "b"), study="friction", values=("0.1", "0.2"),
                         fingerprint={"program": "x"}, seconds={"export": 0.1})
    request.write(tmp_path)
    assert Request.read(tmp_path) == request and request.settings == {"max_products": 70}
