"""Figures drawn on all cores at once: each process draws a share, and no two the same file."""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable

FORK = multiprocessing.get_context("fork")  # what has been read and imported is there already


def draw(one: Callable[[str], None], names: list[str], cores: int = 0) -> None:
    """one(name) for all `names`, on so many `cores`, by default all that this process may use.

    What another process could not draw, for want of memory say, is drawn here, where its error is
    seen. Raises what `one` raises.
    """
    count = max(1, min(cores or len(os.sched_getaffinity(0)), len(names)))
    shares = [names[k::count] for k in range(count)]
    others = [FORK.Process(target=_share, args=(one, share), daemon=True) for share in shares[1:]]
    try:
        for process in others:
            with contextlib.suppress(OSError):  # no process more
                process.start()
        for name in shares[0]:
            one(name)
        for process, share in zip(others, shares[1:]):
            if process.pid is not None:
                process.join()
            if process.exitcode != 0:
                for name in share:
                    one(name)
    finally:
        for process in others:
            if process.pid is not None:
                process.kill()
                process.join()


def _share(one: Callable[[str], None], names: list[str]) -> None:
    """What another process draws; it says nothing and ends at once where it cannot."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    try:
        for name in names:
            one(name)
    except BaseException:  # whatever it is, the process that waits meets it as well
        raise SystemExit(1) from None
