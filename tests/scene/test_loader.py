"""What FreeFEM exports is what it assembled, and a spoiled export is refused with a reason."""

import json
import shutil
from dataclasses import MISSING

import numpy as np
import pytest
from conftest import read_problem
from mpi4py import MPI

from driver import environment
from driver.errors import InputError
from driver.scene import freefem, records, seal
from driver.scene.loader import read_subdomains
from driver.scene.manifest import Manifest, read_manifest

YOUNG, POISSON = 21.19e10, 0.277
# arrays of a record of the model example, in the order of export.idp
(HEAD, GID, X, Y, LABELS, TRIANGLES, REGION, EDGES, LAMBDA, MU, DOF_COORDINATE, IS_X, ROWS, COLUMNS,
 VALUES, LOAD, FIXED,
 EDGE_LOAD, UNSEEN, CONTACT) = range(20)


# ------------------------------------------------------------------------------ a sound export

@pytest.fixture(scope="module")
def model(built):
    return built(reduce=False, cells=4)


def test_rigid_body_motions_cost_nothing(model):
    """Pure Neumann matrix: no support and no penalty may have been assembled into it."""
    for sub in model.subdomains:
        x, y = sub.xy.T
        for motion in (np.column_stack([1 + 0 * x, 0 * x]), np.column_stack([0 * x, 1 + 0 * x]),
                       np.column_stack([-y, x])):
            force = sub.stiffness @ motion.ravel()
            # at most 14 products a row, each rounded
            assert np.abs(force).max() <= 1e-13 * np.abs(sub.stiffness.values).max() * \
                np.abs(motion).max()


def p1_stiffness(sub, factor=lambda x, y: 1.0):
    """Dense plane strain stiffness from the mesh and Young's modulus and Poisson's ratio alone.

    `factor` multiplies Young's modulus; linear on every triangle, it is what it is at the centroid.
    """
    lam, mu = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
    C = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
    K = np.zeros((sub.dofs, sub.dofs))
    for triangle in sub.triangles:
        place = np.column_stack([np.ones(3), sub.xy[triangle]])
        gx, gy = np.linalg.inv(place)[1:]
        strain = np.zeros((3, 6))
        strain[0, 0::2], strain[1, 1::2], strain[2, 0::2], strain[2, 1::2] = gx, gy, gy, gx
        dof = (2 * triangle[:, None] + [0, 1]).ravel()
        area = 0.5 * abs(np.linalg.det(place))
        K[np.ix_(dof, dof)] += area * factor(*sub.xy[triangle].mean(axis=0)) * strain.T @ C @ strain
    return K


@pytest.mark.parametrize("subdomains", ["4x2", "5"])
def test_stiffness_equals_an_independent_assembly(built, subdomains):
    for sub in built(reduce=False, cells=4, subdomains=subdomains).subdomains:
        K = p1_stiffness(sub)
        # inverting 3x3 matrices of condition < 1e3 (cells of size 1/8) costs three digits
        assert np.abs(sub.stiffness.toarray() - K).max() <= 1e-12 * np.abs(K).max()


def test_loads_are_the_integrals_of_the_tractions(model):
    """Resultant of -1e8 on the top (length 2) and of (3e7, 5e7) on the right side (length 1)."""
    total = sum(np.array([sub.loads[0, 0::2].sum(), sub.loads[0, 1::2].sum()])
                for sub in model.subdomains)
    # sums of some hundred roundings
    np.testing.assert_allclose(total, [3e7, 5e7 - 2e8], rtol=1e-13)


def test_distributed_loads_are_integrals_over_edges_and_triangles(built):
    """Uneven tractions and body forces: moments against hat functions by Gauss quadrature, exact
    here to rounding.

    On the corner triangle of the top right two loaded edges meet: nodal forces could not tell them
    apart.
    """
    problem = built("cantilever", reduce=False, cells=3, subdomains="2x1")
    k, w, a, E, nu = 1.3, 0.0025, 0.005, 1000.0, 0.3
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    def s11(x, y):
        return (2 * lam + 2 * mu) * w * k * np.cos(k * x) * np.cos(k * y)

    def s12(x, y):
        return mu * (-2 * w * k * np.sin(k * x) * np.sin(k * y) + 2 * a * x)

    n = {1: (0, -1), 2: (1, 0), 3: (0, 1)}
    at, weight = np.polynomial.legendre.leggauss(3)  # FreeFEM's own rule on edges
    at, weight = (1 + at) / 2, weight / 2
    patterns = [p["kind"] for p in problem.manifest.patterns]
    load, body = patterns.index("traction"), patterns.index("body_force")
    for sub in problem.subdomains:
        for (i, j), label, found in zip(sub.edges, sub.edge_label, sub.edge_loads[load]):
            p, q = sub.xy[[i, j]]
            x, y = (p + at[:, None] * (q - p)).T
            t = np.zeros((2, 3))
            if label in n:
                t = np.array([s11(x, y) * n[label][0] + s12(x, y) * n[label][1],
                              s12(x, y) * n[label][0] + s11(x, y) * n[label][1]])
            moments = [(t * weight * (1 - at)).sum(axis=1), (t * weight * at).sum(axis=1)]
            expected = np.linalg.norm(q - p) * np.array(moments)
            # 7.5: the largest traction
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * 7.5)
        total = np.zeros_like(sub.xy)
        np.add.at(total, sub.triangles, sub.body_loads[body])
        np.testing.assert_allclose(total.ravel(), sub.loads[body], rtol=0,
                                   atol=1e-12 * np.abs(sub.loads[body]).max())


