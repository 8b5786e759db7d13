"""Designs over very many candidates, by designs over the few thousands that matter most.

A pass over all candidates may mean reading gigabytes. So a few thousands are drawn and designed
over as a whole; one pass certifies that design over all, and names those of the largest derivative,
which with its support are the next few thousands. Few passes remain, and memory for few matrices.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.design.active_set import solve
from oed.design.certificate import certified
from oed.design.design import Design
from oed.design.problem import DesignProblem, DesignSolver
from oed.design.whitening import Whitening, largest
from oed.information_sets.candidates import Matrices
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.errors import NotIdentifiable, SolverFailed

_POOL_BYTES, _MANY = 1e8, 4
"""Matrices of a pool: smaller ones take more passes. Pools in what is too much for one search."""


def solve_by_size(
    problem: DesignProblem, tolerance: float, max_rounds: int, solvers: Sequence[DesignSolver]
) -> Design:
    """Return the design of `solve`, of very many candidates by pools where only a budget limits.

    Arguments and errors as there; `max_rounds` limits the pools too.
    """
    allowed, candidates = problem.allowed, problem.candidates
    limited = len(allowed.rows) > 1 or bool(np.isfinite(allowed.upper).any())
    size = int(_POOL_BYTES / (8 * candidates.samples * len(candidates.names) ** 2))
    if len(candidates) > _MANY * size and not limited:
        design = _by_pools(problem, size, tolerance, max_rounds, solvers)
        if design is not None:
            return design
    return solve(problem, tolerance, max_rounds, solvers)


def _by_pools(
    problem: DesignProblem,
    size: int,
    tolerance: float,
    max_rounds: int,
    solvers: Sequence[DesignSolver],
) -> Design | None:
    """Return a design that is certified over all; None where pools do not lead to one."""
    whitening, drawn = Whitening.of(problem), np.random.default_rng(0)
    pool = np.sort(drawn.choice(len(problem.candidates), size, replace=False))
    gaps: list[float] = []
    while len(gaps) < max_rounds:
        try:
            few = solve(_among(problem, pool), tolerance, max_rounds, solvers)
        except (NotIdentifiable, SolverFailed):
            break
        design = _over_all(whitening, pool, few)
        gaps.append(design.gap)
        if design.gap <= tolerance:
            return replace(design, gaps=read_only(np.array(gaps)))
        prices = design.sensitivity / problem.allowed.rows[0]
        pool = np.union1d(pool[few.support], largest(prices, size))
    return None


def _among(problem: DesignProblem, pool: IntArray) -> DesignProblem:
    """Return the problem of the weights beyond the lower ones, over a pool."""
    allowed, candidates = problem.allowed, problem.candidates
    limits = replace(
        allowed,
        rows=allowed.rows[:, pool],
        bounds=allowed.slack,
        lower=np.zeros(len(pool)),
        upper=allowed.upper[pool],
    )
    matrices = Matrices(candidates.names, candidates.take(pool))
    return DesignProblem(matrices, problem.objective, limits, problem.information(allowed.lower))


def _over_all(whitening: Whitening, pool: IntArray, few: Design) -> Design:
    """Return a pool's design as one over all candidates, certified over them."""
    weights: Array = whitening.problem.allowed.lower.copy()
    weights[pool] += few.weights
    certificate = certified(whitening, weights, few.witness)
    return replace(
        few,
        weights=read_only(weights),
        gap=certificate.gap,
        support=read_only(np.flatnonzero(weights)),
        sensitivity=read_only(certificate.sensitivity),
    )
