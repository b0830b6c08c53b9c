"""driver.run: a run as `make run` does it, in a process of its own, from Python.

The calling process starts neither MPI nor PETSc. What the run prints is kept in Result.text;
meanwhile a bar shows the steps, in a notebook and on a terminal.
"""

import os
import sys
import tempfile
import threading
from pathlib import Path

from .. import children, environment
from ..environment import EVERY_STEP
from ..errors import InputError, error_of
from ..options import RESULTS
from ..runs.watch import STEP
from ..scene import freefem
from .result import Result


def run(scene, *, progress: bool | None = None, **options) -> Result:
    """Run `scene`, a name or the path of an .edp; returns the Result.

    `options` are those of `make run` and parameters of the scene, by name in either case: numbers,
    words, True and False for yes and no, sequences for lists; None leaves one out. `progress` shows
    the steps; by default in a notebook or on a terminal, and not with quiet=True. Raises
    DriverError with `exit_status`, in the words of the command line.
    """
    given = {name.lower(): _text(value) for name, value in options.items() if value is not None}
    if len(given) < sum(value is not None for value in options.values()):
        raise InputError("an option is given twice, in capital and in small letters")
    path = freefem.find_scene(str(scene))
    out = Path(given.get("out", RESULTS / path.stem)).absolute()
    given |= {"scene": str(path), "out": str(out)}
    if progress is None:
        progress = given.get("quiet") != "yes" and (_in_notebook() or sys.stderr.isatty())
    status, text, errors = _execute([f"{name.upper()}={value}" for name, value in given.items()],
                                    path.stem, progress)
    if status:
        raise _error(status, errors)
    return Result(out, text)


def _text(value) -> str:
    """An option as the command line takes it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return ",".join(map(_text, value))
    return str(value.item() if hasattr(value, "item") else value)  # numbers of numpy are plain ones


def _execute(words: list[str], name: str, progress: bool) -> tuple[int, str, str]:
    """Exit status, output and errors of `python3 -m driver run` with these words."""
    command = [environment.interpreter(), "-m", "driver", "run", *words]
    env = {**os.environ, "PYTHONPATH": children.python_path(), EVERY_STEP: "yes"}
    lines, (reading, writing) = [], os.pipe()
    with tempfile.TemporaryFile("w+", errors="replace") as errors:
        reader = threading.Thread(target=_follow, args=(reading, lines, name, progress))

        def started():
            os.close(writing)  # the child has its own; the reader ends with it
            reader.start()

        done = children.run_child(command, started, env=env, stdout=writing, stderr=errors)
        reader.join()
        errors.seek(0)
        return done.returncode, "".join(lines), errors.read()


def _follow(reading: int, lines: list[str], name: str, progress: bool) -> None:
    """Read what the child prints into `lines`, but for its steps, which move the bar."""
    bar = None
    with open(reading, errors="replace") as output:
        for line in output:
            step = STEP.search(line)
            if not step:
                lines.append(line)
                continue
            if progress:
                bar = bar or _bar(int(step[2]), name)
                bar.n = int(step[1])
                if bar.n == bar.total:  # what is left may take longer than the steps
                    bar.set_description_str(f"{name}, estimates and figures", refresh=False)
                bar.refresh()
    if bar:
        bar.set_description_str(name, refresh=False)
        bar.close()


def _bar(total: int, name: str):
    """A bar of tqdm: a widget in a notebook that has them, else text."""
    from tqdm.auto import tqdm

    return tqdm(total=total, desc=name, unit="step")


def _in_notebook() -> bool:
    """Whether IPython's kernel runs this process."""
    return "ipykernel" in sys.modules


def _error(status: int, errors: str) -> Exception:
    """What the child has ended with."""
    if status in (130, -2):
        return KeyboardInterrupt()
    lines = [line.removeprefix("error: ") for line in errors.splitlines()
             if line.startswith("error: ")]
    if status in (1, 2, 3, 4) and lines:
        return error_of(status, lines[-1])
    return InputError(f"the driver ended with status {status}: {errors.strip() or 'no message'}")
