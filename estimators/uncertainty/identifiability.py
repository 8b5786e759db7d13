"""What data do not tell: weak directions in parameter names, and what would help."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.common.symmetric_matrices import scaled_inverse

# Relative standard deviation above which a direction counts as weak: a factor of 1.35 either way.
LIMIT = 0.3
# Wider than this many e-folds is not determined; it also makes singular matrices regular.
UNKNOWN = 1e3
# A direction belongs to the parameters that hold this share of its squared length.
SHARE = 0.9


@dataclass(frozen=True, eq=False)
class Advice:
    """One step towards parameters that data tell.

    Attributes
    ----------
    kind : str
        "fix" or "tie".
    names : tuple of str
        The parameter to fix, or those to tie.
    std : float, dimensionless
        Standard deviations of the direction that is weak without this step.
    text : str
        The step in words.
    """

    kind: str
    names: tuple[str, ...]
    std: float
    text: str


@dataclass(frozen=True, eq=False)
class Identifiability(ReprHtml):
    """Standard deviations and undetermined combinations of p parameters by their information.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    singular_values : ndarray, (p,)
        Singular values of the whitened Jacobian, largest first: one over the standard deviation of
        each direction of ln theta.
    directions : ndarray, (p, p)
        Unit vectors of ln theta in rows, in that order.
    std : ndarray, (p,)
        Standard deviations of each parameter; infinite without information.
    alone : ndarray, (p,)
        Of each parameter if all others were fixed.
    inflation : ndarray, (p, p)
        Factor by which freeing parameter j (row) widens parameter i (column); one on the
        diagonal.
    advice : tuple of Advice
        Steps after which no direction is weak, in order.
    limit : float
        Standard deviation above which a direction is weak.
    """

    names: tuple[str, ...]
    singular_values: Array
    directions: Array
    std: Array
    alone: Array
    inflation: Array
    advice: tuple[Advice, ...]
    limit: float

    @property
    def direction_std(self) -> Array:
        """Standard deviations of the directions, (p,), smallest first."""
        with np.errstate(divide="ignore"):
            std = 1 / self.singular_values
        return np.where(std < UNKNOWN / 2, std, np.inf)

    @property
    def price(self) -> Array:
        """What each free parameter costs, (p,): mean factor by which it widens the others."""
        p = len(self.names)
        with np.errstate(divide="ignore"):
            mean = np.exp(np.log(self.inflation).sum(axis=1) / max(p - 1, 1))
        return np.asarray(mean)

    def weak(self) -> tuple[str, ...]:
        """Return the weak directions in words, the weakest first."""
        order = np.argsort(-self.direction_std, kind="stable")
        return tuple(
            f"{in_names(self.directions[k], self.names)} is {_precision(self.direction_std[k])}"
            for k in order
            if self.direction_std[k] > self.limit
        )

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = [f"{'':<{width}}  {'std':>9}  {'alone':>9}  costs others"]
        for i, name in enumerate(self.names):
            lines.append(
                f"{name:<{width}}  {self.std[i]:9.3g}  {self.alone[i]:9.3g}  x {self.price[i]:.3g}"
            )
        lines += [f"weak: {text}" for text in self.weak()]
        lines += [step.text for step in self.advice]
        return "\n".join(lines)


def identifiability(
    information: Array, names: Sequence[str], limit: float = LIMIT
) -> Identifiability:
    """Return standard deviations and undetermined combinations by an information matrix (p, p).

    Parameters
    ----------
    information : ndarray
        Information of a fit (`fit_information`), a plan, or a position; it may be singular.
    names : sequence of str
        p parameters.
    limit : float
        Standard deviation above which a direction is weak.

    Raises
    ------
    InvalidInput
        If the matrix does not fit the names, is not finite or symmetric, or has a negative
        eigenvalue.
    """
    matrix = checked_information(information, len(names))
    values, vectors = np.linalg.eigh(matrix)
    covariance = bounded_inverse(matrix)
    std = np.sqrt(np.diag(covariance))
    with np.errstate(divide="ignore"):
        alone = 1 / np.sqrt(np.diag(matrix))
    correlation = covariance / np.outer(std, std)
    uncorrelated = np.maximum(1 - correlation**2, 1e-24)
    inflation = 1 / np.sqrt(uncorrelated)
    np.fill_diagonal(inflation, 1.0)
    return Identifiability(
        names=tuple(names),
        singular_values=read_only(np.sqrt(np.maximum(values[::-1], 0.0))),
        directions=read_only(_signed(vectors.T[::-1])),
        std=read_only(np.where(std < UNKNOWN / 2, std, np.inf)),
        alone=read_only(alone),
        inflation=read_only(inflation),
        advice=_advice(matrix, tuple(names), limit),
        limit=limit,
    )


def fit_information(fit: FittedModel) -> Array:
    """Return the information on ln theta at a fit, (p, p), its prior included.

    That of the noise's weights, whatever weights the fit has.

    Raises
    ------
    SolverFailed
        If the fit has no finite cost.
    """
    linear = fit.linearise()
    flat = linear.jacobian.reshape(-1, len(linear.names))
    weighted = linear.noise_weights.reshape(-1, 1) * flat
    return np.asarray(2 * (np.conj(flat).T @ weighted).real + linear.prior)


def in_names(direction: Array, names: Sequence[str]) -> str:
    """Return a direction (p,) of ln theta as a product of powers, small powers dropped."""
    size = np.round(np.abs(direction), 6)  # equal ones in the order of the names
    order = [i for i in np.argsort(-size, kind="stable") if size[i] > 0.2 * size.max()]
    return " ".join(f"{names[i]}^{direction[i]:+.2f}" for i in order)


def _precision(std: float) -> str:
    return f"determined to within {100 * std:.2g} %" if np.isfinite(std) else "not determined"


def _signed(directions: Array) -> Array:
    """Return directions whose largest component is positive."""
    largest = np.argmax(np.round(np.abs(directions), 6), axis=1)
    return np.asarray(directions * np.sign(directions[np.arange(len(largest)), largest])[:, None])


def checked_information(information: Array, p: int) -> Array:
    """Return an information matrix (p, p), made exactly symmetric.

    Raises
    ------
    InvalidInput
        As `identifiability`.
    """
    matrix = np.asarray(information, dtype=float)
    if matrix.shape != (p, p) or not np.isfinite(matrix).all():
        raise InvalidInput(
            f"information: shape {matrix.shape}, finite: {bool(np.isfinite(matrix).all())}; a "
            f"finite ({p}, {p}) matrix is needed"
        )
    size = np.abs(matrix).max()
    if not np.allclose(matrix, matrix.T, rtol=0, atol=1e-9 * size):
        raise InvalidInput("information: the matrix is not symmetric")
    lowest = np.linalg.eigvalsh(matrix)[0]
    if lowest < -1e-9 * size:
        raise InvalidInput(f"information: the eigenvalue {lowest:.3g} is negative")
    return np.asarray((matrix + matrix.T) / 2)


def bounded_inverse(matrices: Array) -> Array:
    """Return inverses (..., p, p); directions without information get the variance UNKNOWN^2."""
    regular = matrices + np.eye(matrices.shape[-1]) / UNKNOWN**2
    return scaled_inverse(regular)


def _advice(information: Array, names: tuple[str, ...], limit: float) -> tuple[Advice, ...]:
    """Return what to fix or tie until no direction is weak, one step at a time."""
    steps = []
    while len(names):
        values, vectors = np.linalg.eigh(information)
        std = min(1 / np.sqrt(max(values[0], UNKNOWN**-2)), UNKNOWN)
        if std <= limit:
            break
        step, remaining, mixing = _step(vectors[:, 0], names, std if std < UNKNOWN / 2 else np.inf)
        steps.append(step)
        information, names = mixing.T @ information @ mixing, remaining
    return tuple(steps)


def _step(
    direction: Array, names: tuple[str, ...], std: float
) -> tuple[Advice, tuple[str, ...], Array]:
    """Return a step against one weak direction, the other names, and d old / d new (p, p - 1)."""
    order = np.argsort(-np.round(np.abs(direction), 6), kind="stable")  # ties as the names are
    shares = np.cumsum(direction[order] ** 2)
    count = int(np.searchsorted(shares, SHARE)) + 1
    guilty = [names[i] for i in order[:count]]
    first = int(order[0])
    remaining = tuple(name for i, name in enumerate(names) if i != first)
    mixing = np.delete(np.eye(len(names)), first, axis=1)
    if count == 2 and direction[order[0]] * direction[order[1]] < 0 and _alike(*guilty):
        mixing[first, remaining.index(guilty[1])] = 1.0
        text = f"tie {guilty[0]} and {guilty[1]}: their ratio is {_precision(std)}"
        return Advice("tie", tuple(guilty), std, text), remaining, mixing
    quantity = guilty[0] if count == 1 else in_names(direction, names)
    text = f"fix {guilty[0]}, or measure it otherwise: {quantity} is {_precision(std)}"
    return Advice("fix", (guilty[0],), std, text), remaining, mixing


def _alike(first: str, second: str) -> bool:
    """Whether two parameters are of one kind, such as two stiffnesses."""
    return first.rpartition(".")[2] == second.rpartition(".")[2] or "." not in first + second
