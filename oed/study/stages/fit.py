"""The stages ``fit-NAME``: the fits of each estimator, all from the same starts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.fitting.fit_files import read_fits, write_fits
from estimators.fitting.least_squares import Fit, reweighted
from estimators.fitting.multistart import multistart, perturbed_starts
from estimators.fitting.weights import MINIMUM_SNR, user_weights
from estimators.frf.frf_estimate import FrfEstimate
from oed.criteria.criteria import named_criterion
from oed.study.settings.fit_settings import Estimator, WeightChoice
from oed.study.stage_cache import Files, Stage
from oed.study.stages.data import Data
from oed.study.stages.information import Information
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, NotIdentifiable, SolverFailed
from robotmodels.common.progress import Progress

SAME_COST = 1e-6
"""Costs this close, relatively, are one minimum."""


@dataclass(frozen=True, eq=False)
class Search:
    """The fits of one estimator.

    Attributes
    ----------
    estimator : Estimator
        Residual, weights and positions.
    runs : tuple of Fit
        One fit per start, the least cost first.
    result : Fit
        The best run; if the estimator asks for it, once more with optimal weights at its own FRF.
    """

    estimator: Estimator
    runs: tuple[Fit, ...]
    result: Fit

    @property
    def weights(self) -> str:
        """Kind of the weights of `runs`."""
        return self.estimator.weights

    @property
    def is_likelihood(self) -> bool:
        """Whether the cost is that of all data, weighted as the stated noise has it."""
        kind = self.estimator
        return (kind.residual, kind.weights, kind.positions) == ("nls", "optimal", "all")

    def reached(self, best: float | None = None) -> int:
        """Return how many starts ended at the cost `best`, by default the best of these."""
        best = self.runs[0].cost if best is None else best
        return sum(run.cost <= best * (1 + SAME_COST) for run in self.runs)


def starts_of(run: Run) -> Array:
    """Return the starts (N, p), SI, the same for every estimator, so that they compare."""
    choice = run.study.fit
    return perturbed_starts(run.robot.parameters, choice.starts, choice.decades, run.rng("starts"))


def fit(
    run: Run,
    estimator: Estimator,
    data: Stage[Data],
    info: Information,
    candidates: IntArray,
    starts: Array,
) -> Stage[Search]:
    """Return the fits of an estimator from all starts.

    Parameters
    ----------
    candidates : ndarray of int, (Q,)
        Index in `info` of each position of the data.

    Raises
    ------
    SolverFailed
        If no start led to an answer.
    """
    positions = positions_of(estimator, info, candidates)
    estimate = data.value.estimate.subset(positions)

    def compute(folder: Path, report: Progress | None) -> Search:
        return _search(run, estimator, estimate, starts, folder / _STORE, report)

    def load(folder: Path) -> Search:
        runs = read_fits(folder / "runs.h5", run.robot, estimate)
        (result,) = read_fits(folder / "result.h5", run.robot, estimate)
        return Search(estimator, runs, result)

    inputs = {
        "robot": run.robot_digest,
        "data": data.digest,
        "estimator": estimator.model_dump(mode="json"),
        "positions": positions.tolist(),
        "user_weights": run.study.fit.user_weights.model_dump(mode="json"),
        "starts": starts.tolist(),
    }
    return run.stages.run(f"fit-{estimator.name}", inputs, compute, Files(_save, load))


def _search(
    run: Run,
    estimator: Estimator,
    estimate: FrfEstimate,
    starts: Array,
    store: Path,
    report: Progress | None,
) -> Search:
    """Fit from all starts; the best is reweighted where the estimator asks for it."""
    runs = multistart(
        run.robot,
        estimate,
        starts,
        estimator.residual,
        weights_of(estimator, estimate, run.study.fit.user_weights),
        executor=run.executor,
        progress=report,
        store=store,
    )
    if not np.isfinite(runs[0].cost):
        raise SolverFailed(f"fit: no start of {estimator.name} led to an answer; {runs[0].message}")
    return Search(estimator, runs, reweighted(runs[0]) if estimator.reweight else runs[0])


def positions_of(estimator: Estimator, info: Information, candidates: IntArray) -> IntArray:
    """Return which positions of the data, candidates (Q,) of `info`, an estimator uses.

    "best" is the single one whose information is largest (D), as LLS1U of [WM] 6.

    Raises
    ------
    InvalidInput
        If the data have no such position.
    NotIdentifiable
        If no single position identifies all parameters.
    """
    count = len(candidates)
    if estimator.positions == "all":
        return np.arange(count)
    if estimator.positions == "best":
        matrices = list(info.take(candidates))
        values = [named_criterion("D").value(matrix) for matrix in matrices]
        if not np.isfinite(max(values)):
            raise NotIdentifiable(
                info.unidentifiable(matrices[0]),
                f"no single position identifies all parameters; give {estimator.name} more",
            )
        return np.array([int(np.argmax(values))])
    for i in estimator.positions:
        if i >= count:
            raise InvalidInput(
                f"fit.estimators: {estimator.name}: there is no position {i}; the data have "
                f"{count}, counted from 0"
            )
    return np.array(estimator.positions)


def weights_of(estimator: Estimator, estimate: FrfEstimate, choice: WeightChoice) -> str | Array:
    """Return the weights of an estimator: an array if they are the user's, a name otherwise."""
    if estimator.weights != "user":
        return estimator.weights
    return user_weights(
        estimate,
        diagonal=choice.diagonal,
        off_diagonal=choice.off_diagonal,
        from_omega=2 * np.pi * choice.low,
        minimum_snr=0.0 if estimator.residual == "nls" else MINIMUM_SNR,
    )


def start_number(starts: Array, run: Fit) -> int:
    """Return which of the starts (N, p), from 0, a run came from."""
    return int(np.flatnonzero((starts == run.start).all(axis=1))[0])  # it is the very same array


_STORE = "searches.h5"


def _save(value: Search, folder: Path) -> None:
    write_fits(folder / "runs.h5", value.runs)
    write_fits(folder / "result.h5", [value.result])
    (folder / _STORE).unlink()
