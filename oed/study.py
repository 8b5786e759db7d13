"""From a study file to its results: where to measure, what comes out, how certain it is.

One function per station; nothing here writes a file (except the chains, where asked to) or draws.
"""

import platform
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from estimators import (
    Fit,
    FrfEstimate,
    Posterior,
    Uncertainty,
    covariance,
    fit,
    multistart,
    perturbed_starts,
    reweighted,
    sample_posterior,
    simulate_frf,
)
from oed.candidates import candidate_positions
from oed.exact import ExactDesign, exact_design
from oed.information_set import InformationSet, information
from oed.relaxed import Design, optimal_design
from oed.study_file import Study
from robotmodels import ElasticRobot, load_robot
from robotmodels.arrays import Array, IntArray
from robotmodels.errors import SolverFailed

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, the steps done and the steps in all (0: not known yet)."""

_SAME_COST = 1e-6
"""Costs this close, relatively, are one minimum."""

_PACKAGES = ("elastic-robot-oed", "numpy", "scipy", "pin", "cvxpy", "clarabel", "emcee", "numba")


@dataclass(frozen=True, eq=False)
class Search:
    """The fits of one residual.

    Attributes
    ----------
    runs : one fit per start, the least cost first.
    weights : "optimal" or "user", the weights of `runs`.
    result : the best run; log residuals then once more with optimal weights at its own FRF.
    """

    runs: tuple[Fit, ...]
    weights: str
    result: Fit

    def reached(self, best: float | None = None) -> int:
        """Return how many starts ended at the cost `best`, by default the best of these."""
        best = self.runs[0].cost if best is None else best
        return sum(run.cost <= best * (1 + _SAME_COST) for run in self.runs)


@dataclass(frozen=True, eq=False)
class StudyResults:
    """All a study computed, and from what.

    Attributes
    ----------
    study, robot : what was asked; `robot.parameters` is the truth behind the simulated data.
    omega : (F,) [rad/s].
    information, design, exact : candidates, relaxed optimum, integer plan.
    estimate : the simulated FRFs at the plan's positions.
    starts : (starts, p) perturbed start values in SI units.
    searches : the fits of each residual.
    fit : NLS with optimal weights (the exact likelihood of the simulated noise), best of all.
    fit_origin : where the search for `fit` began, for people.
    theorem1, posterior : its uncertainty, two ways.
    seconds : time per stage.
    versions : of Python and of the packages that computed.
    """

    study: Study
    robot: ElasticRobot
    omega: Array
    information: InformationSet
    design: Design
    exact: ExactDesign
    estimate: FrfEstimate
    starts: Array
    searches: dict[str, Search]
    fit: Fit
    fit_origin: str
    theorem1: Uncertainty
    posterior: Posterior
    seconds: dict[str, float]
    versions: dict[str, str]

    @property
    def used(self) -> IntArray:
        """Indices of the candidates that the plan measures in."""
        return self.exact.support

    @property
    def truth(self) -> Array:
        """The parameters behind the simulated data, (p,) SI."""
        return self.robot.parameters.values

    @property
    def z_scores(self) -> Array:
        """(ln estimate - ln truth) / standard deviation of Theorem 1, (p,)."""
        return np.log(self.fit.parameters.values / self.truth) / self.theorem1.std


def run_study(
    study: Study,
    progress: Progress | None = None,
    *,
    chains: Path | None = None,
    executor: Executor | None = None,
) -> StudyResults:
    """Compute a study, stage by stage; the same seed gives the same results.

    Parameters
    ----------
    study : a study, see `oed.study_file.load_study`.
    progress : told how far each stage is.
    chains : HDF5 file for the emcee chains; None keeps them in memory.
    executor : runs information matrices, fits and ensembles in parallel.

    Raises
    ------
    IdentificationError : where the study cannot be computed, naming what is at fault.
    """
    seconds: dict[str, float] = {}
    data_rng, start_rng, chain_rng = np.random.default_rng(study.seed).spawn(3)
    robot, omega, noise = load_robot(study.robot), study.frequencies.omega(), study.noise.law()

    with _stage("candidates", seconds, progress):
        positions = candidate_positions(
            robot, per_joint=study.candidates.per_joint, limits=study.candidates.limits
        )
    with _stage("information", seconds, progress):
        info = information(
            robot,
            positions,
            omega=omega,
            noise=noise,
            executor=executor,
            progress=_report(progress, "information"),
        )
    with _stage("design", seconds, progress):
        design = optimal_design(info, study.design.criterion, tolerance=study.design.tolerance)
        exact = exact_design(info, n_experiments=study.design.experiments, design=design)
    with _stage("simulate", seconds, progress):
        used = exact.support
        estimate = simulate_frf(
            robot, info.positions[used], omega, noise, data_rng, repetitions=exact.repetitions[used]
        )
    with _stage("fit", seconds, progress):
        starts = perturbed_starts(robot.parameters, study.fit.starts, study.fit.decades, start_rng)
        searches = search_all(
            robot, estimate, study.fit.residuals, starts, executor, _report(progress, "fit")
        )
        best, origin = best_likelihood(robot, estimate, searches, starts)
    with _stage("uncertainty", seconds, progress):
        theorem1 = covariance(best)
    with _stage("posterior", seconds, progress):
        posterior = sample_posterior(
            best,
            rng=chain_rng,
            ensembles=study.posterior.ensembles,
            walkers=study.posterior.walkers,
            steps=study.posterior.steps,
            backend=chains,
            progress=_report(progress, "posterior"),
            executor=executor,
        )
    return StudyResults(
        study=study,
        robot=robot,
        omega=omega,
        information=info,
        design=design,
        exact=exact,
        estimate=estimate,
        starts=starts,
        searches=searches,
        fit=best,
        fit_origin=origin,
        theorem1=theorem1,
        posterior=posterior,
        seconds=seconds,
        versions={"python": platform.python_version()} | {p: version(p) for p in _PACKAGES},
    )


def search_all(
    robot: ElasticRobot,
    estimate: FrfEstimate,
    residuals: tuple[str, ...],
    starts: Array,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Search]:
    """Fit every residual from every start, (N, p) SI, the same for all so that they compare.

    Log residuals start with user weights: [WM] section 7 finds that optimal weights, small at
    resonances, fail from far starts where user weights do not.

    Raises
    ------
    SolverFailed : if no start of a residual led to an answer.
    """
    searches = {}
    for i, residual in enumerate(residuals):
        weights = "optimal" if residual == "nls" else "user"
        runs = multistart(
            robot,
            estimate,
            starts,
            residual,
            weights,
            executor=executor,
            progress=_part(progress, i, len(residuals)),
        )
        if not np.isfinite(runs[0].cost):
            raise SolverFailed(f"fit: no {residual} start led to an answer; {runs[0].message}")
        result = runs[0] if residual == "nls" else reweighted(runs[0])
        searches[residual] = Search(runs, weights, result)
    return searches


def best_likelihood(
    robot: ElasticRobot, estimate: FrfEstimate, searches: dict[str, Search], starts: Array
) -> tuple[Fit, str]:
    """Return the best NLS fit with optimal weights, and where its search began.

    That cost is the exact likelihood of circular complex noise of known covariance. Besides the
    perturbed starts it is tried from the result of every other residual.
    """
    found = []
    if "nls" in searches:
        result = searches["nls"].result
        found.append((result, f"perturbed start {start_number(starts, result) + 1}"))
    for residual, search in searches.items():
        if residual != "nls":
            values = search.result.parameters.values
            refined = fit(robot, estimate, "nls", "optimal", start=values)
            found.append((refined, f"the {residual.replace('_', ' ').upper()} fit"))
    best = min(f.cost for f, _ in found)
    return next((f, origin) for f, origin in found if f.cost <= best * (1 + _SAME_COST))


def start_number(starts: Array, run: Fit) -> int:
    """Return which of the starts (N, p), from 0, a run came from."""
    return int(np.argmin(np.abs(np.log(starts / run.start)).max(axis=1)))


@contextmanager
def _stage(name: str, seconds: dict[str, float], progress: Progress | None) -> Iterator[None]:
    begun = time.perf_counter()
    if progress is not None:
        progress(name, 0, 0)
    yield
    seconds[name] = time.perf_counter() - begun
    if progress is not None:
        progress(name, 1, 1)


def _report(progress: Progress | None, stage: str) -> Callable[[int, int], None] | None:
    return None if progress is None else partial(progress, stage)


def _part(
    progress: Callable[[int, int], None] | None, part: int, parts: int
) -> Callable[[int, int], None] | None:
    """Return the progress of one of several parts of equal length as that of the whole."""
    if progress is None:
        return None
    whole = progress
    return lambda done, total: whole(part * total + done, parts * total)
