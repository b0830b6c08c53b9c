"""Random scenes: each solved at several cuts and on two ranks, checked by the laws of contact.

A scene is solved where all its runs agree, obey the laws of contact on the assembled body and give
the same bits on one rank and on two; a refusal counts where an independent argument confirms it.
"""

import contextlib
import os
import shutil
import signal
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import environment
from ..errors import DriverError
from ..text import assignments
from . import inverted
from .case import KKT, TIGHT, Outcome, read_results
from .generator import RandomScene, draw
from .report import Row

CASES = ()  # of this family a seed makes any number
FAMILY, KEPT = "random", "failed"  # name of the family, directory of the scenes that failed
FAST = 8  # scenes of the default tests
QUIET = {"fields": "no", "figures": "no", "quiet": "yes", "resume": "no", "errors": "no"}
LIMIT = 300  # seconds of one run, on a machine that others may use: beyond them it hangs
AGREEMENT = 1e-4  # of contact forces between cuts: a node is stiffer than its body, KKT times 100


class TooLong(Exception):
    """A run took longer than LIMIT."""


@dataclass
class Verdict:
    """What the runs of a scene came to."""

    status: str = "FAILED"
    why: str = ""
    worst: float = np.nan  # violation of a law over what is allowed
    disagreement: float = np.nan
    outcomes: list[Outcome] = field(default_factory=list)


def name(seed: int) -> str:
    """Name of a scene in the report."""
    return f"seed {seed}"


def judge(seed: int, results: Path) -> Row:
    """Make, run and judge the scene of a seed; never raises for what a scene does.

    A scene that fails is left in the directory KEPT of `results`.
    """
    clock, scene = time.perf_counter(), draw(seed)
    folder = results / "runs" / f"random-{seed}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path = folder / f"random-{seed}.edp"
    path.write_text(scene.text)
    try:
        verdict = _verdict(scene, path, folder)
    except Exception:  # pylint: disable=broad-exception-caught  # whatever happened, it is a row
        verdict = Verdict(why=f"the check failed: {_last_line(traceback.format_exc())}")
    shutil.rmtree(folder)
    return _row(scene, verdict, results, time.perf_counter() - clock)


def died(seed: int, results: Path) -> Row:
    """The row of a scene of which its process died."""
    return _row(draw(seed), Verdict(why="the process died"), results, np.nan)


def _row(scene: RandomScene, verdict: Verdict, results: Path, seconds: float) -> Row:
    """The line of the report; a scene that failed is kept with the commands that repeat it."""
    cuts = " ".join(cut["subdomains"] for cut in scene.cuts)
    row = Row(FAMILY, name(scene.seed), f"SUBDOMAINS={cuts}", "solved or refused",
              verdict.status, _exit(verdict), verdict.why,
              seconds=round(seconds, 2))
    row.seed, row.disagreement = scene.seed, verdict.disagreement
    row.declared = "; ".join(f"{key}: {value}" for key, value in scene.declared.items())
    if scene.refusal:
        row.expected = "refused (exit 2)"
    if verdict.status == "FAILED":
        row.repeat = _keep(scene, results / KEPT)
    if verdict.status == "solved":
        _fill_solved(row, verdict)
    return row


def _exit(verdict: Verdict) -> int:
    """Exit status of the first run that did not converge, 0 if all did, -1 if there is none."""
    statuses = [outcome.status for outcome in verdict.outcomes]
    return next(filter(None, statuses), 0 if statuses else -1)


def _fill_solved(row: Row, verdict: Verdict) -> None:
    """Largest residuals over the cuts, violation of the laws, counts of the first cut."""
    residuals = [outcome.summary["residuals"] for outcome in verdict.outcomes]
    for residual in residuals[0]:
        setattr(row, residual, max(each[residual] for each in residuals))
    counts = verdict.outcomes[0].summary["counts"]
    row.kkt_tolerance, row.oracle, row.error = KKT, "the laws", verdict.worst
    row.products = counts["dual_multiplications"]
    row.fixed_point = counts["fixed_point_iterations"]


def _keep(scene: RandomScene, place: Path) -> str:
    """Leave the scene in `place`; the commands that repeat its judgement and its runs."""
    place.mkdir(parents=True, exist_ok=True)
    path = place / f"random-{scene.seed}.edp"
    path.write_text(scene.text)
    tight = {key.lower(): value for key, value in TIGHT.items()}
    cuts = " or ".join(_named(cut) for cut in scene.cuts)
    return (f"make hard FAMILY=random SEED={scene.seed} COUNT=1; its runs: make run "
            f"SCENE={os.path.relpath(path)} {_named({**scene.options, **tight})} {cuts}")


# ---- runs ----------------------------------------------------------------------------------------

