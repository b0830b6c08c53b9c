"""One value of a parameter study as FreeFEM wrote it: ``value.bin``, see edp/lib/study.idp."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from . import record_checks as checks
from . import records, seal
from .loader import contact_of
from .manifest import Manifest
from .records import RecordFile
from .subdomain import ContactData



class Loads(NamedTuple):
    """Loads of one subdomain under one value, a row for every load pattern of the scene."""

    forces: np.ndarray  # (patterns, dofs)
    fixed: np.ndarray  # (n_fixed,) Dirichlet dofs
    fixed_values: np.ndarray  # (patterns, n_fixed)


class Value(NamedTuple):
    """Contact nodes of all pieces, their node numbers (n,), and loads by number of the subdomain.

    There are no loads where the studied parameter reaches none.
    """

    contact: ContactData
    gid: np.ndarray
    loads: dict[int, Loads]


def read_value(directory: Path, manifest: Manifest) -> Value:
    """Read the file of a value of a scene with contact.

    Raises InputError as `loader.read_subdomains`.
    """
    file = RecordFile(directory / seal.VALUE, manifest.seal)
    count = int(file.stack([("count", 1, np.int64)])["count"][0, 0])
    numbers = records.contact_layout(count, manifest)
    stack = file.stack([("label", count, np.int64), ("gid", count, np.int64), *numbers])
    place = checks.Place(file.path)
    checks.check_indices(stack["gid"], manifest.nodes, "node number", place)
    loads = {}
    while not file.ended:
        number, dofs, patterns, fixed = file.stack([("sizes", 4, np.int64)])["sizes"][0].tolist()
        if patterns != len(manifest.patterns) or min(number, dofs, fixed) < 0:
            raise InputError(f"{file.path} is damaged; run the scene again")
        part = file.stack([*((("load", k), dofs, np.float64) for k in range(patterns)),
                           ("fixed", fixed, np.int64),
                           *((("fixed_value", k), max(1, fixed), np.float64)
                             for k in range(patterns))])
        checks.check_indices(part["fixed"], dofs, "fixed dof", place)
        loads[number] = Loads(
            np.array([part["load", k][0] for k in range(patterns)]).reshape(patterns, dofs),
            part["fixed"][0],
            np.array([part["fixed_value", k][0][:fixed] for k in range(patterns)]).reshape(
                patterns, fixed))
    stack["node"] = np.arange(count)[None]
    return Value(contact_of(stack, manifest, 0), stack["gid"][0], loads)
