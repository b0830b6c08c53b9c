"""What is said while errors are estimated."""

from types import SimpleNamespace

import pytest

from driver.runs import watch


@pytest.mark.parametrize("quiet, seldom, lines", [(False, 0.0, 3), (True, 0.0, 0), (False, 9, 0)])
def test_companions_that_take_long_are_told_in_lines(monkeypatch, capsys, quiet, seldom, lines):
    monkeypatch.setattr(watch, "SELDOM", seldom)
    said = watch.Watch("strip", quiet)
    said.stage("time steps", ["coarser meshes", "time steps"])
    for steps in (1, 2):
        said.begin(steps)
        for _ in range(steps):
            said.update()
        said.end()
    out = capsys.readouterr().out.splitlines()
    assert len(out) == lines
    last = "strip: error estimates 2/2, time steps: companion 2, step 2/2, 0 s remaining"
    assert not lines or out[-1] == last


@pytest.mark.parametrize("quiet", [False, True])
def test_freefem_that_takes_long_is_told_ever_more_seldom(monkeypatch, capsys, tmp_path, quiet):
    now = [100.0]
    monkeypatch.setattr(watch.time, "perf_counter", lambda: now[0])
    known = SimpleNamespace(nodes=5000, subdomains=12)
    monkeypatch.setattr(watch, "announced", lambda _: known if now[0] > 115 else None)
    said = watch.Waiting("strip", tmp_path, quiet)
    for now[0] in (100.0, 109.0, 110.0, 112.0, 119.0, 121.0, 139.0, 141.0):
        assert said.update()
    out = capsys.readouterr().out.splitlines()
    doing = "strip: FreeFEM assembles 5,000 nodes in 12 subdomains"
    assert out == ([] if quiet else ["strip: FreeFEM meshes, 10 s so far", f"{doing}, 21 s so far"])


def test_cycles_are_told_where_they_say_something_new(capsys):
    """The first of several comes to nothing yet; what the second comes to is said, then."""
    told = watch.Progress(12, 0, "strip", False, None)
    told.bar, rows = None, []
    for kind, settled in (("ratcheting", False), ("ratcheting", False), ("ratcheting", False),
                          ("alternating slip", True)):
        rows.append({"cycle": len(rows) + 1, "kind": kind, "settled": settled, "change": 1.0,
                     "slip": 0.5})
        told.judge(SimpleNamespace(total=12, past=SimpleNamespace(rows=rows)))
    assert capsys.readouterr().out.splitlines() == [
        "strip: cycle 1: no previous cycle to compare with, slip 0.5",
        "strip: cycle 2: not settled, ratcheting, change 1.0e+00, slip 0.5",
        "strip: cycle 4: settled, alternating slip, change 1.0e+00, slip 0.5"]


@pytest.mark.parametrize("quiet", [False, True])
def test_steps_that_take_long_are_told_ever_more_seldom(monkeypatch, capsys, quiet):
    now = [100.0]
    monkeypatch.setattr(watch.time, "perf_counter", lambda: now[0])
    told = watch.Progress(4, 0, "strip", quiet, None)
    told.bar = None
    for now[0] in (101.0, 109.0, 112.0, 113.0, 119.0, 125.0):
        told.within(1, 40 + int(now[0]), 0.002)
    step = SimpleNamespace(index=1, fixed_point_iterations=3, products=160,
                           residuals={"gluing": 1e-9})
    told.update(step)  # at 125 s: the next step has begun then
    for now[0] in (134.0, 136.0):
        told.within(2, 300 + int(now[0]), None)
    out = [line for line in capsys.readouterr().out.splitlines() if "so far" in line]
    assert out == ([] if quiet else [
        "strip: step 1/4 has taken 12 s so far, 11 products, residual 2.0e-03",
        "strip: step 1/4 has taken 25 s so far, 24 products, residual 2.0e-03",
        "strip: step 2/4 has taken 11 s so far, 2 products"])


def test_solvers_tell_that_a_step_goes_on(solved, monkeypatch):
    """At every product of a QP and every pass of Newton's method."""
    told = []
    monkeypatch.setattr(watch.Progress, "within", lambda self, *now: told.append(now))
    run = solved("model", loading="monotone", subdomains="2x1", cells=4, steps=2)
    assert run.status == 0 and {index for index, *_ in told} == {1, 2}
