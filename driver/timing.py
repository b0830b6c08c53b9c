"""Seconds of the stages of a run."""

import time
from collections.abc import Callable


class Laps:
    """Wall time by stage: calling it with a stage's name takes the seconds since the stage before ended."""

    def __init__(self, seconds: dict | None = None, barrier: Callable[[], None] = lambda: None):
        """`seconds` of stages that are over; `barrier` is called at the end of a stage, before the clock is read."""
        self.seconds, self.barrier = dict(seconds or {}), barrier
        self.last = time.perf_counter()

    def __call__(self, stage: str) -> None:
        """`stage` ends now."""
        self.barrier()
        now = time.perf_counter()
        self.seconds[stage], self.last = now - self.last, now
