"""Fields for ParaView: what the files hold, read by meshio and, where it is installed, by VTK."""

import re
import subprocess
import sys
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from driver import children
from driver.contact.states import ContactField
from driver.files import read_fields, read_table
from driver.results import contact_lines
from driver.results.contact_lines import ContactLines
from driver.results.vtu import VtuMesh, in_space


@pytest.fixture(scope="module", params=["P1", "P2"])
def wedge(request, solved):
    return solved("wedge", element=request.param, steps=2, h=8, subdomains=6, fields="yes",
                  rtol=1e-11, primal_rtol=1e-8)


def test_step_0_is_the_undeformed_body_and_times_are_named(wedge):
    text = (wedge.directory / "fields.pvd").read_text()
    assert re.findall(r'timestep="([^"]+)".*?file="([^"]+)"', text) == [
        (f"{0.5 * k!r}", f"fields/step_{k:04d}.vtu") for k in range(3)]
    start = meshio.read(wedge.directory / "fields/step_0000.vtu")
    assert not start.point_data["displacement"].any() and not start.cell_data["von_mises"][0].any()
    end = meshio.read(wedge.directory / "fields/step_0002.vtu")
    assert set(start.point_data) == set(end.point_data) == {"displacement", "stress"}
    assert set(start.cell_data) == set(end.cell_data) == {"stress", "von_mises", "subdomain",
                                                          "body", "region"}


def test_bodies_and_subdomains(wedge):
    """Two bodies, one above the other; each subdomain belongs to one of them."""
    data = meshio.read(wedge.directory / "fields/step_0001.vtu")
    kind, = data.cells_dict
    middle = data.points[data.cells_dict[kind][:, :3]].mean(axis=1)
    body, subdomain = (data.cell_data[name][0] for name in ("body", "subdomain"))
    assert sorted(np.unique(body)) == [0, 1]
    assert middle[body == 0][:, 1].mean() < middle[body == 1][:, 1].mean()
    for number in np.unique(subdomain):
        assert len(np.unique(body[subdomain == number])) == 1
    assert len(np.unique(subdomain)) == wedge.summary["sizes"]["subdomains"]


def test_averaged_stress_is_continuous_in_a_body_and_keeps_means(wedge):
    """Copies of a node have the same value; of linear elements a node's is the mean by area."""
    data = meshio.read(wedge.directory / "fields/step_0002.vtu")
    kind, = data.cells_dict
    nodes, body = data.cells_dict[kind], data.cell_data["body"][0]
    at_nodes, mean = data.point_data["stress"], data.cell_data["stress"][0]
    assert at_nodes.shape[1] == mean.shape[1] == 4
    owner = np.zeros(len(data.points), int)
    owner[nodes] = body[:, None]
    place = np.column_stack([np.round(data.points[:, :2], 9), owner])
    _, first, inverse = np.unique(place, axis=0, return_index=True, return_inverse=True)
    assert len(first) < len(place)
    inverse = inverse.ravel()
    assert np.array_equal(at_nodes, at_nodes[first][inverse])
    if kind == "triangle":
        a, b, c = (data.points[nodes[:, k], :2] for k in range(3))
        area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
        total, weight = np.zeros((len(first), 4)), np.zeros(len(first))
        np.add.at(total, inverse[nodes], (area[:, None] * mean)[:, None])
        np.add.at(weight, inverse[nodes], area[:, None])
        np.testing.assert_allclose(at_nodes[first], total / weight[:, None],
                                   atol=1e-12 * abs(mean).max())


def test_a_uniform_stress_is_the_same_everywhere(solved):
    """Patch test at an angle: nodes, triangles and the closed form; s33 = nu (s11 + s22)."""
    for element in ("P1", "P2"):
        run = solved("patch", element=element, cells=3, fields="yes", rtol=1e-12)
        data = meshio.read(run.directory / "fields/step_0001.vtu")
        stress = data.point_data["stress"]
        pressure = -run.contact["sigma_n"].mean()
        expected = np.zeros(4)
        expected[1], nu = -pressure, stress[0, 2] / stress[0, :2].sum()
        expected[2] = -nu * pressure
        assert 0.1 < nu < 0.5
        np.testing.assert_allclose(stress, np.tile(expected, (len(stress), 1)),
                                   atol=1e-8 * pressure)


