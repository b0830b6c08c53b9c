"""Every option of the command line in one table: values, default, commands and reader.

The parsing and checks of every command, the solver's Settings, `make help` and the reference of
options are made from TABLE and COMMANDS. A new option is a line here and the line that reads it.

    python3 -m driver.options        what `make help` shows of the commands
"""

import os
import textwrap
from dataclasses import dataclass, make_dataclass
from enum import Enum

from . import environment
from .arguments import (CYCLES, EVERY, NAMES, SHARE, TOLERANCE, YES_NO, Kind, choice, path,
                        several, text, whole)
from .errors import InputError

RESULTS = environment.ROOT / "results"
CORES = len(os.sched_getaffinity(0))  # that this process may use
RANKS_PER_CORE = 64  # more could not even start
MOST_CYCLES = 20  # of refinement, each with four times the triangles
WIDTH, INDENT = 88, 12  # of help


class Reader(Enum):
    """The stage that reads an option."""

    FRONT = "command line"
    EXPORT = "FreeFEM"
    SOLVER = "solver"
    ESTIMATES = "error estimates"
    OUTPUT = "output"
    FIGURES = "figures"
    STUDY = "study"


@dataclass(frozen=True)
class Option:
    """An option: NAME=VALUE after one of the targets `commands`."""

    name: str  # in lower case
    kind: Kind
    default: object  # value where the option is not given
    reader: Reader
    commands: tuple[str, ...]
    help: str
    otherwise: str = ""  # the default in words, where its value does not say it
    required: bool = False
    excludes: tuple[str, ...] = ()  # options that this one chooses

    def read(self, value: str):
        """The value that the text `value` stands for. Raises InputError."""
        return self.kind.read(self.name.upper(), value)

    @property
    def default_text(self) -> str:
        """The default as a user would write it, or in words; empty for a required option."""
        if self.otherwise or self.default is None:
            return self.otherwise
        if isinstance(self.default, bool):
            return "yes" if self.default else "no"
        if isinstance(self.default, os.PathLike):
            return os.path.relpath(self.default, environment.ROOT)
        return str(self.default)


@dataclass(frozen=True)
class Command:
    """A command of ``python3 -m driver``, which is a target of make too."""

    name: str
    help: str
    parameters: bool = False  # further names are parameters of the scene, which checks them
    refusal: str = ""  # of options of `run` that it does not take


COMMANDS = {command.name: command for command in (
    Command("run", "one scene, by name or path to an .edp; alone: list the scenes", True),
    Command("model", "the model example under both loading histories, or one of them", True,
            "make model decides on {name} itself"),
    Command("table", "the table of the slides beside our own results"),
    Command("effects", "a scene as declared, and with each effect left out in turn", True,
            "the study decides on {name} itself"),
    Command("study", "many values of one parameter on one export: FRICTION=0.05:1.0:100 or a,b,c",
            True, "a study has one mesh and no estimates or fields; {name} belongs to single runs"),
    Command("accuracy", "what accuracy costs: every numerical choice in turn, coarse to fine", True,
            "the study decides on {name} itself"),
    Command("bench", "cost of runs, compared with the slides, other programs and limits of the "
            "machine"),
    Command("hard", "the hard cases, each solved and checked or refused"),
    Command("verify", "published cases of other codes and closed forms, solved and compared"),
    Command("saddle", "write and draw the FETI-DP saddle-point matrix of a small case", True,
            "the matrix does not depend on {name}"),
    Command("docs", "update the generated parts of the documents"),
    Command("figures", "redraw the figures of finished runs from their files"),
    Command("report", "make report.html of a finished run or study again from its files"),
)}

# ---- the table -----------------------------------------------------------------------------------

SCENES = ("run", "effects", "study")
SOLVING = ("run", "model", "effects", "study", "accuracy")
SOLVES = (*SOLVING, "table")
MESHING = (*SOLVING, "saddle")
SINGLE = ("run", "model")
FRONT, EXPORT, SOLVER, STUDY = Reader.FRONT, Reader.EXPORT, Reader.SOLVER, Reader.STUDY

