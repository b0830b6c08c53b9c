"""Material: stiffness that jumps, has a direction, or hardly lets the body change its volume."""

from .case import Case
from .checks import dense, laws

BLOCK = "hard/block"
BOTH = (dense(1e-5), laws(1e-5))


def jump(value: float, board: str, ratio: float | None = None, fast=False) -> Case:
    """Young's modulus jumps by `value` over the chess board `board`."""
    where = {"pieces": "from subdomain to subdomain", "inside": "inside subdomains", "halves": "halfway"}[board]
    return Case(f"E jumps by {value:.0e} {where}", "material", BLOCK, {"JUMP": value, "BOARD": board}, easy={"JUMP": 1},
                ratio=ratio, checks=BOTH, sweep=(f"jump of E {where}", value), fast=fast)


def fibre(stiffness: float) -> Case:
    """Fibres `stiffness` times as stiff along as across, at 30 degrees."""
    return Case(f"fibres stiffer by {stiffness:g}", "material", "hard/fibre", {"STIFFNESS": stiffness}, checks=BOTH,
                easy={"STIFFNESS": 1}, sweep=("stiffness of fibres", stiffness))


def poisson(value: float) -> Case:
    """P1 near incompressibility: the discrete problem is solved, and the run says that it locks."""
    return Case(f"Poisson's ratio {value:g}", "material", BLOCK, {"POISSON": value}, checks=BOTH, easy={"POISSON": 0.277},
                sweep=("1/(1 - 2 nu)", 1 / (1 - 2 * value)), warning="lock" if value > 0.48 else "")


CASES = [
    *(jump(value, "pieces", 2.0) for value in (1, 1e3, 1e6, 1e-3, 1e-6)),
    *(jump(value, "halves", 2.0) for value in (1, 1e3, 1e6, 1e-3, 1e-6)),
    *(jump(value, "inside") for value in (1, 1e3, 1e6, 1e-3, 1e-6)),
    *(fibre(value) for value in (1, 10, 100, 1000)),
    *(poisson(value) for value in (0.3, 0.4, 0.49, 0.499, 0.4999)),
]
