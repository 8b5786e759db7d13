"""What the records of all visits say together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.fitting.least_squares import as_fit
from estimators.fitting.multistart import multistart, perturbed_starts
from estimators.fitting.priors import Prior
from estimators.fitting.run_fit import RunFit
from estimators.fitting.run_problem import run_problem
from estimators.fitting.trust_region import SearchResult
from estimators.frf.frf_from_records import collected_warnings
from estimators.input_output.run_scatter import expected_square
from estimators.input_output.run_spectra import RunSpectra, run_spectra
from estimators.trust.trust import Trust
from estimators.uncertainty.covariance import Uncertainty, covariance
from oed.campaign.checks import drift, recorded_peaks
from oed.campaign.visits import Visit
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import NotIdentifiable, naming
from robotmodels.common.progress import Progress

_STARTS = 4
_SAME_COST = 1e-3
_DRIFT = 0.01
"""Probability of the drift test below which there is doubt."""

FITTED = ("first", "accuracy", "repeat")
"""Purposes of visits that are fitted: at a low level friction is too much of it all."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values, how certain they are, and what the V fitted visits were like.

    Attributes
    ----------
    values : ndarray, (p,), SI
        Fitted.
    std : ndarray, (p,)
        Standard deviations of ln theta: those behind the recommended intervals, of Theorem 1 where
        they are larger.
    covariance : ndarray, (p, p)
        Of ln theta, by Theorem 1, guesses included.
    trust : Trust
        Recommended intervals and verdicts.
    cost : float
        Cost over what noise makes of it.
    reached : float
        Share of the searches that ended at the least cost.
    weighting : str
        Whether outputs were weighed together or one by one.
    noise : ndarray of complex, (F, m + n, m + n)
        Covariance of outputs and torques, of one period.
    drift : float
        Probability of a difference as large between the first visit and its repetition, if nothing
        drifts; not a number before.
    visit_costs : ndarray, (V,)
        Squared residuals of each visit over what noise makes of them.
    peaks : ndarray, (V, 2, n)
        Largest torques [N m] and speeds [rad/s] of the motors in each visit.
    warnings : tuple of str
        What is wrong with records, by visit.
    """

    values: Array
    std: Array
    covariance: Array
    trust: Trust
    cost: float
    reached: float
    weighting: str
    noise: ComplexArray
    drift: float
    visit_costs: Array
    peaks: Array
    warnings: tuple[str, ...]

    @property
    def inflation(self) -> Array:
        """Quoted standard deviations over those of Theorem 1, (p,): what residuals add."""
        return np.asarray(self.std / np.sqrt(np.diag(self.covariance)))

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against the numbers, each in a sentence."""
        verdict, doubts = self.trust.verdict, []
        if verdict in ("not converged", "model error"):
            doubts.append(f"{verdict}: {verdict.reason}")
        if self.drift < _DRIFT:
            doubts.append(
                "the first visit and its repetition differ "
                f"(p = {max(self.drift, 1e-99):.1g}): the robot changed between, as warm gears "
                "do, or transients last longer; warm it up, or allow more transient_periods, "
                "and begin anew"
            )
        if self.reached < 1:
            doubts.append(
                f"only {self.reached:.0%} of the searches ended at the least cost; another minimum "
                "may be the true one; narrower guesses help"
            )
        return tuple(doubts)


def fitted_visits(visits: Sequence[Visit]) -> list[Visit]:
    """Return the visits that are fitted: those whose records are here, check runs left out."""
    return [visit for visit in visits if visit.state == "told" and visit.purpose in FITTED]


def visit_spectra(visits: Sequence[Visit]) -> RunSpectra:
    """Return the spectra of visits whose records are here; noise is that of detection lines.

    Raises
    ------
    InvalidInput
        Naming the file that cannot be read or used.
    """
    return RunSpectra.join([_Measured.of(visit).spectra for visit in visits])


