"""FETI-DP / MPRGP driver for 2D quasistatic contact with local Coulomb friction.

    import driver
    result = driver.run("model", loading="nonmonotone", friction=0.3, out="results/mine")
    result = driver.open("results/mine")

What they do stands in driver/python; it is imported when it is first called.
"""

from .errors import DriverError

__all__ = ["DriverError", "open", "run"]


def run(scene, *, progress: bool | None = None, **options):
    """Run a scene, by name or path of an .edp, and return its Result; see python/run.py."""
    try:
        from .python.run import run as run_scene
    except ImportError as problem:
        raise _package_error(problem) from None
    return run_scene(scene, progress=progress, **options)


def open(directory):  # pylint: disable=redefined-builtin
    """The Result of a finished run in `directory`, without solving; see python/result.py."""
    try:
        from .python.result import Result
    except ImportError as problem:
        raise _package_error(problem) from None
    return Result(directory)


def _package_error(problem: ImportError) -> DriverError:
    from .environment import package_error  # here: an interrupt of a command is heeded the earlier

    return package_error(problem)
