"""What a run leaves step by step: tables of contact, history, convergence; fields.

Rank 0 writes the tables, and ranks share the fields. Files go to the run's private directory, which
the command line renames as a whole, so a result directory that is there is complete.
"""

import functools
from pathlib import Path

import numpy as np

from ..contact.states import STATUS_NAMES, ContactField
from ..environment import give_back_memory
from ..errors import agreed_writes
from ..feti.operator import DualOperator
from ..files import write_rows
from ..march.quasistatic import QuasistaticSolver
from ..march.step import Step
from ..scene.manifest import Manifest
from .boundaries import boundary_rows
from .contact_state import WEAR, less_wear
from .fields import Fields
from .outline import write_outline
from .quantities import resultant
from .record import Record
from .resultants import resultants
from .tables import (BOUNDARIES, CONTACT, CONVERGENCE, CYCLES, GEOMETRIES, HISTORY, LABEL, PROBES,
                     WORN, header, shown)


class Writer:
    """Collects the steps of a run and writes its files; collective."""

    def __init__(self, directory: Path, manifest: Manifest, operator: DualOperator,
                 solver: QuasistaticSolver, fields: bool):
        """`fields`: write VTU files. Raises InputError if `directory` cannot be written to."""
        self.directory, self.manifest = directory, manifest
        self.operator, self.solver = operator, solver
        self.record = Record(operator, solver)
        self.contact = self.record.contact
        self.history_rows = []  # {column: value}
        self.largest_imbalance, self.largest_forces = 0.0, 0.0
        self.fields = Fields(directory, manifest.element, operator) if fields else None
        self.probes = _probes(manifest, operator, self.record.effects)
        write_outline(directory / "boundary.csv", manifest, operator.structure, operator.comm)
        following = operator.structure.contact.following
        if following is not None:
            from .obstacle import write_obstacle  # here: few scenes need it

            write_obstacle(directory / "obstacle.csv", following, operator.comm)
        give_back_memory()  # what outlines, bodies and meshes of files were found with

    def add(self, step: Step, replayed: bool = False) -> tuple[dict[str, np.ndarray], float]:
        """Record one step; the state of the contact nodes and the body's energy u' K u.

        `replayed`: the step and its fields are those of an interrupted run.
        """
        displacements, state = self.record.add(step)
        inner = self.operator.inner_forces(displacements)
        forces, size = resultants(self.operator, step, displacements, inner, state)
        # radial forces are sums around the axis, which hoop stresses balance
        balanced = slice(1, 2) if self.manifest.axisymmetric else slice(2)
        imbalance = float(np.abs(sum(forces.values())[balanced]).max())
        self.largest_imbalance = max(self.largest_imbalance, imbalance)
        self.largest_forces = max(self.largest_forces, float(size.max()))
        self.history_rows.append(self._history_row(step, state, forces))
        if self.probes is not None:
            self.probes.add(step, displacements, inner, state)
        if self.fields is not None:
            self.fields.add(step, displacements, state, replayed)
        energy = float(sum(u @ force for u, force in zip(displacements, inner)))
        return state, self.operator.comm.allreduce(energy)

    def indicate(self, step: Step, indicator: np.ndarray) -> None:
        """Write a file with the error indicator (n_t,) of every triangle in a step."""
        if self.fields is not None:
            self.fields.indicate(step, indicator)
            with agreed_writes(self.operator.comm):
                if self.operator.comm.rank == 0:
                    self.fields.write_collections()  # once more: the tables may be there already

    @property
    def files(self) -> list[str]:
        """Files of fields that are written, relative to the directory."""
        return self.fields.files if self.fields else []

    @property
    def balance(self) -> float:
        """Largest sum of a step's resultants over the largest sum of nodal forces' sizes."""
        return self.largest_imbalance / self.largest_forces if self.largest_forces > 0 else 0.0

    @property
    def cycle_rows(self) -> list[dict]:
        """Rows of cycles.csv."""
        if self.solver.cycles is None:
            return []
        return [row | {"dissipated": work} for row, work in
                zip(self.solver.cycles.past.rows, self.record.cycle_work)]

    @functools.cached_property
    def boundary_rows(self) -> list[dict]:
        """Rows of boundaries.csv; once all steps are recorded."""
        states = less_wear({name: np.array(column) for name, column in self.record.states.items()})
        if self.contact.boundary.moves:
            states["gap"] = np.array(self.record.gaps)
        states |= self.record.counted
        times = [(row["step"], row["time"]) for row in self.history_rows]
        return boundary_rows(self.record, states, times)

    def close(self) -> None:
        """Write the tables. Raises InputError if they cannot be written."""
        with agreed_writes(self.operator.comm):
            if self.operator.comm.rank == 0:
                self._write_tables()

    # ---- rows of the tables ----------------------------------------------------------------------
    def _history_row(self, step: Step, state: dict, forces: dict) -> dict:
        boundary = self.contact.boundary
        weight = boundary.weight
        sigma_n, sigma_t = state[ContactField.SIGMA_N], state[ContactField.SIGMA_T]
        row = {"step": step.index, "time": step.time}
        cycles = self.solver.cycles
        place = step.index if cycles is None else cycles.place(step.index)
        row |= {f"amplitude_{number}": history[place]
                for number, history in self.manifest.amplitudes.items()}
        row |= {"fixed_point_iterations": step.fixed_point_iterations,
                "dual_multiplications": step.products, "contraction": step.contraction,
                "resultant_n": 0.0 - float(resultant(self.record.shares, -sigma_n, weight)),
                "resultant_t": float(resultant(self.record.shares, sigma_t, weight))}
        row |= {f"{name}_{axis}": float(force[k])
                for name, force in forces.items() for k, axis in enumerate("xy")}
        counts = np.bincount(state[ContactField.STATUS], minlength=len(STATUS_NAMES))
        row |= {f"nodes_{name}": int(count) for name, count in zip(STATUS_NAMES, counts)}
        row |= {"contact_length": self.record.contact_length(),
                "max_displacement": self.record.displacements[-1],
                "peak_pressure": self.record.largest_pressure(),
                "dissipated": self.record.dissipated}
        if boundary.following is not None:
            row["geometries"] = step.geometries
        row |= {f"kkt_{name}": value for name, value in step.residuals.items()}
        return row

    def _contact_rows(self, columns: list[str]):
        """Rows of contact.csv with these columns."""
        b, count, record = self.contact.boundary, len(self.contact.boundary.gid), self.record
        fixed = {"node": range(count), "x": _digits(b.xy[:, 0]), "y": _digits(b.xy[:, 1]),
                 "arc": _digits(b.arc), "weight": _digits(b.weight), "boundary": b.label}
        for k, row in enumerate(self.history_rows):
            normal = record.normals[k] if record.normals else b.normal
            status = record.states[ContactField.STATUS][k].tolist()
            table = {**fixed, "step": [row["step"]] * count, "time": [repr(row["time"])] * count,
                     "normal_x": _digits(normal[:, 0]), "normal_y": _digits(normal[:, 1]),
                     "gap": _digits(record.gaps[k])}
            table |= {name: _digits(values[k]) for name, values in record.states.items()
                      if name != ContactField.STATUS}
            table[ContactField.STATUS] = [STATUS_NAMES[code] for code in status]
            yield from zip(*(table[name] for name in columns))

    def _write_tables(self) -> None:
        """On rank 0."""
        labelled = len(self.manifest.contact_labels) > 1
        if len(self.contact.boundary.gid):
            more = ([WORN] if WEAR in self.record.states else []) + ([LABEL] if labelled else [])
            columns = header((*CONTACT, *more))
            write_rows(self.directory / "contact.csv", columns, self._contact_rows(columns))
            write_rows(self.directory / "boundaries.csv", header(BOUNDARIES),
                       (row.values() for row in self.boundary_rows))
        if self.history_rows:
            more = (GEOMETRIES,) if self.record.normals else ()
            residuals = [name.removeprefix("kkt_") for name in self.history_rows[0]
                         if name.startswith("kkt_")]
            columns = header((*HISTORY, *more), amplitude=self.manifest.amplitudes, kkt=residuals)
            rows = ([row[name] for name in columns] for row in self.history_rows)
            write_rows(self.directory / "history.csv", columns, rows)
        if self.probes is not None:
            write_rows(self.directory / "probes.csv", header(PROBES),
                       (row.values() for row in self.probes.rows))
        if self.cycle_rows:
            names = header(CYCLES)
            write_rows(self.directory / "cycles.csv", names,
                       ([shown(row[name]) for name in names] for row in self.cycle_rows))
        write_rows(self.directory / "convergence.csv", header(CONVERGENCE), self.solver.history.log)
        if self.fields is not None and self.fields.steps:
            self.fields.write_collections()


def _digits(values: np.ndarray) -> list[str]:
    """All digits of numbers (n,)."""
    return [repr(value) for value in values.tolist()]


def _probes(manifest: Manifest, operator: DualOperator, effects):
    """The probes of the scene, None where it declares none."""
    if "probe" not in effects:
        return None
    from .probes import Probes  # here: most scenes have none

    return Probes(operator, manifest, effects)
