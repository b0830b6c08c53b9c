"""Columns of the tables that a run leaves, from which headers and their reference follow.

Units are "1", "length", "stress", "time", or products of these; forces and energies are per
thickness, of bodies of revolution those of the whole body, where forces along x are sums of radial
ones around the axis. A name with {} stands for as many columns as the run has of what the meaning
says.
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
        Column("time", "time", "at the end of the step"))

CONTACT = (
    *STEP,
    Column("node", "1", "number of the contact node, from 0, in the order of boundaries and arc; "
           "two at a corner, with a normal each"),
    Column("x", "length", "coordinate of the node"),
    Column("y", "length", "coordinate of the node"),
    Column("arc", "length", "arc length along the boundary"),
    Column("weight", "length", "length of the node's dual segment; of bodies of revolution the "
           "area that it sweeps"),
    *(Column(f"normal_{axis}", "1", "outward unit normal n of the body, at the end of the step "
             "where contact follows the motion; t is n turned by +90 degrees") for axis in "xy"),
    Column("gap", "length", "distance to the obstacle or the other body along n before any "
           "load; of obstacles that move, where they stand at the end of the step; where contact "
           "follows the motion (largeSliding) the sum of u_n and the distance at the end of it"),
    Column(ContactField.U_N, "length",
           "displacement along n, between bodies the jump; at most the gap"),
    Column(ContactField.U_T, "length", "displacement along t, between bodies the jump"),
    Column(ContactField.SLIP, "length", "change of u_t in the step, relative to the surface "
           "of an obstacle that moves"),
    Column(ContactField.SIGMA_N, "stress",
           "normal traction, nodal force over weight; negative in compression"),
    Column(ContactField.SIGMA_T, "stress", "shear traction, nodal force over weight"),
    Column(ContactField.BOUND, "stress", "largest shear traction that friction can hold"),
    Column(ContactField.STATUS, "1", f"{', '.join(STATUS_NAMES)}"),
)
WORN = Column("wear", "length", "worn depth since time 0, where the scene declares wear: u_n is at "
              "most the gap and this")
GEOMETRIES = Column("geometries", "1", "contact geometries of the step, where contact follows the "
                    "motion")
LABEL = Column("boundary", "1", "label of the contact boundary, where there are several; of a pair "
               "the first, which has the contact nodes; at a node in which one goes on in another "
               "that of the longer part")

PEAK = Column("peak_pressure", "stress", QUANTITIES["peak_pressure"].meaning)
LENGTH = Column("contact_length", "length", QUANTITIES["contact_length"].meaning)

HISTORY = (
    *STEP,
    Column("amplitude_{}", "1", "factor of the load with this number"),
    Column("fixed_point_iterations", "1", "QPs that were solved in the step"),
    Column("dual_multiplications", "1", "products with the dual matrix in the step"),
    Column("contraction", "1",
           "mean ratio of successive changes of the fixed point; nan in steps of fewer than two "
           "changes, but for the last step"),
    Column("resultant_n", FORCE, "normal tractions summed over the contact boundary, negative in "
           "compression; of several boundaries minus the sum of their magnitudes"),
    Column("resultant_t", FORCE, "shear tractions summed over the contact boundary; of several "
           "boundaries the magnitudes added"),
    Column("load_x", FORCE, "resultant of the loads"),
    Column("load_y", FORCE, "resultant of the loads"),
    Column("reaction_x", FORCE, "resultant of the support reactions"),
    Column("reaction_y", FORCE, "resultant of the support reactions"),
    Column("contact_x", FORCE, "resultant of the forces of rigid obstacles on the body"),
    Column("contact_y", FORCE, "resultant of the forces of rigid obstacles on the body"),
    *(Column(f"nodes_{name}", "1", f"contact nodes with status {name}") for name in STATUS_NAMES),
    LENGTH,
    Column("max_displacement", "length", "largest |u| of a node"),
    PEAK,
    Column("dissipated", ENERGY, "work that friction has taken since time 0"),
    Column("kkt_{}", "1", "relative residual of this part of the KKT conditions"),
)

BOUNDARIES = (
    *STEP,
    Column("boundary", "1", "label of the contact boundary; of a pair the one with contact nodes"),
    Column("normal_resultant", FORCE, "contact pressure summed over the boundary"),
    Column("tangential_resultant", FORCE, "shear traction sigma_t summed over the boundary"),
    Column("force_x", FORCE, "contact force on the body that carries the contact nodes"),
    Column("force_y", FORCE, "contact force on the body that carries the contact nodes"),
    PEAK,
    LENGTH,
    Column("slip", "length", "largest accumulated slip of a point in contact since time 0"),
    Column("dissipated_energy", ENERGY, "work that friction has taken since time 0"),
)

PROBES = (
    *STEP,
    Column("probe", "1", "point and its number, or label and its number"),
    Column("x", "length", "place, of a label the middle of its edges"),
    Column("y", "length", "place, of a label the middle of its edges"),
    Column("u_x", "length", "displacement, of a label the mean over its edges"),
    Column("u_y", "length", "displacement, of a label the mean over its edges"),
    Column("force_x", FORCE, "force on the body through the label, or at the vertex"),
    Column("force_y", FORCE, "force on the body through the label, or at the vertex"),
)

CYCLES = (
    Column("cycle", "1", "number of the cycle, those jumped over included"),
    Column("step", "1", "number of the step that ends it"),
    Column("time", "time", "at its end"),
    Column("kind", "1", "what it is, or seems to come to: shakedown (nothing slides), alternating "
           "slip (what slides comes back), ratcheting (it goes on), wear (surfaces that slide "
           "wear)"),
    Column("settled", "1", "yes, if cycles to come are like it: the same forces, within a "
           "thousandth of the largest, and slips and growths, within a hundredth"),
    Column("change", "1", "largest change of a contact force against the same step of the cycle "
           "before, after a jump the mean one of the cycles jumped over and this one, over the "
           "largest contact force; 1 in the first cycle"),
    Column("remaining", "1", "estimated further change by the cycles to come, by a geometric "
           "series; at most 1, which also stands where four cycles are not enough to tell"),
    Column("slip", "length", "longest way that a node slides in the cycle, of those that no "
           "support holds along the boundary"),
    Column("drift", "length", "largest change of a node's u_t over the cycle"),
    Column("wear", "length", "largest growth of the worn depth"),
    Column("dissipated", ENERGY, "work that friction takes in the cycle"),
    Column("skipped", "1", "cycles jumped over before it"),
    Column("error", "length", "by how much the jump may err in what grows: drift, wear or, where a "
           "law depends on it, accumulated slip"),
)

CONVERGENCE = (
    Column("product", "1", "products with the dual matrix so far"),
    Column("step", "1", "number of the step"),
    Column("iteration", "1", "iteration of the fixed point in the step"),
    Column("kind", "1", "what the QP solver did: start, cg, expansion, proportioning, ..."),
    Column("residual", "1", "norm of the projected gradient, relative"),
)

BOUNDARY = (
    *(Column(name, "length",
             "ends of the edge of the outline, or of half of a curved one, the body on its left")
      for name in ("x0", "y0", "x1", "y1")),
    Column("label", "1", "label of the edge in the mesh"),
    Column("role", "1", "pair, contact, support, springs, joined (tied, periodic), load or free"),
    Column("traction_x", "stress", "traction of the label at amplitude 1"),
    Column("traction_y", "stress", "traction of the label at amplitude 1"),
    Column("fixed_x", "1", "1 where a support holds this component on the whole label"),
    Column("fixed_y", "1", "1 where a support holds this component on the whole label"),
    Column("moved_x", "length", "displacement that is prescribed there at amplitude 1"),
    Column("moved_y", "length", "displacement that is prescribed there at amplitude 1"),
)

OBSTACLE = (
    Column("step", "1", "number of the step, 0 is the start; of an obstacle that stands 0 alone"),
    *(Column(name, "length", "ends of a side of a polygon that is like the obstacle, the body on "
             "its left") for name in ("x0", "y0", "x1", "y1")),
)

TABLES = {
    "contact.csv": ("a row per step and contact node", (*CONTACT, WORN, LABEL)),
    "history.csv": ("a row per step", (*HISTORY, GEOMETRIES)),
    "boundaries.csv": ("a row per step and contact boundary", BOUNDARIES),
    "probes.csv": ("a row per step and probe", PROBES),
    "cycles.csv": ("a row per cycle of a history that is repeated", CYCLES),
    "convergence.csv": ("a row per step of the QP solver", CONVERGENCE),
    "boundary.csv": ("a row per edge of the outline", BOUNDARY),
    "obstacle.csv": ("a row per side of a rigid obstacle that contact follows (and step)",
                     OBSTACLE),
}

# ---- files for ParaView, in the folder of a run --------------------------------------------------
FIELDS_FOLDER = "fields"
STRESSES = ("xx", "yy", "zz", "xy")  # components in these files


def field_file(index: int, pieces: int = 1) -> str:
    """The fields of the bodies in a step, 0 for the start; of several pieces what names these."""
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
    """A value as it stands in a table: yes or no for a bool."""
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else value


def reference() -> list[dict[str, str]]:
    """A row {file, column, unit, meaning} for every column, for the documentation."""
    return [{"file": file, "column": str(column.name), "unit": column.unit,
             "meaning": column.meaning}
            for file, (_, columns) in TABLES.items() for column in columns]