RUNS = (
    Option("scene", text("name|path"), None, FRONT, SCENES,
           "the scene, which declares all physics", required=True),
    Option("scene", text("name|path"), None, FRONT, ("accuracy",), "the scene of the sweeps",
           "none, needed by PART=sweeps"),
    Option("scene", text("name|path"), "model", FRONT, ("saddle",), "the scene"),
    Option("np", whole("a number of ranks", 1), None, FRONT, SOLVES,
           "number of MPI ranks of FreeFEM and the solver",
           "slots of the hosts; on this host as many solver ranks as pay off for the size"),
    Option("hosts", path("file"), None, FRONT, SOLVES, "file of the hosts on which ranks start, "
           "a line 'name slots=n' for each; all must share the directory of OUT",
           "hosts allotted by Slurm or PBS, else this host"),
    Option("out", path(), None, FRONT, ("run",), "directory of the results; a converged "
           "run replaces an older run there", "results/<scene>"),
    Option("out", path(), None, FRONT, ("model",), "directory of the results; with both "
           "loadings the first part of its name", "results/model-<loading>"),
    Option("out", path(), None, FRONT, ("study",), "directory of the results",
           "results/study/<scene>-<parameter>"),
    Option("out", path(), None, FRONT, ("accuracy",), "directory of the results",
           "results/accuracy/<scene or part>"),
    *(Option("out", path(), RESULTS / folder, FRONT, (command,), "directory of the results")
      for command, folder in (("effects", "effects"), ("bench", "bench"), ("hard", "hard"),
                              ("verify", "verify"),
                              ("saddle", "saddle"))),
    Option("out", path(), None, FRONT, ("figures", "report"),
           "directory of a finished run or study", "all in results/, at any depth"),
    Option("resume", YES_NO, True, FRONT, (*SINGLE, "effects"),
           "continue an interrupted run of the same command after its last finished step"),
    Option("adapt", whole("a number of refinement cycles", 0, MOST_CYCLES), 0, FRONT,
           (*SINGLE, "effects"), "cycles of adaptive refinement before the run itself"),
    Option("accuracy", SHARE, None, FRONT, (*SINGLE, "effects"),
           "choose mesh, steps and tolerances for this relative error of a quantity of interest",
           "not chosen",
           excludes=("cells", "h", "remesh", "steps", "rtol", "friction_rtol", "primal_rtol",
                     "adapt", "quantity")),
    Option("quantity", text("name"), "", Reader.ESTIMATES, SINGLE,
           "quantity of interest for which the run reports the cost of higher accuracy",
           "the first with a known nonzero error that does not follow from the loads"),
    Option("without", NAMES, (), EXPORT, (*SINGLE, "study"), "effects of the scene to "
           "treat as undeclared: friction, gap, load2, quasistatic, ...", "none"),
    Option("errors", choice("yes", "energy", "no"), "yes", Reader.ESTIMATES, SINGLE,
           "estimate errors: of all quantities, in the energy norm only, or none"),
    Option("fields", YES_NO, True, Reader.OUTPUT, SINGLE,
           "write the fields for ParaView; without them figures do not show the body"),
    Option("figures", YES_NO, True, Reader.FIGURES, (*SINGLE, "study"), "draw the figures"),
    Option("animate", YES_NO, False, Reader.FIGURES, SINGLE,
           "draw an animation of deformation and contact status (figures/animation.gif)"),
    Option("quiet", YES_NO, False, Reader.OUTPUT, (*SINGLE, "study"), "do not show progress on the "
           "screen"),
)

