"""How far a fit can be trusted: recommended intervals, the verdict and its evidence."""

from dataclasses import replace

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.fitting.linearise import linearise, sensitivities
from estimators.fitting.model_directions import model_directions
from estimators.fitting.residuals import find_residual, loss_factors
from estimators.fitting.weights import used_elements
from estimators.trust.intervals import VERDICTS, Verdict
from estimators.trust.line_scatter import Scatter
from estimators.trust.rule import Evidence, gather_evidence, judge, variance_scale
from estimators.trust.trust import LEVEL, Trust
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import SolverFailed


def trust(fit: Fit) -> Trust:
    """Return the recommended intervals and the verdict, by the rule of `estimators.trust.rule`.

    Raises
    ------
    SolverFailed
        If the search could not begin.
    """
    if not np.isfinite(fit.cost):
        raise SolverFailed(f"no intervals without a fit: {fit.message}")
    estimate, kind = fit.estimate, find_residual(fit.residual)
    used = used_elements(fit.weights, estimate.response.shape)
    at = sensitivities(fit)
    directions = model_directions(
        fit.model, kind, estimate.positions, estimate.omega, fit.parameters.values, at, used
    )
    evidence = gather_evidence(
        linearise(fit, at), directions, converged=fit.converged, noise_known=estimate.noise_known
    )
    slope, square = loss_factors(fit.loss)
    scatter = evidence.scatter.scaled(variance_scale(evidence) * square / slope**2)
    return _summary(fit, evidence, scatter)


def _summary(fit: Fit, evidence: Evidence, scatter: Scatter) -> Trust:
    verdicts, ends = _ends(fit, scatter, judge(evidence))
    if not evidence.noise_known:
        unknown = np.full_like(scatter.degrees_of_freedom, np.nan)
        scatter = replace(scatter, degrees_of_freedom=unknown)
    correlation = evidence.correlation
    return Trust(
        names=fit.parameters.names,
        values=fit.parameters.values,
        scatter=scatter,
        ends=read_only(ends),
        method=_method(fit, evidence),
        verdicts=tuple(str(v) for v in verdicts),
        reasons=tuple(v.reason for v in verdicts),
        size=evidence.size,
        whiteness=correlation.probability,
        lag_one=float(correlation.coefficients[1:2].sum()),
        tests=evidence.tests,
    )


def _method(fit: Fit, evidence: Evidence) -> str:
    """Return where the standard deviations come from."""
    estimated = np.isfinite(evidence.fit.degrees_of_freedom).any()
    parts = ["scatter of the lines over blocks" if estimated else "Theorem 1, declared noise"]
    if not evidence.noise_known:
        parts = ["Theorem 1, noise of unknown degrees of freedom"]
    if not evidence.correlation.white:
        parts.append("correlated along lines")
    if evidence.too_large:
        parts.append("scaled by the residuals")
    return f"{fit.residual}, {', '.join(parts)}"


def _ends(fit: Fit, scatter: Scatter, verdicts: tuple[Verdict, ...]) -> tuple[list[Verdict], Array]:
    """Return verdicts and ends (p, 2); one-sided, in the values themselves, at a bound of the fit.

    The logarithm of a damper at its lower bound tells nothing: its interval is that of the value,
    from zero to where noise would have pulled it from.
    """
    values, std = fit.parameters.values, np.sqrt(scatter.variance)
    both, one = scatter.quantile(LEVEL), scatter.quantile(2 * LEVEL - 1)
    at_low, at_high = np.isclose(values, fit.bounds, rtol=1e-6, atol=0)
    ends, judged = np.full((len(values), 2), np.nan), list(verdicts)
    for i, verdict in enumerate(verdicts):
        bounded = VERDICTS.index(verdict) >= VERDICTS.index("not identifiable")
        if bounded and at_low[i]:
            judged[i] = Verdict(
                "not identifiable", "at its lower bound; only an upper end is known"
            )
            ends[i, 1] = values[i] * (1 + one[i] * std[i])
        elif bounded and at_high[i]:
            judged[i] = Verdict("not identifiable", "at its upper bound; only a lower end is known")
            ends[i, 0] = values[i] * np.exp(-one[i] * std[i])
        elif verdict.gives_interval and np.isfinite(std[i]):
            ends[i] = values[i] * np.exp(np.array([-1, 1]) * both[i] * std[i])
    return judged, np.where(np.isfinite(ends), ends, np.nan)
