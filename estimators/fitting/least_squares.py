"""Fits of a model to FRF estimates or runs, from one start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import FitProblem, check_enough_data
from estimators.fitting.fitted_model import FittedModel, lines_in_words
from estimators.fitting.frf_problem import FrfProblem, frf_problem
from estimators.fitting.gauss_newton import damped_gauss_newton
from estimators.fitting.priors import Prior
from estimators.fitting.residuals import Residual, find_residual
from estimators.fitting.run_fit import RunFit
from estimators.fitting.run_problem import RunProblem, run_problem
from estimators.fitting.search import check_effort, search
from estimators.fitting.start_values import named_start
from estimators.fitting.trust_region import Minimiser, SearchResult
from estimators.fitting.weight_choice import evaluate_weights
from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.rigid_body_check import RigidLimit, rigid_limit
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray, check_kind, read_only
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.description.parameters import Parameters
from robotmodels.linear.residuals import RESIDUALS, ResidualForm
from robotmodels.linear.response import Elastic, frequency_response
from robotmodels.records.records import Records

Runs = RunSpectra | Records
"""Runs, or the records they are read from."""


@renamed_attributes("0.2", own_residual="custom_residual")
@dataclass(frozen=True, eq=False, kw_only=True)
class Fit(FittedModel):
    """A fit to FRFs: the end of one search, converged or not.

    Its cost is V = sum w |epsilon|^2 of [WM] (4b) or (7b) over complex elements. With optimal
    weights exp(-V) is the likelihood: V is half of the chi-square of real and imaginary parts, and
    noise makes it one half for each of these numbers. All else as in `FittedModel`.

    Attributes
    ----------
    estimate : FrfEstimate
        FRFs that it was fitted to.
    residual : str
        "nls", "lls", "lls_magnitude", or the name of `custom_residual`.
    weights : ndarray or ndarray of complex
        Lambda^-1, (Q, F, m, n) or (Q, F, m n, m n).
    custom_residual : ResidualForm or None
        A residual that the user defined.
    """

    estimate: FrfEstimate
    residual: str
    weights: Array | ComplexArray
    custom_residual: ResidualForm | None = None

    @property
    def kind(self) -> Residual:
        """The residual with its derivative and noise."""
        return find_residual(self.custom_residual or self.residual)

    @cached_property
    def problem(self) -> FrfProblem:
        """The problem that the fit is the end of."""
        return FrfProblem(
            model=self.model,
            data=self.estimate,
            kind=self.kind,
            weights=self.weights,
            bounds=self.bounds,
            prior=self.prior,
            loss=self.loss,
            weighting=self.weighting,
        )

    @property
    def logarithmic(self) -> bool:
        """Whether residuals are logarithms of FRFs."""
        return self.kind.relative

    @property
    def weights_follow(self) -> bool:
        """Whether its named weights are to be evaluated once more, at its FRF."""
        return bool(self.weighting) and (self.kind.relative or self.weighting == "combined")

    @cached_property
    def data_check(self) -> RigidLimit:
        """Signs, units and order of the data, against what the model says at any parameters."""
        return rigid_limit(self.estimate, self.model)

    def _data_in_words(self) -> str:
        count, lines = len(self.estimate.positions), lines_in_words(self.estimate.omega)
        return f"FRFs at {count} positions and {lines}"

    def _warnings(self) -> list[str]:
        return [f"  CHECK THE DATA: {message}" for message in self.data_check.messages]


@overload
def fit(
    model: Elastic,
    estimate: FrfEstimate,
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    start: Array | str | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> Fit: ...
@overload
def fit(
    model: Elastic,
    estimate: Runs,
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    start: Array | str | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> RunFit: ...
def fit(
    model: Elastic,
    estimate: FrfEstimate | Runs,
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    start: Array | str | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> Fit | RunFit:
    """Return the fit from one start: a local minimum, if it converged.

    Parameters
    ----------
    model : Elastic
        Robot, or anything with its ``parameters`` and ``network``.
    estimate : FrfEstimate, RunSpectra or Records
        FRFs to fit, or runs: any number in each position, one will do.
    residual : str or ResidualForm, optional
        Of FRFs "lls" [WM] (7), the default, "nls" [WM] (4), "lls_magnitude", or one of your own. Of
        runs "sml", maximum likelihood with noisy inputs and outputs.
    weights : str or ndarray, optional
        Of FRFs "user", the default, "optimal", "optimal_diagonal", "combined", or an array, see
        `estimators.fitting.weights`. Named weights that depend on the FRF, "combined" ones and all
        where a logarithm is taken, are evaluated once more at the FRF of the fit, see `reweighted`.
        Of runs "joint", outputs are weighed together by their covariance, "row_wise", each by
        itself, or "auto", the default, which is joint from 4 degrees of freedom per output on.
    start : ndarray or str, (p,), optional
        Parameter values; the model's nominal ones where None; "physics" or "chains" for rough ones
        from FRFs, see `physics_start` and `chain_start_values`.
    bounds : tuple of (float, float) or ndarray
        Factors of the model's nominal values between which parameters are sought, or (2, p) values
        [SI].
    max_evaluations : int
        Evaluations of the FRFs and their sensitivities, after which the search gives up.
    tolerance : float
        Relative change of cost and of ln theta, and gradient, at which the search ends.
    positions : sequence of int or ndarray of int, optional
        Which of the positions to fit; all where None.
    prior : Prior, optional
        Prior knowledge of some parameters.
    loss : str
        "linear", or of FRFs "soft_l1", "huber" or "cauchy", under which residuals far outside their
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
    problem = fit_problem(model, estimate, residual, weights, bounds, positions, prior, loss)
    if isinstance(start, str):
        if not isinstance(problem, FrfProblem):
            raise InvalidInput(f"start: {start!r} needs FRFs; give parameter values with runs")
        start = np.clip(named_start(start, model, problem.data), *problem.bounds)
    return solved(problem, problem.checked_start(start), max_evaluations, tolerance)