# numerical parameters of scenes, which FreeFEM checks
MESHES = (
    Option("subdomains", text("NxM|n|auto|piece"), None, EXPORT, MESHING,
           "structured cut NxM; n subdomains by the graph partitioner; a number that suits the "
           "size (auto); or as numbered by the scene (piece)", "that of the scene, else auto"),
    Option("cells", text("n"), None, EXPORT, MESHING,
           "cells along the side of a subdomain, of an oblong one along the shorter side; for "
           "scenes on rectangles", "that of the scene"),
    Option("h", text("length"), None, EXPORT, MESHING,
           "element size in the length unit of the scene; for other scenes", "that of the scene"),
    Option("remesh", text("factor"), None, EXPORT, MESHING,
           "remesh with the element sizes of the scene's own mesh times this factor; for scenes "
           "that read neither CELLS nor H, and for meshes from files", "1"),
    Option("element", choice("P1", "P2", "P2-mixed"), "P1", EXPORT, MESHING, "linear or quadratic "
           "triangles; P2-mixed: for nearly incompressible materials"),
    Option("steps", text("n"), None, EXPORT, MESHING,
           "number of equal time steps; a static scene has one", "that of the scene"),
)

# numerical options of the solver, each with a default that suits most runs; tolerances are relative
SETTINGS = (
    Option("rtol", TOLERANCE, 1e-8, SOLVER, SOLVING,
           "tolerance of a QP: norm of the projected gradient over that of the right-hand side d"),
    Option("friction_rtol", TOLERANCE, 1e-6, SOLVER, SOLVING,
           "tolerance of the fixed point: change of lambda_n over lambda_n; also of the "
           "equilibrium of bodies without support"),
    Option("primal_rtol", TOLERANCE, 1e-6, SOLVER, SOLVING,
           "tolerance of all residuals in summary.json except equilibrium, relative to "
           "deformations and forces; if a residual is larger, the step continues with tighter "
           "RTOL and FRICTION_RTOL; if that does not help, the run ends with status 4"),
    Option("max_fixed_point", whole("a whole number", 1), 100, SOLVER, SOLVING,
           "largest number of fixed-point iterations in a time step"),
    Option("max_products", whole("a whole number", 1), 200_000, SOLVER, SOLVING,
           "largest number of products with the dual operator in a QP"),
    Option("preconditioner", choice("deflated", "dirichlet", "none"), "deflated", SOLVER, SOLVING,
           "Dirichlet with deflation of slowly varying contact tractions, Dirichlet alone, or "
           "none"),
    Option("predictor", choice("load", "previous"), "load", SOLVER, SOLVING,
           "start a step from multipliers extrapolated with the load, or from those of the last "
           "step"),
    Option("inner_rtol", TOLERANCE, 0.1, SOLVER, SOLVING, "residual reduction of a QP before its "
           "friction bound is updated; a tiny value solves every QP to RTOL"),
    Option("estimator", choice("equilibrated", "recovery", "none"), "equilibrated",
           Reader.ESTIMATES, SOLVING,
           "estimate of the error in the energy norm: guaranteed bound, averaged stresses (no "
           "bound), or none"),
    Option("expansion", choice("contact", "cg", "gradient"), "contact", SOLVER, SOLVING,
           "expansion step of MPRGP: contact solved for the gluing multipliers of the CG step; "
           "the projected CG step; or a gradient step of fixed length"),
    Option("corrector", choice("contact", "none"), "contact", SOLVER, SOLVING,
           "whether contact and friction are solved for given gluing multipliers before each QP "
           "(in condensed studies by Newton's method)"),
    Option("linearization", choice("initial", "updated"), "initial", SOLVER, SOLVING,
           "contact between bodies linearized about the initial geometry, or updated once about "
           "the displacements of a first run; not with largeSliding, which follows the motion"),
    Option("uniqueness", choice("auto", "yes", "no"), "auto", SOLVER, SOLVING, "search for other "
           "solutions of every step; auto: where few contact nodes, friction or doubt suggest it, "
           "up to the first step that has other solutions"),
    Option("cycles", CYCLES, EVERY, SOLVER, SOLVING,
           "for a repeated history: number of cycles (n); stop when they have settled (until "
           "settled); or jump over cycles while growth is steady (jump 1%: allowed error of a jump "
           "relative to the growth); 'n until settled' and 'n jump 1%' give the number, too",
           "those of the scene"),
)

