"""Thermal strain: the heated bar of scene `thermal` in plane stress, and its plane-strain and
general variants.

All displacements are linear in x and y, so P1 elements are exact; what remains is rounding and the
tolerance of MPRGP, hence 1e-9 at RTOL=1e-13.
"""

import meshio
import numpy as np
import pytest

from driver.scene import freefem

E, NU, LENGTH, GAP, STRAIN = 210e3, 0.3, 100.0, 0.05, 1.2e-3
EXACT = {"rtol": 1e-13, "steps": 6}


def bar(strain, young, free):
    """Contact stress of the bar at thermal strain `strain`, which expands freely by `free` times
    it.
    """
    return -young * np.maximum(0.0, free * strain - GAP / LENGTH)


def last_stress(found):
    """Stresses (n, 4) and von Mises (n,) in the last VTU file."""
    mesh = meshio.read(sorted((found.directory / "fields").glob("step_*.vtu"))[-1])
    return mesh.cell_data["stress"][0], mesh.cell_data["von_mises"][0]


@pytest.mark.parametrize("subdomains", ["4x1", "5"])
def test_bar_against_a_wall(solved, subdomains):
    found = solved(scene="thermal", subdomains=subdomains, fields="yes", **EXACT)
    expected = bar(STRAIN * np.arange(1, 7) / 6, E, 1.0)
    assert (expected == 0).any() and (expected < 0).any()  # the gap closes within the history
    assert found.contact["sigma_n"] == pytest.approx(np.tile(expected[:, None],
                                                             found.contact["sigma_n"].shape[1]),
                                                     abs=1e-9 * abs(expected).max())
    stress, mises = last_stress(found)
    assert stress == pytest.approx(np.tile([expected[-1], 0, 0, 0], (len(stress), 1)),
                                   abs=1e-9 * E * STRAIN)
    assert mises == pytest.approx(-expected[-1], abs=1e-9 * E * STRAIN)


def test_plane_strain(solved, tmp_path):
    """Suppressed expansion across the plane: free strain (1 + nu) e, modulus E/(1 - nu^2), s33 = nu
    s11 - E e.
    """
    path = tmp_path / "strain.edp"
    path.write_text(freefem.find_scene("thermal").read_text().replace("macro planeStress() 1 //\n",
                                                                      ""))
    found = solved(scene=str(path), fields="yes", **EXACT)
    s11 = bar(STRAIN, E / (1 - NU**2), 1 + NU)
    s33 = NU * s11 - E * STRAIN
    stress, mises = last_stress(found)
    assert stress == pytest.approx(np.tile([s11, 0, s33, 0], (len(stress), 1)),
                                   abs=1e-9 * E * STRAIN)
    assert mises == pytest.approx(np.sqrt(s11**2 - s11 * s33 + s33**2), rel=1e-8)


def test_general_law_with_two_expansions(solved, tmp_path):
    """Orthotropic c_ij: the bar's modulus is c11 - c12^2/c22; the strain is given in two halves."""
    path = tmp_path / "general.edp"
    text = freefem.find_scene("thermal").read_text()
    text = text.replace("macro planeStress() 1 //\nmacro young() E //\nmacro poisson() nu //",
                        "macro c11() 200e3 //\nmacro c12() 30e3 //\nmacro c13() 0. //\n"
                        "macro c22() 90e3 //\nmacro c23() 0. //\nmacro c33() 40e3 //")
    text = text.replace("macro thermal1() (alpha*rise) //",
                        "macro thermal1() (0.25*alpha*rise) //\n"
                        "macro thermal2() (0.75*alpha*rise) //\n"
                        "macro amplitude2(t) t //")
    path.write_text(text)
    found = solved(scene=str(path), **EXACT)
    expected = bar(STRAIN * np.arange(1, 7) / 6, 200e3 - 30e3**2 / 90e3, 1.0)
    assert found.contact["sigma_n"] == pytest.approx(np.tile(expected[:, None],
                                                             found.contact["sigma_n"].shape[1]),
                                                     abs=1e-9 * abs(expected).max())
