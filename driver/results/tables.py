"""Columns of the tables that a run writes; headers and the reference are made from them.

Units are "1", "length", "stress", "time", or products of these. Forces and energies are per
thickness; for bodies of revolution they are those of the whole body, and forces along x are sums
of radial forces around the axis. A name with {} stands for a family of columns, one for each load,
residual or the like that the run has.
"""

from dataclasses import dataclass

from ..contact.states import STATUS_NAMES, ContactField
from ..quantity_table import QUANTITIES


@dataclass(frozen=True)
class Column:
    """One column of a table, or a family of columns."""

    name: str
    unit: str
    meaning: str


FORCE, ENERGY = "stress length", "stress length^2"
STEP = (Column("step", "1", "number of the step, from 1"),
        Column("time", "time", "time at the end of the step"))

CONTACT = (
    *STEP,
    Column("node", "1", "number of the contact node, from 0, ordered by boundary and arc length; "
           "a corner has two contact nodes, each with its own normal"),
    Column("x", "length", "coordinate of the node"),
    Column("y", "length", "coordinate of the node"),
    Column("arc", "length", "arc length along the boundary"),
    Column("weight", "length", "length of the node's dual segment; for bodies of revolution the "
           "area that the segment sweeps"),
    *(Column(f"normal_{axis}", "1", "outward unit normal n of the body (where contact follows "
             "the motion, at the end of the step); t is n turned by +90 degrees") for axis in "xy"),
    Column("gap", "length", "initial distance along n to the obstacle or the other body; for "
           "moving obstacles the distance to their position at the end of the step; with "
           "largeSliding u_n plus the distance at the end of the step"),
    Column(ContactField.U_N, "length",
           "displacement along n (between bodies its jump); at most the gap"),
    Column(ContactField.U_T, "length", "displacement along t (between bodies its jump)"),
    Column(ContactField.SLIP, "length", "change of u_t in the step, relative to the surface "
           "of a moving obstacle"),
    Column(ContactField.SIGMA_N, "stress",
           "normal traction: nodal force divided by weight; negative in compression"),
    Column(ContactField.SIGMA_T, "stress", "shear traction: nodal force divided by weight"),
    Column(ContactField.BOUND, "stress", "friction bound: largest shear traction that friction can "
           "transmit"),
    Column(ContactField.STATUS, "1", f"{', '.join(STATUS_NAMES)}"),
)
WORN = Column("wear", "length", "worn depth since time 0, if the scene declares wear; u_n is then "
              "at most gap + wear")
GEOMETRIES = Column("geometries", "1", "number of contact geometries in the step, where contact "
                    "follows the motion")
LABEL = Column("boundary", "1", "label of the contact boundary, if there are several; for a pair "
               "the first label, which has the contact nodes; for a node shared by two labels "
               "the label with the longer part of its dual segment")

PEAK = Column("peak_pressure", "stress", QUANTITIES["peak_pressure"].meaning)
LENGTH = Column("contact_length", "length", QUANTITIES["contact_length"].meaning)

HISTORY = (
    *STEP,
    Column("amplitude_{}", "1", "factor of the load with this number"),
    Column("fixed_point_iterations", "1", "QPs solved in the step"),
    Column("dual_multiplications", "1", "products with the dual matrix in the step"),
    Column("contraction", "1",
           "mean ratio of successive changes of the fixed-point iteration; nan in steps with fewer "
           "than two changes, except in the last step"),
    Column("resultant_n", FORCE, "normal tractions integrated over the contact boundary, negative "
           "in compression; for several boundaries minus the sum of their magnitudes"),
    Column("resultant_t", FORCE, "shear tractions integrated over the contact boundary; for "
           "several boundaries the sum of their magnitudes"),
    Column("load_x", FORCE, "resultant of the loads"),
    Column("load_y", FORCE, "resultant of the loads"),
    Column("reaction_x", FORCE, "resultant of the support reactions"),
    Column("reaction_y", FORCE, "resultant of the support reactions"),
    Column("contact_x", FORCE, "resultant of the forces of rigid obstacles on the body"),
    Column("contact_y", FORCE, "resultant of the forces of rigid obstacles on the body"),
    *(Column(f"nodes_{name}", "1", f"contact nodes with status {name}") for name in STATUS_NAMES),
    LENGTH,
    Column("max_displacement", "length", "largest |u| of all nodes"),
    PEAK,
    Column("dissipated", ENERGY, "energy dissipated by friction since time 0"),
    Column("kkt_{}", "1", "relative residual of this part of the KKT conditions"),
)

BOUNDARIES = (
    *STEP,
    Column("boundary", "1", "label of the contact boundary; for a pair the label with the contact "
           "nodes"),
    Column("normal_resultant", FORCE, "contact pressure integrated over the boundary"),
    Column("tangential_resultant", FORCE, "shear traction sigma_t integrated over the boundary"),
    Column("force_x", FORCE, "contact force on the body that carries the contact nodes"),
    Column("force_y", FORCE, "contact force on the body that carries the contact nodes"),
    PEAK,
    LENGTH,
    Column("slip", "length", "largest accumulated slip of a point in contact since time 0"),
    Column("dissipated_energy", ENERGY, "energy dissipated by friction since time 0"),
)

PROBES = (
    *STEP,
    Column("probe", "1", "'point' or 'label' followed by its number"),
    Column("x", "length", "position; for a label the centre of its edges"),
    Column("y", "length", "position; for a label the centre of its edges"),
    Column("u_x", "length", "displacement; for a label the mean over its edges"),
    Column("u_y", "length", "displacement; for a label the mean over its edges"),
    Column("force_x", FORCE, "force on the body through the label, or at the vertex"),
    Column("force_y", FORCE, "force on the body through the label, or at the vertex"),
)

