"""Matrix means and their polars as convex expressions of cvxpy.

Solvers want numbers of order one, and the cone of the logarithm stalls where its argument is small:
every mean is divided by a guess of its value.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from oed.design.matrix_means import MatrixMean

# Larger determinants fall apart into smaller ones: cvxpy states one of p rows by a cone of 2p.
_LARGEST_DETERMINANT = 8
# Columns of the combinations in one cone: more make it large, fewer make too many.
_COLUMNS = 9


@dataclass(frozen=True, eq=False)
class ConicMean:
    """The logarithm of a mean, or of its polar, is power * log(size) + shift.

    Attributes
    ----------
    constraints : sequence of Any
        Constraints that make `size` what it is.
    size : Any
        Concave expression, for D the logarithm itself.
    power, shift : float
        Numbers; power is 0 where `size` is the logarithm already.
    slopes : sequence of Any
        Constraints of which the duals' leading (p, p) blocks sum to the derivative.
    """

    constraints: Sequence[Any]
    size: Any
    power: float
    shift: float
    slopes: Sequence[Any] = ()

    def log(self, cp: Any) -> Any:
        """Return the logarithm, a concave expression."""
        return self.shift + (self.power * cp.log(self.size) if self.power else self.size)


def conic_mean(cp: Any, mean: MatrixMean, information: Any, guess: float) -> ConicMean:
    """Return a mean of an affine (p, p) expression.

    det(C)^(-1/m): det(S)^(1/m) of the largest S with M >= B S B'; 1/tr C: the largest s with
    [[M, s B_k], [s B_k', V_k]] >= 0 for all columns B_k of B, sum_k tr V_k <= s; E: the largest s
    with M >= s B B'.

    Parameters
    ----------
    guess : float
        Guess of the mean's logarithm.
    """
    B = mean.combinations
    p = information.shape[0]
    unit = float(np.exp(guess - mean.offset))
    if mean.kind == "D":
        if B is None:
            more, log = log_det(cp, information)
            return ConicMean(more, log / p, 0.0, mean.offset)
        m = B.shape[1]
        S = cp.Variable((m, m), PSD=True)
        above = information - (unit * B) @ S @ B.T >> 0
        more, log = log_det(cp, S)
        return ConicMean([above, *more], log / m, 0.0, guess, [above])
    B = np.eye(p) if B is None else B
    s = cp.Variable()
    if mean.kind == "E":
        above = information - (unit * s) * (B @ B.T) >> 0
        return ConicMean([above], s, 1.0, guess, [above])
    blocks, total = [], 0.0
    for columns in np.array_split(np.sqrt(unit) * B, -(-B.shape[1] // _COLUMNS), axis=1):
        V = cp.Variable((columns.shape[1],) * 2, symmetric=True)
        blocks.append(cp.bmat([[information, s * columns], [s * columns.T, V]]) >> 0)
        total = total + cp.trace(V)
    return ConicMean([*blocks, total <= s], s, 1.0, guess, blocks)


def conic_polar(cp: Any, mean: MatrixMean, weight: Any, guess: float) -> ConicMean:
    """Return a mean's polar, see `MatrixMean.log_polar`.

    Parameters
    ----------
    weight : Any, (p, p)
        Expression, W times the exponential of `guess`.
    guess : float
        Guess of the mean's logarithm.
    """
    B = mean.combinations
    unit = float(np.exp(0.5 * mean.offset))
    inner = weight if B is None else B.T @ weight @ B
    m = inner.shape[0]
    if mean.kind == "D":
        more, log = log_det(cp, inner)
        return ConicMean(more, log / m, 0.0, float(np.log(m)) - mean.offset - guess)
    if mean.kind == "E":
        return ConicMean([], cp.trace(inner) / unit**2, 1.0, -guess)
    # tr X^(1/2) is the largest trace of Y with [[X, Y], [Y', I]] >= 0.
    Y = cp.Variable((m, m))
    block = cp.bmat([[inner / unit**2, Y], [Y.T, np.eye(m)]])
    return ConicMean([block >> 0], cp.trace(Y), 2.0, -guess)


def log_det(cp: Any, matrix: Any) -> tuple[list[Any], Any]:
    """Return constraints and the log determinant of a symmetric (p, p) expression.

    det X = det A det S with A the leading block and S its Schur complement, the largest matrix that
    may be taken from the other diagonal block: one cone of (p, p) and two smaller determinants.
    """
    p = matrix.shape[0]
    if p <= _LARGEST_DETERMINANT:
        return [], cp.log_det(matrix)
    half = p // 2
    S = cp.Variable((p - half, p - half), symmetric=True)
    E = np.eye(p)[:, half:]
    first, log_a = log_det(cp, matrix[:half, :half])
    second, log_s = log_det(cp, S)
    return [matrix - E @ S @ E.T >> 0, *first, *second], log_a + log_s
