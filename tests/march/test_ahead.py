"""What is read and eliminated while FreeFEM writes changes no bit of what comes after."""

import shutil

import numpy as np
import pytest
from mpi4py import MPI

from driver.errors import NoSolution
from driver.feti import reduction
from driver.feti.cholesky import Interior
from driver.march import ahead as stage
from driver.march.ahead import Ahead
from driver.march.problem import assemble
from driver.scene import loader
from driver.scene.manifest import announced, read_manifest
from driver.scene.records import Records, record_layout

# supports, contact and pairs meet cuts; quadratic, several bodies, sliding, loose ones
SCENES = ["tutorial", "bracket", "joint", "latch", "o-ring", "stack"]


@pytest.fixture
def made(monkeypatch):
    """Interiors that were eliminated: of how many nodes the rim was."""
    sizes = []

    def count(K, rim, free):
        sizes.append(len(rim))
        return Interior(K, rim, free)

    monkeypatch.setattr(reduction, "Interior", count)
    return sizes


def matrices(problem) -> list[np.ndarray]:
    """Of all classes, what products and the coarse problem are made of."""
    return [part for c in problem.operator.classes for part in (c.F, c.A, c.S)]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.some(1)
def test_all_some_or_nothing_ahead_have_the_same_bits(exported, made, name):
    """And nothing is eliminated twice: a record says all that the rim needs."""
    export = exported(name, subdomains=7, steps=1)
    alone = assemble(export, MPI.COMM_SELF)
    number, weights = len(made), np.ones(alone.structure.patterns)
    for steps in (3, 100):
        ahead = Ahead(export, MPI.COMM_SELF)
        assert sum(ahead.advance() for _ in range(steps)) == min(steps, 7)
        made[:] = made[number:]
        problem = assemble(export, MPI.COMM_SELF, ahead=ahead)
        assert len(made) == number and not ahead.interiors and ahead.export is None
        for one, other in zip(matrices(problem), matrices(alone), strict=True):
            assert np.array_equal(one, other)
        x = np.linspace(-1, 1, problem.operator.owned)
        for one, other in zip(problem.operator.displacements(x, weights),
                              alone.operator.displacements(x, weights)):
            assert np.array_equal(one, other)


# lines of one label, that of a side of the outline too, which cuts into few or many pieces follow
LINES = """include "scene.idp"
border bottom(t=0, 2) { x = t; y = 0; label = 1; }
border right(t=0, 1) { x = 2; y = t; label = 9; }
border top(t=0, 2) { x = 2 - t; y = 1; label = 3; }
border left(t=0, 1) { x = 0; y = 1 - t; label = 4; }
border line1(t=0, 1) { x = 0.5; y = t; label = 9; }
border line2(t=0, 1) { x = 1; y = t; label = 9; }
border line3(t=0, 1) { x = 1.5; y = t; label = 9; }
body = buildmesh(bottom(16) + right(8) + top(16) + left(8) + line1(8) + line2(8) + line3(8));
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1.) //
macro contact() 1 //
include "export.idp"
"""


