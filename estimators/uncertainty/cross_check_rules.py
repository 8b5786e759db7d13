"""The rules of the cross-check, one function each: evidence in words, none if a rule is silent."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.levels import IMPROBABLE
from estimators.uncertainty.covariance import Uncertainty, covariance
from estimators.uncertainty.log_posterior import magnitude_adjustment
from estimators.uncertainty.misfit import Misfit, misfit
from estimators.uncertainty.model_error import informative_lines
from estimators.uncertainty.theorem_1 import sandwich_parts
from robotmodels.arrays import Array
from robotmodels.errors import NotIdentifiable

if TYPE_CHECKING:
    from estimators.uncertainty.importance import ImportanceSample
    from estimators.uncertainty.monte_carlo import MonteCarlo
    from estimators.uncertainty.posterior import Posterior
    from estimators.uncertainty.profile import Profile

NOT_IDENTIFIABLE = "not identifiable"
MODEL_ERROR = "model error suspected"
SKEWED = "posterior skewed"
AGREE = "agree"

# A standard deviation of one e-fold: a 95 % interval from a seventh to seven times the value.
E_FOLD = 1.0
# A posterior reaches a bound if its 99 % interval comes this close, in standard deviations.
NEAR_BOUND = 0.1
# The empirical sandwich scatters by a few tens of per cent of itself.
WIDER = 1.5
# A variance from n independent squares is uncertain by sqrt(2/n): a third, at so many lines.
FEW_LINES = 20
# Minima whose costs differ by less than the noise's one-sigma change of 2 V are equally good.
SAME_COST = 1.0
# Good fits a standard deviation and more apart are different answers to one question.
APART = 1.0
# Where a normal interval of nominal 95 % has one tail of 4 % instead of 2.5 %.
ASYMMETRY = 1.25
SKEWNESS = 0.5
# Relative difference of widths; Monte Carlo errors of 400 effective draws are 3.5 %.
WIDTH = 0.25


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that is known of a fit's uncertainty; arguments of `cross_check`."""

    fit: Fit
    given: Uncertainty | None
    empirical: Uncertainty | None
    posterior: "Posterior | None"
    importance: "ImportanceSample | None"
    profiles: "tuple[Profile, ...]"
    monte_carlo: "MonteCarlo | None"
    multistart: tuple[Fit, ...]
    blocks: int | None

    @cached_property
    def theorem1(self) -> Uncertainty | NotIdentifiable:
        """Theorem 1's covariance, or why there is none."""
        if self.given is not None:
            return self.given
        try:
            return covariance(self.fit)
        except NotIdentifiable as error:
            return error

    @cached_property
    def std(self) -> Array:
        """Theorem 1's standard deviations (p,), not a number where there are none."""
        if isinstance(self.theorem1, NotIdentifiable):
            return np.full(len(self.fit.parameters), np.nan)
        return self.theorem1.std

    def profile(self, i: int) -> "Profile | None":
        """Return the profile of parameter i."""
        name = self.fit.parameters.names[i]
        return next((p for p in self.profiles if p.name == name), None)

    @cached_property
    def draws(self) -> Array | None:
        """Draws of ln theta (N, p) of the posterior, or of importance sampling."""
        if self.posterior is not None:
            return self.posterior.draws
        if self.importance is not None:
            return self.importance.resampled(20_000, np.random.default_rng(0))
        return None

    @cached_property
    def improbable(self) -> Misfit | None:
        """The cost beside what noise lets expect, if noise does not explain it."""
        if self.fit.loss != "linear":
            return None
        found = misfit(self.fit, self.blocks)
        return found if found.probability < IMPROBABLE else None

    @cached_property
    def scatter(self) -> Array | None:
        """Standard deviations (p,) over fits from many starts that are as good as the best."""
        alike = self.fit.residual, self.fit.loss
        reached = [
            f for f in self.multistart if np.isfinite(f.cost) and (f.residual, f.loss) == alike
        ]
        if len(reached) < 2:
            return None
        best = min(f.cost for f in reached)
        slack = SAME_COST / 2 / magnitude_adjustment(self.fit)
        good = [np.log(f.parameters.values) for f in reached if f.cost <= best + slack]
        return np.std(good, axis=0, ddof=1) if len(good) > 1 else None

    @cached_property
    def weighting(self) -> Array:
        """By how much the weights alone widen the posterior beside Theorem 1, (p,).

        One with the noise's own weights; with others exp(-V) is no likelihood.
        """
        bread, _ = sandwich_parts(self.fit)
        precision = magnitude_adjustment(self.fit) * bread
        if self.fit.prior is not None:
            precision = precision + self.fit.prior.information(self.fit.parameters.names)
        size = np.sqrt(np.diagonal(precision))
        size = np.where(size > 0, size, 1.0)
        variance = np.diagonal(np.linalg.pinv(precision / np.outer(size, size), hermitian=True))
        return np.asarray(np.sqrt(variance) / size / self.std)

    def table(self) -> dict[str, Array]:
        """Return standard deviations (p,) of each method there is."""
        columns = {"Theorem 1": self.std}
        for name, one in (
            ("empirical", self.empirical),
            ("posterior", None if self.posterior is None else self.posterior.uncertainty()),
            ("importance", None if self.importance is None else self.importance.uncertainty()),
            ("Monte Carlo", None if self.monte_carlo is None else self.monte_carlo.uncertainty()),
        ):
            if one is not None:
                columns[name] = one.std
        if self.profiles:
            p = len(self.fit.parameters)
            found = [self.profile(i) for i in range(p)]
            columns["profile"] = np.array([np.nan if f is None else f.std for f in found])
        if self.scatter is not None:
            columns["multistart"] = self.scatter
        return columns

    def notes(self) -> list[str]:
        """Return what concerns all parameters."""
        found = []
        if not self.fit.converged:
            found.append(f"the fit has not converged: {self.fit.message}")
        if self.improbable is not None:
            chance = self.improbable.probability
            found.append(
                f"the cost is {self.improbable.ratio:.3g} times what noise explains "
                f"(probability {f'{chance:.1g}' if chance > 1e-99 else 'below 1e-99'})"
            )
        if self.draws is not None and (np.abs(self.weighting - 1) > WIDTH).any():
            found.append(
                "the weights are not those of the noise, so that exp(-cost) is no likelihood: "
                "scaled to be as wide as Theorem 1 on average, the posterior of a single "
                f"parameter is {np.nanmin(self.weighting):.2g} to {np.nanmax(self.weighting):.2g} "
                "times as wide for that reason alone; Theorem 1 knows weights and noise apart and "
                "is the one to quote"
            )
        if self.empirical is not None and self.few_lines:
            found.append(
                "the empirical sandwich is up to a third too small where few lines carry the "
                f"information, here for {', '.join(self.few_lines)}"
            )
        return found

    @cached_property
    def few_lines(self) -> tuple[str, ...]:
        """Names of parameters that fewer than `FEW_LINES` frequencies, in a position each, tell."""
        names = self.fit.parameters.names
        count = informative_lines(self.fit)
        return tuple(f"{n} ({c:.0f})" for n, c in zip(names, count, strict=True) if c < FEW_LINES)

    def covering(self) -> tuple[str, ...] | None:
        """Return the methods that cover the truth often enough for every parameter."""
        mc = self.monte_carlo
        if mc is None or not mc.methods:
            return None
        known = np.isfinite(mc.truth)
        return tuple(m for m in mc.methods if bool(mc.covers(m)[known].all()))