STUDIES = (
    Option("rows", several(*"12345"), tuple("12345"), STUDY, ("table",),
           "rows of the table, with 8, 32, 128, 512, 2048 subdomains", "all"),
    Option("method", several("default", "plain"), ("default", "plain"), STUDY, ("table",),
           "default method of the driver, and the method of the slides", "both"),
    Option("fresh", YES_NO, False, STUDY, ("table",), "compute existing rows again"),
    Option("part", choice("sweeps", "locking", "curved", "stopping", "coverage", "prices",
                          "requests", "handpicked"),
           "sweeps", STUDY, ("accuracy",),
           "sweeps of a scene; convergence of elements near incompressibility (locking) or with "
           "curved sides; savings from stopping by the error budget on the model example; "
           "tests of claimed errors (coverage), of price lists, of ACCURACY (requests), and of its "
           "cost against settings by hand"),
    Option("rows", several(*"12345"), tuple("1234"), STUDY, ("accuracy",), "PART=stopping: "
           "meshes, coarse to fine, with as many subdomains as those of the table", "1,2,3,4"),
    Option("effort", choice("quick", "full"), "full", STUDY, ("accuracy",), "length of the sweeps"),
    Option("repeats", whole("a whole number", 1), None, STUDY, ("accuracy",),
           "repetitions of every short run", "1 with EFFORT=quick, else 3"),
    Option("quantity", text("name"), None, STUDY, ("accuracy",), "quantity of interest to show",
           "chosen by the study"),
    Option("parts", several("products", "factorization", "geometry", "getfem", "tao", "roofline",
                            "stages", "ranks", "studies", "bodies"), None, STUDY, ("bench",),
           "parts of the benchmark", "all"),
    Option("large", YES_NO, False, STUDY, ("bench",),
           "include GetFEM at h = 1/160, 1/320 and on a mesh of its own with 85,000 dofs (half an "
           "hour), PARTS=geometry with 1,000,000 dofs, PARTS=ranks with 100,000 subdomains"),
    Option("family", several("material", "geometry", "contact", "friction", "scale", "support",
                             "bodies", "element", "algorithm", "environment", "random"), None,
           STUDY, ("hard",), "families of cases; random: scenes drawn from seeds", "all"),
    Option("case", text("text"), "", STUDY, ("hard", "verify"),
           "run only cases with this text in their names",
           "all"),
    Option("seed", whole("a whole number", 0), 1, STUDY, ("hard",),
           "FAMILY=random: the first seed"),
    Option("count", whole("a number of scenes", 1), 200, STUDY, ("hard",),
           "FAMILY=random: number of scenes, with consecutive seeds"),
    Option("fast", YES_NO, False, STUDY, ("hard", "verify"),
           "run only what make test runs; hard cases at the first size"),
    Option("page", YES_NO, False, STUDY, ("verify",),
           "also update edp/verify/README.md and its pictures"),
    Option("gallery", choice("no", "missing", "yes"), "no", STUDY, ("docs",),
           "run scenes and draw their pictures: none, missing ones, or all"),
    Option("jobs", whole("a number of processes", 1), CORES, STUDY, ("hard", "verify"),
           "number of cases that run at the same time", "number of cores"),
)

SECTIONS = {"Runs": RUNS, "Mesh and time steps": MESHES, "Solver": SETTINGS, "Studies": STUDIES}
TABLE = tuple(option for options in SECTIONS.values() for option in options)
OF_RUNS = frozenset(option.name for option in TABLE  # options of runs that no scene reads
                    if "run" in option.commands and option not in MESHES)

Settings = make_dataclass(
    "Settings", [(option.name, type(option.default), option.default) for option in SETTINGS],
    namespace={"__module__": __name__, "__doc__": "Numerical options of the solver, see SETTINGS."})


# ---- the command line ----------------------------------------------------------------------------

@dataclass(frozen=True)
class Given:
    """Options that were given to a command, read and checked; given[name] is the value of one."""

    values: dict[str, object]  # of all options but those below, defaults included
    settings: dict[str, object]  # of the solver: only what was given
    parameters: dict[str, str]  # of the scene, which checks them

    def __getitem__(self, name: str):
        return self.values[name]


def options_of(command: str) -> dict[str, Option]:
    """The options of a command by name."""
    return {option.name: option for option in TABLE if command in option.commands}


