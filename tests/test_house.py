"""Rules of the house: which package may import which, what the front and the figures go without,
how long modules and lines may be, and what has a docstring.

A rule is a function of a folder that holds `driver/`, so that it is tried on broken ones as well.
"""

import ast
import functools
import graphlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from driver import environment
from driver.studies.docs import PACKAGES

ORDER = PACKAGES  # imports go from a later one to an earlier one only
TOP = ("driver", "driver.cli", "driver.__main__")  # may import anything, and nothing imports them
LONGEST, WIDEST = 400, 100  # lines of a module, characters of a line
REASON = "One module because"  # begins the sentence at the top of a longer module that says why


# ------------------------------------------------------------------------------ the rules

def modules(root: Path) -> dict[str, Path]:
    """Files of all modules of the driver in `root` by their dotted names."""
    named = {}
    for path in sorted((root / "driver").rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


@functools.cache
def parsed(path: Path) -> ast.Module:
    """Of the module at `path`, parsed once for all rules."""
    return ast.parse(path.read_text())


@functools.cache
def imports(name: str, path: Path) -> set[str]:
    """Dotted names that a module imports, wherever it does; what may be an attribute has its dot.
    """
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    asked = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            asked |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[:len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            asked |= {".".join([*base, alias.name]) for alias in node.names}
    return asked


def arrows(root: Path) -> dict[str, set[str]]:
    """Modules of the driver that each of its modules imports."""
    known = modules(root)

    def module(name: str) -> str:
        return name if name in known else name.rpartition(".")[0]

    return {name: {module(asked) for asked in imports(name, path)} & set(known) - {name}
            for name, path in known.items()}


def floor(name: str) -> int:
    """Place of a module in the order: leaves in driver/ first, then the packages, then the top."""
    if name in TOP:
        return len(ORDER)
    return ORDER.index(name.split(".")[1]) if name.count(".") > 1 or name[7:] in ORDER else -1


def upward_imports(root: Path) -> list[str]:
    """Imports against the order, and of the command line."""
    return [f"{name} imports {asked}" for name, found in arrows(root).items() for asked in found
            if floor(asked) > floor(name) or asked in TOP[1:] and name not in TOP]


def circles(root: Path) -> list[str]:
    """Modules that import each other in a circle, if any."""
    try:
        graphlib.TopologicalSorter(arrows(root)).prepare()
    except graphlib.CycleError as problem:
        return problem.args[1]
    return []


def imports_of_figures(root: Path) -> list[str]:
    """What figures import but leaves and each other: they read files."""
    return [f"{name} imports {asked}" for name, found in arrows(root).items() for asked in found
            if name.startswith("driver.figures") and not asked.startswith("driver.figures")
            and floor(asked) >= 0]


def missing_strings(root: Path) -> list[str]:
    """Strings that name a module which does not exist, as stages and programs of ranks are named.
    """
    known = modules(root)
    return [f"{name}: {node.value}" for name, path in known.items()
            for node in ast.walk(parsed(path))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
            and re.fullmatch(r"driver(\.\w+)+", node.value) and node.value not in known]


def long_modules(root: Path) -> list[str]:
    """Files of modules that are too long and give no reason in their docstring."""
    found = []
    for path in modules(root).values():
        text = path.read_text()
        top = " ".join((ast.get_docstring(parsed(path)) or "").split())
        if len(text.splitlines()) > LONGEST and not re.search(rf"(^|[.:] ){REASON} \w", top):
            found.append(str(path.relative_to(root)))
    return found


def wide_lines(root: Path) -> list[str]:
    """Lines of programs and scenes that are too wide, as file:number."""
    paths = [path for folder in ("driver", "edp", "tests") for path in (root / folder).rglob("*")
             if path.suffix in (".py", ".edp", ".idp", ".awk")]
    return [f"{path.relative_to(root)}:{number}" for path in sorted(paths)
            for number, line in enumerate(path.read_text().splitlines(), 1) if len(line) > WIDEST]


def undocumented(root: Path) -> list[str]:
    """Public functions, classes and methods of public classes, and modules, without docstring."""
    found = []

    def visit(name: str, body: ast.AST):
        if not ast.get_docstring(body):
            found.append(name)
        for node in body.body if not isinstance(body, ast.FunctionDef) else ():
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                visit(f"{name}.{node.name}", node)

    for name, path in modules(root).items():
        if path.read_text().strip():
            visit(name, parsed(path))
    return found


def twins(tests: Path) -> list[str]:
    """Names that several files of tests have: pytest imports one of them alone."""
    names = [path.name for path in tests.rglob("*.py")]
    return sorted({name for name in names if names.count(name) > 1})


# ------------------------------------------------------------------- they hold in this tree

def test_packages_are_those_of_the_order():
    driver, tests = ({path.name for path in (environment.ROOT / folder).iterdir()
                      if list(path.glob("*.py"))} for folder in ("driver", "tests"))
    assert driver <= set(ORDER) and tests <= {*ORDER, "scenes", "docs"}


def test_imports_go_from_later_packages_to_earlier_ones():
    assert not upward_imports(environment.ROOT)


def test_modules_do_not_import_each_other_in_circles():
    assert not circles(environment.ROOT)


def test_figures_import_leaves_and_each_other():
    assert not imports_of_figures(environment.ROOT)


def test_names_of_modules_in_strings_are_names_of_modules():
    assert not missing_strings(environment.ROOT)


def test_long_modules_say_why():
    assert not long_modules(environment.ROOT)


def test_files_of_tests_have_names_of_their_own():
    assert not twins(environment.ROOT / "tests")


def test_lines_are_not_too_wide():
    assert not wide_lines(environment.ROOT)


def test_public_names_have_docstrings():
    assert not undocumented(environment.ROOT)


FRONT = """
import importlib, pkgutil, sys
from driver import children, cli, environment
from driver.runs import launch

def freefem(*_, **__):
    print(*sys.modules)
    launch.load(None)

def petsc():
    from driver import figures
    for module in pkgutil.iter_modules(figures.__path__):
        importlib.import_module(f"driver.figures.{module.name}")
    print(*sys.modules)
    sys.exit()

children.run_child, environment.start_petsc = freefem, petsc
sys.argv[0] = "driver"
cli.main()
"""


def test_front_starts_freefem_at_once(tmp_path):
    """What a run imports until it starts FreeFEM, and then until it starts PETSc with all figures.
    """
    done = subprocess.run(
        [sys.executable, "-c", FRONT, "run", "SCENE=model", f"OUT={tmp_path / 'out'}"],
        cwd=environment.ROOT, capture_output=True, text=True, check=True)
    early, late = map(set, map(str.split, done.stdout.splitlines()))
    assert "driver.runs.run" in early and not early & {"numpy", "scipy", "matplotlib", "petsc4py"}
    assert "driver.figures.body" in late and not late & {"petsc4py", "mpi4py"}


# ---------------------------------------------------------------- and are noticed when broken

def tree(folder: Path, **texts: str) -> Path:
    """A driver of few modules; `feti__a="..."` is the text of driver/feti/a.py."""
    for name, text in {"__init__": '"""The driver."""\n', **texts}.items():
        path = folder / "driver" / f"{name.replace('__', '/') if name != '__init__' else name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


@pytest.mark.parametrize("rule, texts", [
    (upward_imports, {"feti__a": "from ..march import b", "march__b": ""}),
    (upward_imports, {"feti__a": "def f():\n    import driver.march.b", "march__b": ""}),
    (upward_imports, {"errors": "from .scene.b import c", "scene__b": ""}),
    (upward_imports, {"hard__a": "from .. import cli", "cli": ""}),
    (circles, {"feti__a": "from . import b", "feti__b": "def f():\n    from .a import g"}),
    (imports_of_figures, {"figures__a": "from ..scene.b import c", "scene__b": ""}),
    (missing_strings, {"runs__a": 'STAGES = {"run": "driver.runs.solve"}'}),
    (long_modules, {"feti__a": '"""A module."""\n' + "a = 1\n" * 400}),
    (wide_lines, {"feti__a": "a = " + 97 * "1"}),
    (undocumented, {"feti__a": '"""A module."""\n\ndef f():\n    pass\n'}),
    (undocumented, {"feti__a": '"""A."""\nclass A:\n    """A."""\n    def f(self):\n        pass'}),
    (undocumented, {"feti__a": "a = 1\n"}),
], ids=lambda value: getattr(value, "__name__", ""))
def test_broken_rules_are_noticed(tmp_path, rule, texts):
    assert rule(tree(tmp_path, **texts))


def test_files_of_one_name_are_noticed(tmp_path):
    for name in ("a/test_one.py", "b/test_one.py", "b/test_two.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert twins(tmp_path) == ["test_one.py"]


@pytest.mark.parametrize("rule, texts", [
    (upward_imports, {"march__a": "from ..feti import b\nfrom .. import errors", "feti__b": "",
                      "errors": "", "cli": "from .march.a import c"}),
    (circles, {"feti__a": "from . import b\nfrom .b import c", "feti__b": ""}),
    (imports_of_figures, {"figures__a": "from ..errors import E\nfrom .b import c",
                          "figures__b": "", "errors": ""}),
    (missing_strings, {"runs__a": 'STAGES = {"run": "driver.runs.a"}'}),
    (long_modules, {"feti__a": '"""A module. One module because it\nis."""\n' + "a = 1\n" * 400}),
    (wide_lines, {"feti__a": "a = " + 96 * "1"}),
    (undocumented, {"feti__a": '"""A."""\ndef _f():\n    pass\n', "feti____init__": ""}),
], ids=lambda value: getattr(value, "__name__", ""))
def test_kept_rules_are_not_complained_of(tmp_path, rule, texts):
    assert not rule(tree(tmp_path, **texts))
