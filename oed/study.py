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
    perturbed_starts,
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
from robotmodels.errors import IdentificationError, SolverFailed

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, the steps done and the steps in all (0: not known yet)."""

_SAME_COST = 0.01
"""Costs this close are one minimum: with optimal weights, 0.5 is one standard deviation."""

_PACKAGES = ("elastic-robot-oed", "numpy", "scipy", "pin", "cvxpy", "clarabel", "emcee", "numba")


@dataclass(frozen=True, eq=False)
class Multistart:
    """Fits of one residual with optimal weights, best first.

    Attributes
    ----------
    fits : one per start that ended with an answer.
    starts : the number of the start, from 0, that each came from.
    failures : start number and reason, where a fit ended without an answer.
    """

    fits: tuple[Fit, ...]
    starts: tuple[int, ...]
    failures: tuple[tuple[int, str], ...] = ()

    def reached(self, best: float | None = None) -> int:
        """Return how many starts ended at the cost `best`, by default the best of these."""
        if not self.fits:
            return 0
        best = self.fits[0].cost if best is None else best
        return sum(f.cost - best < _SAME_COST for f in self.fits)


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
    fits : a `Multistart` per residual.
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
    fits: dict[str, Multistart]
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
        fits = fit_from_all(
            robot, estimate, study.fit.residuals, starts, executor, _report(progress, "fit")
        )
        best, origin = best_likelihood(robot, estimate, fits)
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
        fits=fits,
        fit=best,
        fit_origin=origin,
        theorem1=theorem1,
        posterior=posterior,
        seconds=seconds,
        versions={"python": platform.python_version()} | {p: version(p) for p in _PACKAGES},
    )


def fit_from(robot: ElasticRobot, estimate: FrfEstimate, task: tuple[str, Array]) -> Fit | str:
    """Fit a residual with optimal weights from a start; return why not where it fails.

    Log residuals first walk with user weights: [WM] section 7 finds that optimal weights, small
    at resonances, fail from far starts where user weights do not.
    """
    residual, start = task
    try:
        if residual.startswith("lls"):
            start = fit(robot, estimate, residual, "user", start=start).parameters.values
        return fit(robot, estimate, residual, "optimal", start=start)
    except IdentificationError as error:
        return str(error)


def fit_from_all(
    robot: ElasticRobot,
    estimate: FrfEstimate,
    residuals: tuple[str, ...],
    starts: Array,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Multistart]:
    """Fit every residual from every start, the same for all, so that they can be compared."""
    tasks = [(residual, start) for residual in residuals for start in starts]
    work = partial(fit_from, robot, estimate)
    outcomes: list[Fit | str] = []
    for outcome in executor.map(work, tasks) if executor else map(work, tasks):
        outcomes.append(outcome)
        if progress is not None:
            progress(len(outcomes), len(tasks))
    per_residual = np.arange(len(tasks)).reshape(len(residuals), len(starts))
    return {
        residual: _ranked([outcomes[i] for i in rows])
        for residual, rows in zip(residuals, per_residual, strict=True)
    }


def _ranked(outcomes: list[Fit | str]) -> Multistart:
    fits = [(i, f) for i, f in enumerate(outcomes) if isinstance(f, Fit)]
    fits.sort(key=lambda pair: pair[1].cost)
    return Multistart(
        fits=tuple(f for _, f in fits),
        starts=tuple(i for i, _ in fits),
        failures=tuple((i, f) for i, f in enumerate(outcomes) if isinstance(f, str)),
    )


def best_likelihood(
    robot: ElasticRobot, estimate: FrfEstimate, fits: dict[str, Multistart]
) -> tuple[Fit, str]:
    """Return the best NLS fit with optimal weights, and where its search began.

    That cost is the exact likelihood of circular complex noise of known covariance. Besides the
    perturbed starts it is tried from the best fit of every other residual.

    Raises
    ------
    SolverFailed : if no fit ended with an answer.
    """
    found = [
        (f, f"perturbed start {start + 1}")
        for name, runs in fits.items()
        if name == "nls"
        for f, start in zip(runs.fits[:1], runs.starts, strict=False)
    ]
    for name, runs in fits.items():
        if name != "nls" and runs.fits:
            refined = fit_from(robot, estimate, ("nls", runs.fits[0].parameters.values))
            if isinstance(refined, Fit):
                found.append((refined, f"the best {name.upper()} fit"))
    if not found:
        reasons = [why for runs in fits.values() for _, why in runs.failures]
        raise SolverFailed(f"fit: no start led to an answer; the first failure was: {reasons[0]}")
    best = min(f.cost for f, _ in found)
    return next((f, origin) for f, origin in found if f.cost - best < _SAME_COST)


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
