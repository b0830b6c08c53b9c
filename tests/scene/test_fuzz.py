"""Random input: command-line words, manifests and binary records either work or are refused by a
DriverError.

Each target has 50 cases here and 2,000 in the long tests.
"""

import contextlib
import json
import re
import signal
from fractions import Fraction

import numpy as np
import pytest
from conftest import read_problem
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from driver import cli, options
from driver.runs import run
from driver.scene import seal
from driver.errors import DriverError

CASES = pytest.mark.parametrize("cases", [50, pytest.param(2000, marks=pytest.mark.slow)])
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # absurd numbers overflow


def fuzz(cases: int, strategy, check) -> None:
    """`check` on examples of `strategy`, the same ones in every run of the tests; none may take 20
    seconds.
    """
    @settings(max_examples=cases, deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))
    @given(strategy)
    def each(example):
        signal.setitimer(signal.ITIMER_REAL, 20)
        try:
            check(example)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)

    def hangs(*_):
        raise AssertionError("takes longer than 20 seconds")

    before = signal.signal(signal.SIGALRM, hangs)
    try:
        each()
    finally:
        signal.signal(signal.SIGALRM, before)


# ------------------------------------------------------------------------------ command line

SETTINGS = {name: field for name, field in options.Settings.__dataclass_fields__.items()}
NAMES = st.one_of(st.sampled_from([*SETTINGS, *options.OF_RUNS, "friction", "steps", "subdomains",
                                   "export", "sizes", "v"]),
                  st.text(max_size=8))
NUMBERS = st.one_of(st.floats().map(repr), st.integers().map(str), st.integers(0, 40).map(str),
                    st.from_regex(r"[+-]?[0-9_]{0,4}[.,]?[0-9_]{0,4}([eEdD][+-]?[0-9]{0,4})?",
                                  fullmatch=True))
VALUES = st.one_of(NUMBERS,
                   st.sampled_from(["yes", "no", "model", "dirichlet", "none", "load", "cg", "4x2",
                                    "²", "١٢", "1" * 5000, "a" * 5000, "/", "..", "inf", "nan",
                                    "0x10", "True", " 1", "1\n"]),
                   st.text(max_size=12))
WORDS = st.lists(st.one_of(st.builds("{}={}".format, NAMES, VALUES), st.text(max_size=12)),
                 max_size=4)


@CASES
def test_words(cases):
    """Numbers are read as what they say in plain decimal notation, and nothing else is a number."""
    def check(words):
        try:
            pairs = cli.parse_pairs(["SCENE=model", *words])
            found = run.Run.from_pairs(pairs)
        except DriverError as problem:
            assert problem.exit_status == 2 and "\n" not in str(problem)
            return
        for name, value in found.settings.items():
            if SETTINGS[name].type is not str:
                assert re.fullmatch(r"\+?[0-9.]+([eE][+-]?[0-9]+)?", pairs[name]) and value > 0
                assert value == float(Fraction(pairs[name])) == (int(value)
                                                                 if SETTINGS[name].type is int
                                                                 else value)
        assert 1 <= found.front_ranks == int(pairs.get("np", "1"))
        assert pairs.get("np", "1").isascii()
        assert not {"export", "sizes", "v"} & set(found.parameters)

    fuzz(cases, WORDS, check)


@pytest.mark.parametrize("word",
                         ["NP=1_0", "NP=²", "NP=1000000", "RTOL=1_0e-8", "RTOL=１e-8",
                          "RTOL=0x1p-20",
                                  "MAX_PRODUCTS=1e3",
                                  "ADAPT=1000", "EXPORT=/tmp", "V=100", "FRICTION=0.3\n", "NP="
                                  + "1" * 5000])
def test_words_that_python_or_freefem_would_take_for_something_else(word):
    with pytest.raises(DriverError) as found:
        run.Run.from_pairs(cli.parse_pairs(["SCENE=model", word]))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("word", ["SCENE=" + "a" * 5000, "SCENE=a\0b", "SCENE=/", "SCENE=..",
                                  "SCENE=" + "/a" * 4000 + ".edp"])
def test_names_of_no_scene(word):
    with pytest.raises(DriverError):
        run.Run.from_pairs(cli.parse_pairs([word]))


# ------------------------------------------------------------------------------------ exports

JSON = st.recursive(st.one_of(st.none(), st.booleans(), st.integers(), st.integers(-3, 12),
                              st.floats(), st.text(max_size=6),
                              st.sampled_from([2**62, 1e308, -1, "P1", "none", "coulomb",
                                               "displacement", "1"])),
                    lambda inner: st.one_of(st.lists(inner, max_size=4),
                                            st.dictionaries(st.text(max_size=6), inner,
                                                            max_size=3)),
                    max_leaves=6)


