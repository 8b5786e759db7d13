"""Results of simulated plans: predicted and simulated efficiencies against the first one."""

from dataclasses import dataclass

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.monte_carlo import MonteCarlo
from oed.criteria.objective import Objective
from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.printing import ReprHtml

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class _VisitedPlan:
    """A plan of experiments in candidates.

    Attributes
    ----------
    name : str
        Name of the plan.
    support, repetitions : ndarray of int, (k,)
        Candidates it measures in, and experiments in each.
    """

    name: str
    support: IntArray
    repetitions: IntArray


@dataclass(frozen=True, eq=False)
class UnidentifiedPlan(_VisitedPlan):
    """A plan that leaves parameters open, so that nothing was simulated.

    Attributes
    ----------
    unidentified : tuple of str
        Parameters that it leaves open.
    """

    unidentified: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PredictedPlan(_VisitedPlan):
    """A plan and its predicted covariance.

    Attributes
    ----------
    information : ndarray, (p, p)
        Information at the true values.
    predicted : Uncertainty
        Its covariance ([WM] Theorem 1).
    """

    information: Array
    predicted: Uncertainty


@renamed_attributes("0.2", found="simulation", promised="predicted")
@dataclass(frozen=True, eq=False)
class SimulatedPlan(PredictedPlan):
    """A plan, its predicted covariance and its simulated experiments.

    Attributes
    ----------
    simulation : MonteCarlo
        Repeated experiments.
    """

    simulation: MonteCarlo

    @property
    def std(self) -> Array:
        """Standard deviations of ln theta over the experiments, (p,)."""
        return self.simulation.uncertainty().std

    def std_interval(self) -> Array:
        """Return where each true standard deviation lies with 95 %, (p, 2), by chi square."""
        return std_interval(self.std, len(self.simulation.estimates), LEVEL)


@renamed_attributes(
    "0.2",
    trials="plans",
    found="simulated",
    held="fixed_equilibria",
    rivals="alternatives",
    promised="predicted",
    beaten="worse",
)
@dataclass(frozen=True, eq=False)
class PlanComparison(ReprHtml):
    """A plan against its alternatives, the plan first.

    A relative efficiency is the number of experiments of the optimal plan that give as much
    information, by the criterion, as one of the alternative; that of the optimal plan is one.

    Attributes
    ----------
    criterion : str
        Its name.
    optimal : SimulatedPlan
        The plan.
    alternatives : tuple of SimulatedPlan or UnidentifiedPlan
        The K - 1 others.
    predicted : ndarray, (K,)
        Efficiencies by information.
    simulated : ndarray, (K,)
        Efficiencies by the scatter of repeated experiments; zero where a plan leaves parameters
        open.
    interval : ndarray, (K, 2)
        Where the true ones lie with 95 %, each by itself, of normal estimates.
    fixed_equilibria : bool
        Whether fits used fixed equilibria of the true values.
    """

    criterion: str
    optimal: SimulatedPlan
    alternatives: tuple[SimulatedPlan | UnidentifiedPlan, ...]
    predicted: Array
    simulated: Array
    interval: Array
    fixed_equilibria: bool

    @property
    def plans(self) -> tuple[SimulatedPlan | UnidentifiedPlan, ...]:
        """All K plans, the optimal one first."""
        return (self.optimal, *self.alternatives)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        return self.optimal.predicted.names

    @property
    def worse(self) -> tuple[str, ...]:
        """Alternatives that are significantly worse than the plan."""
        return self._alternatives(self.interval[:, 1] < 1)

    @property
    def better(self) -> tuple[str, ...]:
        """Alternatives that are significantly better than the plan."""
        return self._alternatives(self.interval[:, 0] > 1)

    def more_certain(self, alternative: int) -> tuple[int, int, int]:
        """Return of how many parameters the plan has a smaller variance than an alternative.

        The second number counts those where the difference is significant (F test, 95 %), the third
        those of which the alternative has a significantly smaller variance.
        """
        other = self.plans[alternative]
        if isinstance(other, UnidentifiedPlan):
            return len(self.names), len(self.names), 0
        one, two = self.optimal.simulation, other.simulation
        fewer = one.uncertainty().std < two.uncertainty().std
        significant = clearly_smaller(one, two, LEVEL), clearly_smaller(two, one, LEVEL)
        return int(fewer.sum()), int(significant[0].sum()), int(significant[1].sum())

    def _alternatives(self, which: BoolArray) -> tuple[str, ...]:
        pairs = zip(self.alternatives, which[1:], strict=True)
        return tuple(trial.name for trial, selected in pairs if selected)

    def __str__(self) -> str:
        plan, count = self.optimal, len(self.alternatives)
        others = f", worse than {', '.join(self.better) or 'none'}" * (len(self.worse) < count)
        lines = [
            f"{plan.name} better than {len(self.worse)} of {count} alternatives by "
            f"{self.criterion}{others}, {len(plan.simulation.estimates)} simulations each"
        ]
        for k, trial in enumerate(self.alternatives, start=1):
            low, high = self.interval[k]
            lines.append(
                f"  {trial.name:<12} relative efficiency {self.simulated[k]:.2f} "
                f"({low:.2f} to {high:.2f}), predicted {self.predicted[k]:.2f}"
                if isinstance(trial, SimulatedPlan)
                else f"  {trial.name:<12} does not identify {', '.join(trial.unidentified)}"
            )
        return "\n".join(lines)


