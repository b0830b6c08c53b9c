"""make verify: its closed forms against integrals, its fast cases, its table and its page."""

import dataclasses
import types

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j1

from driver.errors import DriverError, InputError
from driver.figures.verify import draw
from driver.files import write_table
from driver.verify import halfspace, page, peer, plane, rates, sizes, suite
from driver.verify.case import ELEMENTS, Check, compared

CASES = {case.name: case for case in suite.cases()}
FAST = [name for name, case in CASES.items() if case.fast]


@pytest.mark.parametrize("shape, gap", [
    (plane._wedge, lambda x: plane.SLOPE * abs(x)),
    (plane._parabola, lambda x: plane.SLOPE * x**2),
    (plane._quartic, lambda x: plane.SLOPE * x**4)])
def test_pressures_of_indenters_carry_the_load_and_follow_the_profile(shape, gap):
    """u(0) - u(x) = h(x) with u(x) = -2/(pi E*) int p(s) ln|x - s| ds (Johnson, 2.24)."""
    P = 7e-4
    a = shape(P, np.zeros(1))[0]

    def pressure(angle):  # of x = a sin(angle), where it has no infinite slopes
        return float(shape(P, np.array([a * np.sin(angle)]))[1][0]) * a * np.cos(angle)

    half = np.pi / 2
    assert 2 * quad(pressure, 0, half)[0] == pytest.approx(P, rel=1e-6)

    def sunk(x):
        place = np.arcsin(x / a)
        return -2 / (np.pi * plane.STIFF) * sum(
            quad(lambda t: pressure(t) * np.log(abs(x - a * np.sin(t))), *part, limit=200)[0]
            for part in ((-half, 0), (0, place), (place, half)) if part[0] < part[1])

    x = 0.6 * a
    assert sunk(0.0) - sunk(x) == pytest.approx(gap(x), rel=1e-4)


@pytest.mark.parametrize("name, half", [("westergaard-quarter", 1 / 6), ("westergaard-half", 0.25)])
def test_westergaards_pressure_has_its_mean_and_its_peak(name, half):
    case = CASES[name]
    mean = case.settings["mean"] * np.pi * plane.STIFF * 1e-4
    places, pressures = case.curve.reference(None)
    peak = next(check.reference for check in case.checks if check.name == "peak_pressure")
    assert pressures[0] == pytest.approx(peak, rel=1e-12) and places[-1] == half
    middles = np.interp((places[1:] + places[:-1]) / 2, places, pressures)
    assert 2 * np.diff(places) @ middles == pytest.approx(mean, rel=2e-2)  # 25 points


