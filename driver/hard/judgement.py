"""What is right about a random scene, by the assembled body: laws, agreement, refusals."""

import re
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from . import laws, sensitivity
from . import refusal as refusals
from .case import Outcome
from .oracle import Assembled


SHARED = "displacements agree; uniqueness of forces fails where bodies meet in one place"
LAWS = 1e-6  # largest violation, as of the other families, on the assembled body, which moves as
# the torn one but for what gluing leaves: that may be as large and comes on top
APART = 1e-4  # distance in energy from which solutions are different ones
# singular value of rows of contact, of about unit length, from which they depend on one another:
# displacements as small as it feel the circling force, and by its square the work
DEPENDENT = 1e-3


@dataclass
class Problem:
    """Manifest and assembled body of a scene."""

    manifest: object
    body: Assembled

    @classmethod
    def of(cls, script: Path, parameters: dict[str, str]) -> "Problem":
        """Export the scene anew and assemble it."""
        from mpi4py import MPI

        from ..march.tearing import build
        from ..scene import freefem
        from ..scene.loader import read_subdomains
        from ..scene.manifest import read_manifest

        with tempfile.TemporaryDirectory() as folder:
            freefem.export(script, Path(folder), parameters)
            manifest = read_manifest(Path(folder))
            subdomains = read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)
        if "cycles" in manifest.rooms:
            manifest = manifest.unrolled(manifest.rooms["cycles"]["count"])
        body = Assembled(manifest, subdomains)
        if manifest.contact_pairs or manifest.axisymmetric:
            body.meet(build(manifest, subdomains, 0, MPI.COMM_SELF).contact)
        return cls(manifest, body)

    def worst(self, outcome: Outcome) -> tuple[str, float]:
        """The law that a run violates most, and by how much: what rounding is worth, apart."""
        if not outcome.contact:
            return "no contact node", 0.0
        given = self.body, self.manifest, outcome.contact
        broken = laws.violations(*given)
        if max(broken.values()) > laws.RESTS:
            broken = laws.violations(*given, far=laws.rounding(*given) / laws.RESTS)
        return max(broken.items(), key=lambda item: item[1])

    def broken(self, outcome: Outcome) -> tuple[str, float, float]:
        """The law that a run violates most, by how much, and how much is allowed."""
        return *self.worst(outcome), LAWS + outcome.summary["residuals"].get("gluing", 0.0)

    def disagreement(self, outcomes: list[Outcome]) -> float:
        """Largest difference of contact forces between any run and the first."""
        if not outcomes[0].contact:
            return 0.0
        return max(laws.disagreement(self.body, outcomes[0].contact, other.contact)
                   for other in outcomes[1:])

    @property
    def contraction(self) -> float:
        """Below 1 every step has one solution, see `friction_contraction`; infinite if unknown."""
        own, _ = refusals.largest_friction(self.body, self.manifest)
        if not own.any():
            return 0.0
        if self.body.motions.shape[1] or "slip_law" in self.manifest.rooms:
            return np.inf
        return friction_contraction(self.body, own)

    def not_unique(self, outcomes: list[Outcome]) -> str:
        """Why runs may end in different forces, empty if they may not.

        Forces that differ where displacements do not are no other solution, unless bodies that
        meet in one place can hand them on to one another in a circle. Friction that falls with slip
        has solutions as near as two states of one node.
        """
        if "slip_law" not in self.manifest.rooms and max(
                laws.distance(self.body, outcomes[0].contact, other.contact)
                for other in outcomes[1:]) < APART:
            return SHARED if shares_forces(self.body) else ""
        verdicts = {outcome.summary["uniqueness"]["verdict"] for outcome in outcomes}
        if "not unique" in verdicts:
            return "not unique by the run's own search: compared by the laws"
        if self.contraction < 1:
            return ""
        return f"uniqueness is not proved: friction {self.contraction:.2g} times the bound"

    def sensitive(self, outcomes: list[Outcome]) -> str:
        """Why different forces are those of one solution, empty if they may not be."""
        first, *others = outcomes
        worst = max(max(outcome.summary["residuals"].values()) for outcome in outcomes)
        same = all(sensitivity.explained(self.body, self.manifest, first.contact, other.contact,
                                         2 * worst) for other in others)
        return f"no more than residuals of {worst:.1e} do to the forces in their states" if (
            same) else ""

    def refusal(self, outcomes: list[Outcome]) -> tuple[str, str]:
        """Status of a scene that runs refuse with exit 3 or 4, and the argument.

        Runs may refuse different steps, or solve what others refuse, only where they follow
        different solutions of a step before; then each refusal is judged by its own history, and
        those that solve all steps by the laws.
        """
        refusing = [outcome for outcome in outcomes if outcome.status]
        steps, judged = [_step(outcome.message) for outcome in refusing], refusing[:1]
        said = f"exit {judged[0].status}: {judged[0].message.partition('; partial')[0]}"
        doubt = ""
        if len(set(steps)) > 1 or len(refusing) < len(outcomes):
            judged, doubt = refusing, self._went_apart(outcomes, min(steps))
            if not doubt:
                return "FAILED", "cuts refuse different steps: " + "; ".join(
                    f"exit {outcome.status} {outcome.message}" for outcome in outcomes)
            doubt = f"; cuts refuse different steps of different solutions: {doubt}"
        for outcome, step in zip(judged, steps):
            shown, why = self._none_in(outcome, step) if step >= 0 else (False, "it names no step")
            if not shown:
                return "FAILED", f"{said}; not confirmed: {why}{doubt}"
        for outcome in (run for run in outcomes if not run.status):
            law, violation, allowed = self.broken(outcome)
            if not violation <= allowed:
                return "FAILED", f"{said}; another cut solves it, with {law} {violation:.1e}"
        return "refused", f"{said}; {why}{doubt}"

    def _none_in(self, outcome: Outcome, step: int) -> tuple[bool, str]:
        """Whether a `step` that a run refuses is shown to have no solution; the argument, or why
        not.
        """
        weights, slipped = self.manifest.factors[step], self._slipped(outcome, step)
        share = refusals.unbalanced(self.body, self.manifest, weights, step > 0, slipped)
        if share > refusals.SLACK:
            return True, f"linear program: {share:.1e} of the load stays unbalanced"
        if step == 0:
            return False, "forces without friction balance the loads"
        gaps, ways = self.body.distances(), self.body.ways()
        u_t = self._before(outcome, step) + ways[min(step, len(ways)) - 1]
        gap = gaps[min(step, len(gaps) - 1)]
        return refusals.no_state(self.body, self.manifest, weights, u_t, slipped, gap,
                                 self._counts(outcome, step))

    def _went_apart(self, outcomes: list[Outcome], step: int) -> str:
        """Why runs may be in different states before `step`, empty if they are not or may not."""
        if step < 2:
            return ""
        before = [replace(outcome, contact={name: values[: step - 1] for name, values
                                            in outcome.contact.items()}) for outcome in outcomes]
        apart = max(laws.distance(self.body, before[0].contact, other.contact)
                    for other in before[1:])
        return self.not_unique(before) if apart >= APART else ""

    def _slipped(self, outcome: Outcome, step: int) -> np.ndarray:
        """(n_c,) sum of |slip| in contact before a step, as the run reports it."""
        if step < 2:
            return np.zeros(len(self.body.gid))
        reported = laws.Reported.of(self.body, outcome.contact)
        ways = laws.ways_in_contact(reported.slip, laws.pressed(self.body, reported.sigma_n))
        return ways[: step - 1].sum(axis=0)

    def _counts(self, outcome: Outcome, step: int) -> np.ndarray:
        """(n_c,) part of a node's slip in a step that slip laws count, if it presses after it."""
        before = np.zeros((0, len(self.body.gid)))
        if step > 1:
            before = laws.Reported.of(self.body, outcome.contact).sigma_n[: step - 1]
        return 0.5 + 0.5 * laws.pressed(self.body, before)[-1]

    def _before(self, outcome: Outcome, step: int) -> np.ndarray:
        """(n_c,) tangential displacements before a step, as the run reports them."""
        body = self.body
        if step > 1:
            return laws.Reported.of(body, outcome.contact).u_t[step - 2]
        return sum((body.columns.get(f"initial_{x}", 0.0) * body.tangent[:, c]
                    for c, x in enumerate("xy")), np.zeros(len(body.gid)))


