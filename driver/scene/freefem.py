"""Run a scene through FreeFEM, which meshes, assembles and exports its subdomains."""

import contextlib
import subprocess
from pathlib import Path

from .. import children, environment
from ..errors import InputError
from ..text import near
from . import (compared, declarations, element_kinds, explain, grammar, label_names, pitfalls,
               rooms, script, seal, size)
from .manifest import Manifest, read_manifest
from .script import text_digest

SCENES = environment.ROOT / "edp"


def scenes() -> dict[str, str]:
    """Names of the scenes that ship and the title of each, the first sentence of its script."""
    titles = {}
    for path in sorted(SCENES.glob("*.edp")):
        head = rooms.head(path)
        titles[path.stem] = rooms.take_title(head, path.name)
    return titles


def find_scene(name: str) -> Path:
    """Script of a scene given by name or path. Raises InputError if there is none."""
    for path in (Path(name), SCENES / f"{name}.edp"):
        with contextlib.suppress(OSError, ValueError):  # names that are no names
            if path.suffix == ".edp" and path.is_file():
                return path.resolve()
    known, given = list(scenes()), Path(name)
    with contextlib.suppress(OSError, ValueError):
        if given.exists():
            kind = "a directory" if given.is_dir() else "no .edp file"
            raise InputError(f"no scene '{name}': it is {kind}; SCENE takes a name, which 'make "
                             "run' lists, or the path of an .edp file")
    if "/" not in name and (hint := near(given.stem, known)):
        raise InputError(f"no scene '{name}' here, nor one of that name{hint}")
    raise InputError(f"no scene '{name}'; a path to an .edp file or one of: {', '.join(known)}")


def nothing() -> None:
    """What is done while FreeFEM works, unless there is something to do."""


def export(scene: Path, directory: Path, parameters: dict[str, str], ranks: int = 1,
           sizes: Path | None = None, meanwhile=nothing, without: tuple[str, ...] = ()) -> Manifest:
    """Run `scene` with command-line `parameters`, spread over `ranks`, into `directory`.

    `sizes` is the stem of a field of element sizes (see adaptivity.write_sizes) that the body is
    meshed with; `meanwhile` is called while FreeFEM works, again as long as it returns True.
    Effects named in `without` are treated as undeclared, with all that needs them: rooms
    ("friction"), one of several loads ("load2"), "quasistatic" (one static step at the end time)
    and "amplitude2" (its factor at the end time in all steps).

    Raises InputError for macros that nothing reads, for names of the library's own, for effects to
    leave out that the scene does not declare, with FreeFEM's own message and script line if the
    script fails, if what it parsed differs from what was asked, and if the scene was edited
    meanwhile; OSError if the disk is full.
    """
    grammar.check(scene)
    script.check_names(scene)
    script.check_statements(scene)
    pitfalls.check(scene, parameters)
    label_names.check_borders(scene)
    script.check_gmsh_numbers(scene)
    script.check_sizes(scene)
    script.check_parameters(scene, parameters)
    text = text_digest(scene)
    directory.mkdir(parents=True, exist_ok=True)
    given = {**parameters, "sizes": str(sizes)} if sizes else parameters
    _run(scene, scene, directory, given, ranks, meanwhile, without)
    if not (directory / "manifest.json").exists():
        raise InputError(f'{scene.name} does not come to its last line, include "export.idp": '
                         "FreeFEM ended without an error and left no manifest.json")
    seal.write(directory, text, [f"block-{k}.bin" for k in range(ranks)])
    manifest = read_manifest(directory, text_digest(scene))
    _check_echo(manifest, parameters)
    label_names.check_fixed(scene, manifest)
    script.check_regions(scene, manifest)
    compared.check(scene, manifest)
    script.check_units(scene, manifest)
    return manifest


def export_study(scene: Path, directory: Path, parameters: dict[str, str], name: str,
                 values: list[str], meanwhile=nothing,
                 without: tuple[str, ...] = ()) -> list[Manifest]:
    """Contact data, loads and manifest of `scene` for every value of `name`: directory/0, 1, ...

    One FreeFEM process goes through the script once a value and assembles no stiffness, and loads
    only where the parameter `name` reaches one. `meanwhile` and `without` as in `export`; errors of
    an export meanwhile come first. Raises InputError if the parameter changes more than friction,
    gap, initial state, loads, prescribed displacements and their histories, and as `export`.
    """
    changed = script.changed_by(scene, name)
    if more := changed - rooms.studied():
        raise InputError("a study can vary what changes friction, gap, loads, prescribed "
                         "displacements, their histories or steps; "
                         f"{name.upper()} also changes {', '.join(sorted(more))}: sweep it by "
                         "driver.run, as driver/README.md shows under From Python")
    places = [directory / str(k) for k in range(len(values))]
    for place in places:
        place.mkdir(parents=True)
    text, loop, varied = text_digest(scene), directory / "study.edp", str(scene)
    if not varied.isascii():  # FreeFEM includes no other paths
        varied = "varied.edp"
        (directory / varied).symlink_to(scene)
    loop.write_text(_loop(varied, name, values, bool(changed & rooms.of_loads())))
    _run(loop, scene, directory, {**parameters, name: values[0]}, 1, meanwhile, without)
    for place in places:
        seal.write(place, text, [seal.VALUE])
    manifests = [read_manifest(place) for place in places]
    for manifest, value in zip(manifests, values):
        _check_echo(manifest, {**parameters, name: value})
    return manifests


