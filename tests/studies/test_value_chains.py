"""Which values of a study follow one another, and the ranks that share them."""

from types import SimpleNamespace

import pytest
from mpi4py import MPI

from driver import options
from driver.runs import launch
from driver.studies import parametric, value_chains


@pytest.mark.parametrize("count, ranks", [(5, 2), (10, 4), (100, 8)])
def test_every_rank_gets_values(count, ranks):
    """Chains are the same for any number of ranks, and as many as a few ranks need."""
    chain = value_chains.length(count)
    assert {k // chain % ranks for k in range(count)} == set(range(ranks))


@pytest.mark.parametrize("count, steps, rooms, cores, ranks", [
    (100, 20, {}, 2, 2), (100, 20, {}, 1, 1), (100, 20, {}, 64, 6),  # 2000 steps pay for six
    (1000, 20, {}, 64, 50),  # no more than chains
    (5, 20, {}, 2, 1),  # too few steps for a second rank
    (100, 20, {"large_sliding": {}}, 2, 1)])  # not condensed: ranks share subdomains
def test_values_have_the_ranks_that_their_steps_pay_for(monkeypatch, count, steps, rooms, cores,
                                                        ranks):
    monkeypatch.setattr(options, "CORES", cores)
    export = SimpleNamespace(steps=steps, rooms=rooms, quasistatic=True, subdomains=8, nodes=1000)
    assert value_chains.ranks_for(export, count) == ranks


@pytest.mark.parametrize("nodes, shared", [(1000, False), (launch.RANK, True)])
def test_ranks_share_bodies_that_pay_for_more_than_one(monkeypatch, nodes, shared):
    """Not each the whole of a large one, however few cores or many ranks there are."""
    structure = SimpleNamespace(contact=SimpleNamespace(following=None), rigid_modes=[None],
                                at_contact=SimpleNamespace(row=[]))
    problem, of = SimpleNamespace(structure=structure, manifest=SimpleNamespace(nodes=nodes)), []
    monkeypatch.setattr(parametric, "LoadValues", lambda *_: SimpleNamespace(widen=None))
    monkeypatch.setattr(parametric, "assemble", lambda _, ranks, *__: of.append(ranks) or problem)
    everyone = SimpleNamespace(size=64)
    parametric._problem(None, "friction", [], everyone, None)
    assert of == ([everyone] if shared else [everyone, MPI.COMM_SELF])


def test_a_large_body_has_the_ranks_of_its_runs(monkeypatch):
    """Factorizing it takes longer than its values."""
    for module in (options, launch):
        monkeypatch.setattr(module, "CORES", 2)
    export = SimpleNamespace(steps=1, rooms={}, quasistatic=True, subdomains=8,
                             nodes=launch.RANK)
    assert value_chains.ranks_for(export, 3) == 2
