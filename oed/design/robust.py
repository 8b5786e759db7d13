"""Designs that hold for a sample of parameter values, not for one guess only.

Information depends on the parameters that an experiment is to find. With samples of theta, drawn
from what is believed before, a design can be good on average (pseudo-Bayesian) or at worst
(maximin), and its efficiency against each sample's own best design says what that costs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from oed.design.criteria import Criterion, averaged, checked_shares, objective
from oed.design.objective import Objective, Term
from oed.design.problem import Candidates, check_candidates
from oed.design.relaxed import Design, optimal_design
from robotmodels.arrays import Array, IntArray, read_only, real_numbers
from robotmodels.errors import InvalidInput, nearest
from robotmodels.notebook import Printed

KINDS = ("average", "maximin")


@dataclass(frozen=True, eq=False)
class InformationSamples:
    """The information of the same candidates for K values of the parameters.

    Attributes
    ----------
    sets : tuple of Candidates
        One set of candidates for each value, in memory or in a store; the first one is the nominal
        value's.

    Raises
    ------
    InvalidInput
        If there is none, or candidates or parameters differ.
    """

    sets: tuple[Candidates, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sets", tuple(self.sets))
        if not self.sets:
            raise InvalidInput("samples: no information set; at least one is needed")
        for k, other in enumerate(self.sets):
            check_candidates(other, f"samples: set {k}")
            if len(other) != len(self) or other.names != self.names or other.samples != 1:
                raise InvalidInput(
                    f"samples: set {k} has {len(other)} candidates and parameters "
                    f"{', '.join(other.names)}; set 0 has {len(self)} and {', '.join(self.names)}"
                )

    def __len__(self) -> int:
        return len(self.sets[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        return self.sets[0].names

    @property
    def samples(self) -> int:
        """The number K of parameter values."""
        return len(self.sets)

    @cached_property
    def matrices(self) -> Array:
        """All matrices, (Q, K, p, p), or (Q, p, p) of a single set."""
        return read_only(self.take(np.arange(len(self))))

    def take(self, indices: IntArray) -> Array:
        """Return matrices, (n, K, p, p), or (n, p, p) of a single set, as it does itself."""
        if self.samples == 1:
            return self.sets[0].take(indices)
        return np.stack([one.take(indices) for one in self.sets], axis=1)

    def prices(self, weight: Array) -> Array:
        """Return sum_k tr(W_k H_ik), (Q,), for W (K, p, p), or (p, p) of a single set."""
        parts = zip(self.sets, weight.reshape(-1, *weight.shape[-2:]), strict=True)
        return np.asarray(np.sum([one.prices(W) for one, W in parts], axis=0))

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_ik, (K, p, p), or (p, p) of a single set."""
        if self.samples == 1:
            return self.sets[0].combined(weights)
        return np.stack([one.combined(weights) for one in self.sets])


@dataclass(frozen=True, eq=False)
class AverageCriterion:
    """The geometric mean of a criterion's efficiencies over samples of theta (pseudo-Bayesian).

    Attributes
    ----------
    criterion : str or Criterion
        Criterion of each sample.
    shares : sequence of float or None
        Weight of each sample; equal if None.
    """

    criterion: str | Criterion = "D"
    shares: Sequence[float] | None = None

    @property
    def name(self) -> str:
        """What reports call it."""
        return f"average {_name(self.criterion)}"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the mean of the samples' log values.

        Raises
        ------
        InvalidInput
            If shares do not fit, or the criterion is robust already.
        """
        shares = checked_shares(self.shares, samples, f"criterion {self.name}")
        return replace(averaged(_of_one(self.criterion, names, self.name), shares), name=self.name)


@dataclass(frozen=True, eq=False)
class MaximinCriterion:
    """The worst of a criterion's values, or efficiencies, over samples of theta.

    Attributes
    ----------
    criterion : str or Criterion
        Criterion of each sample.
    references : sequence of float or None
        log value, see `Objective.log_value`, of each sample's own best design; the values
        themselves are compared if None. `robust_design` finds and uses them.
    """

    criterion: str | Criterion = "D"
    references: Sequence[float] | None = None

    @property
    def name(self) -> str:
        """What reports call it."""
        return f"maximin {_name(self.criterion)}"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the least of the samples' log values.

        Raises
        ------
        InvalidInput
            If references do not fit, or the criterion is robust already.
        """
        terms = _of_one(self.criterion, names, self.name).groups[0]
        groups = tuple(
            tuple(Term(term.mean, term.share, k) for term in terms) for k in range(samples)
        )
        if self.references is None:
            return Objective(self.name, groups)
        references = real_numbers(self.references, f"criterion {self.name}: references")
        if references.shape != (samples,) or not np.isfinite(references).all():
            raise InvalidInput(
                f"criterion {self.name}: references {references}; {samples} numbers are needed"
            )
        return Objective(self.name, groups, tuple(references.tolist()))