DRAWS = 400
"""Of a Wishart distribution: quantiles of 95 % to a tenth of the interval's width."""


def std_interval(std: Array, samples: int, level: float) -> Array:
    """Return intervals (p, 2) of standard deviations from those (p,) of so many samples."""
    from scipy.special import chdtri

    above = np.array([(1 - level) / 2, (1 + level) / 2])
    factors = np.sqrt((samples - 1) / chdtri(samples - 1, above))
    return np.asarray(std[:, None] * factors)


def clearly_smaller(one: MonteCarlo, other: MonteCarlo, level: float) -> BoolArray:
    """Return which standard deviations of one are below the other's by more than chance, (p,).

    By the F test of two variances; chance finds one as clear in a share 1 - `level` of cases.
    """
    from scipy.special import fdtri

    samples = len(one.estimates) - 1, len(other.estimates) - 1
    ratio = (one.uncertainty().std / other.uncertainty().std) ** 2
    return np.asarray(ratio < fdtri(*samples, 1 - level))


def ratio_interval(
    objective: Objective, one: MonteCarlo, other: MonteCarlo, level: float
) -> tuple[float, float, float]:
    """Return the efficiency of one scatter against another, and the ends of its interval.

    Efficiencies are the criterion's, of the inverse sample covariances. Their errors are those of
    draws from Wishart distributions about the samples (a parametric bootstrap; for D exact), whose
    median is taken away.
    """
    rng = np.random.default_rng(0)  # of the method, not of the experiments
    errors = _errors(objective, one, rng) - _errors(objective, other, rng)
    values = [_log_value(objective, mc.uncertainty().covariance) for mc in (one, other)]
    difference = values[0] - values[1]
    low, middle, high = np.quantile(errors, [(1 - level) / 2, 0.5, (1 + level) / 2])
    value, lower, upper = np.exp([difference - middle, difference - high, difference - low])
    return float(value), float(lower), float(upper)


def _log_value(objective: Objective, covariance: Array) -> float:
    return objective.log_value(np.asarray(np.linalg.inv(covariance)))


def _errors(objective: Objective, simulation: MonteCarlo, rng: np.random.Generator) -> Array:
    """Return what sampling adds to the log value, (DRAWS,)."""
    covariance, n = simulation.uncertainty().covariance, len(simulation.estimates)
    p = len(covariance)
    # Bartlett's decomposition of Wishart matrices of n - 1 degrees of freedom.
    triangles = np.tril(rng.standard_normal((DRAWS, p, p)), -1)
    triangles[:, np.arange(p), np.arange(p)] = np.sqrt(
        rng.chisquare(n - 1 - np.arange(p), (DRAWS, p))
    )
    roots = np.linalg.cholesky(covariance) @ triangles / np.sqrt(n - 1)
    values = objective.log_values_of_roots(np.swapaxes(roots, -1, -2))
    return np.asarray(values - _log_value(objective, covariance))