def shares_forces(body: Assembled) -> bool:
    """Whether rows of contact depend on one another beyond those of one vertex.

    So it is where two blocks that touch stand on one floor: their corners and the floor stop two
    displacements by three conditions. Conditions of one vertex count as what they span.
    """
    rows, kept = body.B[:, body.free], []
    scale = np.abs(rows).max()
    for vertex in np.unique(body.gid):
        own = rows[np.tile(body.gid == vertex, 2)]
        _, size, basis = np.linalg.svd(own, full_matrices=False)
        kept.append(basis[size > 1e-9 * scale])
    return np.linalg.matrix_rank(np.vstack(kept), tol=DEPENDENT) < sum(map(len, kept))


def _step(message: str) -> int:
    """Number of the step that a refusal names, 0 for the preload before the first one; -1 if none.
    """
    found = re.search(r"step (\d+)|preload", message)
    return int(found[1] or 0) if found else -1


def friction_contraction(body: Assembled, coefficient: np.ndarray) -> float:
    """F sqrt(|(C^-1)_nn| |C_tt|), below which a step with Coulomb friction has one solution.

    For two solutions with forces l, m of a step and d = l - m the conditions of contact and
    friction give d'Cd <= sum F_i |d_n,i| |(C d)_t,i|, with C the compliance of the contact nodes;
    and |d_n|^2 <= |(C^-1)_nn| d'Cd, |(C d)_t|^2 <= |C_tt| d'Cd.
    """
    n, C = len(body.gid), body.compliance()
    scale = np.sqrt(np.abs(np.diag(C)))
    kept = scale > 1e-6 * scale.max()  # supports leave no displacement but rounding in the others
    C = C[np.ix_(kept, kept)]
    if np.linalg.cond(C) > 1e12:
        return np.inf  # nodes with two conditions
    normal = np.flatnonzero(kept) < n
    inverse = np.linalg.inv(C)[np.ix_(normal, normal)]
    root = np.sqrt(coefficient[np.flatnonzero(kept)[normal]])
    rough = np.sqrt(coefficient[np.flatnonzero(kept)[~normal] - n])
    largest = (np.linalg.eigvalsh(of).max(initial=0.0) for of in (
        root[:, None] * inverse * root, rough[:, None] * C[np.ix_(~normal, ~normal)] * rough))
    return float(np.sqrt(np.prod(list(largest))))
