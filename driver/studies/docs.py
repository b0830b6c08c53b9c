"""make docs: renew what the documents have from the code and from results/reference.

Between the lines <!-- generated: NAME ... --> and <!-- end --> of a document stands what the
function NAME of BLOCKS returns for the words after the name. Nothing is solved for it; only the
pictures of the gallery take runs (GALLERY=missing, GALLERY=yes).
"""

import ast
import csv
import importlib
import itertools
import json
import re
import tempfile
from pathlib import Path

from .. import environment, options
from ..files import read_rows
from ..quantity_table import QUANTITIES
from ..results import summary, tables
from ..runs.run import Run, execute
from ..scene import freefem
from ..scene.rooms import Room, general_macros, head, listed_calls, rooms
from ..text import words
from .accuracy.coverage import totals

ROOT = environment.ROOT
# of the driver in the order of the data
PACKAGES = ("scene", "feti", "contact", "qp", "effects", "march", "results", "energy_norm",
            "validity", "estimates", "figures", "report", "runs", "studies", "hard", "bench",
            "python", "verify")
DOCUMENTS = tuple(ROOT / name for name in (
    "README.md", "edp/README.md", "driver/README.md", "results/README.md", "meshes/README.md"))
REFERENCE = ROOT / "results" / "reference"
GALLERY = REFERENCE / "gallery"
DPI, COLOURS = 120, 128  # of the pictures, which are small files
# pictures beside the gallery's: parameters of the run, and the figure
PICTURES = {REFERENCE / "model-nonmonotone.png": ({"loading": "nonmonotone"}, "deformed"),
            REFERENCE / "model-friction.png": ({"loading": "nonmonotone"}, "contact_tangential")}
MARKED = re.compile(r"(<!-- generated: (\w+)((?: [^\s>]+)*) -->\n).*?(<!-- end -->)", re.DOTALL)


def renew(gallery: str) -> list[Path]:
    """Write the documents anew, with their pictures if `gallery` is "missing" or "yes" (all of
    them); the files that changed. Raises what runs of the scenes raise.
    """
    changed = []
    if gallery != "no":
        changed += [path for path in pictures() if gallery == "yes" or not path.is_file()]
        for path in changed:
            draw(path)
    for path in DOCUMENTS:
        text = renewed(path)
        if text != path.read_text():
            path.write_text(text)
            changed.append(path)
    return changed


def renewed(path: Path) -> str:
    """The text of a document as it should be. Raises KeyError for a block that does not exist."""
    def block(match: re.Match) -> str:
        start, name, arguments, end = match.groups()
        return f"{start}\n{BLOCKS[name](*arguments.split()).strip()}\n\n{end}"

    return MARKED.sub(block, path.read_text())


# ---- Markdown ------------------------------------------------------------------------------------

def markdown(header: tuple[str, ...], rows) -> str:
    """A table; cells are text, and what Markdown would take for markup in them is escaped."""
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines)


def _cell(value) -> str:
    return _escaped(str(value)).replace("|", r"\|")


def _escaped(text: str) -> str:
    """Text in which nothing but what stands between backquotes is markup."""
    marks = {"_": r"\_", "*": r"\*", "<": "&lt;"}
    return re.sub(r"`[^`]*`|[_*<]", lambda match: marks.get(match[0], match[0]), text)


def _grouped(rows) -> list[tuple]:
    """Neighbouring rows that differ in their first cell only as one."""
    groups = itertools.groupby(rows, lambda row: row[1:])
    return [(", ".join(row[0] for row in group), *rest) for rest, group in groups]


def _code(names) -> str:
    return ", ".join(f"`{name}`" for name in names)


# ---- scenes --------------------------------------------------------------------------------------

def calls(name: str) -> str:
    """The calls that the head of a file of edp/lib lists."""
    rows = [(f"`{form}`", meaning) for form, meaning in listed_calls(environment.LIBRARY / name)]
    return markdown(("call", "meaning"), rows)


def macros() -> str:
    """What a scene may define besides effects."""
    return _macros(general_macros())


def effects() -> str:
    """Every effect with the macros that declare it, from the heads of edp/lib/effects."""
    return "\n\n".join(_effect(room) for room in rooms())


def _effect(room: Room) -> str:
    facts = [f"`{room.example}`"]
    if room.needs:
        facts.append(f"needs {', '.join(' or '.join(names) for names in room.needs)}")
    if room.brings:
        facts.append(f"brings {', '.join(room.brings)}")
    if room.studied:
        facts.append(f"may vary in `make study`: {_code(room.studied)}")
    names = {name for macro in room.macros if macro.name in room.declared_by
             for name in macro.names}
    users = [scene for scene in freefem.scenes() if names & _declared(scene)]
    if users:
        facts.append(f"scenes: {_code(users)}")
    parts = [f"#### {words(room.name)}",
             f"{_escaped(_sentence(room.title))} ({'; '.join(facts)})", _macros(room.macros),
             _escaped(room.text.replace("\n", " "))]
    return "\n\n".join(filter(None, parts))


