"""What a fit's residuals say of its uncertainty: the empirical meat."""

from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.least_squares import problem_of
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, SolverFailed

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
    InvalidInput
        If `lags` is negative, or there are no more lines than parameters.
    SolverFailed
        If the search could not begin.
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
