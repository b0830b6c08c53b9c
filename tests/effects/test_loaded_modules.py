"""What a scene does not declare is not imported."""

import importlib.util

import pytest

# what serves some effect, with a small scene that declares none of these
SERVES = {
    "pairs of bodies": {"driver.contact.mortar", "driver.estimates.pair_bound",
                        "driver.results.relinearization"},
    "friction": {"driver.qp.complementarity", "driver.march.uniqueness",
                 "driver.march.globalization", "driver.march.condensation"},
    "bodies without support": {"driver.march.free_bodies"},
    "error estimates": {"driver.estimates.levels", "driver.estimates.energy",
                        "driver.estimates.equilibration"},
    "accuracy asked for": {"driver.runs.goal"},
}
# What is imported all the same; to become empty.
KNOWN = {
    "pairs of bodies": SERVES["pairs of bodies"],
    "friction": SERVES["friction"],
    "bodies without support": SERVES["bodies without support"],
    "error estimates": {"driver.estimates.energy", "driver.estimates.equilibration"},
    "accuracy asked for": SERVES["accuracy asked for"],
}


@pytest.mark.parametrize("effect", SERVES)
def test_what_is_not_declared_is_not_imported(loaded, effect):
    """Of an elastic cantilever without contact; every name is that of a module."""
    modules, _ = loaded("cantilever", "CELLS=2")
    assert "driver.runs.solve" in modules and all(map(importlib.util.find_spec, SERVES[effect]))
    assert modules & SERVES[effect] == KNOWN[effect]


@pytest.mark.parametrize("effect", ["studies", "hard", "bench"])
def test_a_run_imports_no_package_above_it(loaded, effect):
    assert f"driver.{effect}" not in loaded("cantilever", "CELLS=2")[0]
