"""What a design maximises: the worst of some groups of shared logarithms of matrix means.

Every criterion of this package is of that form. With terms j of shares a_j that sum to one in each
group g, and references r_g,

    log value = min_g [ sum_j a_j log f_j(M) - log r_g ],

one group of one term being the usual criteria, one group of several terms a mixture or an average
over samples of theta, several groups a maximin. M is one matrix, (p, p), or one for each sample of
theta, (K, p, p). Like its terms, the value is concave and proportional to M, so that ratios of
values are efficiencies: half the efficiency takes twice the experiments.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from oed.criteria.matrix_means import MatrixMean, inverse_root, log_values
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.deprecation import renamed_attributes

# (p, p), (K, p, p), or one matrix for each of K samples of theta.
KINDS = ("average", "maximin")
"""How samples of theta count: on average, or at worst."""

Information = Array | Sequence[Array]


@dataclass(frozen=True, eq=False)
class Term:
    """A matrix mean of one sample's information, with its share in its group."""

    mean: MatrixMean
    share: float = 1.0
    sample: int = 0


@renamed_attributes("0.2", price="summed_by_sample")
@dataclass(frozen=True, eq=False)
class Objective:
    """A criterion ready for numbers; greater is better.

    Attributes
    ----------
    name : str
        What users call it.
    groups : tuple of tuple of Term
        Terms of each group; their shares sum to one.
    references : tuple of float or None
        log r_g of each group; zeros if None.
    one_sample : bool
        Whether it is that of one sample of theta on purpose, so that it is not averaged over all.
    """

    name: str
    groups: tuple[tuple[Term, ...], ...]
    references: tuple[float, ...] | None = None
    one_sample: bool = False

    def value(self, information: Array) -> float:
        """Return the criterion in its usual form, -inf if a combination is undetermined.

        D: $log det M$; D_s: $-log det C$, C the covariance of what is of interest; A: $-tr M^-1$,
        c and I likewise of their combinations; E: $lambda_min(M)$; all others: the log value.
        """
        return self.usual_form(self.log_value(information), information.shape[-1])

    def usual_form(self, log_value: float, p: int) -> float:
        """Return the criterion in its usual form, of its log value for p parameters."""
        if not self._plain:
            return log_value
        mean = self.terms[0].mean
        if mean.kind == "D":
            return log_value * (p if mean.combinations is None else mean.combinations.shape[1])
        with np.errstate(over="ignore"):
            return float(-np.exp(-log_value) if mean.kind == "A" else np.exp(log_value))

    def gradient(self, information: Array) -> Array:
        """Return the derivative of `value` by M, of M's shape; not finite where M is singular.

        Where groups tie, or E's smallest eigenvalue is multiple, it is one of several.
        """
        log_gradient = self.log_gradient(information)
        if not self._plain:
            return log_gradient
        mean, factor = self.terms[0].mean, abs(self.value(information))
        if mean.kind == "D":
            B = mean.combinations
            factor = information.shape[-1] if B is None else B.shape[1]
        return np.asarray(log_gradient * factor)

    def log_value(self, information: Information) -> float:
        """Return the logarithm of a value that is proportional to the information."""
        return float((self.group_values(information) - self.log_references).min())

    def log_values_of_roots(self, inverse_roots: Array) -> Array:
        """Return the log values (...) for one sample's M^-1 = T'T, T (..., p, p)."""
        logs = log_values([term.mean for term in self.terms], inverse_roots)
        return np.asarray((self.shared(logs) - self.log_references).min(axis=-1))

    def efficiency(self, information: Array, reference: Array) -> float:
        """Return the ratio of the values: the share of experiments `reference` would need."""
        value, best = self.log_value(information), self.log_value(reference)
        return float(np.exp(value - best)) if value > -np.inf else 0.0

    def group_values(self, information: Information) -> Array:
        """Return sum_j a_j log f_j(M) of each group, (G,)."""
        stack, logs = samples(information), np.empty(len(self.terms))
        for k, indices in self.by_sample.items():
            M, means = stack[k], [self.terms[i].mean for i in indices]
            T = inverse_root(M)
            logs[indices] = (
                [mean.log_value(M) for mean in means] if T is None else log_values(means, T)
            )
        return self.shared(logs)

    def shared(self, logs: Array) -> Array:
        """Return sums of the terms' logarithms (..., t) by shares in each group, (..., G)."""
        starts = np.searchsorted(self.owners, np.arange(len(self.groups)))
        return np.asarray(np.add.reduceat(logs * self.shares, starts, axis=-1))

    def witness(
        self, information: Information, multipliers: Array | None = None
    ) -> tuple[Array, ...]:
        """Return the derivative of each term times its share and its group's multiplier.

        The multipliers (G,) sum to one; by default the worst group has them all.
        """
        if multipliers is None:
            worst = np.argmin(self.group_values(information) - self.log_references)
            multipliers = np.eye(len(self.groups))[worst]
        stack = samples(information)
        return tuple(
            factor * t.share * t.mean.log_gradient(stack[t.sample])
            if factor > 0
            else np.zeros_like(stack[t.sample])
            for group, factor in zip(self.groups, multipliers, strict=True)
            for t in group
        )

    def log_gradient(self, information: Array) -> Array:
        """Return the derivative of `log_value` by M, of M's shape, as `gradient`."""
        return self.summed_by_sample(self.witness(information), information.shape)

    def summed_by_sample(self, witness: Sequence[Array], shape: tuple[int, ...]) -> Array:
        """Return the sum of a witness's matrices for each sample, of the information's shape."""
        total = np.zeros(shape)
        stack = total.reshape(-1, *shape[-2:])
        for term, W in zip(self.terms, witness, strict=True):
            stack[term.sample] += W
        return total

    def log_polar(self, witness: Sequence[Array]) -> float:
        """Return the log of c with  sum_j tr(W_j M) >= c value(M)  for every M.

        So the largest sum_j tr(W_j M) over all designs, divided by c, bounds every value. By the
        inequality of the means c = sum_g r_g prod_j (polar_j(W_j) / a_j)^a_j.
        """
        polars, matrices = [], iter(witness)
        for group, reference in zip(self.groups, self.log_references, strict=True):
            parts = [(t, next(matrices)) for t in group]
            if any(not W.any() for _, W in parts):
                polars.append(-np.inf)
                continue
            polar = sum(t.share * (t.mean.log_polar(W) - np.log(t.share)) for t, W in parts)
            polars.append(reference + polar)
        return float(logsumexp(polars))

    def objective(self, names: Sequence[str], samples: int = 1) -> "Objective":
        """Return itself: an objective serves as a criterion too."""
        return self

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """All terms, in the order of the groups."""
        return tuple(term for group in self.groups for term in group)

    @cached_property
    def owners(self) -> IntArray:
        """Group of each term."""
        return np.repeat(np.arange(len(self.groups)), [len(group) for group in self.groups])

    @cached_property
    def shares(self) -> Array:
        """Share of each term in its group."""
        return np.array([term.share for term in self.terms])

    @cached_property
    def by_sample(self) -> dict[int, list[int]]:
        """Indices of the terms of each sample that there are terms of."""
        indices: dict[int, list[int]] = {}
        for i, term in enumerate(self.terms):
            indices.setdefault(term.sample, []).append(i)
        return indices

    @property
    def log_references(self) -> Array:
        """The logarithms log r_g, (G,)."""
        return np.array(self.references or (0.0,) * len(self.groups))

    @property
    def smooth(self) -> bool:
        """Whether every term has second derivatives."""
        return all(term.mean.kind != "E" for term in self.terms)

    @property
    def _plain(self) -> bool:
        return len(self.terms) == 1 and self.references is None


def samples(information: Information) -> Sequence[Array]:
    """Return the information of each sample of theta; a single matrix is that of one sample."""
    if isinstance(information, np.ndarray):
        return (information,) if information.ndim == 2 else tuple(information)
    return information
