"""The tables of a parameter study."""

import itertools
from pathlib import Path

from ..contact.states import STATUS_NAMES, ContactField
from ..files import write_rows, write_table
from ..results.contact_state import WEAR
from ..runs.request import Request

FIELDS = tuple(name for name in ContactField if name != ContactField.STATUS)


def write(directory: Path, request: Request, contact, outcomes: list) -> None:
    """study.csv, history.csv and contact.csv in `directory`.

    `outcomes` are parametric.Outcome, of every value of the `request` one, `contact` the declared
    contact boundary.

    Values stand in the first column of tables, which has the parameter's name, with _value where
    another column has that.
    """
    values = request.values
    full = next((outcome.row for outcome in outcomes if outcome.history), outcomes[0].row)
    worn = [WEAR] if WEAR in outcomes[0].fields else []
    nodal = ["node", "boundary", "x", "y", "arc", "weight", *FIELDS,
             *("worn_depth" for _ in worn), "status"]
    taken = {*nodal, *full, *(key for outcome in outcomes for row in outcome.history
                              for key in row)}
    taken.discard("steps")  # of each run, which are its value where steps are studied
    name = f"{request.study}_value" if request.study in taken else request.study
    write_table(directory / "study.csv", [{name: value} | dict.fromkeys(full, "") | outcome.row
                                          for value, outcome in zip(values, outcomes)])
    steps = [{name: value, **row} for value, outcome in zip(values, outcomes)
             for row in outcome.history]
    if steps:
        write_table(directory / "history.csv", steps)
    place = [contact.label, *contact.xy.T, contact.arc, contact.weight]
    rows = [row for value, outcome in zip(values, outcomes) if outcome.fields
            for row in zip(itertools.repeat(value), itertools.count(),
                           *(part.tolist() for part in place),
                           *(outcome.fields[field].tolist() for field in (*FIELDS, *worn)),
                           map(STATUS_NAMES.__getitem__, outcome.fields["status"]))]
    if rows:
        write_rows(directory / "contact.csv", [name, *nodal], rows)
