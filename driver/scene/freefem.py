"""Stage 1: run a scene through FreeFEM, which meshes, assembles and exports its subdomains."""

import contextlib
import hashlib
import re
import subprocess
from pathlib import Path

from .. import environment
from ..errors import InputError
from . import declarations, elements, rooms, seal
from .manifest import Manifest, read_manifest

SCENES = environment.ROOT / "edp"
# flags that mean something to FreeFEM itself, or that `export` sets
RESERVED = ("export", "sizes", "f", "v", "nw", "ns", "ne", "cd", "log", "wait", "nowait", "glut", "fglut", "version")


def scenes() -> dict[str, str]:
    """Names of the scenes that ship and the first comment line of each."""
    found = {}
    for path in sorted(SCENES.glob("*.edp")):
        first = path.read_text().splitlines()[0]
        found[path.stem] = first.lstrip("/ ").removeprefix(f"{path.stem}.edp - ")
    return found


def find_scene(name: str) -> Path:
    """Script of a scene given by name or path. Raises InputError if there is none."""
    for path in (Path(name), SCENES / f"{name}.edp"):
        with contextlib.suppress(OSError, ValueError):  # names that are no names
            if path.suffix == ".edp" and path.is_file():
                return path.resolve()
    raise InputError(f"no scene '{name}'; a path to an .edp file or one of: {', '.join(scenes())}")


def export(scene: Path, directory: Path, parameters: dict[str, str], ranks: int = 1, sizes: Path | None = None,
           meanwhile=lambda: None, without: tuple[str, ...] = ()) -> Manifest:
    """Run `scene` with command-line `parameters`, spread over `ranks`, into `directory`.

    `sizes` is the stem of a field of element sizes (see adaptivity.write_sizes) that the body is meshed with;
    `meanwhile` is called while FreeFEM works. Effects named in `without` are treated as undeclared, with all that needs
    them: rooms ("friction"), one of several loads ("load2"), "quasistatic" (one static step at the end time) and
    "amplitude2" (its factor at the end time in all steps).

    Raises InputError for macros that nothing reads, for effects to leave out that the scene does not declare, with FreeFEM's own message and script line if the script fails, if
    what it parsed differs from what was asked, and if the scene was edited meanwhile; OSError if the disk is full.
    """
    _check_macros(scene)
    text = text_digest(scene)
    directory.mkdir(parents=True, exist_ok=True)
    declarations.write(directory, without)
    _run(scene, scene, directory, {**parameters, **({"sizes": str(sizes)} if sizes else {})}, ranks, meanwhile)
    seal.write(directory, text, [f"block-{k}.bin" for k in range(ranks)])
    manifest = read_manifest(directory, text_digest(scene))
    _check_echo(manifest, parameters)
    _check_fixed_labels(scene, manifest)
    return manifest


def _run(script: Path, scene: Path, directory: Path, parameters: dict[str, str], ranks: int,
         meanwhile=lambda: None) -> None:
    """Run `script` in the scene's folder; raises InputError with what FreeFEM said if it fails, and for unknown elements."""
    arguments = [str(script), "-export", str(directory)]
    for name, value in parameters.items():
        arguments += [f"-{name}", value]
    flags = ["-nw", "-ns", "-v", "0"]
    if ranks > 1:
        command = [*environment.mpirun(ranks), environment.program("FreeFem++-mpi"), *flags, *arguments]
    else:
        command = [environment.program("FreeFem++"), *flags, *arguments]
    element = parameters.get("element", "P1")
    if element not in elements.NODES:
        raise InputError(f"ELEMENT must be one of {', '.join(elements.NODES)}, not '{element}'")
    env = environment.child_environment(ranks > 1, element)
    if ";" in str(directory):
        raise InputError(f"FreeFEM takes no folder with a semicolon in its name: {directory}")
    env["FF_INCLUDEPATH"] = f"{directory.absolute()};{env['FF_INCLUDEPATH']}"
    done = environment.run_child(command, meanwhile, env=env, stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT, text=True, errors="replace", cwd=scene.parent)
    (directory / "freefem.log").write_text(done.stdout)
    if done.returncode != 0:
        raise InputError(_explain(done.stdout, done.returncode, scene))