def test_shrink_fit_is_the_limit_of_a_rigid_shaft():
    """A hundred thousand times stiffer inner ring: Lame's ring on a rigid shaft."""
    stiff = plane.lame_fit(inner=210e8, over=0.03)
    A = 0.03 / (30 + (1 / (1 - 0.6)) * 45**2 / 30)  # u = A (r + c^2/((1 - 2 nu) r))
    assert stiff == pytest.approx(210e3 / 1.3 * A / 0.4 * (45**2 / 30**2 - 1), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("number", [
    pytest.param(number, marks=[pytest.mark.slow] * (number % 8 > 0))  # an eighth by default
    for number in range(len(FAST))])
@pytest.mark.some(1)
def test_fast_cases_are_met(number, tmp_path):
    """Linear and quadratic elements in turn; make test-long has both for all."""
    rows, curves = suite.judge(FAST[number], ELEMENTS[number % 2:][:1], tmp_path)
    assert {row["met"] for row in rows} == {"yes"}, rows
    assert CASES[FAST[number]].curve is None or curves


@pytest.mark.slow
def test_all_cases_are_met(tmp_path):
    made = suite.run_suite({"out": str(tmp_path)})
    assert (tmp_path / "report.csv") in made


@pytest.mark.slow
def test_a_number_that_misses_its_reference_is_said(tmp_path, monkeypatch, capsys):
    case = CASES["patch-moose"]
    wrong = Check("u_x of the free side", 4.3e-5, case.checks[0].value, 1e-5, "six digits")
    monkeypatch.setattr(suite, "cases", lambda: [
        dataclasses.replace(case, checks=(wrong,), elements=("P1",))])
    monkeypatch.setattr(suite, "ProcessPoolExecutor", _Here)
    with pytest.raises(DriverError, match="1 numbers miss their references"):
        suite.run_suite({"out": str(tmp_path), "case": "moose"})
    assert "MISSED: u_x of the free side" in capsys.readouterr().out


def test_every_case_has_its_picture(tmp_path):
    """Curves where there are some, else errors on the meshes, and what the body's size takes off.
    """
    write_table(tmp_path / "curves.csv", [
        {"kind": kind, "case": "curved", "x": x, "y": x, "x_name": "x", "y_name": "y"}
        for kind in ("P1", "reference") for x in (0.0, 1.0)],
        ("kind", "case", "x", "y", "x_name", "y_name"))
    row = {"quantity": "peak_pressure", "element": "P1", "errors": "1e-1 2e-2", "remaining": 1e-3,
           "tolerance": 1e-2, "size_effect": 2e-2}
    write_table(tmp_path / "report.csv", [{"case": "curved", **row}, {"case": "single", **row},
                                          {"case": "single", **row, "errors": "", "element": "P2"}],
                ("case", *row))
    drawn = {path.name for path in draw(tmp_path / "curves.csv")}
    assert {"curved.png", "single.png"} <= drawn


class _Here:
    """Runs in this process, which knows the changed case."""

    def __init__(self, *_args, **_more):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, task, *values):
        from concurrent.futures import Future

        future = Future()
        future.set_result(task(*values))
        return future


def test_there_are_enough_cases_and_the_page_has_them_all():
    text = (page.FOLDER / "README.md").read_text()
    assert len(CASES) >= 25 and len(FAST) >= len(CASES) // 3
    for name, case in CASES.items():
        assert f"## {name}\n" in text and case.source in text
        section = text.partition(f"## {name}\n")[2].partition("\n## ")[0].splitlines()
        shows = any(line.startswith("| deviation on bodies with") for line in section)
        assert shows == (case.sizes is not None), name
        for check in case.checks:
            end = f"| {check.tolerance:.1e} | {check.because} |"
            rows = [line for line in section if line.endswith(end)
                    and line.startswith(f"| {check.name.replace('_', ' ')} |")]
            assert len(rows) == len(case.elements), (name, check.name)
        assert (page.PICTURES / f"{name}.png").is_file()
    assert "**missed**" not in text


def test_errors_are_relative_and_absolute_where_the_reference_is_zero():
    view = types.SimpleNamespace(a=2.2, b=0.1)
    assert Check("", 2.0, lambda v: v.a, 1, "").compare(view)[2] == pytest.approx(0.1)
    assert Check("", 0.0, lambda v: v.b, 1, "").compare(view)[2] == pytest.approx(0.1)


@pytest.mark.skipif(not peer.installed(), reason=peer.NOTE)
@pytest.mark.parametrize("name, element", [("pressfit", "P1"), ("rough-punch", "P2"),
                                           ("mindlin", "P1")])
def test_getfem_finds_the_same_forces(name, element, tmp_path):
    """Without friction, with it in one step, and after a cycle of 20."""
    assert compared(CASES[name], element, tmp_path) <= peer.SAME


def test_at_least_five_cases_are_solved_by_getfem_too():
    assert sum(case.peer is not None for case in CASES.values()) >= 5


@pytest.mark.parametrize("plane", [False, True])
def test_rings_and_strips_give_spences_form_where_shear_does_not_lift_the_surface(plane):
    for friction in (0.1, 0.3):
        wanted = halfspace.spence(friction, 0.3, plane)
        assert halfspace.stick_ratio(friction, 0.3, False, plane) == pytest.approx(wanted, rel=5e-4)
        # with it the surface sinks less in the middle, where the pressure falls
        assert halfspace.stick_ratio(friction, 0.3, True, plane) < 0.98 * wanted