def _macros(listed) -> str:
    rows = [(f"`{macro.name}`" if macro.arguments is None else f"`{macro.name}({macro.arguments})`",
             " ".join(macro.text.split())) for macro in listed]
    return markdown(("macro", "content"), _grouped(rows))


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:].rstrip(".") + "."


def estimates() -> str:
    """How well the error in the energy norm is known with every effect, and what it adds."""
    rows = []
    for name in _effect_modules():
        room = importlib.import_module(f"driver.effects.{name}").Room
        rows.append((words(name), room.estimates, room.why or "-",
                     " ".join(room.__doc__.split("\n\n")[0].split())))
    return markdown(("effect", "error in the energy norm", "why no better", "what it adds"), rows)


def _effect_modules() -> list[str]:
    """Effects that the driver knows: those of the library in their order, then the others."""
    known = [room.name for room in rooms()]
    there = sorted(path.stem for path in (ROOT / "driver" / "effects").glob("[a-z]*.py"))
    return [*known, *(name for name in there if name not in known)]


def gallery() -> str:
    """All scenes that ship: picture, what it shows, parameters."""
    cells = []
    for name in freefem.scenes():
        path = freefem.SCENES / f"{name}.edp"
        parts = [f"**[`{name}`]({path.name})**: {_escaped(_about(path))}"]
        if parameters := _parameters(path.read_text()):
            parts.append(f"Parameters: {_code(parameters)}.")
        source = f"../{(GALLERY / name).relative_to(ROOT)}.png"
        picture = f'<img src="{source}" width="300" alt="{name}">'
        cells.append((picture, "<br>".join(parts).replace("|", r"\|")))
    lines = [("deformed body", "scene"), ("---", "---"), *cells]
    return "\n".join(f"| {one} | {two} |" for one, two in lines)


def _about(path: Path) -> str:
    """The first sentence of a scene's comment."""
    lines = []
    for line in head(path):
        if not line or line.startswith("   "):
            break
        lines.append(line.strip())
    return _sentence(" ".join(lines).removeprefix(f"{path.name} - "))


def _parameters(text: str) -> list[str]:
    """What a scene reads from the command line, as a user writes it, with defaults."""
    calls_of = re.findall(r'\b(?:physical|whole|choice)\("(\w+)", ("?)([^,()"]+)', text)
    shown = [f"{name.upper()}={value}" for name, _, value in calls_of]
    shown += [f"H={value}" for value in re.findall(r"\bmeshSize\(([^()]+)\)", text)]
    return list(dict.fromkeys(shown))


def _declared(scene: str) -> set[str]:
    """Macros that a scene defines, in its own text or in what it includes from the library."""
    text = (freefem.SCENES / f"{scene}.edp").read_text()
    for name in re.findall(r'include "([\w-]+\.idp)"', text):
        if name not in ("scene.idp", "export.idp", "gmsh.idp"):
            text += (environment.LIBRARY / name).read_text()
    return set(re.findall(r"\bmacro (\w+)\(", text))


# ---- pictures ------------------------------------------------------------------------------------

def pictures() -> dict[Path, tuple[dict[str, str], str]]:
    """Parameters and figure of every picture by its file."""
    scenes = {GALLERY / f"{name}.png": ({"scene": name}, "deformed") for name in freefem.scenes()}
    return scenes | {path: ({"scene": "model"} | parameters, figure)
                     for path, (parameters, figure) in PICTURES.items()}


def draw(path: Path) -> None:
    """Run the scene of a picture and draw it as a small file. Raises what the run raises."""
    import matplotlib
    from PIL import Image

    from ..figures import compose, read_run
    from ..figures.style import STYLE

    parameters, figure = pictures()[path]
    path.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        execute(Run.from_pairs({**parameters, "errors": "no", "figures": "no", "quiet": "yes",
                                "out": str(out)}))
        with matplotlib.rc_context(STYLE):
            compose(figure, read_run(out)).savefig(out / "picture.png", dpi=DPI)
        Image.open(out / "picture.png").convert("RGB").quantize(COLOURS).save(path, optimize=True)


# ---- results and measured numbers ----------------------------------------------------------------

def columns() -> str:
    """Every column of the tables that a run leaves."""
    parts = []
    for file, (rows, _) in tables.TABLES.items():
        listed = _grouped((f"`{row['column']}`", _unit(row), row["meaning"])
                          for row in tables.reference() if row["file"] == file)
        parts.append(f"#### {file}: {rows}\n\n{markdown(('column', 'unit', 'meaning'), listed)}")
    return "\n\n".join(parts)


