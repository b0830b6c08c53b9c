"""Units are spelt as engineers do, and values in files are in what is spelt."""

import pytest

from driver import units


@pytest.mark.parametrize("length, stress, force, energy", [
    ("m", "Pa", "N/m", "J/m"), ("mm", "MPa", "N/mm", "J/m"), ("m", "MPa", "MN/m", "MJ/m"),
    ("mm", "GPa", "kN/mm", "kJ/m"), ("mm", "Pa", "µN/mm", "µJ/m"),
    ("um", "MPa", "µN/um", "µJ/m"), ("mm", "N/mm^2", "N/mm", "J/m"),
    ("m", "kN/m²", "kN/m", "kJ/m"),
    ("mm", "kN/mm2", "kN/mm", "kJ/m"), ("mm", "xN/mm2", "xN/mm2·mm", "xN/mm2·mm²"),
    ("m", "kPa", "kN/m", "kJ/m"), ("in", "psi", "psi·in", "psi·in²"), ("1", "1", "1", "1"),
    ("m", "1", "m", "m²")])
def test_force_and_energy(length, stress, force, energy):
    given = {"length": length, "stress": stress}
    assert units.spelt(1, 1, given) == force and units.spelt(1, 2, given) == energy
    assert units.generic("stress length", given) == force
    assert units.spelt(1, 0, given) == stress and units.spelt(0, 1, given) == length
    assert units.generic("1", given) == ""


@pytest.mark.parametrize("length, stress", [("m", "Pa"), ("mm", "MPa"), ("mm", "kPa"),
                                            ("µm", "GPa"), ("m", "MPa")])
def test_the_spelt_unit_has_the_size_of_the_product(length, stress):
    """stress x length is force / length: the same power of ten in SI units, by definition."""
    given = {"length": length, "stress": stress}
    (a, _), (b, _) = units.split_unit(stress), units.split_unit(length)
    force, thickness = units.spelt(1, 1, given).split("/")
    assert units.split_unit(force)[0] - units.split_unit(thickness)[0] == a + b
    assert units.split_unit(units.spelt(1, 2, given)) == (a + 2 * b, "J/m")
