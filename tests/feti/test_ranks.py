"""What ranks share out and put together, with stand-ins for the others."""

from types import SimpleNamespace

import constants
import numpy as np
import pytest

from driver.feti.gathering import Gathering
from driver.feti.structure import partition


@pytest.mark.parametrize("total, size", [(10, 3), (3, 5), (8, 8), (0, 2), (7, 1)])
def test_every_subdomain_has_one_rank(total, size):
    """Ranges follow one another, from none to all, and differ in length by one at most."""
    ranges = [partition(total, SimpleNamespace(rank=rank, size=size)) for rank in range(size)]
    assert [first for first, _ in ranges] == [0, *(stop for _, stop in ranges[:-1])]
    assert ranges[-1][1] == total
    lengths = [stop - first for first, stop in ranges]
    assert max(lengths) - min(lengths) <= 1


def test_parts_are_joined_in_the_order_of_ranks():
    parts = [np.array([1.0, 2.0]), np.empty(0), np.array([3.0, 4.0, 5.0])]

    def allgatherv(_, into):
        whole, (counts, places) = into
        for part, count, place in zip(parts, counts, places):
            whole[place : place + count] = part

    comm = SimpleNamespace(size=3, allgather=lambda _: list(map(len, parts)), Allgatherv=allgatherv)
    gathering = Gathering(comm, 2)
    assert gathering.size == 5 and gathering(parts[0]).tolist() == [1, 2, 3, 4, 5]


def test_several_arrays_travel_in_one_message():
    """(k, length) parts of every rank, of which one has none, in the order of ranks."""
    parts = [np.array([[1.0, 2], [10, 20]]), np.empty((2, 0)),
             np.array([[3.0, 4, 5], [30, 40, 50]])]
    sent = []

    def allgatherv(own, into):
        sent.append(own)
        whole, (counts, places) = into
        for part, count, place in zip(parts, counts, places):
            whole[place : place + count] = part.ravel()

    comm = SimpleNamespace(size=3, allgather=lambda _: [2, 0, 3], Allgatherv=allgatherv)
    assert Gathering(comm, 2).rows(parts[0]).tolist() == [[1, 2, 3, 4, 5], [10, 20, 30, 40, 50]]
    assert len(sent) == 1 and sent[0].tolist() == parts[0].tolist()


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("feti")
