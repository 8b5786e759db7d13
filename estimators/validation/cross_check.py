"""The recommended intervals beside every other method's: Theorem 1, emcee, profiles, repetition."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.trust.trust import Trust
from estimators.uncertainty.covariance import Uncertainty, covariance
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.common.printing import ReprHtml

if TYPE_CHECKING:
    from estimators.sampling.importance_sampling import ImportanceSample
    from estimators.sampling.posterior import Posterior
    from estimators.sampling.profile_likelihood import Profile
    from estimators.validation.monte_carlo import MonteCarlo

RECOMMENDED, THEOREM_1, POSTERIOR = "recommended", "Theorem 1", "posterior"

WIDTH = 0.25
"""Relative difference of widths from which on two methods disagree."""

_NEAR_BOUND = 0.1  # standard deviations between a bound and the ends of a posterior's 99 % interval
_ASYMMETRY = 1.25  # one tail of a normal interval of 95 % then has 4 % instead of 2.5 %
_SKEWNESS = 0.5
_SAME_COST = 1.0  # minima whose 2 V differ by less than one sigma of the noise are equally good
_DISTINCT = 1.0  # good fits a standard deviation and more apart are different answers


@dataclass(frozen=True, eq=False)
class CrossCheck(ReprHtml):
    """Standard deviations of ln theta by every method, beside the recommended ones.

    Attributes
    ----------
    trust : Trust
        Recommended intervals and verdicts.
    methods : tuple of str
        k columns: the recommended one, Theorem 1, then what was computed.
    stds : ndarray, (k, p)
        Not a number where a method says nothing about a parameter.
    notes : tuple of str
        Which methods were dropped, which agree, and where posteriors and profiles are not normal.
    covering : tuple of str, optional
        Methods whose intervals cover the truth often enough in repeated experiments; None if there
        were none.
    """

    trust: Trust
    methods: tuple[str, ...]
    stds: Array
    notes: tuple[str, ...]
    covering: tuple[str, ...] | None

    @property
    def names(self) -> tuple[str, ...]:
        """The p parameters."""
        return self.trust.names

    @property
    def values(self) -> Array:
        """Estimates, (p,) [SI]."""
        return self.trust.values

    @property
    def verdicts(self) -> tuple[str, ...]:
        """The verdict on each parameter."""
        return self.trust.verdicts

    def ratio(self, first: str = THEOREM_1, second: str = POSTERIOR) -> Array:
        """Return standard deviations of one method over those of another, (p,)."""
        if not {first, second} <= set(self.methods):
            return np.full(len(self.names), np.nan)
        return np.asarray(
            self.stds[self.methods.index(first)] / self.stds[self.methods.index(second)]
        )

    def agreeing(self) -> tuple[str, ...]:
        """Return the methods that agree with the recommended one in every parameter they know."""
        return tuple(
            method
            for method, stds in zip(self.methods[1:], self.stds[1:], strict=True)
            if np.isfinite(stds).any() and not _disagreement(stds, self.stds[0]).any()
        )

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        columns = [max(len(method), 9) for method in self.methods]
        head = "  ".join(f"{m:>{c}}" for m, c in zip(self.methods, columns, strict=True))
        lines = [f"{self.trust.verdict}: {self.trust.verdict.reason}"]
        lines.append(f"{'':<{width}}  {head}  verdict")
        for i, name in enumerate(self.names):
            row = "  ".join(
                f"{'' if np.isnan(s) else f'{s:.4g}':>{c}}"
                for s, c in zip(self.stds[:, i], columns, strict=True)
            )
            lines.append(f"{name:<{width}}  {row}  {self.verdicts[i]}")
        lines += self.notes
        if self.covering is not None:
            lines.append(f"cover the truth in repetitions: {', '.join(self.covering) or 'none'}")
        return "\n".join(lines)


@renamed_keywords("0.2", own_cost="cost_posterior")
def cross_check(
    fit: FittedModel,
    *,
    theorem1: Uncertainty | None = None,
    posterior: "Posterior | None" = None,
    cost_posterior: "Posterior | None" = None,
    importance: "ImportanceSample | None" = None,
    profiles: "Sequence[Profile]" = (),
    monte_carlo: "MonteCarlo | None" = None,
    multistart: Sequence[FittedModel] = (),
    trust: Trust | None = None,
) -> CrossCheck:
    """Return the recommended intervals with those of other methods.

    Three kinds of evidence can refine the verdict of `Fit.verdict` to "not identifiable": a profile
    that is flat on a side, a posterior that reaches a bound of the fit, and other starts whose fits
    are as good and a standard deviation and more apart. All else is noted. Chains that have not
    converged and importance weights that are not trusted are left out, and noted.

    Parameters
    ----------
    fit : Fit
        What is judged.
    theorem1 : Uncertainty, optional
        ``covariance(fit)``; computed where None.
    posterior : Posterior, optional
        Posterior by the likelihood: the density exp(-V), V the cost with the noise's weights.
    cost_posterior : Posterior, optional
        Posterior of the fit's cost, where its weights are not those of the noise.
    importance : ImportanceSample, optional
        Importance sample of the same fit, if computed.
    profiles : sequence of Profile
        Profile likelihoods of the same fit, if computed.
    monte_carlo : MonteCarlo, optional
        Repeated fits of simulated data, if computed.
    multistart : sequence of Fit
        Fits from many starts.
    trust : Trust, optional
        ``fit.trust``; computed where None.

    Raises
    ------
    InvalidInput
        If a method is about other parameters.
    """
    names = fit.parameters.names
    for one in (theorem1, posterior, cost_posterior, importance, monte_carlo):
        if one is not None and one.names != names:
            raise InvalidInput(
                f"cross-check: {type(one).__name__} is about {', '.join(one.names)}, the fit "
                f"about {', '.join(names)}"
            )
    notes = _dropped_methods(posterior, cost_posterior, importance)
    posterior, cost_posterior = (
        None if one is None or not one.converged else one for one in (posterior, cost_posterior)
    )
    importance = None if importance is None or not importance.trusted else importance
    trust = trust or fit.trust
    scatter = _scatter(fit, multistart)
    stds = {
        RECOMMENDED: trust.std,
        THEOREM_1: _theorem1(fit, theorem1),
        POSTERIOR: None if posterior is None else posterior.uncertainty().std,
        "own cost": None if cost_posterior is None else cost_posterior.uncertainty().std,
        "importance": None if importance is None else importance.uncertainty().std,
        "Monte Carlo": None if monte_carlo is None else monte_carlo.uncertainty().std,
        "profile": _profile_std(names, profiles),
        "multistart": scatter,
    }
    table = {method: std for method, std in stds.items() if std is not None}
    draws = None if posterior is None else posterior.draws
    return CrossCheck(
        trust=trust.not_identifiable(_open(fit, trust, profiles, draws, scatter)),
        methods=tuple(table),
        stds=read_only(np.array(list(table.values())).reshape(len(table), len(names))),
        notes=(
            *notes,
            *_agreement(table, names),
            *_shapes(names, profiles, draws),
        ),
        covering=_covering(monte_carlo),
    )


def _theorem1(fit: FittedModel, theorem1: Uncertainty | None) -> Array:
    try:
        return (theorem1 or covariance(fit)).std
    except NotIdentifiable:
        return np.full(len(fit.parameters), np.nan)


def _profile_std(names: tuple[str, ...], profiles: "Sequence[Profile]") -> Array | None:
    if not profiles:
        return None
    by_name = {profile.name: profile.std for profile in profiles}
    return np.array([by_name.get(name, np.nan) for name in names])


def _scatter(fit: FittedModel, multistart: Sequence[FittedModel]) -> Array | None:
    """Return standard deviations (p,) over fits from many starts that are as good as the best."""
    alike = fit.residual, fit.loss
    reached = [f for f in multistart if np.isfinite(f.cost) and (f.residual, f.loss) == alike]
    if len(reached) < 2:
        return None
    best = min(f.cost for f in reached)
    good = [np.log(f.parameters.values) for f in reached if f.cost <= best + _SAME_COST / 2]
    return np.std(good, axis=0, ddof=1) if len(good) > 1 else None


def _dropped_methods(
    posterior: "Posterior | None",
    cost_posterior: "Posterior | None",
    importance: "ImportanceSample | None",
) -> list[str]:
    """Return why what was computed is not to be trusted."""
    notes = [
        f"{name} left out: {one.message}"
        for name, one in ((POSTERIOR, posterior), ("own cost", cost_posterior))
        if one is not None and not one.converged
    ]
    if importance is not None and not importance.trusted:
        notes.append(f"importance sampling left out: Pareto k {importance.pareto_k:.2f}")
    return notes


def _open(
    fit: FittedModel,
    trust: Trust,
    profiles: "Sequence[Profile]",
    draws: Array | None,
    scatter: Array | None,
) -> dict[int, str]:
    """Return the parameters that profiles, posterior or starts leave open, and why."""
    reasons: dict[int, str] = {}
    names = fit.parameters.names
    for profile in profiles:
        if profile.flat:
            sides = [
                s for s, f in zip(("lower", "upper"), profile.sides, strict=True) if f == "flat"
            ]
            reason = f"the profile is flat up to the {' and '.join(sides)} bound"
            reasons[names.index(profile.name)] = reason
    if draws is not None:
        low, high = np.quantile(draws, [0.005, 0.995], axis=0)
        margin, bounds = _NEAR_BOUND * draws.std(axis=0), np.log(fit.bounds)
        for i in np.flatnonzero((low < bounds[0] + margin) | (high > bounds[1] - margin)):
            reasons.setdefault(int(i), "the posterior reaches a bound of the fit")
    if scatter is not None:
        for i in np.flatnonzero(~(scatter <= _DISTINCT * trust.std)):
            reason = f"fits as good as the best scatter by {scatter[i] / trust.std[i]:.2g} std"
            reasons.setdefault(int(i), reason)
    return reasons


def _disagreement(stds: Array, recommended: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.abs(stds / recommended - 1) > WIDTH)


def _agreement(table: dict[str, Array], names: tuple[str, ...]) -> list[str]:
    """Return for each method how it compares with the recommended one."""
    notes = []
    for method, stds in table.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = stds / table[RECOMMENDED]
        if method in (RECOMMENDED, "multistart") or not np.isfinite(ratio).any():
            continue
        differing = [names[i] for i in np.flatnonzero(_disagreement(stds, table[RECOMMENDED]))]
        span = f"{np.nanmin(ratio):.2f} to {np.nanmax(ratio):.2f} times the recommended one"
        what = f"{method}: standard deviations are {span}"
        if method == "own cost":
            what += "; the weights are not those of the noise, so exp(-cost) is no likelihood"
        elif differing:
            what += f", beyond a quarter for {_few(differing)}"
        notes.append(what)
    return notes


def _shapes(
    names: tuple[str, ...], profiles: "Sequence[Profile]", draws: Array | None
) -> list[str]:
    """Return where normal intervals are no good approximation."""
    notes = []
    for profile in profiles:
        ratio = profile.asymmetry
        if profile.sides == ("found", "found") and max(ratio, 1 / ratio) > _ASYMMETRY:
            notes.append(
                f"{profile.name}: the profile's upper side is {ratio:.2g} times its lower one, "
                f"from {profile.lower:.5g} to {profile.upper:.5g}"
            )
    if draws is not None:
        x = draws - draws.mean(axis=0)
        skewness = np.mean(x**3, axis=0) / np.mean(x**2, axis=0) ** 1.5
        skewed = [
            f"{names[i]} ({skewness[i]:+.2f})" for i in np.flatnonzero(abs(skewness) > _SKEWNESS)
        ]
        if skewed:
            notes.append(f"posterior skewed: {_few(skewed)}")
    return notes


def _few(words: list[str]) -> str:
    return ", ".join(words[:6]) + (f" and {len(words) - 6} more" if len(words) > 6 else "")


def _covering(monte_carlo: "MonteCarlo | None") -> tuple[str, ...] | None:
    """Return the methods that cover the truth often enough for every parameter."""
    if monte_carlo is None or not monte_carlo.methods:
        return None
    finite = np.isfinite(monte_carlo.truth)
    return tuple(m for m in monte_carlo.methods if bool(monte_carlo.covers(m)[finite].all()))
