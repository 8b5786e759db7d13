"""The rule that chooses the recommended interval and the verdict, from stated evidence."""

from dataclasses import dataclass, replace

import numpy as np

from estimators.trust.directed_tests import DirectedTests, Directions, directed_tests
from estimators.trust.intervals import Verdict
from estimators.trust.line_correlation import (
    LineCorrelation,
    correlation_of_deviations,
    correlation_of_residuals,
    declared_correlation,
    element_correlation,
)
from estimators.trust.line_scatter import Scatter, line_scatter
from estimators.trust.linearised_fit import LinearisedFit
from estimators.trust.residual_size import (
    ResidualSize,
    line_probabilities,
    residual_size,
    typical_size,
)
from robotmodels.common.arrays import Array

LEVEL = 0.01
"""Probability of a false alarm of all directed tests of a study together."""

OUTLIER_LEVEL = 0.003
"""Probability of a false alarm of all single residuals of a study together."""

NOT_IDENTIFIABLE_STD = 1.0
"""A relative standard deviation of one: an interval from a seventh to seven times the value."""

_CLEARLY_WHITE = 0.05
_MINORITY = 0.5


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the rule looks at.

    Attributes
    ----------
    fit : LinearisedFit
        Residuals, sensitivities, weights and noise.
    correlation : LineCorrelation
        Correlation of the errors along the lines.
    scatter : Scatter
        Variances of ln theta by the lines' scatter, before any scaling.
    size : ResidualSize
        Size of the residuals.
    tests : DirectedTests
        Score tests of single directions.
    explanation : str, optional
        The direction that explains what is wrong: with it the other tests are silent.
    correlated_excess : bool
        Whether what exceeds the noise is smooth along the lines, or stands out at single ones.
    outlier : tuple of int, optional
        Position, line and element of a single residual that no noise explains.
    converged : bool
        Whether the fit ended at a minimum.
    has_degrees_of_freedom : bool
        Whether the estimate tells the degrees of freedom of the noise.
    """

    fit: LinearisedFit
    correlation: LineCorrelation
    scatter: Scatter
    size: ResidualSize
    tests: DirectedTests
    explanation: str | None
    correlated_excess: bool
    outlier: tuple[int, ...] | None
    converged: bool
    has_degrees_of_freedom: bool

    @property
    def too_large(self) -> bool:
        """Whether the residuals are larger than noise makes them."""
        return self.size.too_large


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals beside the noise.

    Attributes
    ----------
    correlation : LineCorrelation
        Correlation of the errors along the lines.
    size : ResidualSize
        Size of the residuals.
    """

    correlation: LineCorrelation
    size: ResidualSize


def find_misfit(fit: LinearisedFit) -> Misfit:
    """Return how residuals lie beside the noise."""
    correlation = find_correlation(fit)
    return Misfit(correlation, residual_size(fit, correlation))


def gather_evidence(
    fit: LinearisedFit,
    directions: Directions,
    misfit: Misfit | None = None,
    *,
    converged: bool = True,
    has_degrees_of_freedom: bool = True,
) -> Evidence:
    """Compute everything that `judge` looks at; `misfit` is that of the fit, if known."""
    misfit = misfit or find_misfit(fit)
    correlation, size = misfit.correlation, misfit.size
    scatter = line_scatter(fit, fit.rows, correlation)
    scatter = with_prior(fit, scatter)
    open_variances = np.where(fit.undetermined, np.inf, scatter.variance)
    scatter = replace(scatter, variance=open_variances)
    std = np.sqrt(scatter.variance)
    expected = size.expected if size.too_large else None
    tests = directed_tests(fit, directions, correlation, std, expected)
    explanation = None
    estimated = bool(np.isfinite(fit.degrees_of_freedom).any())
    if not estimated and not correlation.white and not len(fit.line_correlation):
        white = directed_tests(fit, directions, _white(correlation), std)
        if white.significant(LEVEL).size:
            explanation = _explaining(fit, directions, white, whiteness=True)
            if explanation is not None:
                tests = white
    if explanation is None and tests.significant(LEVEL).size:
        explanation = _explaining(fit, directions, tests, whiteness=False)
    return Evidence(
        fit, correlation, scatter, size, tests, explanation,
        size.too_large and _smooth_excess(fit.noise_fit, correlation, size),
        _outlier(fit.noise_fit, size),
        converged, has_degrees_of_freedom,
    )  # fmt: skip


def find_correlation(fit: LinearisedFit) -> LineCorrelation:
    """Return the correlation of errors along the lines: known, from deviations or residuals."""
    if len(fit.line_correlation):
        return declared_correlation(fit)
    if fit.deviations is not None:
        return correlation_of_deviations(fit)
    return correlation_of_residuals(fit)


