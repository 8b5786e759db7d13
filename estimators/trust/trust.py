"""How far a fit can be trusted: recommended intervals, verdicts and what they rest on."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.fitting.residuals import find_residual
from estimators.fitting.robust import loss_factors
from estimators.fitting.weights import used_elements
from estimators.trust.directed_tests import DirectedTests
from estimators.trust.intervals import VERDICTS, Interval, Verdict, interval_document
from estimators.trust.line_scatter import Scatter
from estimators.trust.linearise import linearise, sensitivities
from estimators.trust.model_directions import model_directions
from estimators.trust.residual_size import ResidualSize
from estimators.trust.rule import Evidence, gather_evidence, judge, variance_scale
from robotmodels.arrays import Array, read_only
from robotmodels.errors import SolverFailed
from robotmodels.notebook import Printed

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Trust(Printed):
    """The recommended intervals of a fit and the verdict on it, as plain arrays and words.

    Attributes
    ----------
    names : tuple of str
        The p parameters.
    values : ndarray, (p,), SI
        Estimates.
    scatter : Scatter
        Variances of ln theta, with their degrees of freedom, that the intervals are made of.
    ends : ndarray, (p, 2), SI
        Lower and upper ends; not a number where the verdict gives none.
    method : str
        Where the standard deviations come from.
    verdicts, reasons : tuple of str
        Of each parameter.
    size : ResidualSize
        Size of the residuals beside the noise.
    whiteness : float
        Probability of lagged products along the lines as large if errors are white.
    lag_one : float, dimensionless
        Correlation of errors of neighbouring lines.
    tests : DirectedTests
        Score tests of single directions in which the model may be wrong.
    """

    names: tuple[str, ...]
    values: Array
    scatter: Scatter
    ends: Array
    method: str
    verdicts: tuple[str, ...]
    reasons: tuple[str, ...]
    size: ResidualSize
    whiteness: float
    lag_one: float
    tests: DirectedTests

    @property
    def std(self) -> Array:
        """Standard deviations of ln theta, (p,)."""
        return np.asarray(np.sqrt(self.scatter.variance))

    @cached_property
    def intervals(self) -> tuple[Interval, ...]:
        """The recommended 95 % interval of each parameter."""
        return tuple(
            Interval(
                name,
                float(self.values[i]),
                float(abs(self.values[i]) * self.std[i]),
                _plain(self.ends[i, 0]),
                _plain(self.ends[i, 1]),
                self.method,
                float(self.scatter.degrees_of_freedom[i]),
                Verdict(self.verdicts[i], self.reasons[i]),
            )
            for i, name in enumerate(self.names)
        )

    @property
    def verdict(self) -> Verdict:
        """The verdict on the whole fit: the gravest of its parameters'."""
        i = min(range(len(self.names)), key=lambda k: VERDICTS.index(self.verdicts[k]))
        alike = [n for n, v in zip(self.names, self.verdicts, strict=True) if v == self.verdicts[i]]
        if self.verdicts[i] != "not identifiable":
            return Verdict(self.verdicts[i], self.reasons[i])
        return Verdict(self.verdicts[i], f"{', '.join(alike)}: {self.reasons[i]}")

    def not_identifiable(self, reasons: dict[int, str]) -> "Trust":
        """Return the same with parameters that other evidence shows not to be identifiable."""
        verdicts, words, ends = list(self.verdicts), list(self.reasons), self.ends.copy()
        for i, reason in reasons.items():
            if VERDICTS.index(verdicts[i]) > VERDICTS.index("not identifiable"):
                verdicts[i], words[i], ends[i] = "not identifiable", reason, np.nan
        return replace(self, verdicts=tuple(verdicts), reasons=tuple(words), ends=read_only(ends))

    def document(self) -> dict[str, Any]:
        """Return all of it as plain numbers and words, for JSON; null where there is none."""
        tests = self.tests
        return {
            "verdict": str(self.verdict),
            "reason": self.verdict.reason,
            "intervals": [interval_document(i) for i in self.intervals],
            "residuals": {
                "ratio": _plain(self.size.ratio),
                "dof": [_plain(self.size.numerator), _plain(self.size.denominator)],
                "probability": _plain(self.size.probability),
                "whiteness": _plain(self.whiteness),
                "lag_one": _plain(self.lag_one),
            },
            "directions": [
                {
                    "name": name,
                    "unit": tests.units[i],
                    "estimate": _plain(tests.estimates[i]),
                    "std": _plain(tests.std[i]),
                    "probability": _plain(tests.probabilities[i]),
                    "undetected_shift": {
                        "parameter": self.names[int(tests.moved[i])],
                        "std": _plain(tests.shift[i]),
                    },
                }
                for i, name in enumerate(tests.names)
            ],
        }

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
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


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
