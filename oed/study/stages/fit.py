"""The stages ``fit-NAME``: the fits of each estimator, all from the same starts."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimators.fitting.fit_files import read_fits, write_fits
from estimators.fitting.fit_problem import Measured
from estimators.fitting.least_squares import Fit, fit as fit_from, reweighted
from estimators.fitting.multistart import multistart
from estimators.fitting.residuals import find_residual
from estimators.fitting.run_fit import RunFit
from estimators.fitting.weights import (
    MINIMUM_SNR,
    combined_weights,
    optimal_weights,
    user_weights,
)
from estimators.input_output.run_spectra import RunSpectra
from estimators.uncertainty.covariance import covariance
from oed.study.settings.fit_settings import SML, Estimator, FitChoice
from oed.study.stage_cache import Files, Stage
from oed.study.stages.data import Data
from oed.study.stages.run import Run
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput, NotIdentifiable, SolverFailed
from robotmodels.common.process_pool import elsewhere
from robotmodels.common.progress import Progress
from robotmodels.data_files.json_text import read_json

LIKELIHOODS = ("nls", "optimal"), (SML, "auto")
"""Residuals and weights of the likelihood, of FRFs and of runs."""

SAME_COST = 1e-6
"""Costs this close, relatively, are one minimum."""
# Of BFGS, the usual one of MATLAB's fminunc; Gauss-Newton steps come nearer in no time.
_TOLERANCE = {"trust_region": 1e-10, "quasi_newton": 1e-6}


@dataclass(frozen=True, eq=False)
class Search:
    """The fits of one estimator.

    Attributes
    ----------
    estimator : Estimator
        Residual, weights and positions.
    runs : tuple of Fit or RunFit
        One fit per start, the least cost first.
    result : Fit or RunFit
        The best run; if the estimator asks for it, once more with optimal weights at its FRF.
    positions : ndarray of int
        Which of the data's positions the estimator uses.
    """

    estimator: Estimator
    runs: tuple[Fit | RunFit, ...]
    result: Fit | RunFit
    positions: IntArray

    @property
    def weights(self) -> str:
        """Kind of the weights of `runs`."""
        return self.estimator.weights

    @property
    def is_likelihood(self) -> bool:
        """Whether the cost is that of all data, weighted as the noise has it."""
        kind = self.estimator
        return (kind.residual, kind.weights) in LIKELIHOODS and kind.positions == "all"

    def reached(self, best: float | None = None) -> int:
        """Return how many starts ended at the cost `best`, by default the best of these."""
        best = self.runs[0].cost if best is None else best
        return sum(run.cost <= best * (1 + SAME_COST) for run in self.runs)


def fit(
    run: Run,
    estimator: Estimator,
    data: Stage[Data],
    starts: Array,
) -> Stage[Search]:
    """Return the fits of an estimator from all starts.

    Raises
    ------
    SolverFailed
        If no start led to an answer.
    """
    whole, choice = data.value.estimate, run.study.fit

    def compute(folder: Path, report: Progress | None) -> Search:
        positions = positions_of(estimator, run.robot, whole, choice)
        runs = _runs(run, estimator, whole.subset(positions), starts, folder / _STORE, report)
        best = runs[0]
        if estimator.reweight and isinstance(best, Fit):
            best = elsewhere(run.executor, reweighted, best)
        return Search(estimator, runs, best, positions)

    def load(folder: Path) -> Search:
        positions = _read_positions(folder / _POSITIONS, len(whole.positions))
        estimate = whole.subset(positions)
        runs: tuple[Fit | RunFit, ...] = read_fits(folder / "runs.h5", run.robot, estimate)
        (result,) = read_fits(folder / "result.h5", run.robot, estimate)
        return Search(estimator, runs, result, positions)

    inputs = {
        "robot": run.robot_digest,
        "data": data.digest,
        "estimator": estimator.model_dump(mode="json"),
        **weighting_of(choice),
        "minimiser": choice.minimiser,
        "starts": starts.tolist(),
    }
    inputs |= run.prior_key
    return run.stages.run(f"fit-{estimator.name}", inputs, compute, Files(_save, load))


def _runs(
    run: Run,
    estimator: Estimator,
    estimate: Measured,
    starts: Array,
    store: Path,
    report: Progress | None,
) -> tuple[Fit | RunFit, ...]:
    """Return the fits from all starts, the least cost first."""
    minimiser = run.study.fit.minimiser
    runs: tuple[Fit | RunFit, ...] = multistart(
        run.robot,
        estimate,
        starts,
        estimator.residual,
        weights_of(estimator, estimate, run.study.fit),
        executor=run.executor,
        progress=report,
        store=store,
        minimiser=minimiser,
        tolerance=_TOLERANCE[minimiser],
        prior=run.prior,
    )
    if not np.isfinite(runs[0].cost):
        raise SolverFailed(f"fit: no start of {estimator.name} led to an answer; {runs[0].message}")
    return runs


def positions_of(
    estimator: Estimator, robot: ElasticRobot, estimate: Measured, choice: FitChoice
) -> IntArray:
    """Return which positions of the data an estimator uses.

    "best" is the single one in which the estimator's covariance by Theorem 1, from the
    covariances of the data and at the nominal parameters, has the least determinant ([WM] 6).

    Raises
    ------
    InvalidInput
        If the data have no such position.
    NotIdentifiable
        If no single position identifies all parameters.
    """
    count = len(estimate.positions)
    if estimator.positions == "all":
        return np.arange(count)
    if estimator.positions == "best":
        sizes = [
            _log_volume(estimator, robot, estimate.subset(np.array([i])), choice)
            for i in range(count)
        ]
        if not np.isfinite(min(sizes)):
            raise NotIdentifiable(
                robot.parameters.names,
                f"no single position identifies all parameters; give {estimator.name} more",
            )
        return np.array([int(np.argmin(sizes))])
    for i in estimator.positions:
        if i >= count:
            raise InvalidInput(
                f"fit.estimators: {estimator.name}: there is no position {i}; the data have "
                f"{count}, counted from 0"
            )
    return np.array(estimator.positions)


def _log_volume(
    estimator: Estimator, robot: ElasticRobot, estimate: Measured, choice: FitChoice
) -> float:
    """Return the logarithm of the determinant of an estimator's covariance at nominal values."""
    weights = weights_of(estimator, estimate, choice)
    try:
        unmoved = fit_from(robot, estimate, estimator.residual, weights, max_evaluations=1)
        sign, size = np.linalg.slogdet(covariance(unmoved).covariance)
    except (NotIdentifiable, InvalidInput):
        return np.inf  # too few data of this position, or none of some parameter
    return float(size) if sign > 0 else np.inf


