"""Recommended intervals and verdicts, and the evidence behind them."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from estimators.trust.directed_tests import DirectedTests
from estimators.trust.intervals import VERDICTS, Interval, Verdict, interval_document
from estimators.trust.line_scatter import Scatter
from estimators.trust.residual_size import ResidualSize
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.plain_data import json_data
from robotmodels.common.printing import ReprHtml

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Trust(ReprHtml):
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
    def model_error(self) -> Array:
        """Largest shifts of ln theta, (p,), by errors of the model whose tests fire; 0 if none."""
        tests = self.tests
        fired = tests.significant()
        each = np.abs(tests.estimates[fired, None] * tests.shifts[fired])
        return np.asarray(each.max(axis=0, initial=0.0))

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
        content = {
            "verdict": str(self.verdict),
            "reason": self.verdict.reason,
            "intervals": [interval_document(i) for i in self.intervals],
            "residuals": {
                "ratio": self.size.ratio,
                "dof": [self.size.numerator, self.size.denominator],
                "probability": self.size.probability,
                "whiteness": self.whiteness,
                "lag_one": self.lag_one,
            },
            "directions": [
                {
                    "name": name,
                    "unit": tests.units[i],
                    "estimate": tests.estimates[i],
                    "std": tests.std[i],
                    "probability": tests.probabilities[i],
                    "undetected_shift": {
                        "parameter": self.names[int(tests.moved[i])],
                        "std": tests.shift[i],
                    },
                }
                for i, name in enumerate(tests.names)
            ],
        }
        plain: dict[str, Any] = json_data(content)
        return plain

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = [f"{self.verdict}: {self.verdict.reason}"]
        for i in self.intervals:
            low = "..." if i.low is None else f"{i.low:.5g}"
            high = "..." if i.high is None else f"{i.high:.5g}"
            note = "" if i.verdict == self.verdict else f"  {i.verdict}: {i.verdict.reason}"
            lines.append(f"  {i.name:<{width}}  {i.value:12.6g}  [{low}, {high}]{note}")
        return "\n".join(lines)


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
