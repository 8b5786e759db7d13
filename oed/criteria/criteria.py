"""Criteria: functions of the information matrix that a design maximises.

`optimal_design` and `exact_design` take the names "D", "A" and "E", or one of the objects below.
A criterion is anything with a name that can state its `Objective` for given parameters; value,
gradient, solvers and certificates are written once, for objectives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from oed.criteria.matrix_means import Kind, MatrixMean
from oed.criteria.objective import Objective, Term
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput, check_word, nearest
from robotmodels.common.symmetric_matrices import ROUNDING, unit_diagonal_scaling


@runtime_checkable
class Criterion(Protocol):
    """Protocol of a design criterion."""

    @property
    def name(self) -> str:
        """What reports call it."""

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the function of the information for these p parameters, `samples` of theta."""


def _plain(kind: Kind) -> Objective:
    return Objective(kind, ((Term(MatrixMean(kind)),),))


# D: the volume of the confidence ellipsoid, whatever the units; A: the sum of the variances;
# E: the most uncertain combination of the parameters.
CRITERIA: dict[str, Objective] = {kind: _plain(kind) for kind in ("D", "A", "E")}


@dataclass(frozen=True, eq=False)
class CCriterion:
    """The variance of one combination of the parameters, $c^T M^-1 c$.

    Attributes
    ----------
    vector : ndarray, (p,)
        Vector.
    """

    vector: Array
    name: str = "c"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return minus c' M^-1 c.

        Raises
        ------
        InvalidInput
            If the vector does not fit the names, or is zero.
        """
        c = real_numbers(self.vector, "criterion c: vector")
        if c.shape != (len(names),) or not np.isfinite(c).all() or not c.any():
            raise InvalidInput(
                f"criterion c: vector of shape {c.shape}; {len(names)} finite numbers, one for "
                "each parameter and not all zero, are needed"
            )
        return Objective(self.name, ((Term(MatrixMean("A", c[:, None])),),))


@dataclass(frozen=True)
class DsCriterion:
    """The volume of the confidence ellipsoid of some parameters; the others are nuisance.

    It is $det(B^T M^-1 B)^(1/2)$ up to a factor, with the unit vectors B of these parameters.

    Attributes
    ----------
    interest : tuple of str
        Names of the parameters of interest.
    """

    interest: tuple[str, ...]
    name: str = "D_s"
    kind: ClassVar[Kind] = "D"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return minus the log determinant of their block of the covariance.

        Raises
        ------
        InvalidInput
            If a name is unknown or repeated, or there is none.
        """
        return Objective(self.name, ((Term(MatrixMean(self.kind, self._selector(names))),),))

    def _selector(self, names: Sequence[str]) -> Array:
        """Return the unit vectors of the parameters of interest, (p, s)."""
        interest = (self.interest,) if isinstance(self.interest, str) else tuple(self.interest)
        if not interest or len(set(interest)) != len(interest):
            raise InvalidInput(
                f"criterion {self.name}: interest {interest!r}; distinct names needed"
            )
        for name in interest:
            check_word(f"criterion {self.name}: parameter", name, names)
        return np.asarray(np.eye(len(names))[:, [list(names).index(name) for name in interest]])


@dataclass(frozen=True)
class AsCriterion(DsCriterion):
    """The sum of the variances of some parameters, $tr(B^T M^-1 B)$; the others are nuisance."""

    name: str = "A_s"
    kind: ClassVar[Kind] = "A"


@dataclass(frozen=True)
class LargestVarianceCriterion(DsCriterion):
    """The largest variance of some parameters, the others nuisance: a maximin of information.

    1/variance of the stiffness of a spring that may be there is the squared size of its test.
    """

    name: str = "maximin"
    kind: ClassVar[Kind] = "A"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the least of the variances' inverses; errors: see `DsCriterion`."""
        columns = self._selector(names).T[..., None]
        groups = tuple((Term(MatrixMean(self.kind, column)),) for column in columns)
        return Objective(self.name, groups, (0.0,) * len(groups))