@pytest.mark.parametrize("cut, element", [(2, "P1"), (4, "P2"), (50, "P1"), (50, "P2")])
@pytest.mark.some(2)
def test_cuts_along_lines_inside_a_body_are_interfaces(exported, named_scene, made, cut, element):
    """Whatever labels the lines have; but for them the outline and what is inside keep theirs."""
    export = exported(named_scene("lines", LINES), subdomains=cut, element=element)
    subdomains = loader.read_subdomains(read_manifest(export), 0, cut, MPI.COMM_SELF)
    label, along = read_manifest(export).interface_label, 0
    held = np.bincount(np.concatenate([np.unique(sub.node_gid) for sub in subdomains]))
    for sub in subdomains:
        x, y = sub.xy[sub.edges].mean(axis=1).T
        outer = np.isin(y, (0, 1)) | np.isin(x, (0, 2))
        sides = np.sort(sub.elements[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        once = [(sides == np.sort(edge)).all(axis=1).sum() == 1 for edge in sub.edges]
        cuts = sub.edge_label == label
        assert np.array_equal(cuts, once & ~outer)
        assert (held[sub.node_gid[sub.edges[cuts]]] > 1).all()
        along += np.isin(x[cuts], (0.5, 1.0, 1.5)).sum()
        assert set(sub.edge_label[~cuts & (x == 2)]) <= {9}
    assert along >= 8
    ahead = Ahead(export, MPI.COMM_SELF)
    while ahead.advance():
        pass
    number = len(made)
    assemble(export, MPI.COMM_SELF, ahead=ahead)
    assert len(made) == number == cut


def test_a_rim_that_lacks_what_rows_need_is_widened(exported, made, monkeypatch):
    """As where a subdomain touches another one in a vertex of its outer boundary alone."""
    export = exported("tutorial", subdomains=7, steps=1)
    wanted = matrices(assemble(export, MPI.COMM_SELF))
    rim = loader._rim
    monkeypatch.setattr(loader, "_rim", lambda *record: rim(*record)[::2])
    ahead = Ahead(export, MPI.COMM_SELF)
    while ahead.advance():
        pass
    found = matrices(assemble(export, MPI.COMM_SELF, ahead=ahead))
    assert len(made) == 21 and np.less(made[7:14], made[14:]).all()
    # another order of elimination: rounding of factors with condition numbers to 1e4
    for one, other in zip(found, wanted, strict=True):
        assert np.abs(one - other).max(initial=0) <= 1e-11 * np.abs(other).max(initial=0)


def test_supports_that_neighbours_mark_inside_are_heeded(exported, made):
    """Whatever marks a dof that the record leaves free: K_ii is not what was eliminated."""
    export = exported("tutorial", subdomains=7, steps=1)
    problem = assemble(export, MPI.COMM_SELF)
    structure, s = problem.structure, 3
    sub, known = structure.subdomains[s], reduction.interior_of(structure.subdomains[s])
    inner = np.setdiff1d(np.arange(sub.dofs), np.concatenate([2 * sub.rim, 2 * sub.rim + 1]))
    structure.fixed[s] = np.sort(np.append(structure.fixed[s], inner[5]))
    structure.fixed_values[s] = np.zeros((structure.patterns, len(structure.fixed[s])))
    c = reduction.reduce_class(structure, [s], sub.stiffness, False, {sub.index: known})
    dense = c.K.toarray()
    wanted = c.B_r @ np.linalg.solve(dense[np.ix_(c.torn, c.torn)], c.B_r.T.toarray())
    assert len(c.torn) == sub.dofs - len(c.corner) - len(structure.fixed[s])
    assert np.abs(c.F - wanted).max() <= 1e-11 * np.abs(wanted).max()


def test_what_is_not_sound_is_left_to_the_loader(exported, tmp_path, monkeypatch):
    """A stiffness that is not positive definite, and records that are none: nothing is kept."""
    export = exported("tutorial", subdomains=7, steps=1)
    shutil.copytree(export, tmp_path, dirs_exist_ok=True)
    calls = []

    def singular(sub):
        calls.append(sub.index)
        if sub.index == 2:
            raise NoSolution("singular")
        return reduction.interior_of(sub)

    monkeypatch.setattr(stage, "interior_of", singular)
    ahead = Ahead(tmp_path, MPI.COMM_SELF)
    assert [ahead.advance() for _ in range(4)] == [True, True, False, False]
    assert calls == [0, 1, 2] and ahead.export is None and not ahead.interiors
    (tmp_path / "block-0.bin").write_bytes(bytes(range(256)) * 40)
    ahead = Ahead(tmp_path, MPI.COMM_SELF)
    assert not ahead.advance() and ahead.export is None


@pytest.mark.parametrize("problem, ends", [
    (MemoryError(), True), (OSError(116, "stale file handle"), True), (ZeroDivisionError(), False)])
def test_what_cannot_be_read_ahead_is_read_afterwards(exported, monkeypatch, problem, ends):
    """No room, or a file system that does not answer; a defect is told of at once."""
    def fails(sub):
        raise problem

    ahead = Ahead(exported("tutorial", subdomains=7, steps=1), MPI.COMM_SELF)
    assert ahead.advance()
    monkeypatch.setattr(stage, "interior_of", fails)
    if ends:
        assert not ahead.advance() and not ahead.interiors and not ahead.advance()
    else:
        with pytest.raises(ZeroDivisionError):
            ahead.advance()


def test_interiors_of_what_freefem_did_not_leave_do_not_count(exported, tmp_path):
    """Those of a body half as stiff, in the same places."""
    export = exported("tutorial", subdomains=7, steps=1)
    wanted = matrices(assemble(export, MPI.COMM_SELF))
    shutil.copytree(export, tmp_path, dirs_exist_ok=True)
    words = np.fromfile(tmp_path / "block-0.bin", np.int64)
    file = Records(tmp_path / "block-0.bin", words)
    manifest = announced(tmp_path)
    for _ in range(manifest.subdomains):
        layout, begin = record_layout(file.head(), manifest), file.position
        for name, count, _ in layout:
            if name == "values":
                words[begin + 1 : begin + 1 + count].view(float)[:] /= 2
            begin += 1 + count
        file.position = begin
    words.tofile(tmp_path / "block-0.bin")
    ahead = Ahead(tmp_path, MPI.COMM_SELF)
    while ahead.advance():
        pass
    assert len(ahead.interiors) == 7
    shutil.copytree(export, tmp_path, dirs_exist_ok=True)
    found = matrices(assemble(tmp_path, MPI.COMM_SELF, ahead=ahead))
    assert all(map(np.array_equal, found, wanted))


def test_nothing_is_done_before_there_is_something(tmp_path, exported):
    """FreeFEM makes the mesh first."""
    ahead = Ahead(tmp_path / "export", MPI.COMM_SELF)
    assert not ahead.advance()
    shutil.copytree(exported("tutorial", subdomains=7, steps=1), tmp_path / "export")
    assert ahead.advance() and ahead.export.subdomains[0].index == 0


def test_a_subdomain_like_the_one_before_has_its_factor(exported, monkeypatch):
    """Equal ones are of a class, which is reduced once."""
    ahead, other = (Ahead(exported("tutorial", subdomains=7, steps=1), MPI.COMM_SELF)
                    for _ in range(2))
    ahead.advance()
    first, again = ahead.interiors[0], ahead.export.subdomains[0]
    monkeypatch.setattr(ahead.export, "read", lambda: ahead.export.subdomains.append(again)
                        or again)
    assert ahead.advance() and ahead.interiors == {0: first}
    assert other.advance() and other.advance() and list(other.interiors) == [0, 1]
