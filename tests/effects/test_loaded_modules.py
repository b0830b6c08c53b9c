"""What a scene does not declare is not imported."""

import importlib.util

import pytest

from driver.scene.manifest import read_manifest

# what serves something that an elastic cantilever without contact does not declare
SERVES = {
    "pairs of bodies": {"driver.contact.mortar", "driver.energy_norm.pair_bound"},
    "friction": {"driver.qp.complementarity", "driver.march.uniqueness",
                 "driver.march.globalization", "driver.march.condensation"},
    "error estimates": {"driver.estimates.companions", "driver.energy_norm.energy",
                        "driver.energy_norm.equilibration"},
    "accuracy asked for": {"driver.runs.goal", "driver.runs.search"},
}
# What is imported all the same; to become empty.
KNOWN = {
    "pairs of bodies": set(),
    "friction": SERVES["friction"],
    "error estimates": {"driver.energy_norm.energy", "driver.energy_norm.equilibration"},
    "accuracy asked for": set(),
    "rooms": {"quasistatic"},
}
SCENES = {"cantilever": {"cells": 2}, "model": {"cells": 2, "steps": 2}, "thermal": {"cells": 2},
          "punch": {"h": 0.1, "steps": 2}}


def modules_of(loaded, scene: str) -> set[str]:
    """Names of all modules that a small run of `scene` has imported."""
    modules, _ = loaded(scene, *(f"{name}={value}" for name, value in SCENES[scene].items()))
    assert "driver.runs.solve" in modules
    return modules


@pytest.mark.parametrize("effect", SERVES)
def test_what_is_not_declared_is_not_imported(loaded, effect):
    assert all(map(importlib.util.find_spec, SERVES[effect]))
    assert modules_of(loaded, "cantilever") & SERVES[effect] == KNOWN[effect]


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.some(2)
def test_rooms_are_imported_as_declared(loaded, exported, scene):
    declared = set(read_manifest(exported(scene, **SCENES[scene])).rooms)
    rooms = {name.removeprefix("driver.effects.") for name in modules_of(loaded, scene)
             if name.startswith("driver.effects.")}
    assert declared and declared <= rooms <= declared | KNOWN["rooms"]


@pytest.mark.parametrize("package", ["figures", "studies", "hard", "bench"])
def test_a_run_imports_no_package_that_only_studies_need(loaded, package):
    assert f"driver.{package}" not in modules_of(loaded, "cantilever")
