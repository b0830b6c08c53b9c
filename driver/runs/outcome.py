"""A finished run in a few lines, for the screen."""

from pathlib import Path

from ..estimates import budget_words, price_words
from ..results import screen
from ..text import counted, shown
from ..units import assumed
from . import seconds


def describe(summary: dict, out: Path) -> str:
    """Few lines about a finished run."""
    title = " ".join(filter(None, (summary["scene"], summary["variant"])))
    sizes, counts = summary["sizes"], summary["counts"]
    worst = max(summary["residuals"].values(), default=0)
    condensed = counts.get("condensed_steps")
    newton = ""
    if condensed:
        newton = f"Newton's method on the contact rows in {counted(condensed, 'step')}, "
    lines = [f"{title}: {subdomains(summary)}, {sizes['primal_dofs']} primal and "
             f"{sizes['dual_dofs']} dual dofs, {counted(summary['steps'], 'step')}",
             f"{counts['fixed_point_iterations']} fixed-point iterations, "
             f"{counts['dual_multiplications']} products with F, {newton}largest KKT residual "
             f"{worst:.1e}, force balance {summary['balance']:.1e}",
             f"{seconds.words(summary['seconds'])}, results in {shown(out)}",
             *assumed(summary["units"]),
             *never_mattered(summary["effects_ledger"]),
             *screen.materials(summary.get("materials", []), summary["units"]),
             *screen.boundaries(summary.get("boundaries", []), summary["units"]),
             *screen.probes(summary.get("probes", []), summary["units"]),
             *screen.cycles(summary.get("cycles"), summary["units"]),
             *budget_words.describe(summary.get("errors", {}), summary["units"],
                                    budget_words.earlier(summary),
                                    len(summary.get("boundaries", []))),
             *price_words.describe(summary.get("errors", {}).get("prices")),
             *screen.warnings(summary["warnings"])]
    return "\n  ".join(lines)


def subdomains(summary: dict) -> str:
    """How many there are; of several bodies also how many were asked for, where these are others.
    """
    made, asked = summary["sizes"]["subdomains"], summary["parameters"].get("subdomains", "")
    if summary["effects"]["bodies"] < 2 or not asked.isdigit() or int(asked) == made:
        return counted(made, "subdomain")
    return (f"{counted(made, 'subdomain')} ({asked} requested; every body is cut separately, into "
            "a number that suits its size)")


def never_mattered(ledger: dict[str, dict]) -> list[str]:
    """One sentence for every effect that is declared and was not active, by the scene's words."""
    said = {"time": "quasistatic"}
    return [f"{said.get(name, name).replace('_', ' ')} is declared but {entry['reason']}"
            for name, entry in ledger.items() if entry["declared"] and entry["active"] is False]
