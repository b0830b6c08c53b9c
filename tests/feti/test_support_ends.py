"""Where labels with prescribed displacements meet, the vertex moves as one of them says."""

import numpy as np
import pytest

from driver.files import read_table

BLOCK = '''include "scene.idp"
subdomains("4x2");
rectangle(0., 2., 0., 1.);
quasistatic(1.);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
{moved}
macro probePoints() [0., 1., 2., 1.] //
include "export.idp"
'''
TOP, SIDE = "on(3, u1 = 0.01, u2 = 0.)", "on(4, u1 = 0.02)"


@pytest.fixture
def corners(solved, tmp_path):
    """Displacements (steps, 2 corners, 2) at both ends of the top, and the run's summary."""
    count = iter(range(100))

    def run(*moved: str, **options):
        path = tmp_path / f"block{next(count)}.edp"  # runs are kept by the name of their scene
        path.write_text(BLOCK.format(moved="\n".join(f"macro {one} //" for one in moved)))
        found = solved(path, steps=2, **options)
        table = read_table(found.directory / "probes.csv")
        u = np.array([table["u_x"], table["u_y"]], float).T.reshape(2, 2, 2)
        return u, [line for line in found.summary["warnings"] if "where these meet" in line]

    return run


@pytest.mark.parametrize("subdomains", ["1", "4x2", "7"])
@pytest.mark.some(1)
def test_a_vertex_of_two_labels_moves_as_the_higher_number_says(corners, subdomains):
    """Not as their sum, which is what patterns of one label are."""
    u, said = corners(f"displacement1() {TOP}", f"displacement2() {SIDE}", "amplitude2(t) t",
                      subdomains=subdomains)
    np.testing.assert_allclose(u[:, 0], [[0.01, 0.0], [0.02, 0.0]], atol=1e-15)
    np.testing.assert_allclose(u[:, 1], [[0.01, 0.0]] * 2, atol=1e-15)
    assert len(said) == 1 and "labels 1 and 4 differ by 0.02" in said[0] and "1 more" in said[0]
    u, said = corners(f"displacement2() {TOP}", f"displacement1() {SIDE}", "amplitude1(t) t",
                      subdomains=subdomains)
    np.testing.assert_allclose(u[:, 0], [[0.01, 0.0]] * 2, atol=1e-15)


def test_labels_that_move_alike_do_not_move_their_vertex_twice(corners):
    """Numbers on the same side are added, as loads are; nothing jumps along the top."""
    u, said = corners("displacement1() on(3, u1 = 0.01*y, u2 = 0.)",
                      "displacement2() on(4, u1 = 0.01*y, u2 = 0.)")
    np.testing.assert_allclose(u[:, :, 0], 0.01, atol=1e-15)
    assert not said
    u, _ = corners("displacement1() on(3, u1 = 0.01*y, u2 = 0.)",
                   "displacement2() on(4, u1 = 0.01*y, u2 = 0.)",
                   "displacement3() on(3, u1 = 0.005*y)", "amplitude3(t) t")
    np.testing.assert_allclose(u[:, :, 0], [[0.0125] * 2, [0.015] * 2], atol=1e-15)


def test_a_jump_beside_a_support_is_said(corners):
    """The body is held below, and its side moves as a whole; a side that tilts is continuous."""
    _, said = corners("displacement1() on(4, u1 = 0.01)")
    assert len(said) == 1 and "along x on the labels 1 and 4 differ by 0.01" in said[0]
    assert not corners("displacement1() on(4, u1 = 0.01*y)")[1]


SHORT = """include "scene.idp"
subdomains("5");
border b1(t=0, 1) { x = 4*t; y = 0; label = 1; }
border b5(t=0, 1) { x = 4 + 0.2*t; y = 0.2*t; label = 5; }
border b2(t=0, 1) { x = 4.2; y = 0.2 + 1.8*t; label = 2; }
border b3(t=0, 1) { x = 4.2 - 4.2*t; y = 2; label = 3; }
border b4(t=0, 1) { x = 0; y = 2 - 2*t; label = 4; }
body = buildmesh(b1(16) + b5(1) + b2(8) + b3(16) + b4(8));
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro displacement1() on(1, u1 = 0.01) //
macro displacement4() on(5, u1 = 0.05) //
macro displacement3() on(2, u1 = 0.03) //
macro probePoints() [4., 0., 4.2, 0.2] //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(1)
def test_a_label_of_one_edge_says_what_both_its_ends_do(solved, tmp_path, element):
    """It has no vertex of its own; its number is the highest at both."""
    path = tmp_path / "short.edp"
    path.write_text(SHORT)
    run = solved(path, element=element)
    table = read_table(run.directory / "probes.csv")
    np.testing.assert_allclose(np.array(table["u_x"], float), 0.05, atol=1e-15)
    assert any("differ by 0.0" in line and "where these meet" in line
               for line in run.summary["warnings"])


def test_smooth_displacements_are_no_jumps_on_coarse_meshes(corners):
    """Three edges of a parabola are level in the middle; its ends are those of the next label."""
    support = "displacement1() on(4, u1 = 0.) + on(3, u1 = 0.01*x*(2. - x))"
    for cells in (3, 4, 9):
        assert not corners(support, cells=cells)[1]
