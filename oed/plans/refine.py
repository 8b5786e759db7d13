"""Designs off the grid: support positions move until no position between candidates is better.

The price of a position, tr(W H(q)) with W the criterion's slope at the design, is nowhere above
that of the support at an optimum (equivalence theorem). So it is climbed from the support and from
the best points of a finer set; what is found joins the candidates, and the design is solved anew.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from oed.candidates.grids import sobol_positions
from oed.candidates.screening import screened_candidates
from oed.design.certificate import certify
from oed.design.criteria import Criterion, sensitivities
from oed.design.criteria import objective as stated
from oed.design.objective import Objective
from oed.design.polytope import Polytope
from oed.design.relaxed import Design, optimal_design
from oed.information_set import InformationSet, information
from robotmodels.arrays import Array, BoolArray
from robotmodels.collision.surroundings import Surroundings
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.errors import InvalidInput
from robotmodels.noise import LoopNoise, RelativeNoise

_STEP = 1e-5  # of finite differences, as a part of the range
_CLIMBS = 6  # of the best points of the finer set, each round
_CLOSE = 1e-3  # as a part of the range: closer positions are one


@dataclass(frozen=True, eq=False)
class Region:
    """Where positions may be moved, and what an experiment there would tell.

    Attributes
    ----------
    limits : (n, 2) ranges of the positions.
    evaluate : information (Q, p, p) of positions (Q, n).
    usable : which positions (Q, n) can be taken, (Q,).
    """

    limits: Array
    evaluate: Callable[[Array], Array]
    usable: Callable[[Array], BoolArray]


@dataclass(frozen=True, eq=False)
class RefinedDesign:
    """A design whose support lies between the candidates it began with.

    Attributes
    ----------
    candidates : those given, and the positions found; an exact plan can be made of them.
    design : relaxed design over all of these.
    gain : by what the criterion's efficiency is larger than that of the given candidates' optimum.
    gap : certified over the candidates and a finer set of as many points as `checked`: no design
        of these is better by more.
    beyond : the same for the best position that climbing from the support and from the best of
        the finer set found: no design of it and the candidates is better by more.
    checked : points of the finer set.
    rounds : designs solved.
    converged : whether both are within the tolerance. That is no proof for what lies between.
    """

    candidates: InformationSet
    design: Design
    gain: float
    gap: float
    beyond: float
    checked: int
    rounds: int
    converged: bool


def refined_design(
    robot: ElasticRobot,
    info: InformationSet,
    omega: Array,
    noise: RelativeNoise | LoopNoise,
    *,
    limits: Array | None = None,
    surroundings: Surroundings | None = None,
    torque_limits: float | Array | None = None,
    criterion: str | Criterion = "D",
    prior: Array | None = None,
    tolerance: float = 1e-3,
    finer: int = 1024,
    max_rounds: int = 8,
    rng: np.random.Generator | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> RefinedDesign:
    """Return a design over all positions of the robot, not of the candidates only.

    Parameters
    ----------
    robot, info, omega, noise : the candidates' information and what it was computed from.
    limits : (n, 2) ranges to stay in; the joints' own if None.
    surroundings, torque_limits : that positions must respect, as in `screened_candidates`.
    criterion, prior : as in `optimal_design`.
    tolerance : largest gap over the finer set, the Sobol points of number `finer`.
    max_rounds : designs to solve at most.
    rng : scrambles the Sobol points.
    progress : called with the number of rounds done and `max_rounds`.

    Raises
    ------
    InvalidInput, NotIdentifiable, SolverFailed : as `optimal_design`.
    """

    def evaluate(positions: Array) -> Array:
        return information(robot, positions, omega, noise).matrices

    def usable(positions: Array) -> BoolArray:
        kept = np.zeros(len(positions), dtype=bool)
        try:
            screened = screened_candidates(
                robot, positions, surroundings, torque_limits=torque_limits
            )
        except InvalidInput:  # none is left
            return kept
        kept[screened.kept] = True
        return kept

    own = np.asarray(robot.position_limits if limits is None else limits, dtype=float)
    points = sobol_positions(robot, finer, own, rng)
    return refined_over(
        info,
        Region(own, evaluate, usable),
        points,
        criterion=criterion,
        prior=prior,
        tolerance=tolerance,
        max_rounds=max_rounds,
        progress=progress,
    )


def refined_over(
    info: InformationSet,
    region: Region,
    finer: Array,
    *,
    criterion: str | Criterion = "D",
    prior: Array | None = None,
    tolerance: float = 1e-3,
    max_rounds: int = 8,
    progress: Callable[[int, int], object] | None = None,
) -> RefinedDesign:
    """Return a design over a region; see `refined_design`.

    Parameters
    ----------
    info : information of the candidates to begin with.
    region : where positions may go.
    finer : (C, n) positions to check.
    criterion, prior, tolerance, max_rounds, progress : as in `refined_design`.

    Raises
    ------
    InvalidInput : if `max_rounds` or the tolerance is not positive, or as `optimal_design`.
    """
    if max_rounds < 1 or not tolerance > 0:
        raise InvalidInput(
            f"refine: max_rounds {max_rounds!r} and tolerance {tolerance!r} must be positive"
        )
    objective = stated(criterion, info.names, info.samples)
    solver = "newton" if objective.smooth else "cvxpy"
    solved = partial(optimal_design, criterion=criterion, prior=prior, solver=solver)
    finer = finer[region.usable(finer)] if len(finer) else finer
    check = _joined(info, finer, region.evaluate(finer)) if len(finer) else info
    candidates, first = info, solved(info)
    design = first
    for done in range(1, max_rounds + 1):
        # Of the solver's witness: for E and maximin the derivative is not unique.
        slope = objective.price(design.witness, design.information.shape)
        prices = sensitivities(slope, check.matrices[len(info) :])
        best = np.argsort(-prices, kind="stable")[:_CLIMBS] + len(info)
        starts = [candidates.positions[design.support], check.positions[best]]
        new = _new(_climbed(region, np.concatenate(starts), slope), candidates.positions, region)
        # Where weight is, prices are one less the prior's share of the slope.
        level = float(sensitivities(slope, candidates.take(design.support)).max())
        beyond = 0.0
        if len(new):
            matrices = region.evaluate(new)
            worth = sensitivities(slope, matrices) / level - 1.0
            beyond = max(float(worth.max()), 0.0)
        if progress is not None:
            progress(done, max_rounds)
        if beyond <= tolerance or done == max_rounds:
            break
        wanted = worth > 0.1 * tolerance
        candidates = _joined(candidates, new[wanted], matrices[wanted])
        design = solved(candidates)
    gap = _gap(design, candidates, check, objective, prior)
    return RefinedDesign(
        candidates=candidates,
        design=design,
        gain=objective.efficiency(design.information, first.information) - 1.0,
        gap=gap,
        beyond=beyond,
        checked=len(finer),
        rounds=done,
        converged=gap <= tolerance and beyond <= tolerance,
    )


def _gap(
    design: Design,
    candidates: InformationSet,
    check: InformationSet,
    objective: Objective,
    prior: Array | None,
) -> float:
    """Return the certified gap of a design over the candidates and those to check."""
    both = _joined(check, candidates.positions, candidates.matrices)
    weights = np.zeros(len(both))
    weights[len(check) :] = design.weights
    allowed = Polytope.shares(len(both))
    return certify(weights, both, objective, allowed, prior, design.witness).gap


def _joined(info: InformationSet, positions: Array, matrices: Array) -> InformationSet:
    return InformationSet(
        np.concatenate([info.positions, positions]),
        np.concatenate([info.matrices, matrices]),
        info.names,
    )


def _climbed(region: Region, starts: Array, slope: Array) -> Array:
    """Return where the price is locally largest, from each start, in usable places."""
    from scipy.optimize import minimize

    low, high = region.limits.T
    span = np.where(high > low, high - low, 1.0)

    def falling(u: Any) -> tuple[float, Array]:
        # A step that would leave the range is made backwards.
        steps = np.where(u + _STEP > 1.0, -_STEP, _STEP) * (high > low)
        places = np.vstack([u, u + np.diag(steps)])
        prices = sensitivities(slope, region.evaluate(low + places * span))
        change = prices[1:] - prices[0]
        slopes = np.divide(change, steps, out=np.zeros_like(steps), where=steps != 0)
        return -float(prices[0]), -slopes

    bounds = [(0.0, 1.0)] * len(low)
    options: Any = {"maxiter": 25, "ftol": 1e-7, "gtol": 1e-6}
    found = []
    for start in starts:
        begin: Any = np.clip((start - low) / span, 0.0, 1.0)
        end: Any = minimize(
            falling, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        found.append(_last_usable(region, start, low + end.x * span))
    return np.array(found)


def _last_usable(region: Region, start: Array, end: Array) -> Array:
    """Return `end`, or the farthest usable point of nine towards it from the usable `start`."""
    shares = np.linspace(1.0, 0.0, 9)[:-1]
    way = start + shares[:, None] * (end - start)
    usable = region.usable(way)
    return np.asarray(way[np.argmax(usable)] if usable.any() else start)


def _new(found: Array, known: Array, region: Region) -> Array:
    """Return the positions found that are not close to a known or an earlier one."""
    span = np.maximum(region.limits[:, 1] - region.limits[:, 0], 1e-12)
    kept: list[Array] = []
    for position in found:
        others = np.concatenate([known, np.reshape(kept, (-1, known.shape[1]))])
        if np.abs((others - position) / span).max(axis=1).min() > _CLOSE:
            kept.append(position)
    return np.reshape(kept, (-1, known.shape[1]))
