"""What a fit's residuals say of its uncertainty: empirical meat, reduced cost, robust losses."""

from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.least_squares import problem_of
from estimators.fitting.robust import LOSSES
from estimators.uncertainty.theorem_1 import sandwich_parts
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, SolverFailed
from robotmodels.response import frequency_response

if TYPE_CHECKING:
    from estimators.fitting.least_squares import Fit


def empirical_parts(fit: "Fit", lags: int | None = None) -> tuple[Array, Array]:
    """Return bread and meat, (p, p), from the residuals themselves, the prior left out.

    With s_f the gradient of one frequency's part of the cost, in one position, the meat is
    sum_q sum_f sum_l (1 - |l|/(L + 1)) s_f s_(f+l)^T over lags |l| <= L (Newey and West 1987),
    with every residual divided by one minus its leverage, as the fit is nearest where it leans most
    (MacKinnon and White 1985).

    Raises
    ------
    InvalidInput : if `lags` is negative, or there are no more lines than parameters.
    SolverFailed : if the search could not begin.
    """
    if not np.isfinite(fit.cost):
        raise SolverFailed(f"no covariance without a fit: {fit.message}")
    problem = problem_of(fit)
    positions, frequencies = fit.estimate.response.shape[:2]
    p, lines = len(fit.parameters), positions * frequencies
    window = int(4 * (frequencies / 100) ** (2 / 9)) if lags is None else lags
    if window < 0 or lines <= p:
        raise InvalidInput(
            f"covariance: {window} lags, {lines} lines for {p} parameters; an empirical covariance "
            "needs lags >= 0 and more lines than parameters"
        )
    error, slope = problem.evaluate(fit.parameters.values)
    known = 0 if fit.prior is None else len(fit.prior.names)
    error, slope = error[: len(error) - known], slope[: len(error) - known]
    _, first, second = problem.robust(error**2)
    bread = 2 * (slope.T * (first + 2 * second * error**2)) @ slope
    parts = 1 if problem.kind.real else 2
    leverage = np.einsum("rp,pq,rq->r", slope, 2 * np.linalg.pinv(bread, hermitian=True), slope)
    shrunk = error / (1 - np.clip(first * leverage, 0.0, 0.99))
    scores = 2 * slope * (first * shrunk)[:, None]
    by_line = scores.reshape(parts, positions, frequencies, -1, p).sum(axis=(0, 3))
    meat = np.einsum("qfi,qfj->ij", by_line, by_line)
    for lag in range(1, min(window, frequencies - 1) + 1):
        pairs = np.einsum("qfi,qfj->ij", by_line[:, :-lag], by_line[:, lag:])
        meat += (1 - lag / (window + 1)) * (pairs + pairs.T)
    return bread, meat


def informative_lines(fit: "Fit") -> Array:
    """Return how many lines carry the information on each parameter, (p,).

    A line is a frequency in one position. The number is one over the sum of the squared shares
    that lines have in the parameter's diagonal element of the bread: n for n equal ones.
    """
    positions, frequencies = fit.estimate.response.shape[:2]
    known = 0 if fit.prior is None else len(fit.prior.names)
    problem = problem_of(fit)
    _, slope = problem.evaluate(fit.parameters.values)
    parts = 1 if problem.kind.real else 2
    square = slope[: len(slope) - known] ** 2
    by_line = square.reshape(parts, positions * frequencies, -1, slope.shape[1]).sum(axis=(0, 2))
    total = by_line.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total**2 / (by_line**2).sum(axis=0))


def reduced_cost(fit: "Fit") -> float:
    """Return the cost over what the estimate's covariance lets expect: one if all is as stated.

    Raises
    ------
    InvalidInput, SolverFailed : as `expected_cost`.
    """
    return float(fit.data_cost / expected_cost(fit))


def expected_cost(fit: "Fit") -> float:
    """Return the expectation of the cost's data part V after the fit, if all is as stated.

    It is sum tr(W R) (half of it for real residuals) minus what the fitted parameters take away,
    p/2 for optimal weights.

    Raises
    ------
    InvalidInput : for a robust loss, whose cost is no sum of squares.
    SolverFailed : if the search could not begin.
    """
    if fit.loss != "linear":
        raise InvalidInput(f"reduced cost: loss {fit.loss!r}; it is defined for 'linear' only")
    bread, meat = sandwich_parts(fit)
    names = fit.parameters.names
    known = np.zeros_like(bread) if fit.prior is None else fit.prior.information(names)
    inverse = np.linalg.pinv(bread + known, hermitian=True)
    taken = np.trace(inverse @ meat)
    given = np.trace(inverse @ bread @ inverse @ (meat + known)) / 2
    estimate, values = fit.estimate, fit.parameters.values
    G = np.asarray(frequency_response(fit.model, estimate.positions, estimate.omega, values))
    expected = float(problem_of(fit).expected_squares(G).sum())
    return float(expected - taken + given)


def loss_factors(loss: str) -> tuple[float, float]:
    """Return E[rho' + 2 z rho''] and E[z rho'^2] with z = u^2 of a normal u.

    By these a robust loss scales bread and meat where the noise is normal; one and one for
    "linear".
    """
    u = np.linspace(-10.0, 10.0, 20001)
    density = np.exp(-(u**2) / 2)
    density /= density.sum()
    _, first, second = LOSSES[loss](u**2)
    return float(density @ (first + 2 * u**2 * second)), float(density @ (u * first) ** 2)