def solved(
    problem: FitProblem,
    start: Array,
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    minimise: Minimiser = damped_gauss_newton,
) -> Fit | RunFit:
    """Return the fit of a problem from a start (p,), as `fit` does."""
    first = as_fit(problem, start, search(problem, start, max_evaluations, tolerance, minimise))
    if isinstance(first, RunFit) or not (first.weights_follow and first.converged):
        return first
    return reweighted(first, first.weighting, rounds=1, tolerance=tolerance)


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
        problem = replace(fit, weights=array, weighting=weights).problem
        again = as_fit(problem, values, search(problem, values, 200, tolerance))
        assert isinstance(again, Fit)
        fit = again
        evaluations += fit.evaluations
    return replace(fit, start=start, evaluations=evaluations)


@overload
def likelihood_fit(fit: Fit) -> Fit: ...
@overload
def likelihood_fit(fit: RunFit) -> RunFit: ...
def likelihood_fit(fit: Fit | RunFit) -> Fit | RunFit:
    """Return the fit repeated with the weights of the noise, from its own values.

    A fit with such weights, as of runs, is returned as it is. exp(-cost) of the result is the
    likelihood of the stated noise.
    """
    if isinstance(fit, RunFit) or fit.has_likelihood:
        return fit
    return reweighted(fit, "optimal", rounds=2 if fit.kind.relative else 1)


def fit_problem(
    model: Elastic,
    data: FrfEstimate | Runs,
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> FrfProblem | RunProblem:
    """Return the problem of a fit; arguments as in `estimators.fit`.

    Raises
    ------
    InvalidInput
        As `frf_problem` and `run_problem`, or for data of another kind.
    """
    problem: FrfProblem | RunProblem
    if isinstance(data, FrfEstimate):
        problem = frf_problem(model, data, residual, weights, bounds, positions, prior, loss)
    else:
        check_kind(data, (FrfEstimate, RunSpectra, Records), "fit: data")
        problem = run_problem(model, data, residual, weights, bounds, positions, prior, loss)
    check_enough_data(problem)
    return problem


def as_fit(problem: FitProblem, start: Array, outcome: SearchResult) -> Fit | RunFit:
    """Return a search's outcome together with the problem it belongs to."""
    parameters = problem.model.parameters
    common: dict[str, Any] = {
        "model": problem.model,
        "parameters": Parameters(parameters.names, outcome.values, parameters.units),
        "cost": outcome.cost,
        "start": read_only(start),
        "bounds": problem.bounds,
        "status": outcome.status,
        "message": outcome.message,
        "evaluations": outcome.evaluations,
        "prior": problem.prior,
        "loss": problem.loss,
        "weighting": problem.weighting,
    }
    if isinstance(problem, RunProblem):
        return RunFit(data=problem.data, **common)
    assert isinstance(problem, FrfProblem)
    form = problem.kind.form
    return Fit(
        estimate=problem.data,
        residual=problem.name,
        weights=problem.weights,
        custom_residual=None if form in RESIDUALS.values() else form,
        **common,
    )