def find(command: str, name: str) -> Option:
    """The option `name` of a command."""
    return options_of(command)[name]


def ranks(pairs: dict[str, str]) -> dict[str, str]:
    """Those of the NAME=VALUE `pairs` that say where ranks start."""
    return {name: pairs[name] for name in ("np", "hosts") if name in pairs}


def read(command: str, pairs: dict[str, str]) -> Given:
    """Sort and check the NAME=VALUE `pairs`, names in lower case. Raises InputError."""
    known = options_of(command)
    _check_names(COMMANDS[command], known, pairs)
    given = {name: known[name].read(value) for name, value in pairs.items() if name in known}
    for name in given:
        for other in known[name].excludes:
            if other in pairs:
                raise InputError(f"{name.upper()} chooses {other.upper()} itself: leave out one of "
                                 "the two")
    settings = {option.name for option in SETTINGS}
    parameters = {name: value for name, value in pairs.items()
                  if name not in known or known[name] in MESHES}
    values = {name: given.get(name, option.default) for name, option in known.items()
              if name not in settings and option not in MESHES}
    return Given(values, {name: given[name] for name in given if name in settings}, parameters)


def _check_names(command: Command, known: dict[str, Option], pairs: dict[str, str]) -> None:
    """Refuse names that the command does not take, and the lack of those that it needs."""
    of_runs = options_of("run")
    for name in pairs:
        if name in known or command.parameters and name not in of_runs:
            continue
        if command.parameters:
            raise InputError(command.refusal.format(name=name.upper()))
        raise InputError(f"make {command.name} has no option {name.upper()}; it has "
                         f"{', '.join(map(str.upper, known))}")
    for name, option in known.items():
        if option.required and name not in pairs:
            raise InputError(f"make {command.name} needs {name.upper()}=<{option.kind.shown}>; "
                             "'make run' lists the scenes")


# ---- help and reference --------------------------------------------------------------------------

def usage() -> str:
    """The commands and their options as text, for `make help`."""
    groups = {"mesh options": MESHES, "solver options": SETTINGS}
    lines = [f"contact suite {environment.version()}", ""]
    for command in COMMANDS.values():
        known = options_of(command.name).values()
        words = [_word(option) if option.required else f"[{_word(option)}]" for option in known
                 if not any(option in group for group in groups.values())]
        words += [f"[{title}]" for title, group in groups.items() if any(o in group for o in known)]
        if command.parameters:
            words.append("[parameters of the scene]")
        lines += [f"{command.name:{INDENT}s}{command.help}", _wrapped(words)]
    for title, group in groups.items():
        lines += ["", title, _wrapped(map(_word, group))]
    return "\n".join(lines)


def _word(option: Option) -> str:
    return f"{option.name.upper()}={option.kind.shown}"


def _wrapped(words) -> str:
    """Lines of WIDTH behind the column of names; a line ends between two words only."""
    margin, space = " " * INDENT, "\u00a0"
    text = " ".join(word.replace(" ", space) for word in words)
    return textwrap.fill(text, WIDTH, initial_indent=margin, subsequent_indent=margin,
                         break_long_words=False, break_on_hyphens=False).replace(space, " ")


def reference() -> str:
    """The table in Markdown, a section for each group of options."""
    parts = []
    for title, options in SECTIONS.items():
        rows = [("option", "values", "default", "targets", "read by", "meaning"), ("---",) * 6]
        rows += [(f"`{option.name.upper()}`", f"`{option.kind.shown}`", option.default_text,
                  ", ".join(option.commands), option.reader.value, option.help)
                 for option in options]
        lines = ["| " + " | ".join(_escaped(cell) for cell in row) + " |" for row in rows]
        parts.append("\n".join([f"### {title}", "", *lines]))
    return "\n\n".join(parts) + "\n"


def _escaped(cell: str) -> str:
    """Text for a cell of a Markdown table."""
    cell = cell.replace("|", r"\|")
    return cell if cell.startswith("`") else cell.replace("<", "&lt;")


if __name__ == "__main__":
    try:
        print(usage(), flush=True)
    except BrokenPipeError:  # who reads it has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