def export_study(scene: Path, directory: Path, parameters: dict[str, str], name: str, values: list[str],
                 meanwhile=lambda: None, without: tuple[str, ...] = ()) -> list[Manifest]:
    """Contact data and manifest of `scene` for every value of parameter `name`, in directory/0, 1, ...

    One FreeFEM process goes through the script once a value and assembles nothing. `meanwhile` and `without` as in `export`;
    errors of an export meanwhile come first. Raises InputError if the parameter changes more than friction, gap,
    initial state and load histories, and as `export`.
    """
    more = changed_by(scene, name) - rooms.studied()
    if more:
        raise InputError(f"a study can vary what changes friction, gap, load histories or steps; {name.upper()} also "
                         f"changes {', '.join(sorted(more))}")
    lines = ["// every value of a parameter study in turn", f'macro studied() "{name}" //',
             'include "studied.idp"', f"string[int] studiedValues({len(values)});"]
    lines += [f'studiedValues[{k}] = "{value}";' for k, value in enumerate(values)]
    lines += [f"for (int study = 0; study < {len(values)}; ++study) {{", f'include "{scene}"', "}"]
    for k in range(len(values)):
        (directory / str(k)).mkdir(parents=True)
    text, script = text_digest(scene), directory / "study.edp"
    script.write_text("\n".join(lines) + "\n")
    declarations.write(directory, without)
    _run(script, scene, directory, {**parameters, name: values[0]}, 1, meanwhile)
    for k in range(len(values)):
        seal.write(directory / str(k), text, ["contact.bin"])
    manifests = [read_manifest(directory / str(k)) for k in range(len(values))]
    for manifest, value in zip(manifests, values):
        _check_echo(manifest, {**parameters, name: value})
    return manifests


def changed_by(scene: Path, name: str) -> set[str]:
    """Declarations of a scene that its parameter `name` reaches, followed through variables and macros of the text.

    Statements that do more than give a variable its value count as changed themselves (by their text).
    """
    if name == "steps":
        return set()
    text = "\n".join(_code(scene))
    macro = re.compile(r"\bmacro\s+(\w+)(.*?)//[^\n]*", re.DOTALL)
    macros = [(found.group(1), found.group(2)) for found in macro.finditer(text)]
    rest = re.sub(r"//[^\n]*", "", macro.sub("", text))
    statements = [" ".join(part.split()) for text in re.split(r"[;{}]", rest) for part in _declarations(text)
                  if part.strip()]
    read = re.compile(rf'\b(?:physical|whole|choice)\(\s*"{re.escape(name)}"')
    reached, changed, size = set(), set(), -1
    while size < len(reached) + len(changed):
        size = len(reached) + len(changed)
        touched = lambda words: read.search(words) or reached & set(re.findall(r"\w+", words))
        for statement in filter(touched, statements):
            if re.match(r"(?:(?:real|int|bool|string) )?\w+ ?=[^=]", statement):
                reached |= set(re.findall(r"(\w+) ?=(?!=)", statement))
            else:
                changed.add(f"'{statement}'")
        reached |= {word for word, body in macros if touched(body)}
    if not reached | changed:
        raise InputError(f"{scene.name} reads no parameter {name.upper()} that a study could vary")
    return changed | (reached & rooms.vocabulary())


def _declarations(statement: str) -> list[str]:
    """A statement, but one that declares several variables, `real a = ..., b = ...`, as one for each."""
    kind = re.match(r"\s*(real|int|bool|string)\s+(?=\w+\s*=)", statement)
    if not kind:
        return [statement]
    parts, depth = [""], 0
    for letter in statement[kind.end():]:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [f"{kind[1]} {part}" for part in parts]


def _code(script: Path) -> list[str]:
    """Lines of a script and of what it includes, but for the library's own files."""
    lines = []
    for line in script.read_text(errors="replace").splitlines():
        found = re.match(r'\s*include\s+"([^"]+)"', line)
        if not found:
            lines.append(line)
        elif found.group(1) not in ("scene.idp", "export.idp", "gmsh.idp"):
            places = [folder / found.group(1) for folder in (script.parent, environment.LIBRARY)]
            lines += [more for place in places if place.is_file() for more in _code(place)]
    return lines