def test_supports_and_contact_are_where_the_scene_says(model):
    for sub in model.subdomains:
        left = np.flatnonzero(sub.xy[:, 0] == 0)
        assert sub.fixed.tolist() == (2 * left[:, None] + [0, 1]).ravel().tolist()
        bottom = np.flatnonzero(sub.xy[:, 1] == 0)
        c = sub.contact
        assert (c is None) == (len(bottom) == 0)
        if c is not None:
            assert sorted(c.node) == bottom.tolist()
            np.testing.assert_allclose(c.normal, np.tile([0, -1], (len(bottom), 1)), atol=1e-15)
            # the segments add up to the side's length
            assert c.weight.sum() == pytest.approx(0.5, rel=1e-14)
            assert c.columns.keys() == {"friction"}
            assert np.allclose(c.columns["friction"], 0.3, rtol=1e-15)


def test_export_is_exact_to_the_last_bit(model):
    """The scene's lattice formula evaluated in double precision gives the very bits of the file."""
    for sub in model.subdomains:
        column, row = sub.node_gid % 17, sub.node_gid // 17
        assert np.array_equal(sub.xy[:, 0], 0 + (2.0 - 0) * (column / 16))
        assert np.array_equal(sub.xy[:, 1], 0 + (1.0 - 0) * (row / 8))


@pytest.mark.parametrize("value", [0.1 + 0.2, 1 / 3, 0.3 * (1 + 2**-52), 1.2345678901234567e-8])
def test_manifest_numbers_round_trip(exported, value):
    found = read_manifest(exported(cells=2, subdomains="2x1", friction=repr(value)))
    assert found.parameters["friction"] == value


def test_amplitudes_are_those_of_the_slides(exported):
    m = read_manifest(exported(cells=2, subdomains="2x1", loading="nonmonotone", steps=7))
    expected = [-4 * (i / 7) ** 2 + 5 * (i / 7) for i in range(8)]
    # a few roundings of 5t
    np.testing.assert_allclose(m.amplitudes["1"], expected, rtol=0, atol=4e-16 * 5)
    assert m.steps == 7 and m.t_end == 1


def test_more_ranks_export_the_same_bytes(exported):
    one, three = (exported(ranks=ranks, cells=2) for ranks in (1, 3))
    blocks = [(three / f"block-{k}.bin").read_bytes() for k in range(3)]
    assert b"".join(blocks) == (one / "block-0.bin").read_bytes()
    assert read_manifest(three).blocks == 3


# ----------------------------------------------------------- exports changed after they were sealed

@pytest.fixture
def sealed(exported, copied):
    """A private copy of a sealed export in three blocks."""
    return copied(exported(ranks=3, cells=2))


def flip(path, bit):
    """Turn one bit of a file over."""
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


@pytest.mark.parametrize("name", ["block-0.bin", "block-2.bin", "manifest.json"])
def test_any_flipped_bit_is_seen(sealed, name):
    """Also the last bit of a number, with which the export would look sound."""
    path = sealed / name
    whole = path.read_bytes()
    for bit in np.random.default_rng(7).integers(0, 8 * len(whole), 60):
        flip(path, int(bit))
        with pytest.raises(InputError, match=f"{name} was changed after FreeFEM wrote it"):
            read_problem(sealed, reduce=False)
        path.write_bytes(whole)


@pytest.mark.parametrize("name", ["block-1.bin", "manifest.json"])
@pytest.mark.parametrize("spoil, said", [
    (lambda path: path.write_bytes(path.read_bytes()[:-8]), "is truncated"),
    (lambda path: path.write_bytes(b""), "is truncated: 0 of"),
    (lambda path: path.write_bytes(path.read_bytes() + b" "), "goes on after its last record"),
    (lambda path: path.unlink(), "is missing")], ids=["cut", "empty", "longer", "missing"])
def test_sealed_file_spoiled(sealed, name, spoil, said):
    spoil(sealed / name)
    with pytest.raises(InputError, match=f"{name} {said}"):
        read_problem(sealed, reduce=False)


def test_exchanged_blocks_are_named(sealed):
    (sealed / "block-0.bin").rename(sealed / "other")
    (sealed / "block-2.bin").rename(sealed / "block-0.bin")
    (sealed / "other").rename(sealed / "block-2.bin")
    with pytest.raises(InputError, match="block-0.bin holds what FreeFEM wrote to block-2.bin"):
        read_problem(sealed, reduce=False)


@pytest.mark.parametrize("text",
                         [None, "", "{", "[]", "{}", '{"scene": 1, "content": 2, "files": 3}',
                                  '{"scene": "", "content": "", "files": {"manifest.json": [1]}}'])
def test_seal_that_is_none(sealed, text):
    (sealed / "seal.json").unlink()
    if text is not None:
        (sealed / "seal.json").write_text(text)
    with pytest.raises(InputError, match="seal.json is (missing|not readable)"):
        read_problem(sealed, reduce=False)


