"""Stage 1: run a scene through FreeFEM, which meshes, assembles and exports its subdomains."""

import re
import subprocess
from pathlib import Path

from . import environment
from .errors import InputError
from .loader import Manifest, read_manifest

SCENES = environment.ROOT / "edp"


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
        if path.suffix == ".edp" and path.is_file():
            return path.resolve()
    raise InputError(f"no scene '{name}'; a path to an .edp file or one of: {', '.join(scenes())}")


def export(scene: Path, directory: Path, parameters: dict[str, str], ranks: int = 1) -> Manifest:
    """Run `scene` with command-line `parameters`, spread over `ranks`, into `directory`.

    Raises InputError with FreeFEM's own message and script line if the script fails, and if what it
    parsed differs from what was asked.
    """
    directory.mkdir(parents=True, exist_ok=True)
    arguments = [str(scene), "-export", str(directory)]
    for name, value in parameters.items():
        arguments += [f"-{name}", value]
    flags = ["-nw", "-ns", "-v", "0"]
    if ranks > 1:
        command = [*environment.mpirun(ranks), environment.program("FreeFem++-mpi"), *flags, *arguments]
    else:
        command = [environment.program("FreeFem++"), *flags, *arguments]
    done = subprocess.run(command, env=environment.child_environment(ranks > 1), stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                          cwd=scene.parent)
    (directory / "freefem.log").write_text(done.stdout)
    if done.returncode != 0:
        raise InputError(_explain(done.stdout, done.returncode, scene))
    manifest = read_manifest(directory)
    _check_echo(manifest, parameters)
    return manifest


def _explain(output: str, status: int, scene: Path) -> str:
    """One line out of FreeFEM's output: its message and the script line."""
    refused = re.search(r"scene error: (.*)", output)
    if refused:
        return f"{scene.name}: {refused.group(1)}"
    if status < 0:
        return f"FreeFEM was killed by signal {-status} while running {scene.name}"
    message = [line.strip() for line in output.splitlines() if re.search(r"error|assert|impossible|exist|unknown", line, re.I)]
    place = re.search(r"[Ee]rror line number\s*(\d+), in file ([^,\s]+)", output)
    line = re.search(r"current line = (\d+)|line number\s*:?\s*(\d+)", output)
    if place:
        where = f"{Path(place.group(2)).name} line {place.group(1)}"
    else:
        where = f"{scene.name} line {line.group(1) or line.group(2)}" if line else scene.name
    before = output.split("Error line number")[0].strip().splitlines()
    said = before[-1].strip() if place and before else (message[0] if message else "no message")
    return f"FreeFEM failed in {where} (exit {status}): {said}"


def _check_echo(manifest: Manifest, parameters: dict[str, str]) -> None:
    """FreeFEM turns an unread flag into silence: what was asked must come back in the manifest."""
    for name, asked in parameters.items():
        if name not in manifest.parameters:
            raise InputError(f"the scene does not read the parameter '{name}'")
        found = manifest.parameters[name]
        same = str(found) == asked if isinstance(found, str) else float(asked) == float(found)
        if not same:
            raise InputError(f"the scene read {name}={found} where {asked} was asked")
