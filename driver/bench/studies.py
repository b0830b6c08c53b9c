"""A hundred friction values on the 128-subdomain model against one run."""

from .workbench import Workbench, child, driver, in_turn, ratios

CASE = ("SCENE=model", "SUBDOMAINS=16x8", "FIGURES=no", "QUIET=yes")


def measure(bench: Workbench) -> None:
    """Whole processes in turn, neither draws or writes fields."""
    out = bench.folder
    study = driver("study", *CASE, "FRICTION=0.05:1.0:100", f"OUT={out / 'study'}")
    run = driver("run", *CASE, "FIELDS=no", "ERRORS=no", f"OUT={out / 'run'}")
    times = in_turn({"study": lambda: child(study)[0], "run": lambda: child(run)[0]})
    bench.add("100 friction values, 16x8", times["study"], "s")
    bench.add("one run, 16x8", times["run"], "s")
    bench.add("100 friction values over one run", ratios(times["study"], times["run"]), "", "<= 5")
