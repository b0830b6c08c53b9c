"""Companions whose scenes another core exports while the run is solved."""

import json

import pytest
from mpi4py import MPI

from driver.estimates import levels as module
from driver.estimates.levels import Levels
from driver.options import Settings
from driver.scene import freefem


@pytest.fixture
def levels(tmp_path, monkeypatch):
    """levels(scene, **parameters): those of a machine with a core to spare."""
    monkeypatch.setattr(module, "CORES", 2)
    made = []

    def make(scene, **parameters):
        made.append(Levels(freefem.find_scene(scene), parameters, tmp_path / str(len(made)),
                           MPI.COMM_SELF, Settings()))
        return made[-1]

    yield make
    for one in made:
        one.close()


def said(place) -> str:
    """What an export says of itself."""
    return json.loads((place / "manifest.json").read_text())


def test_what_is_foreseen_is_exported_once_and_alike(levels, monkeypatch):
    ahead, plain, wanted = levels("indenter"), levels("indenter"), {"h": 0.4}
    place = ahead.place(**wanted)
    ahead.export_ahead((place, wanted))
    series, number = ahead._ahead[place]
    assert series.wait(number) > 0
    monkeypatch.setattr(ahead, "_export", None)  # it is not asked again
    problem = ahead.problem(**wanted)
    other = plain.problem(**wanted)
    assert said(place) == said(plain.place(**wanted))
    assert problem.manifest.nodes == other.manifest.nodes
    assert ahead.spent[("h", 0.4),]["export"] == series.wait(number)


def test_what_cannot_be_exported_ahead_is_refused_as_ever(levels):
    """Whoever asks for it gets the reason; nothing of the first trial is left."""
    of = levels("indenter", wrong="1")
    of.export_ahead((of.place(h=0.4), {"h": 0.4}))
    assert of._ahead[of.place(h=0.4)][0].wait(0) is None
    assert not of.place(h=0.4).exists()
    with pytest.raises(module.DriverError, match="WRONG"):
        of.problem(h=0.4)


def test_what_is_not_foreseen_is_exported_where_it_is_asked_for(levels):
    of = levels("indenter")
    of.export_ahead((of.place(h=0.4), {"h": 0.4}))
    assert of.problem(h=0.8).manifest.parameters["h"] == 0.8


def test_a_core_is_needed_for_it(levels, monkeypatch):
    monkeypatch.setattr(module, "CORES", 1)
    of = levels("indenter")
    of.export_ahead((of.place(h=0.4), {"h": 0.4}))
    assert not of._ahead and of.problem(h=0.4).manifest.parameters["h"] == 0.4


def test_nothing_is_left_of_exports_that_nobody_asked_for(levels):
    of = levels("indenter")
    of.export_ahead(*((of.place(h=size), {"h": size}) for size in (0.4, 0.2, 0.1)))
    of._ahead[of.place(h=0.4)][0].wait(0)
    of.close()
    assert not of.folder.exists()


@pytest.mark.parametrize("element", ["P1", pytest.param("P2", marks=pytest.mark.slow)])
def test_a_run_asks_for_what_was_foreseen(command_here, monkeypatch, tmp_path, element):
    """All of it, in that order: nothing is exported for nobody, and nobody waits for others'."""
    asked, wanted, exported = [], [], Levels.exported

    def ask(self, place, changes, sizes=None, key=None):
        asked.append(None if sizes else changes)
        return exported(self, place, changes, sizes, key)

    monkeypatch.setattr(module, "CORES", 2)
    monkeypatch.setattr(Levels, "exported", ask)
    monkeypatch.setattr(Levels, "export_ahead", lambda self, *exports: wanted.extend(
        changes for _, changes, *sizes in exports if not sizes))
    done = command_here("run", "SCENE=indenter", f"ELEMENT={element}", "H=1", "FIGURES=no",
                        "FIELDS=no", f"OUT={tmp_path / 'out'}")
    assert done.returncode == 0, done.stderr
    assert wanted and [changes for changes in asked if changes in wanted] == wanted
