"""How walkers move: emcee's differential evolution, a corrected snooker, independent proposals."""

from dataclasses import dataclass

import emcee
import numpy as np

from estimators.sampling.student_t_proposal import StudentT
from robotmodels.common.arrays import Array

# Shares of the moves; without a proposal the first two share the third's part.
DE, SNOOKER, INDEPENDENT = 0.28, 0.07, 0.65

GAMMA = 1.7  # of the snooker move, as ter Braak and Vrugt have it


class SnookerMove(emcee.moves.RedBlueMove):  # type: ignore[misc]  # emcee has no types
    """Snooker update of ter Braak and Vrugt (2008).

    x' = x + gamma (P z1 - P z2) with P the orthogonal projection onto the line through x and z,
    accepted with the factor (|x' - z| / |x - z|)^(p - 1). emcee 3.1.6's own divides the direction
    by the root of its length, so its steps depend on where they start, and halves the exponent:
    it samples another distribution.
    """

    def __init__(self) -> None:
        super().__init__(nsplits=4)

    def get_proposal(
        self, sample: Array, complement: list[Array], random: np.random.RandomState
    ) -> tuple[Array, Array]:
        """Return proposals (w, p) for walkers `sample`, and logarithms of their factors (w,)."""
        w, p = sample.shape
        order = np.argsort(random.random_sample((w, 3)), axis=1)
        picks = np.stack([c[random.randint(len(c), size=w)] for c in complement])
        z, z1, z2 = (picks[order[:, i], np.arange(w)] for i in range(3))
        delta = sample - z
        before = np.linalg.norm(delta, axis=1)
        # A walker exactly on z has no line: it stays, with a factor that rejects.
        with np.errstate(invalid="ignore", divide="ignore"):
            direction = delta / before[:, None]
            along = GAMMA * np.einsum("wp,wp->w", direction, z1 - z2)
            proposal = sample + along[:, None] * direction
            after = np.linalg.norm(proposal - z, axis=1)
            factor = (p - 1) * np.log(after / before)
        distinct = (before > 0) & (after > 0)
        return np.where(distinct[:, None], proposal, sample), np.where(distinct, factor, -np.inf)


@dataclass(frozen=True, eq=False)
class IndependentMove:
    """Independence Metropolis proposals: draws that do not depend on where a walker is.

    Exact whatever the target. Where the proposal resembles it a walker forgets its past within a
    few such steps; where not, they are rejected and the other moves do the work.
    """

    proposal: StudentT

    def __call__(self, walkers: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Return proposals (w, p), and logarithms of their factors (w,)."""
        new = self.proposal.draw(len(walkers), random)
        return new, self.proposal.log_density(walkers) - self.proposal.log_density(new)


def moves(proposal: StudentT | None) -> list[tuple[emcee.moves.Move, float]]:
    """Return emcee's weighted moves: DE, corrected snooker, and independent ones if possible."""
    remaining = 1.0 if proposal is None else 1.0 - INDEPENDENT
    mix = [
        (emcee.moves.DEMove(), remaining * DE / (DE + SNOOKER)),
        (SnookerMove(), remaining * SNOOKER / (DE + SNOOKER)),
    ]
    if proposal is not None:
        mix.append((emcee.moves.MHMove(IndependentMove(proposal)), INDEPENDENT))
    return mix
