"""Figures of the design, the frequency responses and the fits."""

from collections.abc import Mapping, Sequence

import numpy as np

from reports.figures.panels import DASHES, SERIES, Axis, Curve, Panel, Panels, Rule, bars
from reports.text import fixed, residual_label, significant
from robotmodels.common.arrays import Array, IntArray

_RANKS = 3000
"""Points of a curve over candidates, of which there may be millions."""


def sensitivity_function(sensitivity: Array, support: IntArray) -> Panels:
    """Return the candidates' sensitivity in falling order, those of the design marked.

    Parameters
    ----------
    sensitivity : ndarray, (Q,)
        tr(M^-1 H_i)/p; at the optimum none exceeds 1 and used ones reach it.
    """
    order = np.argsort(-sensitivity, kind="stable")
    rank = np.empty(len(order))
    rank[order] = np.arange(1, len(order) + 1)
    shown = np.unique(np.geomspace(1, len(order), _RANKS).astype(int)) - 1
    marks = (
        Rule(1.0, "muted", 0.8, DASHES),
        Curve(shown + 1.0, sensitivity[order[shown]], "accent"),
        Curve(rank[support], sensitivity[support], "second", 0.0, 4.0),
    )
    ends = (0.8, len(order) * 1.05)
    x = Axis("candidate position, best first", ends, True, words=lambda rank: fixed(rank, 0))
    y = Axis("sensitivity, 1 at the optimum", (0.0, None))
    return Panels((7.0, 2.6), [[Panel(marks, x, y)]])


def convergence(gaps: Array, final: float) -> Panels:
    """Return the certified gap after each round of the solver, and that of the final design.

    Parameters
    ----------
    gaps : ndarray, (R,)
        As of `Design.gaps`; rounds without a positive finite gap have no dot.
    final : float
        Gap of the design, a dashed line where it is positive.
    """
    shown = np.where(np.isfinite(gaps) & (gaps > 0), gaps, np.nan)
    rounds = Curve(np.arange(1.0, len(gaps) + 1), shown, "accent", 1.3, 4.0)
    last = [Rule(final, "second", 1.0, DASHES)] if final > 0 else []
    x = Axis("round", (0.5, len(gaps) + 0.5), integer=True, count=12)
    y = Axis("certified gap", log=True, words=lambda gap: significant(gap, 1))
    return Panels((7.0, 2.4), [[Panel([rounds, *last], x, y)]])


def costs_over_starts(costs: Mapping[str, Sequence[float]], best: Mapping[str, float]) -> Panels:
    """Return each residual's costs over its best one, a dot per start."""
    marks: list[Curve | Rule] = []
    highest = 1.0
    for row, (residual, values) in enumerate(costs.items()):
        ratio = np.asarray(values) / best[residual]
        highest = max(highest, float(ratio.max()))
        shift = np.linspace(-0.18, 0.18, len(ratio)) if len(ratio) > 1 else np.zeros(len(ratio))
        marks.append(Curve(ratio, row + shift, "accent", 0.0, 5.0, opacity=0.75))
    ends = (0.97, max(1.05 * highest, 1.2))
    words = "cost over the best cost of that estimator"
    x = Axis(words, ends, True, words=lambda ratio: significant(ratio, 3))
    names = {float(row): residual_label(residual) for row, residual in enumerate(costs)}
    y = Axis(limits=(len(costs) - 0.5, -0.5), names=names, line=False)
    size = (7.0, 0.9 + 0.42 * len(costs))
    return Panels(size, [[Panel([*marks, Rule(1.0, "muted", 0.8, DASHES, upright=True)], x, y)]])


def over_expected(ratio: Array, marked: IntArray) -> Panels:
    """Return a dot per position, (Q,), around one; those `marked` in another colour."""
    number = np.arange(1.0, len(ratio) + 1)
    marks = (
        Rule(1.0, "muted", 0.8, DASHES),
        Curve(*bars(number, np.ones(len(ratio)), ratio), "rule", 1.2),
        Curve(number, ratio, "accent", 0.0, 5.0),
        Curve(number[marked], ratio[marked], "second", 0.0, 5.0),
    )
    x = Axis("position", (0.4, len(ratio) + 0.6), integer=True, count=20)
    return Panels((7.0, 2.2), [[Panel(marks, x, Axis("over expected"))]])


def calibration(levels: Array, coverages: Sequence[Array], labels: Sequence[str]) -> Panels:
    """Return observed against nominal coverage, (L,) each, a curve per label."""
    ends = np.array([0.0, 100.0])
    diagonal = Curve(ends, ends, "muted", 0.8, dashes=DASHES)
    curves = [
        Curve(100 * levels, 100 * coverage, colour)
        for coverage, colour in zip(coverages, SERIES, strict=False)
    ]
    x, y = (Axis(f"{words} [%]", (0.0, 100.0)) for words in ("nominal", "observed"))
    panel = Panel([diagonal, *curves], x, y, square=True)
    return Panels((4.2, 3.6), [[panel]], legend=list(zip(labels, SERIES, strict=False)))
