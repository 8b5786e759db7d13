"""Which uncertainty to believe: every method side by side, and a verdict by stated rules."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.uncertainty.cross_check_rules import (
    AGREE,
    MODEL_ERROR,
    NOT_IDENTIFIABLE,
    SKEWED,
    Evidence,
    flat_evidence,
    model_evidence,
    skew_evidence,
)
from robotmodels.arrays import Array, read_only
from robotmodels.errors import InvalidInput
from robotmodels.notebook import Printed

if TYPE_CHECKING:
    from estimators.uncertainty.covariance import Uncertainty
    from estimators.uncertainty.importance import ImportanceSample
    from estimators.uncertainty.monte_carlo import MonteCarlo
    from estimators.uncertainty.posterior import Posterior
    from estimators.uncertainty.profile import Profile

VERDICTS = (NOT_IDENTIFIABLE, MODEL_ERROR, SKEWED, AGREE)


@dataclass(frozen=True, eq=False)
class CrossCheck(Printed):
    """A table of standard deviations of ln theta, and what to make of it.

    Attributes
    ----------
    names : p parameters.
    values : (p,) fitted [SI].
    methods : k columns, in order.
    stds : (k, p); not a number where a method says nothing about a parameter.
    verdicts : one of `VERDICTS` for each parameter.
    evidence : for each parameter what led to its verdict; empty where methods agree.
    notes : what concerns all parameters, and methods that were left out.
    covering : methods whose intervals cover the truth often enough in repeated experiments; None
        if there were none.
    """

    names: tuple[str, ...]
    values: Array
    methods: tuple[str, ...]
    stds: Array
    verdicts: tuple[str, ...]
    evidence: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]
    covering: tuple[str, ...] | None

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        columns = [max(len(method), 9) for method in self.methods]
        head = "  ".join(f"{m:>{c}}" for m, c in zip(self.methods, columns, strict=True))
        lines = [f"{'':<{width}}  {head}  verdict"]
        for i, name in enumerate(self.names):
            row = "  ".join(
                f"{'' if np.isnan(s) else f'{s:.4g}':>{c}}"
                for s, c in zip(self.stds[:, i], columns, strict=True)
            )
            why = f": {'; '.join(self.evidence[i])}" if self.evidence[i] else ""
            lines.append(f"{name:<{width}}  {row}  {self.verdicts[i]}{why}")
        lines += self.notes
        if self.covering is not None:
            lines.append(f"still cover the truth: {', '.join(self.covering) or 'none'}")
        return "\n".join(lines)


def cross_check(
    fit: Fit,
    *,
    theorem1: "Uncertainty | None" = None,
    empirical: "Uncertainty | None" = None,
    posterior: "Posterior | None" = None,
    importance: "ImportanceSample | None" = None,
    profiles: "Sequence[Profile]" = (),
    monte_carlo: "MonteCarlo | None" = None,
    multistart: Sequence[Fit] = (),
    blocks: int | None = None,
) -> CrossCheck:
    """Return what the methods say of each parameter, and the verdict of the first rule that holds.

    1. "not identifiable": the data do not bound the parameter. Theorem 1 has no covariance; or a
       profile is flat on a side; or the posterior reaches a bound of the fit; or a standard
       deviation of ln theta exceeds one e-fold.
    2. "model error suspected": the model does not describe the data to within the noise. The cost
       is larger than noise can explain, with a probability below 1e-3, and the empirical sandwich,
       if there is one, is wider than Theorem 1 by half; or intervals of repeated experiments cover
       the truth too seldom; or good fits from many starts scatter more than Theorem 1 allows.
    3. "posterior skewed": normal intervals are wrong although the model is right. A profile's ends
       lie at distances that differ by a quarter, or the posterior's skewness exceeds a half, or
       its width differs by a quarter from Theorem 1's, times what the weights alone make of it.
    4. "agree".

    The constants and their reasons are in `estimators.uncertainty.cross_check_rules`. Chains that
    have not converged and importance weights that are not trusted are left out, and noted.

    Parameters
    ----------
    fit : what is judged.
    theorem1, empirical : `covariance(fit)` and `covariance(fit, "empirical")`; Theorem 1 is
        computed if not given.
    posterior, importance, profiles, monte_carlo : of the same fit, as far as computed.
    multistart : fits from many starts.
    blocks : that the estimate's covariance was made from; None if it is known exactly.

    Raises
    ------
    InvalidInput : if a method is about other parameters, or there are too few blocks.
    """
    names = fit.parameters.names
    for one in (theorem1, empirical, posterior, importance, monte_carlo):
        if one is not None and one.names != names:
            raise InvalidInput(
                f"cross-check: {type(one).__name__} is about {', '.join(one.names)}, the fit "
                f"about {', '.join(names)}"
            )
    left_out = _left_out(posterior, importance)
    found = Evidence(
        fit, theorem1, empirical,
        posterior if posterior is None or posterior.converged else None,
        importance if importance is None or importance.trusted else None,
        tuple(profiles), monte_carlo, tuple(multistart), blocks,
    )  # fmt: skip
    table = found.table()
    judged = [_judged(found, i) for i in range(len(names))]
    return CrossCheck(
        names=names,
        values=fit.parameters.values,
        methods=tuple(table),
        stds=read_only(np.array(list(table.values())).reshape(len(table), len(names))),
        verdicts=tuple(verdict for verdict, _ in judged),
        evidence=tuple(why for _, why in judged),
        notes=(*left_out, *found.notes()),
        covering=found.covering(),
    )


def _left_out(
    posterior: "Posterior | None", importance: "ImportanceSample | None"
) -> tuple[str, ...]:
    """Return why what was computed is not to be trusted."""
    notes = []
    if posterior is not None and not posterior.converged:
        notes.append(f"posterior left out: {posterior.message}")
    if importance is not None and not importance.trusted:
        notes.append(f"importance sampling left out: Pareto k {importance.pareto_k:.2f}")
    return tuple(notes)


def _judged(found: Evidence, i: int) -> tuple[str, tuple[str, ...]]:
    """Return the verdict on parameter i and its evidence, by the first rule that holds."""
    for verdict, rule in (
        (NOT_IDENTIFIABLE, flat_evidence),
        (MODEL_ERROR, model_evidence),
        (SKEWED, skew_evidence),
    ):
        why = rule(found, i)
        if why:
            return verdict, tuple(why)
    return AGREE, ()