def entries() -> str:
    """Every entry of summary.json."""
    return markdown(("entry", "unit", "meaning"), [
        (f"`{row['entry']}`", _unit(row), row["meaning"]) for row in summary.reference()])


def quantities() -> str:
    """What the quantities of interest are."""
    rows = []
    for name, quantity in QUANTITIES.items():
        parts = [part if power == 1 else f"{part}^{power}"
                 for part, power in zip(("stress", "length"), quantity.unit) if power]
        rows.append((f"`{name}`", " ".join(parts), quantity.meaning))
    return markdown(("quantity", "unit", "meaning"), rows)


def _unit(row: dict[str, str]) -> str:
    """The unit of a column or entry; nothing for text and numbers without one."""
    return "" if row["unit"] == "1" else row["unit"]


def measured(name: str) -> str:
    """A table of results/reference/measured.json, with the command that measures it."""
    found = json.loads((REFERENCE / "measured.json").read_text())[name]
    return f"{markdown(found['columns'], found['rows'])}\n\n{_by(found['commands'])}"


def coverage() -> str:
    """What the table of claimed and true errors comes to."""
    rows = read_rows(REFERENCE / "coverage.csv")
    count, held, half, median = totals(rows)
    runs = {(row["scene"], row["setting"]) for row in rows}  # one may have no claim to judge
    return (f"*`make accuracy PART=coverage`: {len(runs)} runs of {len({s for s, _ in runs})} "
            "scenes and published cases, coarse to fine, linear and quadratic, adaptive, with 1 to "
            "80 steps, against closed forms and much finer runs. Of "
            f"{count} claims that can be judged {held:.1f} % are above the true error, "
            f"{half or 'none'} below half of it; the median of claim over truth is {median:.1f}.*")


def prices() -> str:
    """What the table of predicted and taken seconds comes to; it is measured on an idle machine."""
    rows = read_rows(REFERENCE / "prices.csv")
    within, met = ([row[name] for row in rows] for name in ("within", "met"))
    off = [float(row["seconds"]) / float(row["seconds_predicted"]) for row in rows
           if row["within"] == "no"]
    others = ", ".join(f"{ratio:.1f}" for ratio in sorted(off))
    return (f"*{len(rows)} lines of {len({row['scene'] for row in rows})} scenes, on an idle "
            f"machine: seconds of {within.count('yes')} within a factor of two of what was "
            f"predicted (the others took {others} times as many), {met.count('yes')} of "
            f"{met.count('yes') + met.count('no')} accuracies met; of {met.count('')} more the "
            "references are too coarse to tell. `reference/prices.csv` has them all.*")


def slides() -> str:
    """Products of the slides' table, theirs and ours."""
    with open(REFERENCE / "table.csv", newline="") as file:
        rows = [[f"{int(row[key]):,}" for key in (
            "n_s", "n_d", "slides_n_m_monotone", "n_m_monotone", "slides_n_m_nonmonotone",
            "n_m_nonmonotone")] for row in csv.DictReader(file)]
    header = ("subdomains", "n_d", "monotone: slides", "here", "nonmonotone: slides", "here")
    return f"{markdown(header, rows)}\n\n{_by(['make table METHOD=default'])}"


def _by(commands: list[str]) -> str:
    return f"Measured by {_code(commands)}."


# ---- the driver ----------------------------------------------------------------------------------

def commands() -> str:
    """The commands of the driver."""
    return markdown(("command", "what it does"), [
        (f"`make {command.name}`", command.help) for command in options.COMMANDS.values()])


def house() -> str:
    """The packages in the order of the data: what they do, their modules, what they import."""
    rows = []
    for package in PACKAGES:
        folder = ROOT / "driver" / package
        text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
        modules = sorted(path.stem for path in folder.glob("*.py") if path.stem != "__init__")
        modules += sorted(path.parent.name for path in folder.glob("*/__init__.py"))
        rows.append((f"`{package}`", " ".join(text.split("\n\n")[0].split()), ", ".join(modules),
                     ", ".join(_imported(folder)) or "-"))
    return markdown(("package", "what it does", "modules", "imports"), rows)


def _imported(folder: Path) -> list[str]:
    """Packages that the modules of a package import, in the order of the data."""
    found = set()
    for path in folder.rglob("*.py"):
        dots = r"\." * len(path.relative_to(ROOT / "driver").parts)
        for names in re.findall(rf"^ *from {dots}(\w+|(?= import)[^\n]*)", path.read_text(), re.M):
            found |= set(re.findall(r"\w+", names))
    return [name for name in PACKAGES if name in found and name != folder.name]


BLOCKS = {block.__name__: block for block in (
    calls, macros, effects, estimates, gallery, columns, entries, quantities, measured, coverage,
    prices, slides, commands, options.reference, house)}
BLOCKS["options"] = BLOCKS.pop("reference")
