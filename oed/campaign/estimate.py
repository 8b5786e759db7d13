"""What the records of all visits say together."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimators.fitting.least_squares import as_fit
from estimators.fitting.multistart import perturbed_starts
from estimators.fitting.priors import Prior
from estimators.fitting.run_fit import FrictionLevel, RunFit
from estimators.fitting.run_problem import run_problem
from estimators.fitting.settled_runs import runs_at, settled_fit
from estimators.fitting.trust_region import SearchResult
from estimators.frf.frf_from_records import collected_warnings
from estimators.frf.spectra import spectra
from estimators.input_output.noise_law import NoiseLaw
from estimators.input_output.run_spectra import run_spectra
from estimators.trust.trust import Trust
from estimators.uncertainty.covariance import Uncertainty, covariance
from oed.campaign.checks import drift, recorded_peaks
from oed.campaign.visits import Visit
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import NotIdentifiable, naming
from robotmodels.common.progress import Progress
from robotmodels.linear.response import frequency_response
from robotmodels.records.records import Records

_STARTS, _SEARCHED = 4, 12
"""Searches, and visits at most that they take: they have to come near."""

_FARTHEST = 0.3
"""Decades from guesses to where searches begin."""

_SAME_COST = 1e-3
_DRIFT = 0.01
"""Probability of the drift test below which there is doubt."""

_FEW = 0.5
"""Share of the searches that end at the least cost at which there is doubt."""

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
    friction : tuple of FrictionLevel
        Of each motor; empty where it is not estimated.
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
    friction: tuple[FrictionLevel, ...]
    peaks: Array
    warnings: tuple[str, ...]

    @property
    def inflation(self) -> Array:
        """Quoted standard deviations over those of Theorem 1, (p,): what residuals add."""
        return np.asarray(self.std / np.sqrt(np.diag(self.covariance)))

    def bears(self, targets: Array) -> bool:
        """Tell whether errors of the model that tests show leave every accuracy (p,) reached.

        Each shifts parameters by what leaving it out does in one step; standard deviations are
        inflated by all that tests do not explain. Shift and deviation together have a root mean
        square within the accuracy. An error that no test shows may be of any size.
        """
        shown = self.trust.tests.significant().size > 0
        return shown and bool((np.hypot(self.trust.model_error, self.std) <= targets).all())

    def doubts(self, targets: Array) -> tuple[str, ...]:
        """Return what speaks against the numbers if such accuracies are asked for, in sentences."""
        verdict, doubts = self.trust.verdict, []
        wrong = verdict == "model error" and not self.bears(targets)
        if verdict == "not converged" or wrong:
            doubts.append(f"{verdict}: {verdict.reason}")
        if self.drift < _DRIFT:
            doubts.append(
                "the first visit and its repetition differ "
                f"(p = {max(self.drift, 1e-99):.1g}): the robot changed between, as warm gears "
                "do, or transients last longer; warm it up, or allow more transient_periods, "
                "and begin anew"
            )
        if self.reached <= _FEW:
            doubts.append(
                f"only {self.reached:.0%} of the searches ended at the least cost; another minimum "
                "may be the true one; narrower guesses help"
            )
        return tuple(doubts)


def fitted_visits(visits: Sequence[Visit]) -> list[Visit]:
    """Return the visits that are fitted: those whose records are here, check runs left out."""
    return [visit for visit in visits if visit.state == "measured" and visit.purpose in FITTED]


def noise_of_period(fit: RunFit, periods: Array) -> ComplexArray:
    """Return the covariance of outputs and torques in one period, (F, m + n, m + n).

    What a fit leaves of the outputs, as disturbances of torques, which other positions pass on
    otherwise, and noise of sensors; each line by as much as the law is off there on average.
    """
    values, data = fit.parameters.values, fit.data
    errors = fit.problem.errors(values).covariance * periods[:, None, None, None]  # (Q, F, m, m)
    response = frequency_response(fit.problem.model, data.positions, data.omega, values)
    omega, (m, n) = np.tile(data.omega, len(errors)), response.shape[2:]
    power = np.einsum("qfii->qfi", errors).real.reshape(-1, m)
    law = NoiseLaw.likeliest(power, omega, response.reshape(-1, m, n), data.derivatives)
    scale = np.einsum("qfij,qfji->qf", np.linalg.inv(law.covariance(data.omega, response)), errors)
    scale = np.einsum("q,qf->f", periods / periods.sum(), scale.real) / m
    return np.asarray(scale[:, None, None] * law.of_signals(data.omega))


def estimate(
    robot: ElasticRobot,
    visits: Sequence[Visit],
    prior: Prior | None,
    rng: np.random.Generator,
    progress: Progress | None = None,
    *,
    friction: bool = True,
) -> Estimate:
    """Fit the robot to the records of `visits`; noise is that of detection lines.

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
    friction : bool
        Whether levels of Coulomb friction are estimated along.
    """
    records, peaks, warnings = _read(visits, robot if friction else None)
    starts = perturbed_starts(robot.parameters, _STARTS, _decades(robot, prior), rng)
    options: dict[str, Any] = {"friction": friction, "prior": prior, "progress": progress}
    with collected_warnings():  # said by visit
        fit, searches = settled_fit(
            robot, records, starts, "detection", few=_SEARCHED, weak=True, **options
        )
    theorem1, same = _covariance(fit), searches[0].cost * (1 + _SAME_COST)
    counts = zip(visits, records, strict=True)
    periods = [min(visit.plan.periods, one.torque.shape[3]) for visit, one in counts]
    return Estimate(
        values=fit.parameters.values,
        std=np.maximum(fit.trust.std, theorem1.std),
        covariance=theorem1.covariance,
        trust=fit.trust,
        cost=fit.cost / fit.expected_cost,
        reached=sum(one.cost <= same for one in searches) / len(searches),
        weighting=fit.weighting,
        noise=noise_of_period(fit, np.array(periods, dtype=float)),
        drift=_drift(fit, visits),
        visit_costs=_visit_costs(fit),
        friction=fit.friction_levels(theorem1.covariance),
        peaks=peaks,
        warnings=warnings,
    )


def _decades(robot: ElasticRobot, prior: Prior | None) -> float:
    """Return how far from guesses searches begin: as far as they may be off, `_FARTHEST` at most.

    Farther starts end in other minima, and tell nothing against the numbers.
    """
    if prior is None or len(prior.names) < len(robot.parameters):
        return _FARTHEST
    return float(min(_FARTHEST, prior.std.max() / np.log(10)))


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


def fit_at(
    latest: Estimate, robot: ElasticRobot, visits: Sequence[Visit], *, friction: bool = True
) -> RunFit:
    """Return an estimate as a fit to some of its visits, to compare it with their records."""
    records = [visit.records for visit in visits]
    data = runs_at(robot, records, latest.values, "detection", friction=friction, weak=True)
    problem = run_problem(robot, data, weights=latest.weighting)
    cost = float((np.abs(problem.errors(latest.values).whitened) ** 2).sum())
    result = as_fit(problem, latest.values, SearchResult(latest.values, cost, 1, "an estimate", 0))
    assert isinstance(result, RunFit)
    return result


def noise_in(visit: Visit, robot: ElasticRobot) -> ComplexArray:
    """Return the covariance of one period, (F, m + n, m + n), as periods of one visit scatter.

    Friction is the same in each period, so that the guesses' FRF will do. Where it holds a motor
    that hardly moves, disturbances seem smaller.
    """
    records, periods = visit.records, visit.plan.periods
    lines = np.arange(records.lines[0], records.lines[-1] + 1)
    first = max(records.torque.shape[3] - periods, 0)
    scatter = spectra(records, lines=lines, first=first)
    omega = 2 * np.pi * lines / (records.samples * records.sample_time)
    response = frequency_response(robot, records.positions, omega)[0]
    errors = scatter.noise_output - np.einsum("fmn,bjfne->bjfme", response, scatter.noise_input)
    power = periods * (np.abs(errors) ** 2).mean(axis=(0, 1, 4))
    law = NoiseLaw.likeliest(power, omega, response, records.derivatives)
    return law.of_signals(records.omega)


def _read(
    visits: Sequence[Visit], friction: ElasticRobot | None
) -> tuple[list[Records], Array, tuple[str, ...]]:
    """Return records, their largest torques and speeds, (V, 2, n), and what is wrong with them."""
    records, peaks, words = list[Records](), [], []
    for visit in visits:
        with naming(visit.records_file), collected_warnings() as warnings:
            records.append(visit.records)
            level, swing = recorded_peaks(records[-1], len(visit.plan.motors))
            run_spectra(records[-1], "detection", weak=True, friction=friction)
        peaks.append(np.abs(level) + swing)
        words += [f"visit {visit.number}: {w.removeprefix('position 1: ')}" for w in warnings]
    return records, np.array(peaks), tuple(words)


def _visit_costs(fit: RunFit) -> Array:
    """Return the squared residuals of each visit over their expectation, (V,)."""
    square = np.abs(fit.problem.errors(fit.parameters.values).whitened) ** 2
    return np.asarray(square.sum(axis=(1, 2, 3)) / fit.problem.expected_squares)


def _drift(fit: RunFit, visits: Sequence[Visit]) -> float:
    """Return the probability of `drift` between the first visit and its repetition; nan without."""
    last = [i for i, visit in enumerate(visits) if visit.purpose == "repeat"]
    return drift(fit, 0, last[-1]) if last else np.nan
