"""The stages of a study that fit: every estimator from the same starts, then the one result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimators.fitting.fit_files import read_fits, write_fits
from estimators.fitting.least_squares import Fit, fit, reweighted
from estimators.fitting.multistart import multistart, perturbed_starts
from estimators.fitting.weights import MINIMUM_SNR, user_weights
from estimators.frf.frf_estimate import FrfEstimate
from oed.criteria.criteria import named_criterion
from oed.study.settings.fit_settings import Estimator, WeightChoice
from oed.study.stages.context import Run
from oed.study.stages.data_stages import Data
from oed.study.stages.design_stages import Information
from oed.study.stages.stage_cache import Files, Stage
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, NotIdentifiable, SolverFailed
from robotmodels.common.progress import Progress

_SAME_COST = 1e-6
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
        return sum(run.cost <= best * (1 + _SAME_COST) for run in self.runs)


@dataclass(frozen=True, eq=False)
class Chosen:
    """The fit that is the study's result, and where its search began, for people."""

    fit: Fit
    origin: str


def starts_of(run: Run) -> Array:
    """Return the starts (N, p), SI, the same for every estimator, so that they compare."""
    choice = run.study.fit
    return perturbed_starts(run.robot.parameters, choice.starts, choice.decades, run.rng("starts"))


def search(
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
        return _searched(run, estimator, estimate, starts, folder / _STORE, report)

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
    return run.stages.run(f"fit-{estimator.name}", inputs, compute, Files(_save_search, load))


def _searched(
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


def chosen(
    run: Run, data: Stage[Data], searches: Mapping[str, Stage[Search]], starts: Array
) -> Stage[Chosen]:
    """Return the study's result: the estimator it names, or else the likelihood's best fit."""
    estimate, name = data.value.estimate, run.study.fit.result
    found = {key: stage.value for key, stage in searches.items()}

    def compute(folder: Path, report: Progress | None) -> Chosen:
        if name is None:
            return best_likelihood(run.robot, estimate, found, starts)
        best = found[name].runs[0]
        return Chosen(found[name].result, f"perturbed start {start_number(starts, best) + 1}")

    def load(folder: Path) -> Chosen:
        (best,) = read_fits(folder / "fit.h5", run.robot, estimate)
        return Chosen(best, (folder / "origin.txt").read_text(encoding="utf-8"))

    inputs: dict[str, Any] = {"robot": run.robot_digest, "data": data.digest, "result": name}
    inputs["searches"] = {key: stage.digest for key, stage in searches.items()}
    return run.stages.run("result", inputs, compute, Files(_save_chosen, load))


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


def best_likelihood(
    robot: ElasticRobot, estimate: FrfEstimate, searches: Mapping[str, Search], starts: Array
) -> Chosen:
    """Return the best NLS fit with optimal weights, and where its search began.

    That cost is the exact likelihood of circular complex noise of known covariance. Besides the
    perturbed starts it is tried from the result of every other estimator.
    """
    found = []
    for name, one in searches.items():
        if one.is_likelihood:
            result = one.runs[0]
            found.append((result, f"perturbed start {start_number(starts, result) + 1}"))
        else:
            values = one.result.parameters.values
            refined = fit(robot, estimate, "nls", "optimal", start=values)
            found.append((refined, f"the {name.replace('_', ' ')} fit"))
    best = min(f.cost for f, _ in found)
    # Perturbed starts first: they owe nothing to other estimators.
    found.sort(key=lambda item: item[1].startswith("the "))
    return next(Chosen(*item) for item in found if item[0].cost <= best * (1 + _SAME_COST))


def start_number(starts: Array, run: Fit) -> int:
    """Return which of the starts (N, p), from 0, a run came from."""
    return int(np.flatnonzero((starts == run.start).all(axis=1))[0])  # it is the very same array


_STORE = "searches.h5"


def _save_search(value: Search, folder: Path) -> None:
    write_fits(folder / "runs.h5", value.runs)
    write_fits(folder / "result.h5", [value.result])
    (folder / _STORE).unlink()


def _save_chosen(value: Chosen, folder: Path) -> None:
    write_fits(folder / "fit.h5", [value.fit])
    (folder / "origin.txt").write_text(value.origin, encoding="utf-8")
