"""boundaries.csv, what every contact boundary carries in every step.

A boundary is a label that carries contact nodes; of a pair it is the first label, and the force is
that on its body. Where labels go on in one another see shares.py. Peak, length and slip are located
between nodes as those of the whole scene, see quantities.py.
"""

import numpy as np

from ..contact.states import OPEN, SLIP, ContactField
from .contact_edges import NODES, chains, contact_lengths, part_of
from .quantities import largest_pressure, longest_ways

WORK = "work"  # of friction, beside the names of ContactField


def boundary_rows(record, states: dict[str, np.ndarray],
                  times: list[tuple[int, float]]) -> list[dict]:
    """Rows {column: value} of the table: of every step its boundaries in the order of labels.

    `record` is the Record of the steps; `states` (steps, n_c) by ContactField, status as its code;
    `times` the number and time of every step. Without friction whatever touches slides.
    """
    if not record.effects.frictional:
        closed = states[ContactField.STATUS] != OPEN
        states = states | {ContactField.STATUS: np.where(closed, SLIP, OPEN)}
    work = np.array(record.work) if record.work else np.zeros(states[ContactField.SLIP].shape)
    states, nodes = states | {WORK: work}, record.nodes()
    pieces = chains(nodes)
    lengths = np.array([contact_lengths(nodes, pieces, states, k) for k in range(len(times))])
    tables = [_one_boundary(record.contact.boundary, states, (int(label), share, lengths[:, k]),
                            record.normals or None)
              for k, (label, share) in enumerate(zip(record.labels, record.shares))]
    return [{"step": step, "time": time, **table[k]}
            for k, (step, time) in enumerate(times) for table in tables]


def _one_boundary(boundary, states: dict[str, np.ndarray], of_label: tuple,
                  normals: list[np.ndarray] | None) -> list[dict]:
    """Columns but step and time, for every step; `of_label`: the label, its share (n_c,) in the
    nodes and its length in contact (steps,).

    `normals` (n_c, 2) of every step, where they change.
    """
    label, share, length = of_label
    own = np.flatnonzero(share)
    nodes = part_of({name: getattr(boundary, name) for name in NODES}, own)
    # between two pieces of one label lie nodes of others
    nodes["chain"] = nodes["chain"] * len(own) + np.cumsum(np.diff(own, prepend=own[:1]) > 1)
    nodes["weight"] = weight = nodes["weight"] * share[own]
    nodes["length"] = nodes["length"] * share[own]
    states, pieces = {name: column[:, own] for name, column in states.items()}, chains(nodes)
    pressure, shear = -states[ContactField.SIGMA_N], states[ContactField.SIGMA_T]
    if normals is None:
        normal, tangential = boundary.normal[own], boundary.tangent[own]
        force = (shear * weight) @ tangential - (pressure * weight) @ normal
    else:
        x, y = np.array(normals)[:, own].transpose(2, 0, 1)
        p, t = pressure * weight, shear * weight
        force = np.column_stack([(-t * y - p * x).sum(axis=1), (t * x - p * y).sum(axis=1)])
    dissipated = np.cumsum(states[WORK] @ share[own])
    slip = np.max([longest_ways(nodes, piece, states) for piece in pieces], axis=0)
    rows = []
    for k in range(len(pressure)):
        values = {"normal_resultant": pressure[k] @ weight,
                  "tangential_resultant": shear[k] @ weight,
                  "force_x": force[k, 0], "force_y": force[k, 1],
                  "peak_pressure": largest_pressure(nodes, pieces, pressure[k]),
                  "contact_length": length[k], "slip": slip[k],
                  "dissipated_energy": dissipated[k]}
        rows.append({"boundary": label, **{name: float(v) for name, v in values.items()}})
    return rows
