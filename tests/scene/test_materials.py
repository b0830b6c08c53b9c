"""Materials body by body: bodyMaterial against young and poisson by region, and misuse."""

import pytest

# two squares side by side, unlike ones, pulled apart by different forces: plane stress bars
BARS = """include "scene.idp"
subdomains("auto");
int[int] one = [1, 2, 3, 4], other = [11, 12, 13, 14];
addBody(square(4, 4, [x, y], label = one, region = 5))
bodyMaterial("steel", 200., 0.);
addBody(square(3, 3, [2 + x, y], label = other, region = 7))
bodyMaterial("rubber", 4., 0.);
macro support() on(4, 14, u1 = 0, u2 = 0) //
macro load1() traction(2, 1., 0.) + traction(12, 1., 0.) //
macro probeLabels() [2, 12] //
include "export.idp"
"""


@pytest.fixture
def changed(tmp_path):
    """changed(old, new): path of the scene with a line replaced."""
    def make(old: str = "", new: str = ""):
        assert old in BARS
        path = tmp_path / "bars.edp"
        path.write_text(BARS.replace(old, new))
        return path
    return make


@pytest.mark.parametrize("options", [{}, {"element": "P2", "subdomains": 5}, {"np": 2}])
def test_every_body_has_its_own(solved, changed, options):
    """u = x/E on either bar; named in summary.json."""
    run = solved(changed(), rtol=1e-11, **options)
    ends = {probe["probe"]: probe["u_x"] for probe in run.summary["probes"]}
    assert ends == pytest.approx({"label2": 1 / 200, "label12": 1 / 4}, rel=1e-9)
    assert [(m["body"], m["name"], m["young"]) for m in run.summary["materials"]] == [
        (1, "steel", 200.0), (2, "rubber", 4.0)]


def test_regions_still_give_materials(solved, changed, tmp_path):
    """The same stiffness by region: the same bits."""
    text = BARS.replace('bodyMaterial("steel", 200., 0.);\n', "").replace(
        'bodyMaterial("rubber", 4., 0.);\n',
        "macro young() (region == 5 ? 200. : 4.) //\nmacro poisson() 0. //\n")
    path = tmp_path / "regions.edp"
    path.write_text(text)
    named, region = solved(changed()), solved(path)
    assert named.summary["probes"] == region.summary["probes"]
    assert "materials" not in region.summary


@pytest.mark.parametrize("old, new, reason", [
    ('bodyMaterial("rubber", 4., 0.);\n', "", "body 2 has no material"),
    ('"rubber", 4., 0.', '"rubber", -4., 0.', "bodyMaterial of rubber"),
    ('"rubber", 4., 0.', '"rubber", 4., 0.5', "bodyMaterial of rubber"),
    ('subdomains("auto");', 'bodyMaterial("air", 1., 0.);', "after addBody"),
    ('bodyMaterial("rubber", 4., 0.);', 'bodyMaterial("a", 4., 0.); bodyMaterial("b", 4., 0.);',
     "twice for body 2"),
    ("macro support", "macro young() 2. //\nmacro poisson() 0. //\nmacro support",
     "young or c11 is declared")])
def test_misuse_is_refused_in_one_line(solved, changed, old, new, reason):
    run = solved(changed(old, new))
    assert run.status == 2 and reason in run.reason