@pytest.fixture(scope="module")
def export(exported, tmp_path_factory):
    """A private copy of a small export with prescribed displacements and a slip law: (directory,
    manifest, block).
    """
    source, directory = exported("punch", subdomains=2, steps=2), tmp_path_factory.mktemp("fuzz")
    for path in source.iterdir():
        if path.is_file():
            (directory / path.name).write_bytes(path.read_bytes())
    manifest, block = directory / "manifest.json", directory / "block-0.bin"
    return directory, manifest.read_bytes(), block.read_bytes()


def read_or_refuse(directory) -> bool:
    """Whether the export is accepted; a refusal is one line."""
    try:
        read_problem(directory, reduce=False)
    except DriverError as problem:
        assert "\n" not in str(problem)
        return False
    return True


@contextlib.contextmanager
def restored(export):
    directory, manifest, block = export
    try:
        yield directory
    finally:
        (directory / "manifest.json").write_bytes(manifest)
        (directory / "block-0.bin").write_bytes(block)


@CASES
def test_changed_files_are_refused_whatever_the_change(cases, export):
    """As sealed: bytes overwritten, taken out or put in anywhere in either file."""
    directory, *content = export
    seal.write(directory, "", ["block-0.bin"])
    edits = st.tuples(st.integers(0, 1), st.floats(0, 1, exclude_max=True), st.integers(0, 9),
                      st.binary(max_size=9))

    def check(edit):
        which, place, drop, put = edit
        whole = content[which]
        at = int(place * len(whole))
        changed = whole[:at] + put + whole[at + drop :]
        with restored(export):
            (directory / ("manifest.json", "block-0.bin")[which]).write_bytes(changed)
            assert read_or_refuse(directory) == (changed == whole)

    fuzz(cases, edits, check)


@CASES
def test_manifests(cases, export):
    """Any entry, at any depth, replaced by anything that JSON can hold, and vouched for by a seal.
    """
    directory, manifest, _ = export
    original = json.loads(manifest)
    names = st.sampled_from([*original, "contact_labels"])

    def check(example):
        name, keys, value = example
        changed = json.loads(manifest)
        place, key = changed, name
        for pick in keys:
            inner = place.get(key) if isinstance(place, dict) else place[key]
            inside = []
            if isinstance(inner, dict):
                inside = list(inner)
            elif isinstance(inner, list):
                inside = list(range(len(inner)))
            if not inside:
                break
            place, key = inner, inside[pick % len(inside)]
        place[key] = value
        with restored(export):
            (directory / "manifest.json").write_text(json.dumps(changed))
            seal.write(directory, "", ["block-0.bin"])
            read_or_refuse(directory)

    fuzz(cases, st.tuples(names, st.lists(st.integers(0, 50), max_size=2), JSON), check)


@CASES
def test_records(cases, export):
    """Words of the records overwritten, moved, taken out or put in twice, and vouched for by a
    seal.
    """
    directory, _, block = export
    words = np.frombuffer(block, np.int64)
    wild = st.one_of(st.integers(-3, 40), st.integers(-(2**63), 2**63 - 1),
                     st.floats().map(lambda v: int(np.float64(v).view(np.int64))))
    edits = st.lists(st.tuples(st.sampled_from(["set", "swap", "drop", "twice"]),
                               st.floats(0, 1, exclude_max=True),
                               st.integers(1, 40), wild), min_size=1, max_size=3)

    def check(example):
        changed = words.copy()
        for kind, place, count, value in example:
            at = int(place * len(changed))
            if kind == "set" and len(changed):
                changed[at] = value
            elif kind == "swap":
                piece = changed[at : at + 2 * (count // 2)].copy()
                changed[at : at + len(piece)] = np.roll(piece, count // 2)
            elif kind == "drop":
                changed = np.delete(changed, slice(at, at + count))
            elif kind == "twice":
                changed = np.concatenate([changed[: at + count], changed[at:]])
        with restored(export):
            (directory / "block-0.bin").write_bytes(changed.tobytes())
            seal.write(directory, "", ["block-0.bin"])
            read_or_refuse(directory)

    fuzz(cases, edits, check)


@CASES
def test_seals(cases, export):
    """seal.json itself is anything."""
    directory, *_ = export
    seal.write(directory, "", ["block-0.bin"])
    whole = json.loads((directory / "seal.json").read_text())
    text = st.one_of(JSON.map(json.dumps), st.binary(max_size=30).map(lambda b: b.decode("latin1")),
                     st.tuples(st.sampled_from(list(whole)),
                               JSON).map(lambda pair: json.dumps({**whole, pair[0]: pair[1]})))

    def check(example):
        (directory / "seal.json").write_text(example, encoding="utf-8", errors="surrogatepass")
        read_or_refuse(directory)

    fuzz(cases, text, check)
