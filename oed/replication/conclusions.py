"""Whether a study's models support the seven conclusions of [WM] section 7, by stated rules.

Two estimators are compared by their numbers of models of reasonable cost from the same starts, an
exact McNemar test on the starts in which they differ; and, where the truth is known, by the errors
of their best models, a sign test over the parameters. Two groups of parameters are compared by the
part of LLS15U models that find each within [0.5, 2] of the best model's value, and by the standard
deviations of Theorem 1: a rank-sum test (gearbox against arm) or a sign test over pairs of spring
and damper. A difference counts if p < 0.05.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from oed.replication.paper import CONCLUSIONS
from oed.replication.six_estimators import Evaluation
from oed.replication.table_1 import Groups, Table1, success_share
from robotmodels.common.arrays import Array

Verdict = Literal["supported", "not supported", "undecided"]
LEVEL = 0.05
ONE_MINIMUM = 1e-3
"""Median scatter of the best models, in standard deviations, below which they are one."""


@dataclass(frozen=True)
class Judged:
    """One conclusion, what this study says of it, and why."""

    conclusion: str
    verdict: Verdict
    evidence: str


@dataclass(frozen=True)
class Contest:
    """How many of the same starts led two estimators to a reasonable cost.

    Attributes
    ----------
    first, second : str
        Names.
    wins, losses : int
        Starts of which only the first, or only the second, made a reasonable model.
    counts : tuple of (int, int)
        Reasonable models of each.
    total : int
        Starts.
    p : float
        p-value of the exact McNemar test.
    """

    first: str
    second: str
    wins: int
    losses: int
    counts: tuple[int, int]
    total: int
    p: float

    @property
    def outcome(self) -> int:
        """1 if the first is better, -1 if the second is, 0 if chance could have done it."""
        return 0 if self.p >= LEVEL else 1 if self.wins > self.losses else -1

    def __str__(self) -> str:
        return (
            f"{self.first} {self.counts[0]} of {self.total} reasonable, {self.second} "
            f"{self.counts[1]} ({_p(self.p)})"
        )


def contest(evaluation: Evaluation, first: str, second: str) -> Contest:
    """Compare two estimators start by start."""
    good = []
    for name in (first, second):
        row = evaluation.of(name)
        reached = np.zeros(evaluation.user.shape[1], dtype=bool)
        reached[evaluation.start[row]] = evaluation.reasonable_by_cost[row]
        good.append(reached)
    wins, losses = int((good[0] & ~good[1]).sum()), int((good[1] & ~good[0]).sum())
    counts = int(good[0].sum()), int(good[1].sum())
    return Contest(first, second, wins, losses, counts, len(good[0]), sign_test(wins, losses))


def sign_test(wins: int, losses: int) -> float:
    """Return the p value of an unequal split, two-sided and exact; ties do not count."""
    from scipy.stats import binomtest

    return float(binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0


def conclusions(
    evaluation: Evaluation,
    theorem1: Uncertainty,
    table: Table1,
    groups: Groups,
    truth: Array,
) -> tuple[Judged, ...]:
    """Return the verdicts on the seven conclusions.

    Parameters
    ----------
    evaluation : Evaluation
        Estimates of the study.
    theorem1 : Uncertainty
        Theorem 1 of the best LLS15U model.
    table : Table1
        Table 1 of the study.
    groups : Groups
        Groups of the parameters.
    truth : ndarray, (p,)
        True parameters [SI], NaN if unknown.
    """
    contests = (
        (("LLS15U", "NLS15U"), ("LLS15O", "NLS15O")),
        (("LLS15U", "LLS1U"),),
        (("LLS15U", "LLSM15U"),),
        (("LLS15U", "LLS15O"), ("NLS15U", "NLS15O")),
    )
    verdicts = [_estimators_differ(evaluation, truth, pairs) for pairs in contests]
    share = success_share(evaluation)
    verdicts.append(_groups_differ(share, theorem1.std, groups.gear_springs, groups.arm_springs))
    verdicts.append(_pairs_differ(share, theorem1.std, groups.springs, groups.dampers))
    verdicts.append(_indicative(table, np.log(evaluation.best / truth) / theorem1.std))
    return tuple(
        Judged(text, verdict, evidence)
        for text, (verdict, evidence) in zip(CONCLUSIONS, verdicts, strict=True)
    )


def agreed(outcomes: Sequence[int]) -> Verdict:
    """Return the verdict of several comparisons: 1 for the conclusion, -1 against, 0 open.

    Some for it and none against support it, some against and none for do not.
    """
    if min(outcomes) < 0:
        return "not supported" if max(outcomes) <= 0 else "undecided"
    return "supported" if max(outcomes) > 0 else "undecided"


def _estimators_differ(
    evaluation: Evaluation, truth: Array, pairs: Sequence[tuple[str, str]]
) -> tuple[Verdict, str]:
    outcomes, sentences = [], []
    for first, second in pairs:
        one = contest(evaluation, first, second)
        outcomes.append(one.outcome)
        sentences.append(str(one))
        if np.isfinite(truth).any():
            errors = [_errors(evaluation, name, truth) for name in (first, second)]
            nearer = _smaller(*errors)
            outcomes.append(nearer.outcome)
            sentences.append(
                f"median true error of the best models {_percent(errors[0])} and "
                f"{_percent(errors[1])}, smaller for {nearer}"
            )
    return agreed(outcomes), "; ".join(sentences)


def _errors(evaluation: Evaluation, name: str, truth: Array) -> Array:
    """Return |ln(estimate/truth)| of the parameters that have a true value."""
    errors = np.abs(np.log(evaluation.values[evaluation.of(name), 0] / truth))
    return np.asarray(errors[np.isfinite(errors)])


@dataclass(frozen=True)
class _Split:
    """Of so many pairs, in how many the first is smaller, or the second."""

    smaller: int
    larger: int
    total: int

    @property
    def p(self) -> float:
        return sign_test(self.smaller, self.larger)

    @property
    def outcome(self) -> int:
        return _outcome(self.smaller - self.larger, self.p)

    def __str__(self) -> str:
        return f"{self.smaller} of {self.total} ({_p(self.p)})"


def _smaller(first: Array, second: Array) -> _Split:
    return _Split(int((first < second).sum()), int((first > second).sum()), len(first))


def _groups_differ(
    share: Array, std: Array, gear: Sequence[int], arm: Sequence[int]
) -> tuple[Verdict, str]:
    from scipy.stats import mannwhitneyu

    if not gear or not arm:
        return "undecided", "the model has no springs of one of the kinds"
    outcomes, sentences = [], []
    for what, easy, values in (("part of models that find one", 1, share), ("std_th", -1, std)):
        a, b = values[list(gear)], values[list(arm)]
        # All equal: no rank is above another.
        p = float(mannwhitneyu(a, b).pvalue) if np.ptp(np.append(a, b)) > 0 else 1.0
        outcomes.append(_outcome(easy * float(np.median(a) - np.median(b)), p))
        sentences.append(f"median {what} {_percent(a)} (gearboxes), {_percent(b)} (arm), {_p(p)}")
    return agreed(outcomes), "springs: " + "; ".join(sentences)


def _pairs_differ(
    share: Array, std: Array, springs: Sequence[int], dampers: Sequence[int]
) -> tuple[Verdict, str]:
    if not springs:
        return "undecided", "the model has no pairs of spring and damper"
    spring, damper = list(springs), list(dampers)
    easier = _smaller(share[damper], share[spring])
    surer = _smaller(std[spring], std[damper])
    evidence = (
        f"more models find the spring than its damper in {easier}; median std_th "
        f"{_percent(std[spring])} (springs), {_percent(std[damper])} (dampers), smaller for the "
        f"spring in {surer}"
    )
    return agreed([easier.outcome, surer.outcome]), evidence


def _indicative(table: Table1, z_scores: Array) -> tuple[Verdict, str]:
    """Judge std_th by the scatter of the best models and, if there are any, by the true errors.

    Models that are one minimum, to the search's tolerance, have no informative scatter.
    It indicates the scatter if the ranks correlate and the median ratio lies within a factor of
    ten ([WM] have 1.5 to 33, median 3); the errors if their root mean square is at most three.
    """
    from scipy.stats import spearmanr

    outcomes, sentences = [], []
    ratio = table.std / table.theory
    middle = float(np.median(ratio))
    if middle < ONE_MINIMUM:
        sentences.append(
            f"the best {table.count} models are one minimum, whose scatter says nothing"
        )
    elif np.ptp(table.std) > 0 and np.isfinite(middle):
        ranks = spearmanr(table.std, table.theory)
        correlated = ranks.statistic > 0 and ranks.pvalue < LEVEL
        outcomes.append(1 if correlated and 0.1 <= middle <= 10 else -1)
        sentences.append(
            f"scatter of the best {table.count} over std_th: median {middle:.2g}, "
            f"{ratio.min():.2g} to {ratio.max():.2g}, rank correlation {ranks.statistic:.2f}"
        )
    finite = z_scores[np.isfinite(z_scores)]
    if finite.size:
        rms = float(np.sqrt(np.mean(finite**2)))
        outcomes.append(1 if rms <= 3 else -1)
        sentences.append(f"true error over std_th of {finite.size} parameters: rms {rms:.2g}")
    if not sentences:
        return "undecided", "neither scatter nor truth is known"
    return agreed(outcomes or [0]), "; ".join(sentences)


def _outcome(difference: float, p: float) -> int:
    return 0 if p >= LEVEL or difference == 0 else 1 if difference > 0 else -1


# In what people read, a number and its sign stay on one line.
_SPACE = "\N{NO-BREAK SPACE}"


def _percent(values: Array) -> str:
    value = 100 * float(np.median(values))
    return f"{value:.0f}{_SPACE}%" if value >= 10 else f"{value:.2g}{_SPACE}%"


def _p(value: float) -> str:
    return f"p{_SPACE}<{_SPACE}0.001" if value < 0.001 else f"p{_SPACE}{value:.2g}"
