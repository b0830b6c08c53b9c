"""The study of what accuracy costs: references, trusted errors, fronts and cheapest settings on
made-up runs; one small sweep."""

import numpy as np
import pytest

from driver.errors import InputError, NotConverged
from driver.estimates.budget import FLOOR, SAFETY
from driver.figures import accuracy as picture
from driver.files import read_rows
from driver.studies.accuracy import cheapest, reference, run_accuracy, sweeps
from driver.studies.accuracy.reference import Reference
from driver.studies.accuracy.trial import SWEEPS, Setting, Trial


def trial(sweep="mesh", value=1.0, error=0.1, seconds=1.0, steps=None, adapt=0, dofs=100,
          exact=2.0):
    return Trial(sweep, value, Setting(1.0, steps, adapt), f"{sweep}={value}",
                 values={"slip": exact * (1 + error)},
                 sizes={"primal_dofs": dofs}, solver=[seconds], export=[0.5])


TWO = Reference(2.0, 0.002, reference.RUN)


def test_reference_adds_what_space_and_time_change():
    # q(h, dt) = 1 + h^2 + dt: cycles halve h, steps halve dt
    def values(h, dt):
        return {"displacement": 1 + h**2 + dt, "slip": 3.0}

    runs = {"base": (0.2, 0.1), "coarser": (0.2, 0.1), "finer": (0.1, 0.1), "finest": (0.05, 0.1),
            "fewer": (0.2, 0.04), "more": (0.2, 0.02), "most": (0.2, 0.01)}
    made = {name: Trial("reference", 0, Setting(1.0, 1), name, values=values(*setting))
            for name, setting in runs.items()}
    found = reference.references(made)
    assert set(found) == {"displacement"}  # what no run changes has no error to show
    left = 0.05**2 + 0.01  # in space and time at the finest
    assert found["displacement"].value == pytest.approx(1 + left, abs=1e-12)
    # the caution of both extrapolations (a second order counts up to three times as much, as the
    # last difference may be chance), and the product of the corrections
    most = SAFETY * (3 * FLOOR * 0.05**2 + 0.01) + 1.01 * 0.05 * 0.1
    assert 1.2 * left < found["displacement"].own < most


def test_a_reference_that_does_not_converge_ends_with_its_status():
    """Not as bad input."""
    study = object.__new__(sweeps.Study)
    study.reference_runs, study.plan = lambda: {"base": trial()}, lambda: []

    def run(failing):
        failing.reason, failing.status = "too bad", 4

    study.run = run
    with pytest.raises(NotConverged, match="the reference run .* failed: too bad"):
        study.run_all(None)


def test_quantity_that_does_not_converge_has_no_reference():
    value = {"base": 1.0, "coarser": 2.0, "finer": 4.0, "finest": 8.0}
    runs = {name: Trial("reference", 0, Setting(1.0, None), name, values={"displacement": v})
            for name, v in value.items()}
    assert not reference.references(runs)


def test_closed_form_takes_the_place_of_runs():
    P = 1.75
    found = reference.hertz({"normal_resultant": Reference(P, 0.01 * P, reference.RUN)})
    a, p0 = found["contact_length"].value / 2, found["peak_pressure"].value
    # Hertz: the ellipse of p0 over 2a carries P
    assert np.pi / 2 * a * p0 == pytest.approx(P, rel=1e-12)
    assert a**2 == pytest.approx(4 * P * (1 - 0.3**2) / (np.pi * 2000), rel=1e-12)
    assert found["peak_pressure"].uncertainty == pytest.approx(2 * a**2 + 0.005, rel=1e-9)


def test_an_error_that_cancels_by_accident_is_not_trusted():
    lucky = [trial(value=4, error=0.2), trial(value=2, error=1e-5), trial(value=1, error=-0.05)]
    error = cheapest.trusted(lucky, TWO, "slip")
    assert [round(error[id(t)], 9) for t in lucky] == [0.2, 0.05, 0.05]
    # nothing is known below the reference's own error
    exact = [trial(error=0.0)]
    assert cheapest.trusted(exact, TWO, "slip")[id(exact[0])] == TWO.uncertainty
    # together: finer means mesh and steps, adaptive and uniform meshes apart
    grid = [trial("together", 0, 1e-5, steps=5, dofs=100),
            trial("together", 0, 0.1, steps=10, dofs=100),
            trial("together", 0, 0.03, steps=10, dofs=400),
            trial("together", 0, 0.02, steps=5, adapt=1, dofs=900)]
    error = cheapest.trusted(grid, TWO, "slip")
    assert [round(error[id(t)], 9) for t in grid] == [0.1, 0.1, 0.03, 0.02]


