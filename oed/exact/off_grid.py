"""Designs off the grid: support positions move until no position between candidates is better.

The sensitivity function tr(W H(q)), with W the derivative of the criterion at the design, is
nowhere above its value on the support at an optimum (equivalence theorem). So it is maximised
locally from the support and from the best points of a finer set; the maxima join the candidates,
and the design is solved anew.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from oed.candidates.grids import sobol_positions
from oed.candidates.screening import usable
from oed.criteria.criteria import Criterion, objective_of
from oed.criteria.objective import Objective
from oed.design.certificate import certify
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.design.polytope import Polytope
from oed.design.problem import DesignProblem
from oed.exact.local_ascent import Region, local_maxima, new_positions
from oed.information_sets.candidates import check_candidates, sensitivities
from oed.information_sets.compute import information
from oed.information_sets.information_set import InformationSet
from robotmodels.collision.surroundings import Surroundings
from robotmodels.common.arrays import Array, BoolArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress, tell
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.noise import LoopNoise, NoiseLaw

_CLIMBS = 6  # of the best points of the finer set, each round
_PRECISION = 0.01  # of climbing, as a part of the tolerance


@dataclass(frozen=True, eq=False)
class RefinedDesign(ReprHtml):
    """A design whose support lies between the candidates it began with.

    Attributes
    ----------
    candidates : InformationSet
        The initial ones and the new positions; an exact plan can be made of them.
    design : Design
        Relaxed design over all of these.
    gain : float
        Factor by which the criterion's efficiency is larger than that of the initial
        candidates' optimum.
    gap : float
        Certified over the candidates and a finer set of as many points as `checked`: no design of
        these is better by more.
    beyond : float
        The same for the best local maximum from the support and from the best of the finer set: no
        design of it and the candidates is better by more.
    checked : int
        Points of the finer set.
    rounds : int
        Designs solved.
    converged : bool
        Whether both are within the tolerance. That is no proof for what lies between.
    """

    candidates: InformationSet
    design: Design
    gain: float
    gap: float
    beyond: float
    checked: int
    rounds: int
    converged: bool

    def __str__(self) -> str:
        ended = "" if self.converged else ", not converged"
        return (
            f"{self.design}\n  {self.gain:.2%} more efficient than on the grid; gap {self.gap:.1e} "
            f"over {self.checked} finer points, {self.beyond:.1e} at local maxima{ended}"
        )


def refined_design(
    robot: ElasticRobot,
    info: InformationSet,
    omega: Array,
    noise: NoiseLaw | LoopNoise,
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
    progress: Progress | None = None,
) -> RefinedDesign:
    """Return a design over all positions of the robot, not of the candidates only.

    Parameters
    ----------
    robot : ElasticRobot
        Robot of the candidates.
    info : InformationSet
        Information of the candidates.
    omega : ndarray, rad/s
        Angular frequencies it was computed for.
    noise : NoiseLaw or LoopNoise
        Noise it was computed for.
    limits : ndarray, (n, 2), optional
        Ranges to stay in; the joint limits if None.
    surroundings : Surroundings, optional
        What positions must not collide with, as in `screened_candidates`.
    torque_limits : float or ndarray, optional
        Limits on the holding torques, as in `screened_candidates`.
    criterion : str or Criterion
        As in `optimal_design`.
    prior : ndarray, optional
        As in `optimal_design`.
    tolerance : float
        Largest gap over the finer set, the Sobol points of number `finer`.
    max_rounds : int
        Designs to solve at most.
    rng : Generator, optional
        Scrambles the Sobol points.
    progress : Progress, optional
        Called with the number of rounds done and `max_rounds`.

    Raises
    ------
    InvalidInput
        If ranges, torque limits or `max_rounds` do not fit; and what `optimal_design` raises,
        NotIdentifiable and SolverFailed too.
    """

    def evaluate(positions: Array) -> Array:
        return information(robot, positions, omega, noise).matrices

    def possible(positions: Array) -> BoolArray:
        return usable(robot, positions, surroundings, torque_limits=torque_limits)

    ranges = np.asarray(robot.position_limits if limits is None else limits, dtype=float)
    points = sobol_positions(robot, finer, ranges, rng)
    return refined_over(
        info,
        Region(ranges, evaluate, possible),
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
    progress: Progress | None = None,
) -> RefinedDesign:
    """Return a design over a region; see `refined_design`.

    Parameters
    ----------
    info : InformationSet
        Information of the candidates to begin with.
    region : Region
        Where positions may go.
    finer : ndarray, (C, n)
        Positions to check.
    criterion : str or Criterion
        As in `refined_design`.
    prior : ndarray, optional
        As in `refined_design`.
    tolerance : float
        As in `refined_design`.
    max_rounds : int
        As in `refined_design`.
    progress : Progress, optional
        As in `refined_design`.

    Raises
    ------
    InvalidInput
        If `max_rounds` or the tolerance is not positive, or as `optimal_design`.
    """
    check_candidates(info)
    if max_rounds < 1 or not tolerance > 0:
        raise InvalidInput(
            f"refine: max_rounds {max_rounds!r} and tolerance {tolerance!r} must be positive"
        )
    objective = objective_of(criterion, info.names, info.samples)
    optimal = partial(optimal_design, criterion=criterion, prior=prior)
    finer = finer[region.usable(finer)] if len(finer) else finer
    check = _joined(info, finer, region.evaluate(finer)) if len(finer) else info
    candidates, first = info, optimal(info)
    design = first
    for done in range(1, max_rounds + 1):
        ascent = _ascend(region, candidates, design, objective, check, len(info), tolerance)
        beyond = max(float(ascent.excess.max(initial=0.0)), 0.0)
        tell(progress, done, max_rounds)
        if beyond <= tolerance or done == max_rounds:
            break
        useful = ascent.excess > 0.1 * tolerance
        candidates = _joined(candidates, ascent.positions[useful], ascent.matrices[useful])
        design = optimal(candidates)
    gap = _gap(design, candidates, check, objective, prior)
    gain = objective.efficiency(design.information, first.information) - 1.0
    most = max(gap, beyond)
    return RefinedDesign(
        candidates, design, gain, gap, beyond, len(finer), done, converged=most <= tolerance
    )


@dataclass(frozen=True, eq=False)
class _Ascent:
    """New positions (k, n), their information (k, p, p), and what they exceed the support by."""

    positions: Array
    matrices: Array
    excess: Array


def _ascend(
    region: Region,
    candidates: InformationSet,
    design: Design,
    objective: Objective,
    check: InformationSet,
    n_initial: int,
    tolerance: float,
) -> _Ascent:
    """Ascend from the support and from the best of `check` after its `n_initial` first ones."""
    # Of the solver's witness: for E and maximin the derivative is not unique.
    gradient = objective.summed_by_sample(design.witness, design.information.shape)
    derivatives = sensitivities(gradient, check.matrices[n_initial:])
    best = np.argsort(-derivatives, kind="stable")[:_CLIMBS] + n_initial
    starts = [candidates.positions[design.support], check.positions[best]]
    ends = local_maxima(region, np.concatenate(starts), gradient, _PRECISION * tolerance)
    new = new_positions(ends, candidates.positions, region)
    if not len(new):
        return _Ascent(new, candidates.matrices[:0], np.empty(0))
    # On the support tr(W H) is one less the prior's share.
    level = float(sensitivities(gradient, candidates.take(design.support)).max())
    matrices = region.evaluate(new)
    return _Ascent(new, matrices, sensitivities(gradient, matrices) / level - 1.0)


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
    return certify(DesignProblem(both, objective, allowed, prior), weights, design.witness).gap


def _joined(info: InformationSet, positions: Array, matrices: Array) -> InformationSet:
    return InformationSet(
        np.concatenate([info.positions, positions]),
        np.concatenate([info.matrices, matrices]),
        info.names,
    )
