"""How far a fit can be trusted: recommended intervals, the verdict and its evidence."""

from dataclasses import replace

import numpy as np

from estimators.fitting.fit_problem import Problem
from estimators.fitting.linearise import linearise, sensitivities
from estimators.fitting.model_directions import model_directions
from estimators.fitting.residuals import loss_factors
from estimators.trust.intervals import VERDICTS, Verdict
from estimators.trust.line_scatter import Scatter
from estimators.trust.rule import Evidence, gather_evidence, judge, variance_scale
from estimators.trust.trust import LEVEL, Trust
from robotmodels.common.arrays import Array, read_only


def fit_trust(problem: Problem, values: Array, converged: bool) -> Trust:
    """Return the recommended intervals and the verdict, by the rule of `estimators.trust.rule`.

    Parameters
    ----------
    problem : Problem
        Problem of the fit.
    values : ndarray, (p,), SI
        Parameters where its search ended.
    converged : bool
        Whether that is a local minimum.
    """
    estimate = problem.estimate
    at = sensitivities(problem, values)
    directions = model_directions(
        problem.model, problem.kind, estimate.positions, estimate.omega, values, at, problem.used
    )
    evidence = gather_evidence(
        linearise(problem, values, at),
        directions,
        converged=converged,
        noise_known=estimate.noise_known,
    )
    slope, square = loss_factors(problem.loss)
    scatter = evidence.scatter.scaled(variance_scale(evidence) * square / slope**2)
    return _summary(problem, values, evidence, scatter)


def _summary(problem: Problem, values: Array, evidence: Evidence, scatter: Scatter) -> Trust:
    verdicts, ends = _ends(values, problem.bounds, scatter, judge(evidence))
    if not evidence.noise_known:
        unknown = np.full_like(scatter.degrees_of_freedom, np.nan)
        scatter = replace(scatter, degrees_of_freedom=unknown)
    correlation = evidence.correlation
    return Trust(
        names=problem.model.parameters.names,
        values=values,
        scatter=scatter,
        ends=read_only(ends),
        method=_method(problem.kind.name, evidence),
        verdicts=tuple(str(v) for v in verdicts),
        reasons=tuple(v.reason for v in verdicts),
        size=evidence.size,
        whiteness=correlation.probability,
        lag_one=float(correlation.coefficients[1:2].sum()),
        tests=evidence.tests,
    )


def _method(residual: str, evidence: Evidence) -> str:
    """Return where the standard deviations come from."""
    estimated = np.isfinite(evidence.fit.degrees_of_freedom).any()
    parts = ["scatter of the lines over blocks" if estimated else "Theorem 1, declared noise"]
    if not evidence.noise_known:
        parts = ["Theorem 1, noise of unknown degrees of freedom"]
    if not evidence.correlation.white:
        parts.append("correlated along lines")
    if evidence.too_large:
        parts.append("scaled by the residuals")
    return f"{residual}, {', '.join(parts)}"


def _ends(
    values: Array, bounds: Array, scatter: Scatter, verdicts: tuple[Verdict, ...]
) -> tuple[list[Verdict], Array]:
    """Return verdicts and ends (p, 2); one-sided, in the values themselves, at a bound of the fit.

    The logarithm of a damper at its lower bound tells nothing: its interval is that of the value,
    from zero to where noise would have pulled it from.
    """
    std = np.sqrt(scatter.variance)
    both, one = scatter.quantile(LEVEL), scatter.quantile(2 * LEVEL - 1)
    at_low, at_high = np.isclose(values, bounds, rtol=1e-6, atol=0)
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
