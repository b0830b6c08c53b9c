"""What is said while errors are estimated."""

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
    last = "strip: error estimates 2/2, time steps: companion 2, step 2/2, 0 s left of it"
    assert not lines or out[-1] == last
