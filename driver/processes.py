"""Processes that share the work of this one, and how signals end them."""

import contextlib
import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable

from .options import CORES

FORK = multiprocessing.get_context("fork")  # what has been read and imported is there already
PR_SET_PDEATHSIG = 1  # linux/prctl.h


def share(one: Callable[[str], None], names: list[str], cores: int = CORES) -> None:
    """one(name) for all `names`, on so many `cores` at once, each of which takes a share of them.

    What another process has not done, for want of memory say, is done here, where its error is
    seen. Raises what `one` raises.
    """
    count = max(1, min(cores, len(names)))
    shares = [names[k::count] for k in range(count)]
    others = [FORK.Process(target=_quietly, args=(one, part, os.getpid()), daemon=True)
              for part in shares[1:]]
    try:
        for process in others:
            with contextlib.suppress(OSError):  # no process more
                process.start()
        for name in shares[0]:
            one(name)
        for process, part in zip(others, shares[1:]):
            if process.pid is not None:
                process.join()
            if process.exitcode != 0:
                for name in part:
                    one(name)
    finally:
        for process in others:
            if process.pid is not None:
                process.kill()
                process.join()


@contextlib.contextmanager
def aside(one: Callable[[], None]):
    """one() in another process while a block runs; gives what waits for it and says whether it is
    done. It may not be, for want of memory say: then do it here, where its error is seen.
    """
    process = FORK.Process(target=_quietly, args=(lambda _: one(), [""], os.getpid()), daemon=True)

    def done() -> bool:
        if process.pid is not None:
            process.join()
        return process.exitcode == 0

    try:
        with contextlib.suppress(OSError):  # no process more
            process.start()
        yield done
    finally:
        if process.pid is not None:
            process.kill()
            process.join()


def _quietly(one: Callable[[str], None], names: list[str], parent: int) -> None:
    """What another process does; it says nothing and ends at once where it cannot."""
    die_of_signals()
    _end_with(parent)
    try:
        for name in names:
            one(name)
    except BaseException:  # whatever it is, the process that waits meets it as well
        raise SystemExit(1) from None


def _end_with(parent: int) -> None:
    """End this process when its parent does, however that is killed."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # which has ended before
        raise SystemExit(1)


def die_of_signals() -> None:
    """A signal ends this process without a word from now on; one that is ignored stays so."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