@dataclass(frozen=True, eq=False)
class ICriterion:
    """The mean variance of predictions, $tr(L M^-1)$.

    Attributes
    ----------
    matrix : ndarray
        L, (p, p), the mean of g g' over the predictions' gradients g by the parameters; see
        `prediction_matrix`.
    """

    matrix: Array
    name: str = "I"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return minus tr(L M^-1).

        Raises
        ------
        InvalidInput
            If L does not fit the names, or is not symmetric, positive semidefinite.
        """
        L, p = real_numbers(self.matrix, "criterion I: matrix"), len(names)
        if L.shape != (p, p) or not np.isfinite(L).all():
            raise InvalidInput(
                f"criterion I: matrix of shape {L.shape}; finite numbers of shape {(p, p)} needed"
            )
        # Of unit diagonal: units differ, and so much that small ones would be taken for rounding.
        s = unit_diagonal_scaling(L)
        scaled = s[:, None] * L * s
        eigenvalues, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        small = ROUNDING * len(L)
        missing = bool(np.abs(L[s == 0]).max(initial=0.0) > 0)
        if missing or eigenvalues[0] < -small or abs(scaled - scaled.T).max() > 1e3 * small:
            raise InvalidInput(
                "criterion I: the matrix is not symmetric, positive semidefinite and nonzero; "
                "`prediction_matrix` makes one from gradients"
            )
        used = eigenvalues > small
        units = np.divide(1.0, s, out=np.zeros_like(s), where=s > 0)
        root = units[:, None] * vectors[:, used] * np.sqrt(eigenvalues[used])
        return Objective(self.name, ((Term(MatrixMean("A", root)),),))


@dataclass(frozen=True, eq=False)
class MixtureCriterion:
    """A compromise: the product of efficiencies, each to the power of its share.

    Attributes
    ----------
    criteria : sequence of str or Criterion
        The criteria.
    shares : sequence of float or None
        Shares of each, positive; they are scaled to sum to one. Equal if None.
    """

    criteria: Sequence[str | Criterion]
    shares: Sequence[float] | None = None

    @property
    def name(self) -> str:
        """The names of its parts."""
        return " + ".join(c if isinstance(c, str) else c.name for c in self.criteria)

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the shared sum of the parts' log values.

        Raises
        ------
        InvalidInput
            If there is no part, shares do not fit, or a part is a maximin.
        """
        if not len(self.criteria):
            raise InvalidInput("criterion mixture: criteria: none given; at least one is needed")
        parts = [objective_of(c, names, samples) for c in self.criteria]
        shares = checked_shares(self.shares, len(parts), f"criterion {self.name}")
        for part in parts:
            if len(part.groups) > 1:
                raise InvalidInput(
                    f"criterion {self.name}: {part.name} cannot be part of a mixture"
                )
        terms = tuple(
            Term(term.mean, share * term.share, term.sample)
            for part, share in zip(parts, shares, strict=True)
            for term in part.groups[0]
        )
        return Objective(self.name, (terms,))


def objective_of(criterion: str | Criterion, names: Sequence[str], samples: int = 1) -> Objective:
    """Return the objective of a criterion, or of a criterion's name.

    With several samples of theta a criterion that knows nothing of them is averaged over them, as
    by `AverageCriterion`: the geometric mean of its efficiencies.

    Raises
    ------
    InvalidInput
        If there is no criterion of that name, or it does not fit the parameters.
    """
    if not isinstance(criterion, str | Criterion):
        raise InvalidInput(f"criterion {criterion!r} is neither a name nor a criterion")
    single = (
        named_criterion(criterion)
        if isinstance(criterion, str)
        else criterion.objective(names, samples)
    )
    unaware = len(single.groups) == 1 and all(term.sample == 0 for term in single.terms)
    unaware = unaware and not single.one_sample
    return averaged(single, np.full(samples, 1.0 / samples)) if unaware and samples > 1 else single


def averaged(one: Objective, shares: Array) -> Objective:
    """Return the mean of an objective of one sample of theta over samples with these shares."""
    group = tuple(
        Term(term.mean, float(share) * term.share, k)
        for k, share in enumerate(shares)
        for term in one.groups[0]
    )
    return Objective(one.name, (group,))


def named_criterion(name: str) -> Objective:
    """Return the criterion of that name.

    Raises
    ------
    InvalidInput
        If there is none.
    """
    if name not in CRITERIA:
        raise InvalidInput(
            f"criterion {name!r} is not known{nearest(name, CRITERIA)}; "
            f"there are {', '.join(CRITERIA)}, and objects such as CCriterion"
        )
    return CRITERIA[name]


def checked_shares(shares: Sequence[float] | None, count: int, what: str) -> Array:
    """Return `count` positive shares that sum to one.

    Raises
    ------
    InvalidInput
        Starting with `what`, if there are not as many, or one is not positive.
    """
    if count == 0:
        raise InvalidInput(f"{what}: at least one is needed")
    array = np.ones(count) if shares is None else real_numbers(shares, f"{what}: shares")
    if array.shape != (count,) or not (np.isfinite(array) & (array > 0)).all():
        raise InvalidInput(f"{what}: shares {shares!r}; {count} positive numbers are needed")
    return np.asarray(array / array.sum())
