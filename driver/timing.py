"""Seconds of the stages of a run."""

import resource
import time
from collections.abc import Callable

STARTED = time.perf_counter()  # when this process had just begun to import the driver


def memory_used() -> float:
    """MiB that this process has used at most, so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class Laps:
    """Wall time by stage: a call with a stage's name takes the seconds since the last call."""

    def __init__(self, seconds: dict | None = None, barrier: Callable[[], None] = lambda: None):
        """`seconds`: of finished stages; `barrier` is called before the clock is read."""
        self.seconds, self.barrier = dict(seconds or {}), barrier
        self.last = time.perf_counter()

    def __call__(self, stage: str) -> None:
        """`stage` ends now."""
        self.barrier()
        now = time.perf_counter()
        self.seconds[stage], self.last = now - self.last, now