def judge(evidence: Evidence) -> tuple[Verdict, ...]:
    """Return the verdict on each parameter; the first rule that holds.

    1. "not converged": the search did not end at a minimum.
    2. "too few blocks": the degrees of freedom of the noise are unknown.
    3. "model error": a test of a single direction fires at 1 % over all of them, or residuals are
       too large (.5 %) and what exceeds the noise is smooth along the lines or stands out
       at single ones, or a single residual is improbable at .3 % over all.
    4. "not identifiable": the standard deviation of ln theta, as 5 scales it, exceeds one.
    5. "noise understated": residuals are too large, and alike everywhere; intervals are scaled.
    6. "noise correlated" along the lines; intervals allow for it.
    7. "trustworthy".

    Every rule fails closed: evidence that is not a number counts against the fit.
    """
    e = evidence
    std = np.sqrt(e.scatter.variance * variance_scale(e))
    overall = _overall(e)
    verdicts = []
    for i in range(len(std)):
        if overall in ("not converged", "too few blocks", "model error"):
            verdicts.append(overall)
        elif not std[i] <= NOT_IDENTIFIABLE_STD:
            reason = f"the relative standard deviation is {std[i]:.3g}, more than one"
            if e.too_large:
                reason += f", as residuals are {e.size.ratio:.3g} times what noise explains"
            verdicts.append(Verdict("not identifiable", reason))
        else:
            verdicts.append(overall)
    return tuple(verdicts)


def _overall(e: Evidence) -> Verdict:
    """Return the verdict as far as it concerns all parameters alike."""
    if not e.converged:
        return Verdict("not converged", "the search did not end at a minimum of the cost")
    if not e.has_degrees_of_freedom:
        return Verdict(
            "too few blocks", "the degrees of freedom of the noise covariance are not known"
        )
    strongest = e.tests.significant(LEVEL)
    if strongest.size:
        return Verdict("model error", _named(e, int(strongest[0])))
    if e.too_large and e.correlated_excess:
        return Verdict(
            "model error",
            f"residuals are {e.size.ratio:.3g} times what noise explains (p = "
            f"{e.size.probability:.1g}), smooth along the lines or large at single ones; none of "
            "the tested directions explains them",
        )
    if e.outlier is not None:
        q, f, i = (int(k) + 1 for k in e.outlier)
        return Verdict(
            "model error",
            f"the residual of element {i} of vec(G) at line {f} in position {q} is an outlier; "
            "leave it out, or use a robust loss",
        )
    if e.too_large:
        return Verdict(
            "noise understated",
            f"residuals are {e.size.ratio:.3g} times what noise explains (p = "
            f"{e.size.probability:.1g}), at all lines and positions; intervals are "
            f"{np.sqrt(e.size.ratio):.3g} times as wide",
        )
    if not e.correlation.white:
        lag = e.correlation.coefficients[1] if len(e.correlation.coefficients) > 1 else 0.0
        return Verdict(
            "noise correlated",
            "errors of neighbouring lines are "
            + (f"correlated by {lag:.2g}" if abs(lag) >= 0.005 else "a little correlated")
            + f" (p = {e.correlation.probability:.1g}); intervals allow for it",
        )
    reason = f"noise explains the residuals (F = {e.size.ratio:.3g}, p = {e.size.probability:.2g})"
    if e.size.probability_below < LEVEL:
        reason += ", which are smaller than the noise stated: intervals are wider than they need be"
    return Verdict("trustworthy", reason)


def _named(e: Evidence, i: int) -> str:
    """Return the reason of a model error that a directed test shows."""
    tests = e.tests
    if e.explanation is not None:
        j = tests.names.index(e.explanation)
        return (
            f"{e.explanation}: {tests.estimates[j]:.3g} {tests.units[j]} +- {tests.std[j]:.2g} "
            f"would explain the residuals (p = {tests.probabilities[j]:.1g})"
        )
    return (
        f"{len(tests.significant(LEVEL))} of {len(tests.names)} score tests are significant, the "
        f"strongest along {tests.names[i]} (p = {tests.probabilities[i]:.1g}); none alone "
        "explains the others"
    )


def variance_scale(evidence: Evidence) -> float:
    """Return the factor of the variances for residuals that are too large."""
    return evidence.size.ratio if evidence.too_large else 1.0


