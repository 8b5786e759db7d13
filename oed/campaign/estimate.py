"""What the records of all visits say together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.fitting.multistart import multistart, perturbed_starts
from estimators.fitting.priors import Prior
from estimators.fitting.run_fit import RunFit
from estimators.input_output.run_spectra import RunSpectra, run_spectra
from estimators.uncertainty.covariance import covariance
from oed.campaign.checks import drift
from oed.campaign.visits import Visit
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import naming
from robotmodels.common.progress import Progress
from robotmodels.records.records import Records

_STARTS = 4
_SAME_COST = 1e-3

FITTED = ("first", "accuracy", "repeat")
"""Purposes of visits that are fitted: at a low level friction is too much of it all."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values, how certain they are, and the noise that was met.

    Attributes
    ----------
    values : ndarray, (p,), SI
        Fitted.
    std : ndarray, (p,)
        Standard deviations of ln theta behind the recommended intervals.
    covariance : ndarray, (p, p)
        Of ln theta, by Theorem 1, guesses included.
    cost : float
        Cost over what noise makes of it.
    reached : float
        Share of the searches that ended at the least cost.
    verdict, reason : str
        Of the fit.
    noise : ndarray of complex, (F, m + n, m + n)
        Covariance of outputs and torques, of one period.
    drift : float
        Probability of a difference as large between the first visit and its repetition, if nothing
        drifts; not a number before.
    """

    values: Array
    std: Array
    covariance: Array
    cost: float
    reached: float
    verdict: str
    reason: str
    noise: ComplexArray
    drift: float


def visit_spectra(visits: Sequence[Visit]) -> RunSpectra:
    """Return the spectra of visits whose records are here; noise is that of detection lines.

    Raises
    ------
    InvalidInput
        Naming the file that cannot be read or used.
    """
    parts = []
    for visit in visits:
        with naming(visit.records_file):
            parts.append(run_spectra(Records.load(visit.records_file), "detection"))
    return RunSpectra.join(parts)


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
    data = visit_spectra(visits)
    starts = perturbed_starts(robot.parameters, _STARTS, 0.3, rng)
    fits = multistart(robot, data, starts, prior=prior, progress=progress)
    fit = fits[0]
    theorem1 = covariance(fit)
    periods = np.array([visit.plan.periods for visit in visits], dtype=float)
    drifted = _drift(fit, visits)
    return Estimate(
        values=fit.parameters.values,
        std=np.maximum(fit.trust.std, theorem1.std),
        covariance=theorem1.covariance,
        cost=fit.cost / fit.expected_cost,
        reached=sum(one.cost <= fit.cost * (1 + _SAME_COST) for one in fits) / len(fits),
        verdict=str(fit.verdict),
        reason=fit.verdict.reason,
        noise=noise_of_period(data, periods),
        drift=drifted,
    )


def _drift(fit: RunFit, visits: Sequence[Visit]) -> float:
    """Return the probability of `drift` between the first visit and its repetition; nan without."""
    last = [i for i, visit in enumerate(visits) if visit.purpose == "repeat"]
    return drift(fit, 0, last[-1]) if last else np.nan
