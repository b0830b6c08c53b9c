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


class Series:
    """one(0), one(1), ... in another process, in turn, while this one goes on, until `close`."""

    def __init__(self, one: Callable[[int], object], count: int):
        self._answers, (self._receiver, sender) = [], FORK.Pipe(duplex=False)
        self._process = FORK.Process(target=_in_turn, args=(one, count, sender, os.getpid()),
                                     daemon=True)
        with contextlib.suppress(OSError):  # no process more
            self._process.start()
        sender.close()

    def wait(self, number: int):
        """What one(number) has returned, once it has; None where there will be no answer, for want
        of memory say: then do it here, where its error is seen.
        """
        while len(self._answers) <= number:
            try:
                self._answers.append(self._receiver.recv())
            except (EOFError, OSError):
                return None
        return self._answers[number]

    def close(self) -> None:
        """End what is still to be done, with the programs that it has started."""
        if self._process.pid is not None:
            self._process.terminate()
            self._process.join()
        self._receiver.close()


def _in_turn(one: Callable[[int], object], count: int, sender, parent: int) -> None:
    """What another process does for a Series; on a signal it stops programs that it waits for."""
    def stop(*_) -> None:
        raise SystemExit(1)

    _on_signals(stop)
    signal.signal(signal.SIGTERM, stop)  # that of `close`, also where others are ignored
    _end_with(parent)
    try:
        for number in range(count):
            sender.send(one(number))
    except BaseException:  # whatever it is, the process that waits meets it as well
        raise SystemExit(1) from None


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
    _on_signals(signal.SIG_DFL)


def _on_signals(handler) -> None:
    """Let a `handler` meet what ends this process; a signal that is ignored stays so."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
