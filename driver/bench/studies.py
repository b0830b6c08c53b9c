"""A hundred friction values on the 128-subdomain model against one run."""

from .workbench import Workbench, child, driver, in_turn, ratios

PART = "studies"
CASE = ("SCENE=model", "SUBDOMAINS=16x8", "FIGURES=no", "QUIET=yes")


def measure(bench: Workbench) -> None:
    """Whole processes in turn, neither draws or writes fields."""
    out = bench.folder
    found = in_turn({
        "study": lambda: child(driver("study", *CASE, "FRICTION=0.05:1.0:100",
                                      f"OUT={out / 'study'}"))[0],
        "run": lambda: child(driver("run", *CASE, "FIELDS=no", "ERRORS=no",
                                    f"OUT={out / 'run'}"))[0]})
    bench.report.add(PART, "100 friction values, 16x8", found["study"], "s")
    bench.report.add(PART, "one run, 16x8", found["run"], "s")
    bench.report.add(PART, "100 friction values over one run",
                     ratios(found["study"], found["run"]), "", "<= 5")