def test_front_and_cheapest_settings():
    trials = [trial("mesh", 4, 0.2, 1.0), trial("mesh", 2, 0.08, 3.0), trial("mesh", 1, 0.01, 9.0),
              trial("adapt", 1, 0.1, 4.0), trial("adapt", 0.5, 0.009, 6.0),
              trial("rtol", 1, 0.0799, 3.5)]
    failed = Trial("rtol", 2, Setting(1.0, None), "fails", reason="no fixed point")
    error = cheapest.trusted([*trials, failed], TWO, "slip")
    # the adaptive 0.1 costs more than the uniform 0.08; the last digit of 0.0799 is not worth a
    # place
    assert cheapest.front([*trials, failed], error) == [trials[0], trials[1], trials[4]]
    fastest = [cheapest.cheapest([*trials, failed], error, level)
               for level in (0.5, 0.1, 0.05, 0.001)]
    assert fastest == [trials[0], trials[1], trials[4], None]
    table = cheapest.run_rows([*trials, failed], {"slip": TWO})
    assert [row.get("slip_front") for row in table] == [1, 1, 0, 0, 1, 0, None]
    assert table[-1]["reason"] == "no fixed point" and "seconds_solver" not in table[-1]
    text = cheapest.describe(cheapest.cheapest_rows(trials, {"slip": TWO}), {"slip": TWO},
                             {"length": "m", "stress": "Pa"}, "slip")
    assert "10 %" in text and "mesh=2" in text and "good to 0.1 %" in text


def test_settings_read_as_on_the_command_line():
    setting = Setting(0.002, 40, 2, (("rtol", 1e-4), ("primal_rtol", 1.0)))
    assert setting.options("h") == {"h": "0.002", "steps": "40",
                                    "adapt": "2", "rtol": "1e-4", "primal_rtol": "1"}


def test_exponents():
    h = np.array([0.4, 0.2, 0.1])
    assert picture.exponent(h, 3 * h**2, 2) == pytest.approx(2, rel=1e-12)
    assert picture.exponent(h[:2], h[:2], 2) is None  # two runs tell no rate
    assert picture.exponent([1.0, 1.1, 1.2], h, 2) is None  # nor do runs of equal cost


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Directory of the smallest study of the scene with a manufactured solution."""
    out, kept = tmp_path_factory.mktemp("accuracy") / "zones", dict(sweeps.EFFORTS)
    sweeps.EFFORTS["quick"] = sweeps.Effort(12000, 3, (1, 2), (1e-2,), (1e-2, 1e-6), 1)
    try:
        paths = run_accuracy({"scene": "zones", "steps": "2", "effort": "quick", "out": str(out)})
    finally:
        sweeps.EFFORTS.update(kept)
    assert all(path.is_file() for path in paths)
    return out


@pytest.mark.slow  # a study of thirty runs; meshes of fewer dofs are too coarse for claims of slip
def test_study_of_a_known_solution(swept):
    known = {row["quantity"]: row for row in read_rows(swept / "reference.csv")}
    table = read_rows(swept / "accuracy.csv")
    assert {row["sweep"] for row in table} == set(SWEEPS) == set(picture.SWEEPS)
    # the reference covers the exact work that friction takes (see the scene), within its own stated
    # error
    from test_scenes_zones import DISSIPATED

    energy = known["dissipated_energy"]
    assert energy["main"] == "1"
    value, uncertainty = float(energy["value"]), float(energy["uncertainty"])
    assert abs(value - DISSIPATED) < 1.2 * uncertainty * value
    steps = [row for row in table if row["sweep"] == "steps"]
    # all grows in proportion: any number of steps gives the same work but for tolerances of 1e-6
    assert all(float(row["dissipated_energy_own"]) < 1e-4 for row in steps)
    for row in table:
        least, median, most = (float(row[f"seconds_solver{name}"])
                               for name in ("_least", "", "_most"))
        assert row["repeats"] == "1" and least <= median <= most
        assert float(row["seconds_export"]) > 0 and float(row["energy_estimate"]) > 0
    assert any(row["dissipated_energy_front"] == "1" for row in table)
    left = {path.name for path in swept.iterdir() if not path.name.startswith(".")}
    assert left == {"accuracy.csv", "cheapest.csv", "reference.csv", "work_precision.png",
                    "work_precision.pdf"}


@pytest.mark.parametrize("pairs, reason", [
    ({}, "make accuracy needs SCENE="), ({"scene": "nowhere"}, "no scene"),
    ({"scene": "zones", "adapt": "2"}, "ADAPT itself"),
    ({"scene": "zones", "effort": "some"}, "EFFORT must be one of"),
    ({"scene": "zones", "repeats": "0"}, "REPEATS expects"),
    ({"part": "moon"}, "PART must be one of"),
    ({"scene": "zones", "rows": "1"}, "PART=sweeps does not read ROWS"),
    ({"scene": "zones", "frictoin": "1"}, "FRICTOIN"),
    ({"scene": "bar", "quantity": "slip"}, "the scene has no such quantity; it has peak_pressure"),
])
def test_mistakes_are_reported_in_one_line(tmp_path, pairs, reason):
    with pytest.raises(InputError) as problem:
        run_accuracy({**pairs, "out": str(tmp_path / "out")})
    assert reason in str(problem.value) and "\n" not in str(problem.value)
