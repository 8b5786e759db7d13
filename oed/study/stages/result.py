"""The stage ``result``: the one fit that is the study's, and where its search began."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimators.fitting.fit_files import read_fits, write_fits
from estimators.fitting.fit_problem import Measured
from estimators.fitting.least_squares import Fit, fit
from estimators.fitting.run_fit import RunFit
from estimators.input_output.run_spectra import RunSpectra
from oed.study.stage_cache import Files, Stage
from oed.study.stages.data import Data
from oed.study.stages.fit import LIKELIHOODS, SAME_COST, Search, start_number
from oed.study.stages.run import Run
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array
from robotmodels.common.process_pool import elsewhere
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class SelectedFit:
    """The fit that is the study's result.

    Attributes
    ----------
    fit : Fit or RunFit
        Fit by the estimator that the study names, or else by the likelihood of the noise: NLS with
        optimal weights, or of runs SML; best of all.
    origin : str
        Where its search began, for people.
    """

    fit: Fit | RunFit
    origin: str


def result(
    run: Run, data: Stage[Data], searches: Mapping[str, Stage[Search]], starts: Array
) -> Stage[SelectedFit]:
    """Return the study's result: the estimator it names, or else the likelihood's best fit."""
    estimate, name = data.value.estimate, run.study.fit.result
    finished = {key: stage.value for key, stage in searches.items()}

    def compute(folder: Path, report: Progress | None) -> SelectedFit:
        if name is None:
            return elsewhere(run.executor, best_likelihood, run.robot, estimate, finished, starts)
        search = finished[name]
        return SelectedFit(search.result, origin_of(starts, search.runs[0]))

    def load(folder: Path) -> SelectedFit:
        best: Fit | RunFit
        (best,) = read_fits(folder / "fit.h5", run.robot, estimate)
        return SelectedFit(best, (folder / "origin.txt").read_text(encoding="utf-8"))

    inputs: dict[str, Any] = {"robot": run.robot_digest, "data": data.digest, "result": name}
    inputs["searches"] = {key: stage.digest for key, stage in searches.items()}
    return run.stages.run("result", inputs, compute, Files(_save, load))


def best_likelihood(
    robot: ElasticRobot, estimate: Measured, searches: Mapping[str, Search], starts: Array
) -> SelectedFit:
    """Return the best fit by the likelihood, and where its search began.

    That is NLS with optimal weights, the exact likelihood of circular complex noise of known
    covariance; of runs SML. Besides the perturbed starts it is tried from the result of every other
    estimator.
    """
    kind = LIKELIHOODS[isinstance(estimate, RunSpectra)]
    from_starts, from_fits = [], []
    for name, search in searches.items():
        if search.is_likelihood:
            from_starts.append(SelectedFit(search.runs[0], origin_of(starts, search.runs[0])))
        else:
            values, prior = search.result.parameters.values, search.result.prior
            refined = fit(robot, estimate, *kind, start=values, prior=prior)
            from_fits.append(SelectedFit(refined, f"the {name.replace('_', ' ')} fit"))
    # Perturbed starts first: they owe nothing to other estimators.
    candidates = from_starts + from_fits
    best = min(one.fit.cost for one in candidates)
    return next(one for one in candidates if one.fit.cost <= best * (1 + SAME_COST))


def origin_of(starts: Array, run: Fit | RunFit) -> str:
    """Return the start of a run in words."""
    return f"perturbed start {start_number(starts, run) + 1}"


def _save(value: SelectedFit, folder: Path) -> None:
    write_fits(folder / "fit.h5", [value.fit])
    (folder / "origin.txt").write_text(value.origin, encoding="utf-8")
