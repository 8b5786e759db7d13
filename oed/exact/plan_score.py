"""The score of a plan made by hand: efficiency, standard deviations, best additions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from oed.candidates.grids import candidate_at
from oed.criteria.criteria import Criterion
from oed.design.design import Design
from oed.exact.exact_design import ExactDesign, as_exact_design, relax
from oed.exact.gain_bounds import best_addition
from oed.information_sets.candidates import Candidates, check_candidates
from oed.information_sets.null_space import weak_directions
from robotmodels.common.arrays import Array, IntArray, read_only, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.common.symmetric_matrices import scaled_eigh

_CONSIDERED = 512
_OPEN = 1e-6  # part of an open combination that counts


@dataclass(frozen=True)
class Addition:
    """One more experiment.

    Attributes
    ----------
    candidate : int
        Its index.
    gain : float
        Factor by which its information multiplies the criterion's efficiency, at least 1.
    largest_std : float
        The largest standard deviation with it.
    """

    candidate: int
    gain: float
    largest_std: float


@dataclass(frozen=True, eq=False)
class Score(ReprHtml):
    """Efficiency and standard deviations of a plan, best additions and losses.

    Attributes
    ----------
    plan : ExactDesign
        Plan with its certified efficiency against the best plan of as many experiments.
    std : ndarray, (p,)
        Predicted standard deviations, relative ones where parameters are ln theta.
    additions : tuple of Addition
        The best experiments to add, the best first.
    losses : ndarray, (s,)
        Losses for each position of `plan.support`, by what leaving out one of its experiments
        multiplies the criterion's efficiency; 0 where the plan needs it.
    """

    plan: ExactDesign
    std: Array
    additions: tuple[Addition, ...]
    losses: Array

    @property
    def efficiency(self) -> float:
        """The plan's certified efficiency."""
        return self.plan.efficiency

    def to_dict(self) -> dict[str, float]:
        """Return the standard deviation of each parameter by its name."""
        return dict(zip(self.plan.names, map(float, self.std), strict=True))

    def __str__(self) -> str:
        worst = int(np.argmax(self.std))
        lines = [
            str(self.plan),
            f"  largest standard deviation {self.std[worst]:.3g}, of {self.plan.names[worst]}",
        ]
        for one in self.additions:
            lines.append(
                f"  one more visit to {one.candidate}: {one.gain:.3f} times the efficiency, "
                f"largest standard deviation {one.largest_std:.3g}"
            )
        return "\n".join(lines)


def score(
    info: Candidates,
    plan: ArrayLike,
    repetitions: Sequence[int] | IntArray | None = None,
    *,
    criterion: str | Criterion | None = None,
    prior: Array | None = None,
    design: Design | None = None,
    additions: int = 5,
) -> Score:
    """Return the efficiency of a plan made by hand against the best one, and how to improve it.

    Parameters
    ----------
    info : Candidates
        Information of each candidate; positions need an `InformationSet` or a store.
    plan : array_like
        (k,) indices of candidates, or (k, n) positions that are among them.
    repetitions : sequence of int or ndarray of int, (k,), optional
        Experiments in each, one by default. What is named twice counts twice.
    criterion : str or Criterion, optional
        As in `exact_design`.
    prior : ndarray, optional
        As in `exact_design`.
    design : Design, optional
        As in `exact_design`.
    additions : int
        How many to seek, among the 512 candidates of the largest derivatives.

    Raises
    ------
    InvalidInput
        If a candidate does not exist or repetitions do not fit.
    NotIdentifiable
        Naming the parameters that the plan leaves open.
    """
    check_candidates(info)
    counts = _counts(info, plan, repetitions)
    problem, _, _, bound = relax(info, int(counts.sum()), design, criterion=criterion, prior=prior)
    exact = as_exact_design(problem, counts, bound, per_experiment=True)
    objective, information = problem.objective, exact.information
    value = objective.log_value(information)
    gradient = objective.log_gradient(information)
    derivatives = info.directional_derivatives(gradient)
    size = min(_CONSIDERED, len(info))
    pool = np.argpartition(-derivatives, size - 1)[:size]
    matrices = info.take(pool)
    usable = np.ones(size, dtype=bool)
    best_additions = []
    for _ in range(min(additions, size)):
        best, new = best_addition(objective, information, matrices, usable)
        usable[best] = False
        largest = float(standard_deviations(information + matrices[best]).max())
        best_additions.append(Addition(int(pool[best]), float(np.exp(new - value)), largest))
    supported = info.take(exact.support)
    without = np.array([objective.log_value(information - H) for H in supported])
    return Score(
        plan=exact,
        std=read_only(standard_deviations(information)),
        additions=tuple(best_additions),
        losses=read_only(np.exp(without - value)),
    )


def standard_deviations(information: Array) -> Array:
    """Return the square roots of the inverse's diagonal, (p,); of the first sample of theta.

    Infinite for the parameters of which the information leaves a combination open; what it says
    of the others does not depend on those.
    """
    matrix = information if information.ndim == 2 else information[0]
    s, eigenvalues, vectors = scaled_eigh(matrix)
    null = weak_directions(matrix)
    half = vectors[:, null.shape[1] :] / np.sqrt(eigenvalues[null.shape[1] :])
    std = s * np.linalg.norm(half, axis=1)
    return np.asarray(np.where(np.linalg.norm(null, axis=1) > _OPEN, np.inf, std))


def _counts(
    info: Candidates, plan: ArrayLike, repetitions: Sequence[int] | IntArray | None
) -> IntArray:
    entries = real_numbers(plan, "plan")
    if entries.ndim == 2:
        indices = _candidates_at(info, entries)
    elif entries.ndim == 1 and entries.size and (entries == np.round(entries)).all():
        indices = entries.astype(np.int64)
        wrong = (indices < 0) | (indices >= len(info))
        if wrong.any():
            raise InvalidInput(
                f"plan: candidate {indices[np.argmax(wrong)]} is not in 0..{len(info) - 1}"
            )
    else:
        raise InvalidInput(
            f"plan: shape {entries.shape}; (k,) indices of candidates or (k, n) positions are "
            "needed"
        )
    times = (
        np.ones(len(indices)) if repetitions is None else real_numbers(repetitions, "repetitions")
    )
    if times.shape != indices.shape or not ((times >= 1) & (times == np.round(times))).all():
        raise InvalidInput(
            f"repetitions: {repetitions!r}; {len(indices)} whole numbers >= 1 are needed"
        )
    return np.bincount(indices, weights=times, minlength=len(info)).astype(np.int64)


def _candidates_at(info: Candidates, positions: Array) -> IntArray:
    """Return the candidates at `positions` (k, n)."""
    among = np.asarray(getattr(info, "positions", np.empty((0, 0))))
    if positions.shape[1] != among.shape[1] or not len(positions):
        raise InvalidInput(
            f"plan: positions of shape {positions.shape}; (k, {among.shape[1]}) is needed"
        )
    remedy = "compute the information of the plan's positions too"
    return np.array(
        [
            candidate_at(among, position, f"plan: position {i}", remedy)
            for i, position in enumerate(positions)
        ]
    )