def test_seal_does_not_depend_on_ranks(exported):
    """Content and scene digests are those of the same problem; another problem has others."""
    one, three = (seal.read(exported(ranks=ranks, cells=2)) for ranks in (1, 3))
    other = seal.read(exported(cells=2, friction="0.4"))
    assert (one.scene, one.content) == (three.scene, three.content)
    assert set(three.files) - set(one.files) == {"block-1.bin", "block-2.bin"}
    assert other.scene == one.scene and other.content != one.content


@pytest.mark.parametrize("edited", ["own.edp", "part.edp", "mesh.msh"])
def test_export_of_an_edited_scene_is_stale(exported, copied, variant, tmp_path, edited):
    """The script itself, what it includes, and data files that it or an included file names."""
    scene = tmp_path / "own.edp"
    scene.write_text(variant("own").read_text() + 'include "part.edp"\n')
    (tmp_path / "part.edp").write_text('string data = "mesh.msh";\n')
    (tmp_path / "mesh.msh").write_bytes(bytes(range(256)))
    directory = copied(exported(cells=2))
    seal.write(directory, freefem.text_digest(scene), ["block-0.bin"])
    read_manifest(directory, freefem.text_digest(scene))
    (tmp_path / edited).write_text("// another\n")
    with pytest.raises(InputError, match="stale"):
        read_manifest(directory, freefem.text_digest(scene))


def test_export_with_an_edited_library_is_stale(monkeypatch, tmp_path):
    """Also in a process that has read its scripts before."""
    library = shutil.copytree(environment.LIBRARY, tmp_path / "lib")
    monkeypatch.setattr(environment, "LIBRARY", library)
    scene = environment.ROOT / "edp" / "tutorial.edp"
    digests = [freefem.text_digest(scene)]
    for name, text in (("contact.idp", "// a remark\n"), ("another.idp", "")):
        with open(library / name, "a") as script:
            script.write(text)
        digests.append(freefem.text_digest(scene))
    assert len(set(digests)) == 3


def test_scene_edited_while_freefem_runs(tmp_path, variant, monkeypatch):
    """FreeFEM may have read the old text or the new one: neither can be vouched for."""
    scene, run_child = variant("edited"), freefem.children.run_child

    def edit_too(*words, **options):
        done = run_child(*words, **options)
        scene.write_text(scene.read_text() + "// an afterthought\n")
        return done

    monkeypatch.setattr(freefem.children, "run_child", edit_too)
    with pytest.raises(InputError, match="stale"):
        freefem.export(scene, tmp_path / "export", {"cells": "2"})


@pytest.mark.parametrize("code", ['savemesh(Th, "own.msh");', '{ ofstream out("own.msh"); }'])
def test_a_file_that_the_scene_writes_is_none_that_was_edited(tmp_path, code):
    scene = tmp_path / "mine.edp"
    scene.write_text(f'mesh Th = square(2, 2);\n{code}\nbody = readmesh("own.msh");\n')
    before = freefem.text_digest(scene)
    (tmp_path / "own.msh").write_text("whatever it is")
    assert freefem.text_digest(scene) == before
    scene.write_text('body = readmesh("own.msh");\n')
    before = freefem.text_digest(scene)
    (tmp_path / "own.msh").write_text("another one")
    assert freefem.text_digest(scene) != before


# ------------------------------------------- exports that FreeFEM, not the way to here, has spoiled

@pytest.fixture
def read(read):
    """The session's `read`, after a seal that vouches for whatever is there."""
    def sealed_again(directory, **options):
        seal.write(directory, "",
                   [f"block-{k}.bin" for k in range(len(list(directory.glob("block-*.bin"))))])
        return read(directory, **options)

    return sealed_again


@pytest.fixture
def small(exported, copied, variant):
    """A private copy of a tiny export: two subdomains of 2x2 cells, cut so that each has a
    stiffness of its own.
    """
    scene = variant("halves",
                    ('include "export.idp"', 'macro piece() (x > 1.) //\n\ninclude "export.idp"'))
    return copied(exported(scene, cells=3, subdomains="piece", steps=2))


@pytest.fixture
def sharing(exported, copied):
    """A private copy of a tiny export of the same subdomains, which share mesh and stiffness."""
    return copied(exported(cells=2, subdomains="2x1", steps=2))


def counted(path):
    """The int64 arrays of a file."""
    words = np.fromfile(path, np.int64)
    found, at = [], 0
    while at < len(words):
        found.append(words[at + 1 : at + 1 + words[at]].copy())
        at += 1 + words[at]
    return found


def arrays(directory):
    """Records of block-0.bin, each a list of int64 arrays in file order."""
    found = counted(directory / "block-0.bin")
    starts = [k for k, a in enumerate(found) if k == 0 or k == starts_of_second(found)]
    return [found[a:b] for a, b in zip(starts, [*starts[1:], len(found)])]


def starts_of_second(found):
    """Position of the second record: its head is the first later array of 9 words that starts with
    1.
    """
    return next(k for k, a in enumerate(found) if k > 2 and len(a) == 9 and a[0] == 1 and a[1]
                == found[0][1])


