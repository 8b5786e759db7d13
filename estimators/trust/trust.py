"""The rule applied to a fit: recommended intervals, verdicts, and what they rest on."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimators.fitting.least_squares import Fit, problem_of
from estimators.fitting.residuals import find_residual
from estimators.fitting.weights import used_elements
from estimators.frf.estimate import vec
from estimators.trust.intervals import VERDICTS, Interval, Verdict
from estimators.trust.line_scatter import Scatter
from estimators.trust.linearised_fit import LinearisedFit
from estimators.trust.model_directions import model_directions
from estimators.trust.rule import Evidence, gather_evidence, judge, variance_scale
from estimators.uncertainty.model_error import loss_factors
from robotmodels.arrays import Array
from robotmodels.errors import SolverFailed
from robotmodels.notebook import Printed
from robotmodels.response import sensitivity

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Trust(Printed):
    """The recommended intervals of a fit and the verdict on it.

    Attributes
    ----------
    intervals : tuple of Interval
        One for each parameter.
    verdict : Verdict
        Of the whole fit: the gravest of its parameters'.
    evidence : Evidence
        What the rule looked at.
    """

    intervals: tuple[Interval, ...]
    verdict: Verdict
    evidence: Evidence

    @property
    def possible_shifts(self) -> tuple[tuple[str, str, float], ...]:
        """For each direction the parameter it moves most while undetected, and by how many std."""
        tests, names = self.evidence.tests, self.evidence.fit.names
        worst = np.abs(tests.undetected_shift)
        return tuple(
            (name, names[int(np.argmax(row))], float(row.max()))
            for name, row in zip(tests.names, worst, strict=True)
        )

    def document(self) -> dict[str, Any]:
        """Return all of it as plain numbers and words, for JSON."""
        size, tests = self.evidence.size, self.evidence.tests
        correlation = self.evidence.correlation
        return {
            "verdict": str(self.verdict),
            "reason": self.verdict.reason,
            "intervals": [
                {
                    "name": i.name,
                    "value": i.value,
                    "std": _plain(i.std),
                    "low": i.low,
                    "high": i.high,
                    "method": i.method,
                    "dof": _plain(i.dof),
                    "verdict": str(i.verdict),
                    "reason": i.verdict.reason,
                }
                for i in self.intervals
            ],
            "residuals": {
                "ratio": _plain(size.ratio),
                "dof": [_plain(size.numerator), _plain(size.denominator)],
                "probability": _plain(size.probability),
                "judged": self.evidence.size_known,
            },
            "line_correlation": {
                "probability": _plain(correlation.probability),
                "lag_one": _plain(float(correlation.coefficients[1:2].sum())),
            },
            "directions": [
                {
                    "name": tests.names[i],
                    "unit": tests.units[i],
                    "estimate": _plain(float(tests.estimates[i])),
                    "std": _plain(float(tests.std[i])),
                    "probability": _plain(float(tests.probabilities[i])),
                    "undetected_shift": {"parameter": parameter, "std": _plain(shift)},
                }
                for i, (_, parameter, shift) in enumerate(self.possible_shifts)
            ],
        }

    def __str__(self) -> str:
        width = max(len(i.name) for i in self.intervals)
        lines = [f"{self.verdict}: {self.verdict.reason}"]
        for i in self.intervals:
            low = "..." if i.low is None else f"{i.low:.5g}"
            high = "..." if i.high is None else f"{i.high:.5g}"
            note = "" if i.verdict == self.verdict else f"  {i.verdict}: {i.verdict.reason}"
            lines.append(f"  {i.name:<{width}}  {i.value:12.6g}  [{low}, {high}]{note}")
        return "\n".join(lines)


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
    G, J = sensitivity(
        fit.model, estimate.positions, estimate.omega, fit.parameters.values, sag=True
    )
    linear = linearise(fit, G, J)
    directions = model_directions(
        fit.model, kind, estimate.positions, estimate.omega, fit.parameters.values, G, J, used
    )
    evidence = gather_evidence(
        linear, directions, converged=fit.converged, noise_known=estimate.noise_known
    )
    slope, square = loss_factors(fit.loss)
    scale = variance_scale(evidence) * square / slope**2
    verdicts = judge(evidence)
    intervals = _intervals(fit, evidence.scatter.scaled(scale), verdicts, _method(fit, evidence))
    overall = min(verdicts, key=VERDICTS.index)
    return Trust(intervals, _of_study(overall, verdicts, fit.parameters.names), evidence)


def linearise(fit: Fit, response: Array, jacobian: Array) -> LinearisedFit:
    """Return a fit about its solution.

    Parameters
    ----------
    response : (Q, F, m, n)
        FRF at the fit.
    jacobian : (Q, F, m, n, p)
        Its derivatives with respect to ln theta.
    """
    estimate, problem = fit.estimate, problem_of(fit)
    kind, used = problem.kind, problem.used
    slopes = -kind.jacobian(response, jacobian, used)
    residuals = np.where(used, kind.error(estimate.response, response, used), 0.0)
    noise = kind.noise(estimate.covariance, response, used)
    pooled = kind.noise(estimate.pooled_variance, response, used)
    deviations = estimate.deviations
    if deviations is not None:
        at = np.where(used, response, 1.0)[:, None]
        deviations = deviations / at if kind.relative else deviations
        deviations = np.where(used[:, None], deviations, 0.0)
        deviations = vec(np.sqrt(2) * deviations.real if kind.real else deviations)
    names = fit.parameters.names
    prior = np.zeros((len(names),) * 2)
    freedom = estimate.degrees_of_freedom
    return LinearisedFit(
        names=names,
        residuals=vec(residuals),
        jacobian=np.moveaxis(vec(np.moveaxis(slopes, -1, 2)), 2, -1),
        weights=fit.weights if fit.weights.shape != response.shape else vec(fit.weights),
        noise_weights=vec(np.where(used, 1.0 / np.where(used, pooled, 1.0), 0.0)),
        covariance=vec(noise) if noise.shape == response.shape else noise,
        deviations=deviations,
        degrees_of_freedom=np.where(np.isnan(freedom), np.inf, freedom),
        line_correlation=estimate.line_correlation,
        prior=prior if fit.prior is None else fit.prior.information(names),
        real=kind.real,
    )


def _method(fit: Fit, evidence: Evidence) -> str:
    """Return where the standard deviations come from."""
    estimated = np.isfinite(evidence.fit.degrees_of_freedom).any()
    parts = ["scatter of the lines over blocks" if estimated else "Theorem 1, declared noise"]
    if not evidence.correlation.white:
        parts.append("correlated along lines")
    if evidence.too_large:
        parts.append("scaled by the residuals")
    return f"{fit.residual}, {', '.join(parts)}"


def _intervals(
    fit: Fit, scatter: Scatter, verdicts: tuple[Verdict, ...], method: str
) -> tuple[Interval, ...]:
    """Return the intervals; one-sided, in the values themselves, where a parameter is at a bound."""
    values, std = fit.parameters.values, np.sqrt(scatter.variance)
    both, one = scatter.quantile(LEVEL), scatter.quantile(2 * LEVEL - 1)
    at_low, at_high = np.isclose(values, fit.bounds, rtol=1e-6, atol=0)
    intervals = []
    for i, name in enumerate(fit.parameters.names):
        low: float | None = None
        high: float | None = None
        verdict, value = verdicts[i], float(values[i])
        with np.errstate(over="ignore"):
            if at_low[i] and verdict in ("not identifiable", "trustworthy"):
                high = value * (1 + one[i] * std[i])
                verdict = Verdict("not identifiable", "at its lower bound: only a limit is known")
            elif at_high[i]:
                verdict = Verdict("not identifiable", "at its upper bound; widen the bounds")
            elif verdict.gives_interval and np.isfinite(std[i]):
                low, high = (float(value * np.exp(s * both[i] * std[i])) for s in (-1, 1))
        dof = float(scatter.degrees_of_freedom[i])
        deviation = float(value * std[i])
        intervals.append(Interval(name, value, deviation, low, high, method, dof, verdict))
    return tuple(intervals)


def _of_study(overall: Verdict, verdicts: tuple[Verdict, ...], names: tuple[str, ...]) -> Verdict:
    """Return the verdict on the whole; it names the parameters that are not identifiable."""
    if overall != "not identifiable":
        return overall
    open_ = [n for n, v in zip(names, verdicts, strict=True) if v == overall]
    return Verdict(overall, f"relative standard deviations above one: {', '.join(open_)}")


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
