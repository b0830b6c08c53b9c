"""Loads and prescribed displacements that the values of a study change: more load patterns.

The body is set up once, with the patterns of all values side by side: those of the export first,
then what other values have in their place. A value uses its own ones; all others have the factor
zero in its history. Patterns that are equal to the last bit are one.
"""

import dataclasses
import hashlib

import numpy as np

from ..errors import InputError, agree
from ..scene.manifest import Manifest
from ..scene.study_value import Loads, Value
from ..scene.subdomain import Subdomain

UNUSED = 0  # number of the amplitude of patterns that belong to other values


def unvaried(name: str, why: str) -> InputError:
    """The error of a parameter that one export and factorization do not do for."""
    return InputError(f"a study cannot vary {name.upper()}: {why}; sweep it by driver.run, as "
                      "driver/README.md shows under From Python")


class LoadValues:
    """The load patterns of all values; `columns` holds, by value, where each of its patterns is.

    `name` is the studied parameter. Collective over `comm`.
    """

    def __init__(self, name: str, values: list[Value], comm):
        self.name, self.values, self.comm = name.upper(), values, comm
        self.columns: list[list[int]] = []

    def widen(self, manifest: Manifest,
              subdomains: list[Subdomain]) -> tuple[Manifest, list[Subdomain]]:
        """Manifest and subdomains with the patterns of all values.

        Raises InputError where a value changes the mesh or the places of supports.
        """
        error, own = None, [[Loads(s.loads, s.fixed, s.fixed_values) for s in subdomains]]
        try:
            own += [self._own(value, subdomains) for value in self.values]
        except InputError as problem:
            error = problem
        agree(self.comm, error)
        count = len(manifest.patterns)
        digests = [[_digest(loads, k) for k in range(count)] for loads in own]
        digests = list(zip(*self.comm.allgather(digests)))  # by value, of all ranks
        number, added = {}, []
        for value, ranks in enumerate(digests):
            self.columns.append([])
            for k, of_pattern in enumerate(zip(*ranks)):
                if (k, of_pattern) not in number:
                    number[k, of_pattern] = len(number)
                    added += [(value, k)] if value else []
                self.columns[-1].append(number[k, of_pattern])
        self.columns.pop(0)  # the export's own
        wide = [dataclasses.replace(
            sub, loads=np.vstack([sub.loads, *(own[v][s].forces[k] for v, k in added)]),
            fixed_values=np.vstack([sub.fixed_values,
                                    *(own[v][s].fixed_values[k] for v, k in added)]))
                for s, sub in enumerate(subdomains)]
        patterns = [*manifest.patterns, *(manifest.patterns[k] for _, k in added)]
        return dataclasses.replace(manifest, patterns=patterns), wide

    def history(self, number: int, value: Manifest, base: Manifest) -> Manifest:
        """The manifest of value `number` with all patterns of the widened one, `base`."""
        patterns = [{**pattern, "amplitude": UNUSED} for pattern in base.patterns]
        for pattern, column in zip(value.patterns, self.columns[number]):
            patterns[column] = pattern
        amplitudes = {**value.amplitudes, str(UNUSED): [0.0] * (value.steps + 1)}
        return dataclasses.replace(value, patterns=patterns, amplitudes=amplitudes)

    def _own(self, value: Value, subdomains: list[Subdomain]) -> list[Loads]:
        """The loads of the rank's subdomains under a value."""
        own = []
        for sub in subdomains:
            if not value.loads:
                own.append(Loads(sub.loads, sub.fixed, sub.fixed_values))
                continue
            loads = value.loads.get(sub.index)
            if loads is None or loads.forces.shape != sub.loads.shape:
                raise unvaried(self.name, "it changes the mesh")
            if not np.array_equal(loads.fixed, sub.fixed):
                raise unvaried(self.name, "it changes where displacements are prescribed")
            own.append(loads)
        return own


def _digest(loads: list[Loads], pattern: int) -> bytes:
    """Digest of a pattern on subdomains."""
    digest = hashlib.sha256()
    for part in loads:
        digest.update(part.forces[pattern].tobytes() + part.fixed_values[pattern].tobytes())
    return digest.digest()