def text_digest(scene: Path) -> str:
    """Digest of the scene's script, of the library and of every file that either names in quotes."""
    digest, known, left = hashlib.sha256(), set(), [scene, *sorted(environment.LIBRARY.rglob("*.idp"))]
    while left:
        path = left.pop().resolve()
        if path in known:
            continue
        known.add(path)
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)} ".encode("utf-8", "surrogateescape") + content)
        if path.suffix in (".edp", ".idp"):
            named = [scene.parent / name for name in re.findall(r'"([\w./+-]+)"', content.decode("utf-8", "replace"))]
            left += [file for file in named if len(file.name) < 256 and file.is_file()]
    return digest.hexdigest()


def _explain(output: str, status: int, scene: Path) -> str:
    """One line out of FreeFEM's output: its message and the script line."""
    refused = re.search(r"scene error: (.*)", output)
    if refused:
        return f"{scene.name}: {refused.group(1)}"
    if status < 0 or status > 128:  # by itself or, as mpirun tells it, one of its ranks
        return f"FreeFEM was killed by signal {-status if status < 0 else status - 128} while running {scene.name}"
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    compile_error = re.search(r"Error line number\s*(\d+), in file (\S+?), before\s+token\s*(.*)", output)
    if compile_error:
        number, file, token = compile_error.groups()
        at = next(i for i, line in enumerate(lines) if "Error line number" in line)
        around = [line for line in lines[max(0, at - 3):at] + lines[at + 1:at + 2] if "current line" not in line]
        name = Path(file).name if file.endswith((".edp", ".idp")) else scene.name
        return f"FreeFEM failed in {name} line {number} before token {token.strip()}: {'; '.join(around) or 'syntax error'}"
    at = next((i for i, line in enumerate(lines) if "current line" in line), len(lines))
    number = re.search(r"current line = (\d+)", output)
    where = f"{scene.name} line {number.group(1)}" if number else scene.name
    said = [line for line in lines[max(0, at - 2):at] if not line.startswith("-")]
    said += [line for line in lines if line.startswith("Exec error")][:1]
    return f"FreeFEM failed in {where} (exit {status}): {'; '.join(dict.fromkeys(said)) or 'no message'}"


def _check_echo(manifest: Manifest, parameters: dict[str, str]) -> None:
    """FreeFEM turns an unread flag into silence: what was asked must come back in the manifest."""
    for name, asked in parameters.items():
        if name not in manifest.parameters:
            raise InputError(f"the scene does not read the parameter '{name}'")
        found = manifest.parameters[name]
        try:
            same = found == asked if isinstance(found, str) else float(asked) == float(found)
        except ValueError:
            raise InputError(f"{name.upper()} expects a number, not '{asked}'") from None
        if not same:
            raise InputError(f"the scene read {name}={found} where {asked} was asked")


def _check_macros(scene: Path) -> None:
    """A macro that is neither of the library's vocabulary nor used in the script is a misspelt declaration."""
    text = scene.read_text(errors="replace")
    code = "\n".join(line.split("//")[0] for line in text.splitlines())
    if 'include "export.idp"' not in code:
        return
    library = "\n".join(path.read_text() for path in environment.LIBRARY.rglob("*.idp"))
    for number, line in enumerate(text.splitlines(), 1):
        found = re.match(r"\s*macro\s+(\w+)", line)
        word = found and re.compile(rf"\b{found.group(1)}\b")
        known = found and (found.group(1) in rooms.vocabulary() or word.search(library))
        if found and not known and len(word.findall(code)) == 1:
            import difflib

            near = difflib.get_close_matches(found.group(1), sorted(rooms.vocabulary()), 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise InputError(f"{scene.name} line {number}: nothing reads the macro {found.group(1)}{hint}")


def _check_fixed_labels(scene: Path, manifest: Manifest) -> None:
    """FreeFEM ignores on(label, ...) for a label that the mesh lacks: refuse it where it stands as a number."""
    for number, line in enumerate(scene.read_text().splitlines(), 1):
        code = line.split("//")[0]
        for label in re.findall(r"\bon\(\s*(\d+)\s*,", code):
            if int(label) not in manifest.labels:
                raise InputError(f"{scene.name} line {number}: on({label}, ...) names a label that the mesh lacks; it "
                                 f"has {', '.join(map(str, manifest.labels))}")
