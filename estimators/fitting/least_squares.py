"""Weighted least squares fits of a model to FRF estimates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import Problem, make_fit_problem
from estimators.fitting.linearise import linearise
from estimators.fitting.priors import Prior
from estimators.fitting.residuals import Residual, find_residual
from estimators.fitting.search import check_effort, search
from estimators.fitting.start_values import named_start
from estimators.fitting.trust_region import SearchResult
from estimators.fitting.weight_choice import evaluate_weights
from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.rigid_body_check import RigidLimit, rigid_limit
from estimators.trust.intervals import Interval, Verdict
from estimators.trust.linearised_fit import LinearisedFit
from estimators.trust.trust import Trust
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import SolverFailed
from robotmodels.common.printing import ReprHtml
from robotmodels.description.parameters import Parameters
from robotmodels.linear.residuals import RESIDUALS, ResidualForm
from robotmodels.linear.response import Elastic, frequency_response

if TYPE_CHECKING:
    from robotmodels.elastic.robot import ElasticRobot


@renamed_attributes("0.2", own_residual="custom_residual")
@dataclass(frozen=True, eq=False)
class Fit(ReprHtml):
    """The end of one search, converged or not.

    Attributes
    ----------
    model : Elastic
        Model that was fitted.
    estimate : FrfEstimate
        FRFs that it was fitted to.
    residual : str
        "nls", "lls", "lls_magnitude", or the name of `custom_residual`.
    weights : ndarray or ndarray of complex
        Lambda^-1, (Q, F, m, n) or (Q, F, m n, m n).
    parameters : Parameters
        Fitted values; the start's where the search could not begin.
    cost : float
        What was minimised: V = sum w |epsilon|^2 of [WM] (4b) or (7b) over complex elements, with
        the prior's part and the loss if there are any; infinite where the search could not begin.
        With optimal weights exp(-V) is the likelihood: V is half of the chi-square of real and
        imaginary parts, and noise makes it one half for each of these numbers.
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
    custom_residual : ResidualForm or None
        A residual that the user defined.
    """

    model: Elastic
    estimate: FrfEstimate
    residual: str
    weights: Array | ComplexArray
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
    custom_residual: ResidualForm | None = None

    @property
    def kind(self) -> Residual:
        """The residual with its derivative and noise."""
        return find_residual(self.custom_residual or self.residual)

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
    def data_check(self) -> RigidLimit:
        """Signs, units and order of the data, against what the model says at any parameters."""
        return rigid_limit(self.estimate, self.model)

    @cached_property
    def trust(self) -> Trust:
        """How far the fit can be trusted, with all evidence.

        Raises
        ------
        SolverFailed
            If the search could not begin.
        """
        if not np.isfinite(self.cost):
            raise SolverFailed(f"no intervals without a fit: {self.message}")
        from estimators.fitting.fit_trust import fit_trust  # loads Pinocchio, which a fit may spare

        return fit_trust(problem_of(self), self.parameters.values, self.converged)

    def linearise(self) -> LinearisedFit:
        """Return residuals, Jacobian and noise at the fitted values."""
        return linearise(problem_of(self), self.parameters.values)

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
        from estimators.fitting.fitted_robot import fitted_robot, lines_in_words

        provenance = {
            "data": f"FRFs at {len(self.estimate.positions)} positions and "
            f"{lines_in_words(self.estimate.omega)}",
            "fit": f"{self.residual}, weights {self.weighting or 'given'}, cost {self.cost:.9g}, "
            f"{'converged' if self.converged else 'not converged'}",
        }
        values = self.parameters.values
        return fitted_robot(self.model, values, trust or self.trust, provenance, covariance)

    def __str__(self) -> str:
        p = self.parameters
        width = max(len(name) for name in p.names)
        lines = [
            f"{self.residual} fit: {'converged' if self.converged else 'NOT converged'}, "
            f"cost {self.cost:.6g} (half of the chi-square), {self.evaluations} "
            f"evaluations ({self.message})"
        ]
        for name, value, unit, start in zip(p.names, p.values, p.units, self.start, strict=True):
            lines.append(f"  {name:<{width}}  {value:12.6g} {unit:<10} start x {value / start:.4g}")
        lines += [f"  CHECK THE DATA: {message}" for message in self.data_check.messages]
        return "\n".join(lines)


def fit(
    model: Elastic,
    estimate: FrfEstimate,
    residual: str | ResidualForm = "lls",
    weights: str | NDArray[Any] = "user",
    start: Array | str | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> Fit:
    """Return the fit from one start: a local minimum, if it converged.

    Parameters
    ----------
    model : Elastic
        Robot, or anything with its ``parameters`` and ``network``.
    estimate : FrfEstimate
        FRFs to fit.
    residual : str or ResidualForm
        "nls" [WM] (4), "lls" [WM] (7), "lls_magnitude", or one of your own.
    weights : str or ndarray
        "user", "optimal", "optimal_diagonal", "combined", or an array, see
        `estimators.fitting.weights`. Named weights that depend on the FRF, "combined" ones and all
        where a logarithm is taken, are evaluated once more at the FRF of the fit, see `reweighted`.
    start : ndarray or str, (p,), optional
        Parameter values; the model's nominal ones where None; "physics" or "chains" for rough ones
        from the FRFs, see `physics_start` and `chain_start_values`.
    bounds : tuple of (float, float) or ndarray
        Factors of the model's nominal values between which parameters are sought, or (2, p) values
        [SI].
    max_evaluations : int
        Evaluations of the FRFs and their sensitivities, after which the search gives up.
    tolerance : float
        Relative change of cost and of ln theta, and gradient, at which the search ends.
    positions : sequence of int or ndarray of int, optional
        Which of the estimate's positions to fit; all where None.
    prior : Prior, optional
        Prior knowledge of some parameters.
    loss : str
        "linear", or "soft_l1", "huber" or "cauchy", under which residuals far outside their
        standard deviation, by the estimate's covariance, count less.

    Raises
    ------
    InvalidInput
        For unknown names, misfitting arrays, a start outside the bounds, fewer data than
        parameters, or a logarithm of zero.
    IdentificationError
        If the model has no FRF at the start.
    """
    check_effort(max_evaluations, tolerance)
    problem = make_fit_problem(model, estimate, residual, weights, bounds, positions, prior, loss)
    if isinstance(start, str):
        start = np.clip(named_start(start, model, problem.estimate), *problem.bounds)
    begin = problem.checked_start(start)
    first = as_fit(problem, begin, search(problem, begin, max_evaluations, tolerance))
    follows = problem.kind.relative or weights == "combined"
    if not isinstance(weights, str) or not follows or not first.converged:
        return first
    return reweighted(first, weights, rounds=1, tolerance=tolerance)


def reweighted(
    fit: Fit, weights: str = "optimal", rounds: int = 2, tolerance: float = 1e-10
) -> Fit:
    """Return the fit repeated with named weights evaluated at its own FRF, not the measured one.

    [WM] (8) with the measured FRF correlates weights with errors, and a signal-to-noise ratio of
    the measured FRF selects elements whose errors happen to be large. Over tens of thousands of
    noisy elements these biases outgrow the standard deviations; at the FRF of a good fit both
    vanish. Elements below 10 dB are left out where a logarithm is taken: its mean is
    ln|G| + E1(snr)/2, whose second term is 2e-6 from there on. Costs of fits weighted by their own
    models do not compare: find the best of many starts first.

    Parameters
    ----------
    fit : Fit
        Gives model, residual and data.
    weights : {"optimal", "optimal_diagonal", "user", "combined"}
        As in `estimators.fit`.
    rounds : int
        How often weights are evaluated anew.
    """
    start, evaluations = fit.start, fit.evaluations
    for _ in range(rounds):
        model, estimate, values = fit.model, fit.estimate, fit.parameters.values
        G = np.asarray(frequency_response(model, estimate.positions, estimate.omega, values))
        array = evaluate_weights(weights, estimate, fit.kind, G)
        problem = problem_of(replace(fit, weights=array, weighting=weights))
        fit = as_fit(problem, values, search(problem, values, 200, tolerance))
        evaluations += fit.evaluations
    return replace(fit, start=start, evaluations=evaluations)


def likelihood_fit(fit: Fit) -> Fit:
    """Return the fit repeated with the weights of the noise, from its own values.

    exp(-cost) of the result is the likelihood of the stated noise.
    """
    return reweighted(fit, "optimal", rounds=2 if fit.kind.relative else 1)


def problem_of(fitted: Fit) -> Problem:
    """Return the problem that a fit is the end of."""
    return Problem(
        model=fitted.model,
        estimate=fitted.estimate,
        kind=fitted.kind,
        weights=fitted.weights,
        bounds=fitted.bounds,
        prior=fitted.prior,
        loss=fitted.loss,
        weighting=fitted.weighting,
    )


def as_fit(problem: Problem, start: Array, outcome: SearchResult) -> Fit:
    """Return a search's outcome together with the problem it belongs to."""
    parameters, form = problem.model.parameters, problem.kind.form
    return Fit(
        model=problem.model,
        estimate=problem.estimate,
        residual=problem.kind.name,
        weights=problem.weights,
        parameters=Parameters(parameters.names, outcome.values, parameters.units),
        cost=outcome.cost,
        start=read_only(start),
        bounds=problem.bounds,
        status=outcome.status,
        message=outcome.message,
        evaluations=outcome.evaluations,
        prior=problem.prior,
        loss=problem.loss,
        weighting=problem.weighting,
        custom_residual=None if form in RESIDUALS.values() else form,
    )
