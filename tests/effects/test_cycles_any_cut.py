"""Cycles do not depend on the cut, nor, in the last bit, on ranks: bodies of many kinds.

Between cuts contact forces agree to 1e-6 of the largest, displacements to 1e-6 of theirs, as those
of other scenes do (tests/scenes/test_any_cut.py); what cycles come to (cycles.csv) to 1e-5 of the
longest way, as a cycle adds up the slips of its eight steps.
"""

import numpy as np
import pytest

from driver.files import read_table
from test_any_cut import assert_same

pytestmark = pytest.mark.slow  # many runs
TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-10, "primal_rtol": 1e-8}
WAYS = 1e-5
CUTS = (1, 3, 5, 7, 13)
HISTORY = """
quasistatic(2.);
macro amplitude1(t) min(1., 2.*t) //
macro amplitude2(t) (t < 1. ? 0. : sin(2.*pi*t)) //
macro cycles() 3 //
macro cycleStart() 1. //
include "export.idp"
"""
# a bracket with a hole stands with one foot on a lower body of another mesh; labels out of order
BODIES = """include "scene.idp"
border a(t=0,1){x=0.1+2.3*t;y=0;label=41;}
border b(t=0,1){x=2.4-0.5*t;y=1.1*t;label=7;}
border c(t=0,1){x=1.9-1.8*t;y=1.1+0.2*t;label=19;}
border d(t=0,1){x=0.1;y=1.3*(1-t);label=3;}
border e(t=0,2*pi){x=1.1+0.27*cos(t);y=0.7+0.2*sin(t);label=30;}
addBody(buildmesh(a(7) + b(4) + c(6) + d(4) + e(-9)))
bodyMaterial("bracket", 900., 0.3);
int[int] lower = [5, 6, 2, 8];
addBody(square(9, 3, [-0.3 + 3.1*x, -1. + y], label = lower))
bodyMaterial("base", 400., 0.3);
macro support() on(5, u1 = 0., u2 = 0.) //
macro load1() traction(19, 0.2, -4.) //
macro load2() traction(7, 0.7, 0.) + traction(3, 0.7, 0.2) //
macro contactPair() 41, 2 //
macro friction() (0.35 + 0.1*x) //
""" + HISTORY
# a foot of buildmesh on a rough floor, held at its top, and rubbed to and fro
FOOT = """include "scene.idp"
border a(t=0,1){x=1.7*t;y=0.05*sin(3*t);label=12;}
border b(t=0,1){x=1.7+0.2*t;y=0.05*sin(3.)+(1.2-0.05*sin(3.))*t;label=4;}
border c(t=0,1){x=1.9-2.1*t;y=1.2;label=9;}
border d(t=0,1){x=-0.2+0.2*t;y=1.2*(1-t);label=23;}
body = buildmesh(a(11) + b(6) + c(8) + d(6));
macro young() 1000. //
macro poisson() 0.3 //
macro displacement1() on(9, u1 = 0., u2 = -0.01) //
macro displacement2() on(9, u1 = 0.012, u2 = 0.) //
macro contact() 12 //
macro obstacle(x, y) (y + 0.001) //
macro friction() 0.3 //
LAW""" + HISTORY
ROUGH = "macro normalCompliance() 3e3 //\n"
POWER = "macro normalCompliance() 3e4 //\nmacro normalComplianceExponent() 1.5 //\n"
WEAR = "macro wear() 2e-4 //\n"


@pytest.mark.parametrize("text, law, options", [
    (BODIES, "", {}), (BODIES, "", {"element": "P2"}), (BODIES, WEAR, {"element": "P2-mixed"}),
    (FOOT, ROUGH, {"element": "P2"}), (FOOT, POWER, {}), (FOOT, WEAR, {"element": "P2"}),
    (FOOT, ROUGH + WEAR, {}), (FOOT, WEAR, {"cycles": "20 jump 5%"}),
], ids=["bodies", "bodies-P2", "bodies-wear-mixed", "rough-P2", "power", "wear-P2", "rough-wear",
        "jumps"])
def test_any_cut_and_any_ranks(solved, named_scene, text, law, options):
    text = text.replace("LAW", law) if "LAW" in text else text.replace(HISTORY, law + HISTORY)
    path = named_scene("cycled", text)
    runs = [solved(path, subdomains=cut, steps=16, **TIGHT, **options) for cut in CUTS]
    for cut, run in zip(CUTS, runs):
        compare(run, runs[0], f"SUBDOMAINS={cut}")
    for cut, run in zip(CUTS[3:], runs[3:]):
        ranks = solved(path, subdomains=cut, steps=16, np=2, **TIGHT, **options)
        for name in ("contact.csv", "history.csv", "cycles.csv"):
            assert ((run.directory / name).read_bytes()
                    == (ranks.directory / name).read_bytes()), (cut, name)


def compare(run, first, where) -> None:
    """Forces and displacements in every step, and the verdicts on cycles."""
    assert_same(run, first, where)
    largest = first.history["max_displacement"].max()
    found, expected = (read_table(of.directory / "cycles.csv") for of in (run, first))
    for name in ("cycle", "kind", "settled", "skipped"):
        assert list(found[name]) == list(expected[name]), (where, name)
    longest = max(np.max(expected["slip"]), largest)
    for name in ("slip", "drift", "wear", "error"):
        np.testing.assert_allclose(found[name], expected[name], atol=WAYS * longest, err_msg=where)
    np.testing.assert_allclose(found["dissipated"], expected["dissipated"], rtol=1e-5,
                               atol=1e-5 * np.max(expected["dissipated"]), err_msg=where)
