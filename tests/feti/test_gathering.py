"""What the first rank makes for all of them."""

from types import SimpleNamespace

import pytest
from mpi4py import MPI

from driver.errors import NotConverged
from driver.feti.gathering import by_first


def failing():
    raise NotConverged("too far")


@pytest.mark.parametrize("rank", [0, 1])
def test_the_first_rank_works_for_all(rank):
    """Others make nothing of their own, and get its error, too."""
    made, sent = [], []
    comm = SimpleNamespace(size=2, rank=rank, bcast=lambda own: sent.append(own) or (
        own if rank == 0 else (7, None)))
    assert by_first(comm, lambda given: made.append(given) or 7, 3) == 7
    assert made == ([3] if rank == 0 else []) and sent == [(7, None) if rank == 0 else (None,) * 2]
    other = SimpleNamespace(size=2, rank=rank, bcast=lambda own: own if rank == 0 else (
        None, NotConverged("too far")))
    with pytest.raises(NotConverged, match="too far"):
        by_first(other, failing)


def test_one_rank_works_for_itself():
    assert by_first(MPI.COMM_SELF, lambda *given: given, 1, 2) == (1, 2)
    with pytest.raises(NotConverged):
        by_first(MPI.COMM_SELF, failing)
