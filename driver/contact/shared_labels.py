"""Labels that are on several bodies, where that leaves open what a contact pair means."""

import contextlib

import numpy as np

from ..errors import InputError
from ..feti.gathering import gather
from ..feti.travel import bodies_of


class SeveralPlaces(InputError):
    """A place of the first side faces several places of the second; `pairs` of labels at fault."""

    pairs: list[tuple[int, int]] = []


@contextlib.contextmanager
def of_pairs(pairs: list[tuple[int, int]]):
    """A block whose SeveralPlaces are about these pairs of labels."""
    try:
        yield
    except SeveralPlaces as fault:
        fault.pairs = pairs
        raise


@contextlib.contextmanager
def explained(manifest, subdomains, skeleton, comm):
    """A block of which SeveralPlaces says which labels of its pairs are on several bodies.

    Collective also where that is raised, as it is on all ranks.
    """
    try:
        yield
    except SeveralPlaces as fault:
        number = bodies_of(skeleton, manifest.axisymmetric).number
        on = on_bodies(subdomains, number, comm)
        shared = {}  # labels by the bodies that they are on
        for label in np.unique(fault.pairs).tolist():
            if len(on.get(label, ())) > 1:
                shared.setdefault(_listed(on[label]), []).append(label)
        if not shared:
            raise
        said = ", ".join(f"{'labels' if len(labels) > 1 else 'label'} {_listed(labels)} "
                         f"{'are' if len(labels) > 1 else 'is'} on bodies {bodies}"
                         for bodies, labels in shared.items())
        raise InputError(f"{str(fault).partition(';')[0]}: {said}; give each "
                         "body labels of its own, as  square(..., label = sides)  does") from None


def on_bodies(subdomains, number: np.ndarray, comm) -> dict[int, list[int]]:
    """Bodies, counted from 1, that the edges of a label are on; `number` (total,) by subdomain."""
    parts = [np.empty((0, 2), int)]
    for sub in subdomains:
        labels = np.unique(sub.edge_label)
        parts.append(np.column_stack([labels, np.full(len(labels), number[sub.index] + 1)]))
    found: dict[int, list[int]] = {}
    for label, body in np.unique(gather(comm, np.concatenate(parts)), axis=0).tolist():
        found.setdefault(label, []).append(body)
    return found


def _listed(numbers: list[int]) -> str:
    """Numbers as in 1, 2 and 3."""
    *most, last = map(str, numbers)
    return f"{', '.join(most)} and {last}" if most else last