def with_prior(fit: LinearisedFit, scatter: Scatter) -> Scatter:
    """Add the prior's part to the variances of ln theta."""
    if not fit.prior.any():
        return scatter
    rows = fit.rows.reshape(len(fit.names), -1)
    J = fit.jacobian.reshape(-1, len(fit.names))
    # Re(A J) = I - N^-1 (prior/2): what is left of the identity is the prior's.
    share = np.eye(len(fit.names)) - (rows @ J).real
    prior_covariance = np.linalg.pinv(fit.prior, hermitian=True)
    more = np.einsum("ij,jk,ik->i", share, prior_covariance, share)
    total = scatter.variance + more
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = np.where(
            scatter.variance > 0,
            scatter.degrees_of_freedom * (total / scatter.variance) ** 2,
            np.inf,
        )
    return Scatter(total, dof)


def _white(correlation: LineCorrelation) -> LineCorrelation:
    coefficients = np.zeros_like(correlation.coefficients)
    coefficients[0] = 1.0
    return replace(correlation, probability=1.0, coefficients=coefficients, variance=1.0)


def _explaining(
    fit: LinearisedFit, directions: Directions, tests: DirectedTests, *, whiteness: bool
) -> str | None:
    """Return the strongest significant direction with which, as a parameter, all tests pass."""
    for i in tests.significant(LEVEL)[:5]:
        name = tests.names[int(i)]
        refitted = with_columns(fit, name, directions.column(int(tests.index[int(i)])))
        correlation = find_correlation(refitted)
        if whiteness and correlation.probability < _CLEARLY_WHITE:
            continue
        if residual_size(refitted, correlation).too_large:
            continue
        std = np.sqrt(line_scatter(refitted, refitted.rows, correlation).variance)
        if not directed_tests(refitted, directions, correlation, std).significant(LEVEL).size:
            return name
    return None


def with_columns(fit: LinearisedFit, name: str, column: Array) -> LinearisedFit:
    """Return the fit with one more parameter, by one linear step."""
    J = np.concatenate([fit.jacobian, column], axis=-1)
    p = len(fit.names)
    prior = np.zeros((p + 1, p + 1))
    prior[:p, :p] = fit.prior
    wider = replace(fit, names=(*fit.names, name), jacobian=J, prior=prior)
    return wider.after_step()


def _smooth_excess(fit: LinearisedFit, correlation: LineCorrelation, size: ResidualSize) -> bool:
    """Tell whether residuals beyond the noise are smooth along the lines, or single ones stand out.

    Noise that was stated too small by one factor has the correlation of the noise; errors of a
    model vary slowly along the lines.
    """
    if not np.isfinite(size.ratio):
        return True
    white = np.sqrt(fit.noise_weights) * fit.errors
    power = float((np.abs(white) ** 2).sum())
    lag_one = float((np.conj(white[:, :-1]) * white[:, 1:]).real.sum())
    rho = float(correlation.coefficients[1]) if len(correlation.coefficients) > 1 else 0.0
    noise = power / size.ratio
    excess = power - noise
    share = (lag_one - rho * noise) / excess if excess > 0 else 0.0
    if share > max(_MINORITY, (1 + rho) / 2):
        return True
    return _group_stands_out(fit, correlation, size)


def _outlier(fit: LinearisedFit, size: ResidualSize) -> tuple[int, ...] | None:
    """Return where a single residual stands out, by its exact law and beside their typical size."""
    factor = np.fmax(typical_size(fit), 1.0) if size.too_large else 1.0
    probabilities = line_probabilities(fit, factor)
    worst = np.unravel_index(int(probabilities.argmin()), probabilities.shape)
    if probabilities[worst] >= OUTLIER_LEVEL / max(int(fit.used.sum()), 1):
        return None
    return tuple(int(k) for k in worst)


def _group_stands_out(fit: LinearisedFit, correlation: LineCorrelation, size: ResidualSize) -> bool:
    """Tell whether a line or an element of a position exceeds the common factor (F laws)."""
    from scipy.special import fdtrc

    square = fit.noise_weights * np.abs(fit.errors) ** 2
    stated = fit.noise_weights * fit.element_variances
    each = stated * (size.expected / stated.sum()) * size.ratio
    nu = np.minimum(fit.degrees_of_freedom, 1e6)[:, None]
    dependent = element_correlation(fit)
    for axis, fewer in ((2, dependent), (1, correlation.inflation)):
        count = fit.parts * fit.used.sum(axis=axis) / fewer
        seen = count > 0
        ratio = np.where(seen, square.sum(axis=axis), 0.0) / np.where(seen, each.sum(axis=axis), 1)
        probability = fdtrc(np.maximum(count, 1e-9), np.maximum(count, 1) * nu, ratio)
        if (probability[seen] < LEVEL / 2 / max(int(seen.sum()), 1)).any():
            return True
    return False
