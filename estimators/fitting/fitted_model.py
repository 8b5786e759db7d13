"""The end of a fit's search, whatever the data: values, intervals and how far to trust them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.priors import Prior
from estimators.trust.intervals import Interval, Verdict
from estimators.trust.linearised_fit import LinearisedFit
from estimators.trust.rule import Misfit, find_misfit
from estimators.trust.trust import Trust
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import SolverFailed
from robotmodels.common.printing import ReprHtml
from robotmodels.description.parameters import Parameters
from robotmodels.linear.response import Elastic

if TYPE_CHECKING:
    from robotmodels.elastic.robot import ElasticRobot

# A factor two of Theorem 1's meat over its bread: variances of few blocks scatter by as much.
SAME_WEIGHTS = np.log(2.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedModel(ReprHtml, ABC):
    """The end of one search, converged or not.

    Attributes
    ----------
    model : Elastic
        Model that was fitted.
    residual : str
        What was compared.
    parameters : Parameters
        Fitted values; the start's where the search could not begin.
    cost : float
        What was minimised, with the prior's part and the loss if there are any; infinite where the
        search could not begin.
    start : ndarray, (p,)
        Values at which the search began.
    bounds : ndarray, (2, p)
        Lowest and highest values.
    status : int
        Status of `scipy.optimize.least_squares` (1 to 4 converged, 0 out of evaluations), -1 where
        the search could not begin, -2 where it was stopped early (`multistart`).
    message : str
        The reason in words.
    evaluations : int
        Evaluations of the FRF and its sensitivities.
    prior : Prior or None
        Prior knowledge of some parameters, see `Prior`.
    loss : str
        "linear", or the robust loss.
    weighting : str
        The name of the weights; empty for an array.
    """

    model: Elastic
    residual: str
    parameters: Parameters
    cost: float
    start: Array
    bounds: Array
    status: int
    message: str
    evaluations: int
    prior: Prior | None = None
    loss: str = "linear"
    weighting: str = ""

    @property
    @abstractmethod
    def problem(self) -> FitProblem:
        """The problem that the fit is the end of."""

    @property
    @abstractmethod
    def logarithmic(self) -> bool:
        """Whether residuals are logarithms, so that the cost is no likelihood of normal noise."""

    @property
    def converged(self) -> bool:
        """Whether a local minimum was reached."""
        return self.status > 0

    @property
    def at_bounds(self) -> dict[str, str]:
        """Names of parameters that stopped at a bound, with "lower" or "upper"."""
        at_bound = np.isclose(self.parameters.values, self.bounds, rtol=1e-6, atol=0)
        return {
            name: "lower" if low else "upper"
            for name, low, high in zip(self.parameters.names, *at_bound, strict=True)
            if low or high
        }

    @property
    def data_cost(self) -> float:
        """The cost without the prior's part."""
        if self.prior is None:
            return self.cost
        return self.cost - float(self.prior.cost(self.parameters.names, self.parameters.values))

    @cached_property
    def trust(self) -> Trust:
        """How far the fit can be trusted, by the rule of `estimators.trust`, with all evidence.

        Raises
        ------
        SolverFailed
            If the search could not begin.
        """
        self.check_begun("intervals")
        from estimators.fitting.fit_trust import fit_trust  # loads Pinocchio, which a fit may spare

        return fit_trust(self)

    def linearise(self) -> LinearisedFit:
        """Return residuals, Jacobian and noise at the fitted values."""
        return self.problem.linearise(self.parameters.values)

    @cached_property
    def misfit(self) -> Misfit:
        """How large the residuals are, and how correlated along the lines."""
        return find_misfit(self.linearise())

    def sandwich_parts(self) -> tuple[Array, Array]:
        """Return bread and meat of the covariance, (p, p), see `FitProblem.sandwich_parts`.

        Raises
        ------
        SolverFailed
            If the search could not begin.
        """
        return self._sandwich_parts

    @cached_property
    def _sandwich_parts(self) -> tuple[Array, Array]:
        self.check_begun("covariance")
        bread, meat = self.problem.sandwich_parts(self.parameters.values)
        return read_only(bread), read_only(meat)

    @property
    def has_likelihood(self) -> bool:
        """Whether exp(-cost) is a likelihood: whether the weights are those of the noise.

        Then bread and meat of Theorem 1 are alike on average, in every parameter.
        """
        bread, meat = map(np.diag, self.sandwich_parts())
        ratio = meat / np.where(bread > 0, bread, 1.0)
        return bool((np.abs(np.log(np.where(ratio > 0, ratio, 1.0))) < SAME_WEIGHTS).all())

    @property
    def _mean_levels(self) -> Array | None:
        """Fitted Coulomb friction of the motors, (n,) [N m]; None without."""
        return None

    def intervals(self) -> tuple[Interval, ...]:
        """Return the recommended 95 % interval of each parameter, in SI units."""
        return self.trust.intervals

    @property
    def verdict(self) -> Verdict:
        """The verdict on the whole fit, one of `estimators.VERDICTS`, with its reason."""
        return self.trust.verdict

    def robot(self, trust: Trust | None = None, covariance: Array | None = None) -> "ElasticRobot":
        """Return the robot with the fitted values, for `robotmodels.save_robot` and `export`.

        Its file's section ``fitted`` has the standard deviations of parameters with an interval,
        the verdict, and what the fit rests on; `robot_prior` makes a prior of it.

        Parameters
        ----------
        trust : Trust, optional
            Recommended intervals; by default the fit's own, `Fit.trust`.
        covariance : ndarray, (p, p), optional
            Covariance of ln theta, such as `estimators.covariance` gives, whose correlations go
            along; without it the file has none.

        Raises
        ------
        InvalidInput
            If the model that was fitted is no robot, or no body can have the fitted inertia.
        SolverFailed
            If the search could not begin.
        """
        from estimators.fitting.fitted_robot import fitted_robot

        what = f"{self.residual}, weights {self.weighting or 'given'}, cost {self.cost:.9g}"
        provenance = {
            "data": self._data_in_words(),
            "fit": f"{what}, {'converged' if self.converged else 'not converged'}",
        }
        values, levels = self.parameters.values, self._mean_levels
        return fitted_robot(self.model, values, trust or self.trust, provenance, covariance, levels)

    @abstractmethod
    def _data_in_words(self) -> str:
        """Return what the fit rests on, for people."""

    @property
    def _cost_in_words(self) -> str:
        return "half of the chi-square"

    def _warnings(self) -> list[str]:
        """Return what is wrong with the data."""
        return []

    def __getstate__(self) -> dict[str, Any]:
        # The problem holds the data once more, and what was computed with them.
        return {name: value for name, value in self.__dict__.items() if name != "problem"}

    def check_begun(self, what: str) -> None:
        """Refuse what needs a fit whose search could not begin.

        Raises
        ------
        SolverFailed
            Naming `what`, with the reason.
        """
        if not np.isfinite(self.cost):
            raise SolverFailed(f"no {what} without a fit: {self.message}")

    def __str__(self) -> str:
        p = self.parameters
        width = max(len(name) for name in p.names)
        lines = [
            f"{self.residual} fit: {'converged' if self.converged else 'NOT converged'}, "
            f"cost {self.cost:.6g} ({self._cost_in_words}), {self.evaluations} "
            f"evaluations ({self.message})"
        ]
        for name, value, unit, start in zip(p.names, p.values, p.units, self.start, strict=True):
            lines.append(f"  {name:<{width}}  {value:12.6g} {unit:<10} start x {value / start:.4g}")
        return "\n".join([*lines, *self._warnings()])


def lines_in_words(omega: Array) -> str:
    """Return how many lines there are, and between which frequencies."""
    low, high = omega[[0, -1]] / (2 * np.pi)
    return f"{len(omega)} lines from {low:.6g} to {high:.6g} Hz"