@dataclass(frozen=True, eq=False)
class _Measured:
    """Spectra of a visit, largest torques and speeds (2, n), and what is wrong with its records."""

    spectra: RunSpectra
    peaks: Array
    warnings: list[str]

    @classmethod
    def of(cls, visit: Visit) -> "_Measured":
        records = visit.records
        with naming(visit.records_file), collected_warnings() as warnings:
            level, swing = recorded_peaks(records, len(visit.plan.motors))
            spectra = run_spectra(records, "detection", weak=True)
        words = [f"visit {visit.number}: {w.removeprefix('position 1: ')}" for w in warnings]
        return cls(spectra, np.abs(level) + swing, words)


def noise_of_period(data: RunSpectra, periods: Array) -> ComplexArray:
    """Return the covariance of one period, (F, m + n, m + n), the mean over all positions."""
    weights = periods / periods.sum()
    return np.asarray(np.einsum("q,qfij->fij", weights * periods, data.covariance))


def estimate(
    robot: ElasticRobot,
    visits: Sequence[Visit],
    prior: Prior | None,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Estimate:
    """Fit the robot to the records of `visits`.

    Parameters
    ----------
    robot : ElasticRobot
        With the guesses.
    visits : sequence of Visit
        Those whose records are here.
    prior : Prior or None
        How far guesses may be off.
    rng : Generator
        Draws where searches begin, around the guesses.
    progress : Progress, optional
        Called with searches done and their number.
    """
    measured = [_Measured.of(visit) for visit in visits]
    data = RunSpectra.join([one.spectra for one in measured])
    starts = perturbed_starts(robot.parameters, _STARTS, 0.3, rng)
    fits = multistart(robot, data, starts, prior=prior, progress=progress)
    fit = fits[0]
    theorem1 = _covariance(fit)
    periods = np.array([visit.plan.periods for visit in visits], dtype=float)
    return Estimate(
        values=fit.parameters.values,
        std=np.maximum(fit.trust.std, theorem1.std),
        covariance=theorem1.covariance,
        trust=fit.trust,
        cost=fit.cost / fit.expected_cost,
        reached=sum(one.cost <= fit.cost * (1 + _SAME_COST) for one in fits) / len(fits),
        weighting=fit.weighting,
        noise=noise_of_period(data, periods),
        drift=_drift(fit, visits),
        visit_costs=_visit_costs(fit),
        peaks=np.array([one.peaks for one in measured]),
        warnings=tuple(words for one in measured for words in one.warnings),
    )


def _covariance(fit: RunFit) -> Uncertainty:
    """Return the covariance by Theorem 1.

    Raises
    ------
    NotIdentifiable
        If some directions do not show above the noise.
    """
    try:
        return covariance(fit)
    except NotIdentifiable as error:
        remedy = "noise hides them; give limits more room, allow more periods, or free fewer"
        raise NotIdentifiable(error.names, remedy, error.combinations) from None


def fit_at(latest: Estimate, robot: ElasticRobot, visits: Sequence[Visit]) -> RunFit:
    """Return an estimate as a fit to some of its visits, to compare it with their records."""
    problem = run_problem(robot, visit_spectra(visits), weights=latest.weighting)
    cost = float((np.abs(problem.errors(latest.values).whitened) ** 2).sum())
    result = as_fit(problem, latest.values, SearchResult(latest.values, cost, 1, "an estimate", 0))
    assert isinstance(result, RunFit)
    return result


def _visit_costs(fit: RunFit) -> Array:
    """Return the squared residuals of each visit over their expectation, (V,)."""
    square = np.abs(fit.problem.errors(fit.parameters.values).whitened) ** 2
    expected = expected_square(fit.data.degrees_of_freedom, fit.problem.rows) * square[0].size
    return np.asarray(square.sum(axis=(1, 2, 3)) / expected)


def _drift(fit: RunFit, visits: Sequence[Visit]) -> float:
    """Return the probability of `drift` between the first visit and its repetition; nan without."""
    last = [i for i, visit in enumerate(visits) if visit.purpose == "repeat"]
    return drift(fit, 0, last[-1]) if last else np.nan