CYCLES = (
    Column("cycle", "1", "number of the cycle, including cycles jumped over"),
    Column("step", "1", "number of the last step of the cycle"),
    Column("time", "time", "time at the end of the cycle"),
    Column("kind", "1", "behaviour that the cycles have reached or seem to approach: shakedown (no "
           "slip), alternating slip (slip is reversed within the cycle), ratcheting (slip "
           "accumulates from cycle to cycle), wear (surfaces slide and wear)"),
    Column("settled", "1", "yes if further cycles would repeat this one: contact forces within "
           "0.1 % of the largest force, slip and growth per cycle within 1 %"),
    Column("change", "1", "largest change of a contact force from the same step of the previous "
           "cycle, divided by the largest contact force; after a jump the mean change per cycle "
           "since the last computed cycle; 1 in the first cycle"),
    Column("remaining", "1", "estimated change of contact forces in all further cycles, from a "
           "geometric series, relative as above; at most 1, also 1 if the last four cycles "
           "do not allow an estimate"),
    Column("slip", "length", "largest slip of a node in the cycle, accumulated over its steps; "
           "without nodes constrained along the boundary"),
    Column("drift", "length", "largest net change of a node's u_t over the cycle"),
    Column("wear", "length", "largest increase of the worn depth in the cycle"),
    Column("dissipated", ENERGY, "energy dissipated by friction in the cycle"),
    Column("skipped", "1", "number of cycles jumped over before this one"),
    Column("error", "length", "estimated error of the jump before this cycle in the extrapolated "
           "quantities: u_t, worn depth and, if a friction law depends on it, accumulated slip"),
)

CONVERGENCE = (
    Column("product", "1", "products with the dual matrix so far"),
    Column("step", "1", "number of the step"),
    Column("iteration", "1", "iteration of the fixed point in the step"),
    Column("kind", "1", "what the QP solver did: start, cg, expansion, proportioning, ..."),
    Column("residual", "1", "relative norm of the projected gradient"),
)

BOUNDARY = (
    *(Column(name, "length",
             "end points of the edge, or of half of a curved edge, with the body on its left")
      for name in ("x0", "y0", "x1", "y1")),
    Column("label", "1", "label of the edge in the mesh"),
    Column("role", "1", "pair, contact, support, springs, joined (tied, periodic), load or free"),
    Column("traction_x", "stress", "traction on the label at amplitude 1"),
    Column("traction_y", "stress", "traction on the label at amplitude 1"),
    Column("fixed_x", "1", "1 if a support constrains this component on the whole label"),
    Column("fixed_y", "1", "1 if a support constrains this component on the whole label"),
    Column("moved_x", "length", "displacement prescribed there at amplitude 1"),
    Column("moved_y", "length", "displacement prescribed there at amplitude 1"),
)

OBSTACLE = (
    Column("step", "1", "number of the step, 0 for the start; always 0 for a fixed obstacle"),
    *(Column(name, "length", "end points of a side of a polygon that approximates the obstacle, "
             "with the body on its left") for name in ("x0", "y0", "x1", "y1")),
)

TABLES = {
    "contact.csv": ("a row per step and contact node", (*CONTACT, WORN, LABEL)),
    "history.csv": ("a row per step", (*HISTORY, GEOMETRIES)),
    "boundaries.csv": ("a row per step and contact boundary", BOUNDARIES),
    "probes.csv": ("a row per step and probe", PROBES),
    "cycles.csv": ("a row per computed cycle of a repeated history", CYCLES),
    "convergence.csv": ("a row per step of the QP solver", CONVERGENCE),
    "boundary.csv": ("a row per edge of the outline", BOUNDARY),
    "obstacle.csv": ("a row per side of a rigid obstacle with largeSliding (and step)",
                     OBSTACLE),
}

# ---- files for ParaView, in the folder of a run --------------------------------------------------
FIELDS_FOLDER = "fields"
STRESSES = ("xx", "yy", "zz", "xy")  # components in these files


def field_file(index: int, pieces: int = 1) -> str:
    """File of the bodies' fields in a step, 0 for the start; with several pieces their index."""
    return f"{FIELDS_FOLDER}/step_{index:04d}.{'vtu' if pieces == 1 else 'pvtu'}"


def piece_file(name: str, piece: int) -> str:
    """A piece of a PVTU file."""
    return f"{name.removesuffix('.pvtu')}_{piece:04d}.vtu"


def contact_file(index: int) -> str:
    """The lines of the contact boundary in a step."""
    return f"{FIELDS_FOLDER}/contact_{index:04d}.vtu"


def error_file(index: int, pieces: int = 1) -> str:
    """The error indicator of a step, as `field_file`."""
    return f"{FIELDS_FOLDER}/error_{index:04d}.{'vtu' if pieces == 1 else 'pvtu'}"


def header(columns: tuple[Column, ...], **families) -> list[str]:
    """Names of the columns; `families` has the members of a column `name`_{} by `name`."""
    names = []
    for column in columns:
        if column.name.endswith("_{}"):
            members = families[column.name.removesuffix("_{}")]
            names += [column.name.format(member) for member in members]
        else:
            names.append(str(column.name))
    return names


def shown(value):
    """A value as written in a table: yes or no for a bool."""
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else value


def reference() -> list[dict[str, str]]:
    """A row {file, column, unit, meaning} for every column, for the documentation."""
    return [{"file": file, "column": str(column.name), "unit": column.unit,
             "meaning": column.meaning}
            for file, (_, columns) in TABLES.items() for column in columns]