def write(directory, records):
    words = [word for record in records for a in record for word in (np.array([len(a)]), a)]
    np.concatenate(words).astype(np.int64).tofile(directory / "block-0.bin")


def spoil(directory, array, change, record=0):
    """Apply `change` to one array of a record, seen as what it holds."""
    records = arrays(directory)
    real = array in (X, Y, LAMBDA, MU, DOF_COORDINATE, IS_X, VALUES, LOAD,
                     EDGE_LOAD, UNSEEN) or array >= CONTACT + 2
    change(records[record][array].view(np.float64 if real else np.int64))
    write(directory, records)


def refused(read, directory, *words):
    with pytest.raises(InputError) as found:
        read(directory, reduce=False)
    message = str(found.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_rewritten_export_is_accepted(small, read):
    """The tests' own writer changes nothing by itself."""
    before = (small / "block-0.bin").read_bytes()
    write(small, arrays(small))
    assert (small / "block-0.bin").read_bytes() == before
    assert len(read(small, reduce=False).subdomains) == 2


@pytest.mark.slow
def test_truncated_anywhere(small, read):
    whole = (small / "block-0.bin").read_bytes()
    for size in [*range(0, len(whole), 8), *range(3, len(whole), 1001), len(whole) - 1]:
        (small / "block-0.bin").write_bytes(whole[:size])
        refused(read, small, "truncated")


def test_longer_than_its_records(small, read):
    with open(small / "block-0.bin", "ab") as file:
        file.write(bytes(8))
    refused(read, small, "after its last record")


@pytest.mark.parametrize("array",
                         [X, Y, LAMBDA, MU, DOF_COORDINATE, VALUES, LOAD, EDGE_LOAD, CONTACT + 2,
                          CONTACT + 5])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite(small, read, array, bad):
    spoil(small, array, lambda a: a.__setitem__(len(a) // 2, bad), record=1)
    refused(read, small, "not finite")


def test_edge_loads_that_are_not_the_nodal_ones(small, read):
    spoil(small, EDGE_LOAD, lambda a: a.__imul__(1 + 1e-6), record=1)
    refused(read, small, "edges", "nodes")


def write_both_triangles(directory):
    """The records of an export with all entries of the stiffness, not the lower triangle alone."""
    records_of = arrays(directory)
    for record in records_of:
        rows, columns = record[ROWS], record[COLUMNS]
        both = np.append(rows, columns[rows != columns]), np.append(columns, rows[rows != columns])
        order = np.lexsort(both[::-1])
        record[ROWS], record[COLUMNS] = (part[order] for part in both)
        record[VALUES] = np.append(record[VALUES], record[VALUES][rows != columns])[order]
        record[HEAD][5] = len(order)
    write(directory, records_of)


def test_both_triangles_are_those_of_the_lower_one(small, read):
    before = [sub.stiffness.toarray() for sub in read(small, reduce=False).subdomains]
    write_both_triangles(small)
    for sub, K in zip(read(small, reduce=False).subdomains, before):
        assert np.array_equal(sub.stiffness.toarray(), K) and np.array_equal(K, K.T)


def test_unsymmetric(small, read):
    write_both_triangles(small)
    rows, columns = (arrays(small)[0][k] for k in (ROWS, COLUMNS))
    entry = int(np.flatnonzero(rows != columns)[5])
    spoil(small, VALUES, lambda a: a.__setitem__(entry, a[entry] + 1e-9 * np.abs(a).max()))
    refused(read, small, "subdomain 0", "not symmetric")


def test_unsymmetric_pattern(small, read):
    write_both_triangles(small)
    rows, columns = (arrays(small)[0][k] for k in (ROWS, COLUMNS))
    last = int(np.flatnonzero(rows == 0)[-1])  # of the first row, farther to the right
    spoil(small, COLUMNS, lambda a: a.__setitem__(last, columns.max()))
    refused(read, small, "not symmetric")


def test_an_entry_of_the_stiffness_twice(small, read):
    spoil(small, COLUMNS, lambda a: a.__setitem__(1, a[2]))
    refused(read, small, "not in order")


def test_swapped_records(small, read):
    write(small, arrays(small)[::-1])
    refused(read, small, "belongs to subdomain 1")


def test_swapped_blocks(exported, copied, read):
    directory = copied(exported(ranks=3, cells=2))
    (directory / "block-0.bin").rename(directory / "other")
    (directory / "block-2.bin").rename(directory / "block-0.bin")
    (directory / "other").rename(directory / "block-2.bin")
    with pytest.raises(InputError, match="subdomain"):
        read(directory, reduce=False)


def test_missing_block(exported, copied, read):
    directory = copied(exported(ranks=3, cells=2))
    (directory / "block-1.bin").unlink()
    refused(read, directory, "block-1.bin", "missing")


def test_wrong_count_of_any_array(small, read):
    records = arrays(small)
    position, words = 0, np.fromfile(small / "block-0.bin", np.int64)
    for a in [a for record in records for a in record]:
        for wrong in (-1, 1):
            changed = words.copy()
            changed[position] += wrong
            changed.tofile(small / "block-0.bin")
            with pytest.raises(InputError):
                read(small, reduce=False)
        position += 1 + len(a)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # absurd lengths overflow
@pytest.mark.parametrize("value, apart", [
    (-1, 5), (2**40, 5), (np.float64(1e300).view(np.int64), 5),
    # slow: what all words of an array do, every fifth does; all lengths are hit
    pytest.param(-1, 1, marks=pytest.mark.slow), pytest.param(2**40, 1, marks=pytest.mark.slow),
    pytest.param(np.float64(1e300).view(np.int64), 1, marks=pytest.mark.slow)])
@pytest.mark.some(1)
def test_a_wild_word_anywhere_ends_in_no_traceback(small, read, value, apart):
    """Any word of the file overwritten: the export is refused by an InputError or read, nothing
    else.
    """
    lengths = np.cumsum([0] + [1 + len(a) for record in arrays(small) for a in record])[:-1]
    words = np.fromfile(small / "block-0.bin", np.int64)
    tried, accepted = sorted({*range(0, len(words), apart), *lengths.tolist()}), 0
    for at in tried:
        changed = words.copy()
        changed[at] = value
        changed.tofile(small / "block-0.bin")
        try:
            read(small, reduce=False)
            accepted += 1
        except InputError:
            pass
        except Exception as problem:
            raise AssertionError(f"word {at} set to {value}: {problem!r}") from problem
    assert accepted < len(tried) / 2


# ---------------------------------------------------------------- subdomains that share a stiffness

# where shared.bin has what records have elsewhere: no numbers of nodes and labels of edges
PLACES = {X: 1, Y: 2}
OF_SHARED = {**PLACES, **{array: array - 2 for array in range(TRIANGLES, LOAD)}}


def spoil_shared(directory, array, change):
    """Apply `change` to one array of shared.bin."""
    found = counted(directory / "shared.bin")
    real = array in (X, Y, LAMBDA, MU, DOF_COORDINATE, IS_X, VALUES)
    change(found[OF_SHARED[array]].view(np.float64 if real else np.int64))
    np.concatenate([word for a in found
                    for word in (np.array([len(a)]), a)]).tofile(directory / "shared.bin")


def test_shared_stiffness_is_that_of_every_piece(sharing, small, read):
    """The same two halves of the block, once with one stiffness and once with two."""
    one, two = (read(directory, reduce=False).subdomains for directory in (sharing, small))
    for sub, other in zip(one, two):
        for name in ("stiffness", "elements", "elasticity"):
            assert getattr(sub, name) is getattr(one[0], name)
        order = [np.flatnonzero(other.node_gid == gid)[0] for gid in sub.node_gid]
        dof = (2 * np.array(order)[:, None] + [0, 1]).ravel()
        expected = other.stiffness.toarray()[np.ix_(dof, dof)]
        assert np.array_equal(sub.xy, other.xy[order])
        # sums of up to 6, in another order
        assert np.abs(sub.stiffness.toarray() - expected).max() <= 1e-14 * np.abs(expected).max()


def test_shared_file_missing(sharing, read):
    (sharing / "shared.bin").unlink()
    refused(read, sharing, "shared.bin is missing")


def test_shared_file_spoiled_after_sealing(sharing):
    content = bytearray((sharing / "shared.bin").read_bytes())
    content[1000] ^= 1
    (sharing / "shared.bin").write_bytes(content)
    with pytest.raises(InputError, match="shared.bin was changed"):
        read_problem(sharing, reduce=False)


def test_shared_file_truncated_or_longer(sharing, read):
    whole = (sharing / "shared.bin").read_bytes()
    for size in range(0, len(whole), 8):
        (sharing / "shared.bin").write_bytes(whole[:size])
        refused(read, sharing, "shared.bin", "truncated")
    (sharing / "shared.bin").write_bytes(whole + bytes(8))
    refused(read, sharing, "shared.bin goes on after its last record")


@pytest.mark.parametrize("array, place, value, said", [
    (VALUES, 1, 1.0, "rigid motion"), (VALUES, 0, np.nan, "not finite"),
    (COLUMNS, 3, 10**6, "out of range"),
    (TRIANGLES, 0, 9, "out of range"), (EDGES, 0, 9, "ends at no vertex"),
    (IS_X, 0, 0.0, "node by node"),
    (LAMBDA, 0, np.inf, "not finite"), (X, 0, 0.1, "do not match"),
    (DOF_COORDINATE, 0, 0.1, "do not match")])
def test_shared_array_spoiled(sharing, read, array, place, value, said):
    spoil_shared(sharing, array, lambda a: a.__setitem__(place, value))
    refused(read, sharing, "shared.bin", said)


@pytest.mark.parametrize("distance", [1e-3, 1e-11])
@pytest.mark.parametrize("record", [0, 1])
def test_vertex_moved_of_a_piece_that_refers_to_the_shared_stiffness(sharing, read, record,
                                                                     distance):
    """The shared stiffness was checked on its own mesh: 1e-11 is some ten roundings in a rotation.
    """
    words = arrays(sharing)
    x, y = (words[record][array].view(float) for array in (X, Y))
    vertex = int(np.flatnonzero((x == 0.5 + record) & (y == 0.5))[0])
    words[record][X].view(float)[vertex] += distance
    write(sharing, words)
    refused(read, sharing, f"subdomain {record}", "resists a rigid motion")


def test_piece_of_another_size_than_the_shared_one(exported, sharing, read):
    other = exported(cells=3, subdomains="2x1", steps=2)
    (sharing / "shared.bin").write_bytes((other / "shared.bin").read_bytes())
    refused(read, sharing, "subdomain 0", "another size")


def test_stiffness_lost_where_none_is_shared(small, read):
    """A record without entries of the stiffness in an export whose subdomains have their own."""
    records = arrays(small)
    records[1] = records[1][: LABELS + 1] + records[1][LOAD:]
    records[1][HEAD][5] = 0
    write(small, records)
    refused(read, small, "shared.bin is missing")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # absurd lengths overflow
@pytest.mark.parametrize("stride", [9, pytest.param(2, marks=pytest.mark.slow)])
def test_a_wild_word_in_what_is_shared_ends_in_no_traceback(sharing, read, stride):
    words = np.fromfile(sharing / "shared.bin", np.int64)
    for k, value in enumerate([-1, 2**40, np.float64(1e300).view(np.int64)]):
        for at in range(k, len(words), stride):
            changed = words.copy()
            changed[at] = value
            changed.tofile(sharing / "shared.bin")
            try:
                read(sharing, reduce=False)
            except InputError:
                pass


def test_records_are_the_same_read_together_or_one_by_one(exported, monkeypatch):
    manifest = read_manifest(exported(cells=2, subdomains="8x4"))
    together = read_subdomains(manifest, 0, 32, MPI.COMM_SELF)
    monkeypatch.setattr(records, "STACK", 1)
    for sub, other in zip(read_subdomains(manifest, 0, 32, MPI.COMM_SELF), together):
        assert sub.index == other.index and (sub.contact is None) == (other.contact is None)
        for name in ("node_gid", "xy", "edge_label", "loads", "fixed", "fixed_values"):
            assert np.array_equal(getattr(sub, name), getattr(other, name))
        assert np.array_equal(sub.edge_loads[0], other.edge_loads[0])
        assert np.array_equal(sub.stiffness.values, other.stiffness.values)


@pytest.mark.parametrize("array, change, said", [
    (GID, lambda a: a.__setitem__(3, a[0]), "stands twice"),
    (GID, lambda a: a.__setitem__(0, -1), "node number out of range"),
    (LOAD - 10, lambda a: a.__setitem__(0, 1.0), "do not add up"),
    (HEAD, lambda a: a.__setitem__(0, 7), "subdomain 7")])
def test_the_record_that_is_refused_is_named(exported, copied, read, array, change, said):
    """One of many that are read together; those that share a stiffness lack ten arrays."""
    directory = copied(exported(cells=2, subdomains="8x4", steps=2))
    found = counted(directory / "block-0.bin")
    heads = [k for k, a in enumerate(found) if len(a) == 9
             and (k == 0 or a[1:5].tolist() == found[0][1:5].tolist())]
    assert len(heads) == 32
    change(found[heads[13] + array].view(float if array > GID else np.int64))
    write(directory, [found])
    refused(read, directory, "subdomain 13", said)


# -------------------------------------------------------------------------------- interfaces

def at(record, x, y):
    """Local number of the vertex at (x, y)."""
    return int(np.flatnonzero((record[X].view(float) == x) & (record[Y].view(float) == y))[0])


@pytest.mark.parametrize("distance", [1e-3, 1e-9])
def test_subdomain_moved(small, read, distance):
    """As a whole: its stiffness is that of its mesh, only its neighbour knows better."""
    spoil(small, X, lambda a: a.__iadd__(distance))
    spoil(small, DOF_COORDINATE, lambda a: a[::2].__iadd__(distance))
    refused(read, small, "do not conform")


@pytest.mark.parametrize("distance", [1e-3, 1e-9])
def test_vertex_moved(small, read, distance):
    """A stiffness assembled on the old mesh resists the rotation of the new one."""
    vertex = at(arrays(small)[0], 1, 0.5)
    spoil(small, X, lambda a: a.__setitem__(vertex, a[vertex] + distance))
    spoil(small, DOF_COORDINATE, lambda a: a.__setitem__(2 * vertex, a[2 * vertex] + distance))
    refused(read, small, "resists a rigid motion")


def test_what_the_next_subdomain_shares_is_kept_once(small, read):
    one, other = read(small, reduce=False).subdomains
    assert all(getattr(one, name) is getattr(other, name)
               for name in ("elements", "stiffness"))


@pytest.mark.parametrize("distance", [1e-3, 1e-11])
def test_vertex_moved_where_the_stiffness_is_shared(small, read, distance):
    """Checks of a stiffness that was read before hold for a mesh of the same shape only: 1e-11 is
    some ten roundings in
    the rotation about a node at a distance of 0.5."""
    vertex = at(arrays(small)[1], 1.5, 0.5)
    spoil(small, X, lambda a: a.__setitem__(vertex, a[vertex] + distance), record=1)
    spoil(small, DOF_COORDINATE, lambda a: a.__setitem__(2 * vertex, a[2 * vertex] + distance),
          record=1)
    refused(read, small, "subdomain 1", "resists a rigid motion")


def test_unsymmetric_where_the_rest_is_shared(small, read):
    write_both_triangles(small)
    spoil(small, VALUES, lambda a: a.__setitem__(1, a[1] + 1e-6 * np.abs(a).max()), record=1)
    refused(read, small, "subdomain 1", "not symmetric")


def test_pattern_that_differs_where_the_values_are_shared(small, read):
    spoil(small, COLUMNS, lambda a: a.__setitem__(1, a[2]), record=1)
    refused(read, small, "subdomain 1", "not in order")


@pytest.mark.parametrize("row, column", [(0, 0), (3, 5), (7, 7)])
def test_stiffness_that_is_not_the_bodys(small, read, row, column):
    """A support or a penalty assembled into the matrix, a lost element, a wrong power of ten:
    symmetric, yet wrong.
    """
    pair = [(row, column), (column, row)]
    rows, columns = (arrays(small)[0][k] for k in (ROWS, COLUMNS))
    there = [k for k in range(len(rows)) if (rows[k], columns[k]) in pair]
    assert there
    spoil(small, VALUES, lambda a: a.__setitem__(there, a[there] + 1e-9 * np.abs(a).max()))
    refused(read, small, "resists a rigid motion")


def test_negative_friction(small, read):
    spoil(small, CONTACT + 5, lambda a: a.__setitem__(1, -0.3))
    refused(read, small, "negative friction")


def test_vertex_moved_without_its_dofs(small, read):
    vertex = at(arrays(small)[0], 1, 0.5)
    spoil(small, X, lambda a: a.__setitem__(vertex, a[vertex] + 1e-3))
    refused(read, small, "dof coordinates do not match")


# body numbers of the 5 x 3 vertices: 0..4 at the bottom, 5..9, 10..14 at the top; 15 is used by
# none
@pytest.mark.parametrize("x, y, new", [
    (1, 0.5, 15), (1, 0, 15), (1, 1, 15),  # torn open
    (1, 0.5, 8), (0.5, 1, 13), (0, 0, 4),  # tied to a vertex of the neighbour
    # a number twice in one subdomain
    (0.5, 0.5, 7), (0.5, 0.5, 2), (0.5, 0.5, 5), (0.5, 1, 12), (0, 0, 1)])
def test_renumbered_vertex(small, read, x, y, new):
    """One vertex of subdomain 0 gets another body number: refused, or dofs would be tied or held
    wrongly.
    """
    edit(small, nodes=16)
    here = at(arrays(small)[0], x, y)
    spoil(small, GID, lambda a: a.__setitem__(here, new))
    with pytest.raises(InputError):
        read(small, reduce=False)


@pytest.mark.parametrize("bad", [-1, 9, 2**40])
def test_boundary_edge_of_no_vertex(small, read, bad):
    """Edges carry the labels of contact and interfaces: one that joins no vertices is lost
    silently.
    """
    spoil(small, EDGES, lambda a: a.__setitem__(3, bad))
    with pytest.raises(InputError):
        read(small, reduce=False)


def test_swapped_interface_numbers(small, read):
    """Two interface vertices exchange their numbers on one side: every edge may still find a
    partner.
    """
    record = arrays(small)[0]
    gid, top, middle = record[GID], at(record, 1, 1), at(record, 1, 0.5)
    spoil(small, GID, lambda a: a.__setitem__([top, middle], gid[[middle, top]]))
    refused(read, small, "do not conform")


# -------------------------------------------------------------------------------- the manifest

def edit(directory, **changes):
    """Change entries of the manifest; None removes one."""
    path = directory / "manifest.json"
    raw = json.loads(path.read_text())
    raw.update(changes)
    path.write_text(json.dumps({k: v for k, v in raw.items() if v is not None}))


def test_missing_manifest(small, read):
    (small / "manifest.json").unlink()
    refused(read, small, "manifest.json is missing")


@pytest.mark.parametrize("stride", [17, pytest.param(1, marks=pytest.mark.slow)])
def test_truncated_manifest(small, read, stride):
    whole = (small / "manifest.json").read_text().rstrip()
    for size in range(0, len(whole), stride):
        (small / "manifest.json").write_text(whole[:size])
        refused(read, small, "manifest.json is not readable")


@pytest.mark.parametrize("text", ["[]", "3", "null", '"x"', "{}"])
def test_manifest_that_is_no_manifest(small, read, text):
    (small / "manifest.json").write_text(text)
    refused(read, small, "lacks")


NEEDED = [name for name, f in Manifest.__dataclass_fields__.items()
          if name != "directory" and f.default is f.default_factory is MISSING]


@pytest.mark.parametrize("name", NEEDED)
def test_manifest_lacks_an_entry(small, read, name):
    edit(small, **{name: None})
    refused(read, small, "lacks", name)


@pytest.mark.parametrize("name",
                         ["subdomains", "blocks", "nodes", "steps", "rooms", "columns", "patterns",
                          "amplitudes",
                                  "contact_labels"])
@pytest.mark.parametrize("value", ["x", [3]])
def test_manifest_entry_of_the_wrong_type(small, read, name, value):
    edit(small, **{name: value})
    with pytest.raises(InputError):
        read(small, reduce=False)


@pytest.mark.parametrize("changes, word", [
    ({"steps": 3}, "3 steps"), ({"steps": 0}, "positive"), ({"subdomains": 3}, "truncated"),
    ({"subdomains": 1}, "after its last record"), ({"blocks": 2}, "block"),
    ({"nodes": 9}, "node number"),
    ({"amplitudes": {"1": [0, float("nan"), 1]}}, "not finite"),
    ({"amplitudes": {"1": [0, 10**400, 1]}}, "not finite"),
    ({"amplitudes": {"1": [0, 1]}}, "2 values"),
    ({"amplitudes": {}}, "amplitude 1"), ({"patterns": []}, "load patterns"),
    ({"contact_labels": [1, 77]}, "77"),
    ({"material": "general"}, "count")])
def test_manifest_that_does_not_fit_its_records(small, read, changes, word):
    edit(small, **changes)
    refused(read, small, word)


# ------------------------------------------------------------------------ parameters echoed back

def test_a_flag_that_the_scene_does_not_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="unknown parameter FRICTOIN; .*; did you mean FRICTION"):
        freefem.export(freefem.find_scene("model"), tmp_path, {"frictoin": "0.4"})


@pytest.mark.parametrize("asked, word",
                         [({"friction": "0.4"}, "friction=0.3"),
                          ({"loading": "nonmonotone"}, "monotone"),
                                         ({"pressure": "1"}, "does not read")])
def test_echo_is_compared(exported, asked, word):
    """A scene that drops or changes a value must not go unnoticed."""
    manifest = read_manifest(exported(cells=2, subdomains="2x1", steps=2))
    with pytest.raises(InputError, match=word):
        freefem._check_echo(manifest, asked)


def test_reading_part_of_the_subdomains(exported):
    """A rank that starts in the middle of a block reads the same records."""
    manifest = read_manifest(exported(ranks=3, cells=2))
    everything = read_subdomains(manifest, 0, 8, MPI.COMM_SELF)
    for start, stop in [(0, 3), (3, 5), (5, 8), (7, 8), (4, 4)]:
        for sub, other in zip(read_subdomains(manifest, start, stop, MPI.COMM_SELF),
                              everything[start:stop]):
            assert sub.index == other.index and np.array_equal(
                sub.stiffness.values, other.stiffness.values)


@pytest.mark.parametrize("young, factor", [
    ("E", lambda x, y: 1.0), ("(x > 1.2 ? 2. : 1.)*E", lambda x, y: 1.0 + (x > 1.2)),
    ("E*(1 + x)", lambda x, y: 1 + x),
    ("(x > 1.2 && y < 0.4 ? 1.0001 : 1.)*E", lambda x, y: 1.0 + 1e-4 * (x > 1.2 and y < 0.4))])
@pytest.mark.some(2)
def test_pieces_share_a_stiffness_only_where_it_is_theirs(variant, exported, read, young, factor):
    """Pieces of a rectangle reuse stiffness and elasticity of piece 0: right for every material,
    the same on any ranks.
    """
    scene = variant(f"young-{abs(hash(young))}",
                    ("macro young() E //", f"macro young() {young} //"))
    alone, spread = (exported(scene, ranks=ranks, subdomains="4x2", cells=5) for ranks in (1, 2))
    for sub in read(alone, reduce=False).subdomains:
        found, expected = sub.stiffness.toarray(), p1_stiffness(sub, factor)
        # rounding of some ten sums
        assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()
        shear = [YOUNG / (2 * (1 + POISSON)) * factor(*sub.xy[vertices].mean(axis=0))
                 for vertices in sub.triangles]
        np.testing.assert_allclose(sub.elasticity[:, 2, 2], shear, rtol=1e-12)
    assert seal.read(alone).content == seal.read(spread).content


@pytest.mark.parametrize("parts", [4, 5, 6, 7, 8])
def test_no_piece_is_empty_however_many_there_are(built, named_scene, parts):
    """METIS leaves some empty where a piece gets hardly more than a triangle, of eight."""
    problem = built(named_scene("few", """include "scene.idp"
body = square(2, 2);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
include "export.idp"
"""), reduce=False, subdomains=parts)
    counts = [len(sub.triangles) for sub in problem.subdomains]
    assert len(counts) == parts and min(counts) >= 1 and sum(counts) == 8


FAR = """include "scene.idp"
real away = physical("away", 0.);
body = square(9, 4, [away + 6.*x, 2.*y]);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro gap() (-0.02) //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2", "P2-mixed"])
@pytest.mark.some(1)
def test_bodies_far_from_the_origin_are_read_however_they_are_cut(solved, named_scene, element):
    """Coordinates have fewer digits there for a triangle, and rows of the stiffness add up less
    well; the forces are those of the body at the origin.
    """
    forces = [solved(named_scene("far", FAR), away=away, element=element, subdomains=cut)
              .summary["quantities"]["normal_resultant"]
              for away, cut in ((0, 1), (1000, 1), (1000, 5), (1000000, 3))]
    assert forces == pytest.approx(4 * forces[:1], rel=1e-6)