def test_nothing_couples_in_incompressible_half_spaces():
    """beta = 0: pressure draws the surface nowhere, so that all sticks at any friction."""
    _, _, sunk, drawn, _ = halfspace._rings(20, 0.5)
    assert not sunk.any() and not drawn.any()


def test_rings_shear_as_an_integral_of_bessel_functions():
    """One ring: int int s J1(ks) J1(kr) ds dk, k damped by exp(-k d), d -> 0 by extrapolation."""
    ends = halfspace._rings(8, 0.3)[0]
    r, low, high = (ends[2] + ends[3]) / 2, ends[5], ends[6]

    def damped(d):
        return quad(lambda s: quad(lambda k: s * j1(k * s) * j1(k * r) * np.exp(-k * d), 0, 40 / d,
                                   limit=2000)[0], low, high, epsrel=1e-5)[0]

    near, far = damped(0.1), damped(0.2)
    assert halfspace._shear(ends)[2, 5] == pytest.approx((4 * near - far) / 3, rel=2e-2)


@pytest.mark.parametrize("order", [1, 2])
def test_what_sizes_add_is_told_from_what_the_mesh_adds(order):
    ratios, mesh, body = np.array([0.05, 0.1, 0.2, 0.3]), 4e-3, 0.5
    effect = sizes.fitted(ratios, mesh + body * ratios**order, distance=False)
    assert effect.order == order and effect.factor == pytest.approx(body)
    assert effect.remaining(mesh + effect.of(0.1), 0.1) == pytest.approx(mesh)
    curves = sizes.fitted(ratios, np.hypot(mesh, body * ratios**order), distance=True)
    assert curves.order == order and curves.factor == pytest.approx(body)
    assert curves.remaining(np.hypot(mesh, curves.of(0.1)), 0.1) == pytest.approx(mesh)


def test_hertz_falls_short_on_hemispheres_as_their_size_says():
    """The published numbers are those of the formula that the sizes are compared with."""
    view = types.SimpleNamespace(settings={"press": 2.0, "force": 35e3})
    given = {name: CASES[name].checks[k].reference(view) for name, k in (
        ("hemispheres", 0), ("nafems-cylinder", 0))}
    assert given == pytest.approx({"hemispheres": 2798.33, "nafems-cylinder": 3585.36}, rel=1e-5)
    assert CASES["nafems-cylinder"].checks[1].reference(view) == pytest.approx(6.2146, rel=1e-5)


@pytest.mark.parametrize("power", [1.0, 2.5])
def test_orders_are_slopes(power):
    sizes = np.array([1.0, 0.5, 0.25])
    assert rates.order(sizes, 3 * sizes**power) == pytest.approx(power)
    assert rates.order(sizes, [0.0, 0.0, 0.0]) == ""


@pytest.mark.slow
def test_slip_and_dissipation_of_the_zones_have_their_orders(tmp_path):
    """Quadratic elements: slip of order 3 in L2, its work of order 3."""
    series = next(one for one in rates.SERIES
                  if one.scene == "zones" and one.element == "P2")
    orders = {row["quantity"]: row["order"] for row in rates._rows(series, tmp_path)}
    assert orders["slip in L2"] > 2.7 and orders["dissipated energy"] > 2.7
    assert orders["shear in L2"] > 1.3


def test_the_page_takes_all_cases(tmp_path):
    with pytest.raises(InputError, match="no fast case has 'hertz' in its name"):
        suite.run_suite({"fast": "yes", "case": "hertz"})
    with pytest.raises(InputError, match="PAGE=yes shows all cases"):
        suite.run_suite({"out": str(tmp_path), "case": "hertz", "page": "yes"})
