"""Designs that hold for a sample of parameter values, not for one guess only.

Information depends on the parameters that an experiment is to find. With samples of theta, drawn
from what is believed before, a design can be good on average (pseudo-Bayesian) or at worst
(maximin), and its efficiency against the best design of each sample is the price of that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from oed.criteria.criteria import Criterion, objective_of
from oed.criteria.objective import KINDS
from oed.criteria.robust_criteria import AverageCriterion, MaximinCriterion
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.information_sets.candidates import Candidates, InformationSamples
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.common.printing import ReprHtml


@dataclass(frozen=True, eq=False)
class RobustDesign(ReprHtml):
    """A robust design beside the nominal one.

    Attributes
    ----------
    design : Design
        The robust design.
    nominal : Design
        The best design for the first sample.
    efficiency : ndarray, (K,)
        Efficiency of the robust design against the best one of each sample.
    nominal_efficiency : ndarray, (K,)
        Nominal efficiency of the nominal design.
    """

    design: Design
    nominal: Design
    efficiency: Array
    nominal_efficiency: Array

    def __str__(self) -> str:
        robust = ", ".join(f"{value:.3f}" for value in self.efficiency)
        nominal = ", ".join(f"{value:.3f}" for value in self.nominal_efficiency)
        return (
            f"{self.design}\n  keeps at each sample {robust}\n  the nominal design keeps {nominal}"
        )


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
        Options of `optimal_design`; its solver computes the robust design; the best designs of
        the samples come from the fastest solver that takes the criterion.

    Raises
    ------
    InvalidInput
        If `kind` is unknown, or samples do not fit; and what `optimal_design` raises.
    """
    check_word("kind", kind, KINDS)
    if kind == "maximin" and shares is not None:
        raise InvalidInput('shares: they weigh an average; kind "maximin" has none')
    if not isinstance(samples, InformationSamples):
        samples = InformationSamples(tuple(samples))
    base = objective_of(criterion, samples.names)
    # They are only compared with: whoever finds them, the certificate is the same.
    fast = options | {"solver": "auto", "form": None}
    local = [optimal_design(one, criterion, **fast) for one in samples.sets]
    best = [base.log_value(design.information) for design in local]
    robust_criterion: Criterion = AverageCriterion(criterion, shares)
    if kind == "maximin":
        robust_criterion = MaximinCriterion(criterion, best)
    design = optimal_design(samples, robust_criterion, **options)
    prior = design.information - samples.combined(design.weights)
    nominal = samples.combined(local[0].weights) + prior

    def efficiency(information: Array) -> Array:
        stack = information.reshape(-1, *information.shape[-2:])
        values = np.array([base.log_value(matrix) for matrix in stack])
        return read_only(np.exp(values - best))

    return RobustDesign(design, local[0], efficiency(design.information), efficiency(nominal))
