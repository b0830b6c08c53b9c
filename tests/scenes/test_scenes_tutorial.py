"""tutorial: at most 40 lines, every one explained, and it runs as README says."""

import re

import numpy as np
import pytest

from driver.scene import freefem

SCENE = freefem.find_scene("tutorial")


def test_length_and_comments():
    lines = SCENE.read_text().splitlines()
    assert len(lines) <= 40 and max(map(len, lines)) <= 120
    explained = 0
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("//"):
            explained = number if line.startswith("//") else 0
            continue
        last = line.split("//")[-1].strip()
        # a comment on the line itself, or one that heads its paragraph
        assert ("//" in line and last) or explained, f"line {number} is not explained: {line}"
    assert lines[0].startswith("// tutorial.edp - ")


def test_it_only_declares():
    text = SCENE.read_text()
    assert text.count('include "') == 2
    assert not re.search(r"\b(for|while|varf|solve|int2d|ofstream)\b", text)


@pytest.fixture(scope="module")
def run(solved):
    found = solved("tutorial")
    assert found.status == 0, found.reason
    return found


def test_pressed_then_dragged(run):
    assert run.summary["effects"]["friction"] == "coulomb"
    assert run.summary["effects"]["time"] == "quasistatic"
    time, push, pull = run.history["time"], run.history["contact_y"], run.history["contact_x"]
    pressing = time <= 0.25
    # a symmetric body under a symmetric push: no net shear, to the mesh's own asymmetry and the
    # solver's tolerance
    assert np.abs(pull[pressing]).max() < 1e-3 * push[pressing].max()
    assert np.all(np.diff(push[pressing]) > 0)
    assert np.all(np.diff(pull[~pressing]) < 1e-4)


def test_in_the_end_it_slides(run):
    """All touching nodes slip at full sliding, and the friction force is F times the normal force
    (F = 0.5).
    """
    assert run.history["nodes_stick"][-1] == 0 and run.history["nodes_slip"][-1] > 0
    assert run.history["contact_x"][-1] == pytest.approx(-0.5 * run.history["contact_y"][-1],
                                                         rel=1e-9)
    # steady sliding: the step's dissipation is the friction force times the way of the glued top, 2
    # * 0.05/0.75
    work = np.diff(run.history["dissipated"])[-1]
    assert work == pytest.approx(-run.history["contact_x"][-1] * 2 * 0.05 / 0.75, rel=1e-3)


def test_balance(run):
    assert run.summary["balance"] < 1e-9


def test_works_from_a_users_folder(solved, tmp_path_factory):
    """By its path, from anywhere, under another name and number of subdomains."""
    path = tmp_path_factory.mktemp("mine") / "foot.edp"
    path.write_text(SCENE.read_text())
    assert solved(path, SUBDOMAINS=3, FRICTION=0.2).status == 0
