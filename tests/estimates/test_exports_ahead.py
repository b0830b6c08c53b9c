"""Exports of companions that another core makes while the run is solved."""

import fcntl
import json
import time

import pytest

from driver.errors import DriverError
from driver.estimates import exports as module
from driver.estimates.exports import Exports
from driver.estimates.levels import Levels
from driver.options import Settings
from driver.scene import freefem

COARSE, FINE = {"h": 0.8}, {"h": 0.4}


@pytest.fixture
def exports(tmp_path, monkeypatch):
    """exports(**parameters): those of a scene, on a machine with a core to spare."""
    monkeypatch.setattr(module, "CORES", 2)
    made = []

    def make(**parameters) -> Exports:
        made.append(Exports(freefem.find_scene("indenter"), parameters, (),
                            tmp_path / str(len(made))))
        return made[-1]

    yield make
    for one in made:
        one.close()


def said(place) -> dict:
    """What an export says of itself."""
    return json.loads((place / "manifest.json").read_text())


def test_what_is_asked_for_later_is_made_once_and_alike(exports, monkeypatch):
    ahead, plain = exports(), exports()
    place, other = ahead.folder / "fine", plain.folder / "fine"
    ahead.ahead((place, FINE))
    monkeypatch.setattr(ahead, "_make", None)  # not here
    assert ahead.made(place, FINE) > 0
    plain.made(other, FINE)
    assert said(place) == said(other)


def test_what_cannot_be_made_ahead_is_refused_where_it_is_asked_for(exports):
    """With the reason; nothing of the first trial is left."""
    of = exports(wrong="1")
    place = of.folder / "fine"
    of.ahead((place, FINE))
    series, number = of._ahead[place]
    assert series.wait(number) is None and not place.exists()
    with pytest.raises(DriverError, match="WRONG"):
        of.made(place, FINE)


def test_a_core_is_needed_for_it(exports, monkeypatch):
    monkeypatch.setattr(module, "CORES", 1)
    of = exports()
    of.ahead((of.folder / "fine", FINE))
    assert not of._ahead
    of.made(of.folder / "fine", FINE)
    assert said(of.folder / "fine")["parameters"]["h"] == 0.4


def test_nothing_is_left_of_exports_that_nobody_asked_for(exports):
    of = exports()
    of.ahead((of.folder / "coarse", COARSE), (of.folder / "fine", FINE))
    series, number = of._ahead[of.folder / "coarse"]
    series.wait(number)
    of.close()
    assert not of.folder.exists()


def test_one_export_at_a_time_and_what_is_waited_for_comes_soon(exports, monkeypatch, tmp_path):
    """Scenes may call programs that leave files of one name."""
    order, busy = tmp_path / "order", tmp_path / "busy"

    def asked() -> bool:
        """Whether one is waited for, or was."""
        with open(of.folder / "asked", "w", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
        return "waited for" in order.read_text()

    def make(_self, place, *_) -> None:
        busy.mkdir()  # fails where another one is at work
        with open(order, "a", encoding="utf-8") as file:
            file.write(f"{place.name}\n")
        trials = 0 if place.name == "waited for" else 500
        while trials and not asked():
            time.sleep(0.001)
            trials -= 1
        busy.rmdir()

    monkeypatch.setattr(Exports, "_make", make)
    of = exports()
    first, second = ([of.folder / f"{name}{k}" for k in range(6)] for name in "ab")
    for places in first, second:
        of.ahead(*((place, {}) for place in places))
    while not order.exists():
        time.sleep(0.001)
    of.made(of.folder / "waited for", {})
    for place in first + second:
        assert of.made(place, {}) is not None
    assert len(order.read_text().splitlines()) == 13  # none was made again for want of an answer
    # behind what was under way, and what the other series waited with before
    assert order.read_text().splitlines().index("waited for") <= 2


@pytest.mark.parametrize("element", ["P1", pytest.param("P2", marks=pytest.mark.slow)])
def test_a_run_asks_for_what_was_foreseen(command_here, monkeypatch, tmp_path, element):
    """All of it, in that order: nothing is exported for nobody, and nobody waits for others'."""
    asked, wanted, exported = [], [], Levels.exported

    def ask(self, place, changes, sizes=None, key=None):
        asked.append(None if sizes else changes)
        return exported(self, place, changes, sizes, key)

    monkeypatch.setattr(Levels, "exported", ask)
    monkeypatch.setattr(Levels, "export_ahead", lambda self, *exports: wanted.extend(
        changes for _, changes, *sizes in exports if not sizes))
    done = command_here("run", "SCENE=pressfit", f"ELEMENT={element}", "FIGURES=no",
                        "FIELDS=no", f"OUT={tmp_path / 'out'}")
    assert done.returncode == 0, done.stderr
    assert wanted and [changes for changes in asked if changes in wanted] == wanted


def test_several_ranks_make_nothing_ahead(tmp_path, monkeypatch):
    """They keep the cores busy."""
    class Two:
        """A communicator's size."""
        size = 2

    monkeypatch.setattr(Exports, "ahead", None)
    Levels(freefem.find_scene("indenter"), {}, tmp_path, Two(), Settings()).export_ahead()