def flat_evidence(found: Evidence, i: int) -> list[str]:
    """Rule 1: whether the data bound parameter i."""
    name = found.fit.parameters.names[i]
    evidence = []
    if isinstance(found.theorem1, NotIdentifiable) and name in found.theorem1.names:
        evidence.append("the information is singular")
    if found.std[i] > E_FOLD:
        evidence.append(f"Theorem 1's std is {found.std[i]:.2g}, more than an e-fold")
    profile = found.profile(i)
    if profile is not None and profile.flat:
        sides = [s for s, f in zip(("lower", "upper"), profile.sides, strict=True) if f == "flat"]
        evidence.append(f"the profile is flat up to the {' and '.join(sides)} bound")
    if found.draws is not None:
        x = found.draws[:, i]
        low, high = np.quantile(x, [0.005, 0.995])
        margin = NEAR_BOUND * x.std()
        bounds = np.log(found.fit.bounds[:, i])
        if low < bounds[0] + margin or high > bounds[1] - margin:
            evidence.append("the posterior reaches a bound")
    return evidence


def model_evidence(found: Evidence, i: int) -> list[str]:
    """Rule 2: whether the model describes the data to within the noise."""
    evidence = []
    if found.improbable is not None:
        if found.empirical is None:
            evidence.append("noise does not explain the cost")
        elif found.empirical.std[i] > WIDER * found.std[i]:
            ratio = found.empirical.std[i] / found.std[i]
            evidence.append(
                f"noise does not explain the cost, the empirical sandwich is {ratio:.2g} times "
                "Theorem 1"
            )
    mc = found.monte_carlo
    if mc is not None and "theorem1" in mc.methods and np.isfinite(mc.truth[i]):
        share, least = mc.coverage("theorem1")[i], mc.band()[0]
        if share < least:
            evidence.append(
                f"Theorem 1 covers the truth in {100 * share:.0f} % of repeated experiments "
                f"(at least {100 * least:.0f} %), bias {mc.bias[i] / found.std[i]:+.1f} std"
            )
    if found.scatter is not None and found.scatter[i] > APART * found.std[i]:
        evidence.append(
            f"fits as good as the best scatter by {found.scatter[i] / found.std[i]:.2g} std"
        )
    return evidence


def skew_evidence(found: Evidence, i: int) -> list[str]:
    """Rule 3: whether normal intervals are wrong although the model is right."""
    evidence = []
    profile = found.profile(i)
    if profile is not None and profile.sides == ("found", "found"):
        ratio = profile.asymmetry
        if max(ratio, 1 / ratio) > ASYMMETRY:
            evidence.append(f"the profile's upper side is {ratio:.2g} times its lower one")
    if found.draws is not None:
        x = found.draws[:, i]
        skewness = float(np.mean((x - x.mean()) ** 3) / x.std() ** 3)
        if abs(skewness) > SKEWNESS:
            evidence.append(f"the posterior's skewness is {skewness:+.2f}")
        ratio = float(x.std() / found.std[i] / found.weighting[i])
        by_weights = " with these weights" if abs(found.weighting[i] - 1) > WIDTH else ""
        if abs(ratio - 1) > WIDTH:
            evidence.append(f"the posterior is {ratio:.2g} times as wide as Theorem 1{by_weights}")
    return evidence
