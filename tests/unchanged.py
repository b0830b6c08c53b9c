"""Compares runs of this tree with those of another commit: the same bits, the same products.

    python3 tests/unchanged.py 5c0ad6b            # all cases, some minutes on 2 cores
    python3 tests/unchanged.py 5c0ad6b --fast     # model and stack with P1 on 1 rank, seconds
    python3 tests/unchanged.py 5c0ad6b model P2   # cases whose name holds every word

A restructured program must give contact.csv byte for byte, and the same iteration counts,
quantities and error estimates. Bits depend on the machine's libraries, so the reference is made
here: the other commit is unpacked and run once, and what it left is kept in results/unchanged. The
exit status is 1 where anything differs.
"""

import argparse
import hashlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "results" / "unchanged"
SCENES = {
    "model-monotone": ["SCENE=model", "LOADING=monotone"],
    "model-nonmonotone": ["SCENE=model", "LOADING=nonmonotone"],
    **{name: [f"SCENE={name}"] for name in ("punch", "bracket", "joint", "stack", "pressfit",
                                            "mindlin")},
}
FAST = ("model-monotone P1 1", "model-nonmonotone P1 1", "stack P1 1")
TABLES = ("contact.csv", "history.csv", "convergence.csv", "boundary.csv")
ENTRIES = ("converged", "counts", "residuals", "quantities", "sizes", "effects", "fallbacks",
           "warnings", "errors")


def cases() -> dict[str, list[str]]:
    """Words of the command line by the name of the case: scene, element, ranks."""
    return {f"{name} {element} {ranks}": [*words, f"ELEMENT={element}", f"NP={ranks}"]
            for (name, words), element, ranks in itertools.product(SCENES.items(), ("P1", "P2"),
                                                                   (1, 2))}


def outcome(tree: Path, words: list[str]) -> dict:
    """What a run in `tree` left: digests of its tables, and the entries of its summary that are no
    times.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [sys.executable, "-m", "driver", "run", *words, "FIGURES=no", "QUIET=yes",
                   f"OUT={out}"]
        done = subprocess.run(command, cwd=tree, capture_output=True, text=True,
                              env={**os.environ, "PYTHONPATH": ""})
        if done.returncode:
            return {"status": done.returncode, "said": done.stderr[-400:]}
        summary = json.loads((out / "summary.json").read_text())
        (summary.get("errors") or {}).pop("prices", None)  # seconds and memory of other settings
        digests = {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in TABLES}
        # through JSON once more, so that it compares with what was kept
        return json.loads(json.dumps(digests | {name: summary.get(name) for name in ENTRIES}))


def outcomes(tree: Path, wanted: dict[str, list[str]]) -> dict[str, dict]:
    """Outcome of every wanted case, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(wanted, pool.map(lambda words: outcome(tree, words), wanted.values())))


def reference(commit: str, wanted: dict[str, list[str]]) -> dict[str, dict]:
    """Outcomes of `commit`, made where they are not kept yet."""
    name = subprocess.run(["git", "rev-parse", commit], cwd=ROOT, check=True, capture_output=True,
                          text=True).stdout.strip()
    path = KEPT / f"{name}.json"
    known = json.loads(path.read_text()) if path.is_file() else {}
    missing = {case: words for case, words in wanted.items() if case not in known}
    if missing:
        with tempfile.TemporaryDirectory() as folder:
            archive = subprocess.run(["git", "archive", name], cwd=ROOT, check=True,
                                     capture_output=True).stdout
            subprocess.run(["tar", "-x", "-C", folder], input=archive, check=True)
            known |= outcomes(Path(folder), missing)
        KEPT.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(known, indent=1))
    return {case: known[case] for case in wanted}


def main() -> int:
    """Compare and say what differs; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("commit", help="the commit to compare with")
    parser.add_argument("words", nargs="*", help="only cases whose name holds every word")
    parser.add_argument("--fast", action="store_true", help="few small cases")
    given = parser.parse_args()
    wanted = {name: words for name, words in cases().items()
              if all(word in name for word in given.words) and (not given.fast or name in FAST)}
    expected = reference(given.commit, wanted)
    found = outcomes(ROOT, wanted)
    wrong = {name: sorted(key for key in expected[name].keys() | found[name].keys()
                          if expected[name].get(key) != found[name].get(key)) for name in wanted}
    for name, parts in wrong.items():
        print(f"{name}: {'differs in ' + ', '.join(parts) if parts else 'the same'}")
    return int(any(wrong.values()))


if __name__ == "__main__":
    sys.exit(main())