def test_openings_of_contact_lines(tmp_path):
    """What displacements against a gap, and what is worn off, leave of it."""
    n = 3
    b = SimpleNamespace(gid=np.arange(n), xy=np.column_stack([np.arange(3.0), np.zeros(n)]),
                        gap=np.array([0.5, 1.0, 2.0]), normal=np.tile([0.0, -1.0], (n, 1)),
                        label=np.ones(n), motion=None)
    (tmp_path / "fields").mkdir()
    lines = ContactLines(tmp_path, None, False)
    lines.structure = SimpleNamespace(contact=SimpleNamespace(declared=SimpleNamespace(
        at=lambda time: b)))
    lines.mesh = VtuMesh(in_space(b.xy), np.array([[0, 1], [1, 2]]), {}, {})
    state = {ContactField.U_N: np.array([0.25, 0.5, 4.0]), "wear": np.array([0.0, 0.0, 2.0])}
    for field in (ContactField.SIGMA_N, ContactField.SIGMA_T, ContactField.SLIP,
                  ContactField.STATUS):
        state[field] = np.zeros(n)
    lines.write(1, 0.0, np.zeros((n, 2)), state)
    data = meshio.read(tmp_path / "fields/contact_0001.vtu")
    assert data.point_data["opening"].tolist() == [0.25, 0.5, 0.0]
    assert data.point_data["wear"].tolist() == [0.0, 0.0, 2.0]


def test_contact_lines_hold_what_contact_csv_says(wedge):
    table = read_table(wedge.directory / "contact.csv")
    assert "boundary" not in table  # there is one
    for step in (1, 2):
        data = meshio.read(wedge.directory / f"fields/contact_{step:04d}.vtu")
        own = {name: column[table["step"] == step] for name, column in table.items()}
        order = np.lexsort((own["node"],))
        assert np.array_equal(data.points[:, 0], own["x"][order])
        for name, column, sign in (("pressure", "sigma_n", -1), ("shear", "sigma_t", 1),
                                   ("gap", "gap", 1), ("slip", "slip", 1)):
            assert np.array_equal(data.point_data[name], sign * own[column][order])
        names = np.array(["open", "stick", "slip"])
        assert np.array_equal(names[data.point_data["status"]], own["status"][order])
        assert np.allclose(data.point_data["opening"], own["gap"] - own["u_n"])
        assert "obstacle" not in data.point_data  # it stands still
        lines = data.cells_dict["line"]
        assert len(lines) == len(data.points) - 1  # an open chain
        assert np.array_equal(lines.T, [np.arange(len(lines)), 1 + np.arange(len(lines))])
    assert (wedge.directory / "contact.pvd").read_text().count("contact_000") == 2


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_lines_go_on_from_label_to_label_and_round_corners(solved, tmp_path, element):
    """A floor of two labels and a wall of a third: one line along each, whichever label the node
    between the first two reports; the corner is there twice, once for each direction.
    """
    path = tmp_path / "corner.edp"
    path.write_text("""include "scene.idp"
units("m", "Pa");
subdomains("3");
int[int] sides = [8, 5, 3, 4];
mesh block = square(6, 4, [2.*x, y], label = sides);
func int half(int l, real px) { return (l == 8 && px > 1.) ? 7 : l; }
body = change(block, flabel = half(label, x));
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0.5, -1.) //
macro contact() 8, 7, 5 //
include "export.idp"
""")
    run = solved(path, element=element, fields="yes")
    assert run.status == 0, run.reason
    data = meshio.read(run.directory / "fields/contact_0001.vtu")
    lines = data.cells_dict["line"]
    ends = data.points[lines]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    first = 2 / 6 * (1 if element == "P1" else 0.5)  # from the clamped corner to the first node
    assert length.sum() == pytest.approx(3 - first)
    assert np.count_nonzero(np.abs(data.points - [2, 0, 0]).max(axis=1) < 1e-12) == 2