@dataclass(frozen=True, eq=False)
class RobustDesign(Printed):
    """A robust design beside the nominal one.

    Attributes
    ----------
    design : Design
        The robust design.
    nominal : Design
        The best design for the first sample.
    efficiency : ndarray, (K,)
        Efficiency of the robust design against each sample's own best one.
    nominal_efficiency : ndarray, (K,)
        Nominal efficiency of the nominal design.
    """

    design: Design
    nominal: Design
    efficiency: Array
    nominal_efficiency: Array

    def __str__(self) -> str:
        kept = ", ".join(f"{value:.3f}" for value in self.efficiency)
        nominal = ", ".join(f"{value:.3f}" for value in self.nominal_efficiency)
        return f"{self.design}\n  keeps at each sample {kept}\n  the nominal design keeps {nominal}"


def robust_design(
    samples: InformationSamples | Sequence[Candidates],
    criterion: str | Criterion = "D",
    kind: str = "maximin",
    shares: Sequence[float] | None = None,
    **options: Any,
) -> RobustDesign:
    """Return the design that is best on average or at worst, and the efficiency at each sample.

    Parameters
    ----------
    samples : InformationSamples or sequence of Candidates
        Information of the same candidates for each theta; the first one is nominal.
    criterion : str or Criterion
        Criterion of each sample.
    kind : str
        "average", the geometric mean of efficiencies, or "maximin", the least of them.
    shares : sequence of float, optional
        Shares of each sample in the average.
    options : Any
        Options of `optimal_design`; its solver finds the robust design, the samples' own best ones
        are found by the fastest one that takes the criterion.

    Raises
    ------
    InvalidInput
        If `kind` is unknown, or samples do not fit; and what `optimal_design` raises.
    """
    if kind not in KINDS:
        raise InvalidInput(
            f"kind {kind!r} is not known{nearest(kind, KINDS)}; there are {', '.join(KINDS)}"
        )
    if kind == "maximin" and shares is not None:
        raise InvalidInput('shares: they weigh an average; kind "maximin" has none')
    if not isinstance(samples, InformationSamples):
        samples = InformationSamples(tuple(samples))
    base = objective(criterion, samples.names)
    # They are only compared with: whoever finds them, the certificate is the same.
    fast = options | {"solver": "newton"} if base.smooth else options
    local = [optimal_design(one, criterion, **fast) for one in samples.sets]
    best = [base.log_value(design.information) for design in local]
    wanted: Criterion = AverageCriterion(criterion, shares)
    if kind == "maximin":
        wanted = MaximinCriterion(criterion, best)
    design = optimal_design(samples, wanted, **options)
    prior = design.information - samples.combined(design.weights)
    nominal = samples.combined(local[0].weights) + prior

    def efficiency(information: Array) -> Array:
        stack = information.reshape(-1, *information.shape[-2:])
        values = np.array([base.log_value(matrix) for matrix in stack])
        return read_only(np.exp(values - best))

    return RobustDesign(design, local[0], efficiency(design.information), efficiency(nominal))


def _of_one(criterion: str | Criterion, names: Sequence[str], name: str) -> Objective:
    """Return a criterion of one sample."""
    if isinstance(criterion, AverageCriterion | MaximinCriterion):
        raise InvalidInput(f"criterion {name}: {criterion.name} is robust already")
    return objective(criterion, names)


def _name(criterion: str | Criterion) -> str:
    return criterion if isinstance(criterion, str) else criterion.name