def _loop(scene: str, name: str, values: list[str], loaded: bool) -> str:
    """Script that includes a scene once for every value of its parameter `name`.

    `loaded`: the loads of every value are written too.
    """
    lines = ["// every value of a parameter study in turn", f'macro libStudied() "{name}" //',
             *(["macro libLoads() 1 //"] if loaded else []), 'include "studied.idp"',
             f"string[int] libValues({len(values)});"]
    lines += [f'libValues[{k}] = "{value}";' for k, value in enumerate(values)]
    lines += [f"for (int libStudy = 0; libStudy < {len(values)}; ++libStudy) {{",
              f'include "{scene}"', "}"]
    return "\n".join(lines) + "\n"


def _run(program: Path, scene: Path, directory: Path, parameters: dict[str, str], ranks: int,
         meanwhile=nothing, without: tuple[str, ...] = ()) -> None:
    """Run the script `program` in the scene's folder, after writing what it is to include.

    Raises InputError with what FreeFEM said if it fails, and for unknown elements.
    """
    element = parameters.get("element", "P1")
    if element not in element_kinds.NODES:
        kinds = ", ".join(element_kinds.NODES)
        raise InputError(f"ELEMENT must be one of {kinds}, not '{element}'")
    if ";" in str(directory):
        raise InputError(f"FreeFEM takes no folder with a semicolon in its name: {directory}")
    spelled = grammar.parameters(scene)

    def start(ranks: int, meanwhile=nothing, traced: bool = False,
              given=parameters) -> subprocess.CompletedProcess:
        declarations.write(directory, without, traced)
        env = children.child_environment(ranks > 1, element)
        # for shells that FreeFEM starts (gmsh.idp)
        env |= {"EXPORT_DIRECTORY": str(directory), "SIZE_FIELD": parameters.get("sizes", "")}
        env["FF_INCLUDEPATH"] = f"{directory.absolute()};{env['FF_INCLUDEPATH']}"
        command = [children.program("FreeFem++")]
        if ranks > 1:
            command = [*children.mpirun(ranks, env), children.program("FreeFem++-mpi")]
        command += ["-nw", "-ns", "-v", "0", str(program), "-export", str(directory)]
        command += [word for name, value in given.items()
                    for word in (f"-{spelled.get(name, name)}", value)]
        return children.run_child(command, meanwhile, env=env, stdout=subprocess.PIPE,
                                  stderr=subprocess.STDOUT, text=True, errors="replace",
                                  cwd=scene.parent)

    done = start(ranks, meanwhile)
    if done.returncode != 0 and size.check(done.stdout, parameters,
                                           lambda trial: start(1, given=trial).stdout):
        parameters = {**parameters, "counted": "1"}
        done = start(ranks, meanwhile, given=parameters)
    if done.returncode != 0 and ranks > 1 and explain.REFUSED not in done.stdout:
        done = start(1, given=parameters)  # rank 0 alone speaks, and another one may have refused
    (directory / "freefem.log").write_text(done.stdout)
    if done.returncode != 0:
        from . import mesh_file  # with numpy, which runs that succeed load later

        if fault := mesh_file.fault(done.stdout, done.returncode, scene, directory):
            raise InputError(fault)
        raise InputError(explain.failure(done.stdout, done.returncode, scene, directory.absolute(),
                                         lambda: start(1, traced=True,
                                                       given=parameters).stdout))


def _check_echo(manifest: Manifest, parameters: dict[str, str]) -> None:
    """Refuse what the scene read otherwise than asked: FreeFEM ignores a flag that nothing reads.
    """
    read = {name.lower(): value for name, value in manifest.parameters.items()}
    for name, asked in parameters.items():
        if name not in read:
            raise InputError(f"the scene does not read the parameter '{name}'; it reads "
                             f"{', '.join(sorted(read))}")
        echo = read[name]
        try:
            same = echo == asked if isinstance(echo, str) else float(asked) == float(echo)
        except ValueError:
            raise InputError(f"{name.upper()} expects a number, not '{asked}'") from None
        if not same:
            raise InputError(f"the scene read {name}={echo} where {asked} was asked")