def test_lines_close_a_ring_and_leave_gaps_between_boundaries(solved):
    ring = solved("pressfit", fields="yes", h=4)
    data = meshio.read(ring.directory / "fields/contact_0001.vtu")
    lines = data.cells_dict["line"]
    held = len(np.unique(lines))
    assert held == len(data.points)
    assert len(lines) in (len(data.points), len(data.points) - 1)
    length = np.linalg.norm(np.subtract(*data.points[lines.T]), axis=1)
    assert length.max() < 3 * np.median(length)
    two = solved("bracket", fields="yes", steps=1, h=8)
    data = meshio.read(two.directory / "fields/contact_0001.vtu")
    label = data.point_data["boundary"]
    assert np.array_equal(*label[data.cells_dict["line"].T])


def test_no_line_leads_to_a_clamped_node(solved):
    """The model's contact boundary begins at its clamped side: the first edge has one contact node.
    """
    run = solved("model", cells=3, steps=1, fields="yes")
    data = meshio.read(run.directory / "fields/contact_0001.vtu")
    lines = data.cells_dict["line"]
    assert len(data.points) == 12 and data.points[0, 0] > 0
    assert np.array_equal(lines.T, [np.arange(11), 1 + np.arange(11)])


def test_vtk_itself_reads_the_files(wedge):
    """VTK is no package of the suite; where it is installed it names the components."""
    vtk = pytest.importorskip("vtk")
    for name in ("fields/step_0002.vtu", "fields/contact_0002.vtu"):
        reader = vtk.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(wedge.directory / name))
        reader.Update()
        grid = reader.GetOutput()
        assert reader.GetErrorCode() == 0 and grid.GetNumberOfPoints() > 0
        points = grid.GetPointData()
        assert points.GetArray("displacement").GetNumberOfComponents() == 3
        if name.startswith("fields/step"):
            for data in (points, grid.GetCellData()):
                stress = data.GetArray("stress")
                assert [stress.GetComponentName(k) for k in range(4)] == ["xx", "yy", "zz", "xy"]


def test_names_of_components_are_in_the_file(wedge):
    """meshio reads past them."""
    text = (wedge.directory / "fields/step_0001.vtu").read_bytes()
    names = b'ComponentName0="xx" ComponentName1="yy" ComponentName2="zz" ComponentName3="xy"'
    assert text.count(b'Name="stress" ' + names) == 2


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(2)
def test_stiffness_is_there_where_the_material_varies(solved, wedge, element):
    """The shear modulus E/(2 (1 + nu)) of aluminium on steel, region by region."""
    assert "shear_modulus" not in meshio.read(wedge.directory / "fields/step_0001.vtu").cell_data
    run = solved("bracket", steps=1, h=12, element=element, without="quasistatic",
                 fields="yes")
    cells = meshio.read(run.directory / "fields/step_0000.vtu").cell_data
    shear, region = cells["shear_modulus"][0], cells["region"][0]
    for number, modulus in ((1, 70e3 / 2.66), (2, 210e3 / 2.6)):
        np.testing.assert_allclose(shear[region == number], modulus, rtol=1e-9)


PIECES = """
import sys
from pathlib import Path
from types import SimpleNamespace
from driver import environment
environment.prepare_libraries(); environment.start_petsc()
import numpy as np
from mpi4py import MPI
from driver.feti.operator import DualOperator
from driver.march.tearing import build
from driver.results import fields, pieces
from driver.scene.loader import read_subdomains
from driver.scene.manifest import read_manifest
from driver.feti.structure import partition
export, out = map(Path, sys.argv[1:])
manifest, step = read_manifest(export), SimpleNamespace(index=1, time=0.5, weights=None)

def write(comm, folder, size):
    pieces.PIECE = size
    first, last = partition(manifest.subdomains, comm)
    subdomains = read_subdomains(manifest, first, last, comm)
    structure = build(manifest, subdomains, first, comm)
    step.weights = np.ones(structure.patterns)
    made = [np.random.default_rng(sub.index).standard_normal(sub.dofs) for sub in subdomains]
    if comm.rank == 0:
        folder.mkdir()
    comm.Barrier()
    files = fields.Fields(folder, manifest.element, DualOperator(structure, comm))
    files.lines = None  # they have a file of their own
    files.add(step, made, {})
    triangles = comm.allreduce(sum(len(sub.triangles) for sub in subdomains))
    files.indicate(step, np.arange(1.0, triangles + 1) if comm.rank == 0 else None)
    return files

files = write(MPI.COMM_WORLD, out / "ranks", 40)
if MPI.COMM_WORLD.rank == 0:
    files.write_collections()
    write(MPI.COMM_SELF, out / "alone", 40)
    write(MPI.COMM_SELF, out / "whole", 10**6)
    print(*files.files)
"""