def run(scene: RandomScene, path: Path, folder: Path, cut: dict[str, str],
        ranks: int = 1) -> Outcome:
    """One run in this process, with the tolerances TIGHT."""
    from ..runs.run import Run, execute

    out = folder / ("x".join(cut.values()) + f"-{ranks}")
    pairs = {"scene": str(path), "out": str(out), "np": str(ranks), **QUIET, **scene.options,
             **cut, **{name.lower(): value for name, value in TIGHT.items()}}
    outcome = Outcome(0, "", 0.0, out)
    clock = time.perf_counter()
    try:
        with _limited(LIMIT):
            execute(Run.from_pairs(pairs))
    except DriverError as problem:
        outcome.status, outcome.message = problem.exit_status, str(problem)
        outcome.crashed = outcome.status == 1
    except TooLong:
        outcome.status, outcome.message = -1, f"not finished after {LIMIT} s"
    except Exception:  # pylint: disable=broad-exception-caught  # what a user would see as a crash
        outcome.status, outcome.crashed = 1, True
        outcome.message = traceback.format_exc()
    outcome.seconds = time.perf_counter() - clock
    return read_results(outcome)


@contextlib.contextmanager
def _limited(seconds: float):
    """Raise TooLong in the block after so many seconds."""
    def stop(number, frame):
        raise TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _last_line(text: str) -> str:
    return text.strip().splitlines()[-1]


# ---- judging -------------------------------------------------------------------------------------

def _verdict(scene: RandomScene, path: Path, folder: Path) -> Verdict:
    """Run a scene at all its cuts and judge what came out."""
    environment.prepare_libraries()
    environment.start_petsc()
    outcomes = [run(scene, path, folder, cut) for cut in scene.cuts]
    verdict = Verdict(outcomes=outcomes)
    for cut, outcome in zip(scene.cuts, outcomes):
        if outcome.crashed or outcome.status not in (0, 2, 3, 4):
            verdict.why = f"{_named(cut)}: {_last_line(outcome.message)}"
            return verdict
    statuses = {outcome.status for outcome in outcomes}
    if scene.refusal or 2 in statuses:
        return _refused_by_intent(scene, verdict)
    from . import judgement

    problem = judgement.Problem.of(path, {**scene.options, **scene.cuts[0]})
    if statuses != {0}:
        verdict.status, verdict.why = problem.refusal(outcomes)
        return verdict
    _judge_solved(scene, path, folder, verdict, problem)
    return verdict


def _named(cut: dict[str, str]) -> str:
    return assignments(cut)


def _refused_by_intent(scene: RandomScene, verdict: Verdict) -> Verdict:
    """Bad scenes are refused with exit 2 and the right words, others are not.

    But for arcs on a mesh that is too coarse for them, which the generator does not know.
    """
    first = verdict.outcomes[0]

    def all_say(words: str) -> bool:
        return bool(words) and all(outcome.status == 2 and words in outcome.message
                                   for outcome in verdict.outcomes)

    said = f"exit {first.status}: {first.message}"
    argument = inverted.confirmed(scene.text, {**scene.options, **scene.cuts[0]}) if (
        all_say(inverted.SAID)) else ""
    verdict.status = "refused" if argument or all_say(scene.refusal) else "FAILED"
    verdict.why = f"{said}; {argument}" if argument else said
    if verdict.status == "FAILED":
        verdict.why = f"{scene.declared.get('spoilt', 'a sound scene')}: {said}"
    return verdict


def _judge_solved(scene: RandomScene, path: Path, folder: Path, verdict: Verdict, problem) -> None:
    """Laws at every cut, agreement of the cuts, bits of two ranks, residuals."""
    wrong, broken = [], {}
    for cut, outcome in zip(scene.cuts, verdict.outcomes):
        worst = max(outcome.summary["residuals"].values(), default=0.0)
        if not worst <= KKT:
            wrong.append(f"{_named(cut)}: KKT residual {worst:.1e} with status 0")
        law, violation, allowed = problem.broken(outcome)
        broken[law] = max(broken.get(law, 0.0), violation / allowed)
        if not violation <= allowed:
            wrong.append(f"{_named(cut)}: {law} {violation:.1e}")
    verdict.worst = max(broken.values())
    verdict.disagreement, doubt = problem.disagreement(verdict.outcomes), ""
    if not verdict.disagreement <= AGREEMENT:
        doubt = problem.not_unique(verdict.outcomes) or problem.sensitive(verdict.outcomes)
        text = f"cuts differ by {verdict.disagreement:.1e} of the largest contact force"
        if doubt:
            doubt = f"{text}, each obeys the laws: {doubt}"
        else:
            wrong.append(text)
    said = ranks_agree(scene, path, folder, verdict.outcomes[1])
    if said:
        wrong.append(f"{_named(scene.cuts[1])} NP=2: {said}")
    verdict.status, verdict.why = ("FAILED", "; ".join(wrong)) if wrong else ("solved", doubt)


def ranks_agree(scene: RandomScene, path: Path, folder: Path, alone: Outcome) -> str:
    """What is wrong with the second cut on two ranks, whose run on one rank is `alone`."""
    both = run(scene, path, folder, scene.cuts[1], ranks=2)
    if both.status != alone.status:
        return f"exit {both.status} {_last_line(both.message)}"
    tables = [name for name in ("contact.csv", "history.csv")
              if (alone.directory / name).is_file()]
    same = all((alone.directory / name).read_bytes() == (both.directory / name).read_bytes()
               for name in tables)
    return "" if same else "other bits than with NP=1"
