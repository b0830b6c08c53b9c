"""Records that are read while FreeFEM writes are those of the sealed export, or do not count."""

import dataclasses
import shutil

import numpy as np
import pytest
from mpi4py import MPI

from driver.errors import InputError
from driver.scene import seal
from driver.scene.growing import GrowingExport
from driver.scene.loader import read_subdomains
from driver.scene.manifest import announced, read_manifest


class Writing:
    """An export that appears again, as far as it is let."""

    def __init__(self, export, place):
        self.export, self.place = export, place
        shutil.copy(export / "manifest.json", place)

    def write(self, upto: float, block=0) -> None:
        """A part of a block, from its beginning."""
        name = f"block-{block}.bin"
        content = (self.export / name).read_bytes()
        (self.place / name).write_bytes(content[: int(upto * len(content))])

    def end(self) -> None:
        """All of it, and the seal."""
        shutil.copytree(self.export, self.place, dirs_exist_ok=True)


@pytest.fixture(params=[("tutorial", 1), ("bracket", 1), ("joint", 2)], ids=str)
def writing(request, exported, tmp_path):
    """One of 7 subdomains: linear, quadratic with a mesh of gmsh, and several bodies in 2 blocks.
    """
    scene, ranks = request.param
    return Writing(exported(scene, ranks, subdomains=7, steps=1), tmp_path)


def same(one, other) -> bool:
    """Whether all arrays of two subdomains are equal, bit by bit."""
    def equal(a, b) -> bool:
        if dataclasses.is_dataclass(a):
            return all(equal(getattr(a, f.name), getattr(b, f.name))
                       for f in dataclasses.fields(a))
        if isinstance(a, dict):
            return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
        return np.array_equal(a, b)

    return equal(one, other)


def read_all(growing) -> list:
    """What is there."""
    found = []
    while (sub := growing.read()) is not None:
        found.append(sub)
    return found


def test_a_subdomain_is_there_once_its_record_is_whole(writing):
    """In their order, with the bits that the loader finds; ranks take those of their own alone."""
    wanted = read_subdomains(read_manifest(writing.export), 0, 7, MPI.COMM_SELF)
    manifest = announced(writing.place)
    whole, part, found = GrowingExport(manifest, 0, 7), GrowingExport(manifest, 2, 4), []
    for block in range(manifest.blocks):
        for upto in np.linspace(0, 1, 40):
            writing.write(upto, block)
            found += read_all(whole)
            read_all(part)
        assert len(found) == 7 * (block + 1) // manifest.blocks
    assert all(map(same, found, wanted)) and found == whole.subdomains
    assert [sub.index for sub in part.subdomains] == [2, 3]
    assert all(map(same, part.subdomains, wanted[2:4]))


@pytest.mark.parametrize("upto", [0.0, 0.3, 0.99, 1.0])
def test_what_was_read_is_not_read_again(writing, upto):
    """The loader goes on where the records ended."""
    wanted = read_subdomains(read_manifest(writing.export), 1, 7, MPI.COMM_SELF)
    writing.write(upto)
    growing = GrowingExport(announced(writing.place), 1, 7)
    before = read_all(growing)
    writing.end()
    found = read_subdomains(read_manifest(writing.place), 1, 7, MPI.COMM_SELF, growing)
    assert all(one is other for one, other in zip(before, found))
    assert len(found) == 6 and all(map(same, found, wanted))
    assert growing.pieces.manifest.seal is not None  # of what comes after, too


def test_what_freefem_did_not_leave_does_not_count(writing):
    """It may have begun anew."""
    writing.write(1.0)
    path = writing.place / "block-0.bin"
    words = np.fromfile(path, np.int64)
    nodes = words[2]
    words[10 + 1 + nodes + 1] ^= 1  # the last bit of a coordinate
    words.tofile(path)
    growing = GrowingExport(announced(writing.place), 0, 2)
    before = read_all(growing)
    writing.end()
    found = read_subdomains(read_manifest(writing.place), 0, 2, MPI.COMM_SELF, growing)
    wanted = read_subdomains(read_manifest(writing.export), 0, 2, MPI.COMM_SELF)
    assert all(map(same, found, wanted)) and not same(before[0], found[0])


@pytest.mark.parametrize("start, stop, steps", [(0, 4, 1), (1, 7, 1), (0, 7, 2)])
def test_what_was_read_for_something_else_does_not_count(writing, start, stop, steps):
    """Other subdomains, or with the manifest of another export."""
    writing.end()
    manifest = announced(writing.place)
    manifest.raw["steps"] = steps
    growing = GrowingExport(manifest, start, stop)
    before = read_all(growing)
    found = read_subdomains(read_manifest(writing.place), 0, 7, MPI.COMM_SELF, growing)
    assert [sub.index for sub in found] == list(range(7))
    assert not any(one is other for one in before for other in found)


def test_a_record_that_is_not_sound_is_refused(writing):
    """By what reads it early, and by the loader in its words."""
    writing.end()
    path = writing.place / "block-0.bin"
    words = np.fromfile(path, np.int64)
    words[2] += 1  # the number of nodes
    words.tofile(path)
    with pytest.raises(InputError):
        read_all(GrowingExport(announced(writing.place), 0, 7))
    manifest = announced(writing.place)
    seal.write(writing.place, "", [f"block-{k}.bin" for k in range(manifest.blocks)])
    with pytest.raises(InputError, match="makes? no subdomain"):
        read_subdomains(read_manifest(writing.place), 0, 7, MPI.COMM_SELF)


def test_a_manifest_counts_once_it_is_whole(writing):
    """It is written in many parts."""
    path = writing.place / "manifest.json"
    content = path.read_bytes()
    for size in range(0, len(content.rstrip()), 37):
        path.write_bytes(content[:size])
        assert announced(writing.place) is None
    path.write_bytes(content)
    assert announced(writing.place).subdomains == 7
    path.unlink()
    assert announced(writing.place) is None


def test_subdomains_that_are_cut_alike_are_read_together_at_the_end(exported, tmp_path):
    """They are many and small, and what they share is in another file."""
    writing = Writing(exported("model", cells=4), tmp_path)
    writing.end()
    with pytest.raises(InputError, match="in another file"):
        read_all(GrowingExport(announced(tmp_path), 0, 4))


def test_the_rim_has_what_subdomains_and_bodies_share(writing):
    """By gids of all subdomains, contact nodes of each, and the boundaries of pairs."""
    manifest = read_manifest(writing.export)
    subdomains = read_subdomains(manifest, 0, 7, MPI.COMM_SELF)
    _, first, count = np.unique(np.concatenate([sub.node_gid for sub in subdomains]),
                                return_index=True, return_counts=True)
    gids = np.concatenate([sub.node_gid for sub in subdomains])[first[count > 1]]
    met = {label for pair in manifest.contact_pairs for label in pair}
    for sub in subdomains:
        needed = [np.flatnonzero(np.isin(sub.node_gid, gids))]
        if sub.contact is not None:
            needed.append(sub.contact.node)
        edges = sub.edges[np.isin(sub.edge_label, [*met])]
        needed += [edges.ravel(), sub.middles(edges)]
        assert np.isin(np.concatenate(needed), sub.rim).all()
        assert (np.diff(sub.rim) > 0).all() and len(sub.rim) < len(sub.xy)