@pytest.mark.slow
@pytest.mark.parametrize("ranks, scene, options", [
    (3, "wedge", {"element": "P2", "h": 8, "subdomains": 6}),
    pytest.param(2, "stack", {"subdomains": 13}, marks=pytest.mark.slow),
    pytest.param(5, "model", {"subdomains": "3x1", "cells": 6}, marks=pytest.mark.slow)])
def test_pieces_hold_what_one_file_does_whoever_writes_them(exported, tmp_path, ranks, scene,
                                                            options):
    """Several ranks write byte for byte the files of one; together they are those of one file."""
    script = tmp_path / "pieces.py"
    script.write_text(PIECES)
    env = {**children.child_environment(), "PYTHONPATH": children.python_path()}
    done = subprocess.run([*children.mpirun(ranks), sys.executable, script,
                           exported(scene, **options), tmp_path], env=env, text=True,
                          capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr[-3000:]
    written = {path.name: path.read_bytes() for path in (tmp_path / "ranks/fields").iterdir()}
    assert written == {path.name: path.read_bytes()
                       for path in (tmp_path / "alone/fields").iterdir()}
    pieces = written["step_0001.pvtu"].decode()
    count = pieces.count("<Piece ")
    assert count > 1 and len(written) == 3 * (count + 1)
    assert done.stdout.split()[0] == "fields/step_0001.pvtu"
    assert len(done.stdout.split()) == count + 1
    assert 'file="fields/step_0001.pvtu"' in (tmp_path / "ranks/fields.pvd").read_text()
    for name in ("step_0000", "step_0001", "error_0001"):
        parts = read_fields(tmp_path / f"ranks/fields/{name}.pvtu")
        whole = read_fields(tmp_path / f"whole/fields/{name}.vtu")
        assert np.array_equal(parts.points, whole.points)
        assert parts.cells[0].type == whole.cells[0].type
        assert np.array_equal(parts.cells[0].data, whole.cells[0].data)
        for one, other in ((parts.point_data, whole.point_data),
                           (parts.cell_data, whole.cell_data)):
            assert set(one) == set(other)
            for key, values in other.items():
                assert np.array_equal(one[key], values), key
        header = set(re.findall(r'PDataArray type="(\w+)" Name="(\w+)"',
                                written[f"{name}.pvtu"].decode()))
        assert header == set(re.findall(r'DataArray type="(\w+)" Name="(\w+)"',
                                        written[f"{name}_0000.vtu"].decode(errors="ignore"))) - {
            ("Int64", "connectivity"), ("Int64", "offsets"), ("Int64", "types"),
            ("Float64", "Points")}


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("ring", [False, True])
def test_lines_are_the_sides_between_contact_nodes(ring, quadratic):
    """Of quadratic elements their halves; round a ring, and not from end to end of a boundary."""
    n = 8
    angle = 2 * np.pi * np.arange(n) / (n if ring else 12)
    xy = np.column_stack([np.cos(angle), np.sin(angle)])
    side = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    gid = 40 - 3 * np.arange(n)
    b = SimpleNamespace(xy=xy, arc=np.append(0.0, np.cumsum(side)), chain=np.zeros(n, int), gid=gid)
    pairs = [(k, (k + 1) % n) for k in range(n if ring else n - 1)]
    edges, middles = [(gid[a], gid[c]) for a, c in pairs], []
    if quadratic and not ring:
        pairs.pop()  # seven nodes, three sides
    if quadratic:
        edges = [(gid[k], gid[(k + 2) % n]) for k in range(0, len(pairs), 2)]
        middles = [gid[k + 1] for k in range(0, len(pairs), 2)]
    structure = SimpleNamespace(contact=SimpleNamespace(declared=b), outer_edges=np.column_stack(
        [np.array(edges), np.ones(len(edges), int)]), outer_middles=np.array(middles, int))
    found = contact_lines._lines(structure)
    assert found.tolist() == sorted(sorted(pair) for pair in pairs)