def weights_of(
    estimator: Estimator, estimate: Measured, choice: FitChoice
) -> str | Array | ComplexArray:
    """Return the weights of an estimator: a name where they are the usual ones of that name."""
    if isinstance(estimate, RunSpectra):
        return estimator.weights
    logarithmic = find_residual(estimator.residual).relative
    minimum_snr = choice.minimum_snr if logarithmic else 0.0
    if estimator.weights == "user":
        user = choice.user_weights
        return user_weights(
            estimate,
            diagonal=user.diagonal,
            off_diagonal=user.off_diagonal,
            from_omega=2 * np.pi * user.low,
            minimum_snr=minimum_snr,
        )
    by_line = choice.variances == "own"
    if not by_line and minimum_snr == (MINIMUM_SNR if logarithmic else 0.0):
        return estimator.weights
    if estimator.weights == "combined":
        return combined_weights(estimate, estimator.residual, minimum_snr=minimum_snr)
    if by_line:  # nothing is pooled of variances that count as certain
        estimate = replace(estimate, degrees_of_freedom=np.array(np.inf), deviations=None)
    return optimal_weights(estimate, estimator.residual, minimum_snr=minimum_snr, diagonal=by_line)


def weighting_of(choice: FitChoice) -> dict[str, Any]:
    """Return what weights depend on beside estimator and data, for the key of a stage."""
    return choice.model_dump(mode="json", include={"user_weights", "minimum_snr", "variances"})


def start_number(starts: Array, run: Fit | RunFit) -> int:
    """Return which of the starts (N, p), from 0, a run came from."""
    return int(np.flatnonzero((starts == run.start).all(axis=1))[0])  # it is the very same array


_STORE, _POSITIONS = "searches.h5", "positions.json"


def _save(value: Search, folder: Path) -> None:
    write_fits(folder / "runs.h5", value.runs)
    write_fits(folder / "result.h5", [value.result])
    (folder / _POSITIONS).write_text(json.dumps(value.positions.tolist()), encoding="utf-8")
    (folder / _STORE).unlink()


def _read_positions(path: Path, count: int) -> IntArray:
    """Return the positions that `_save` wrote, which must be among `count`."""
    positions = read_json(path)
    if not isinstance(positions, list) or not all(each in range(count) for each in positions):
        raise InvalidInput(f"{path}: not a list of positions below {count}")
    return np.array(positions, dtype=np.int64)
