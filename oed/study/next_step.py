"""What to do next about a study: one sentence for page, terminal and JSON."""

from dataclasses import dataclass

import numpy as np

from estimators.uncertainty.next_measurements import best_additions
from oed.study.parts import DesignedPlan
from oed.study.results import FittedStudy, PlannedStudy
from robotmodels.common.arrays import Array

PRECISE = 0.1
"""Relative standard deviation above which a parameter is worth more measurements."""

_REPEATED = 2
"""Positions that are proposed for further measurements."""

_LISTED = 12
"""Positions that are listed in an order; a page's figure lists all of them."""

_STEPS_NAMED = 2
"""Steps against weak combinations that are named; a page lists all of them."""

_OF_SETTINGS = {
    "not converged": "raise fit.starts of the study, or improve the values of the robot file that "
    "searches start from",
    "too few blocks": "give the FRFs with their degrees of freedom, or records of two or more "
    "blocks in every position",
}


@dataclass(frozen=True)
class NextStep:
    """The most useful thing to do after a study.

    Attributes
    ----------
    action : {"measure", "measure again", "correct the model", "reparametrise", "settings", "none"}
        Kind of step.
    sentence : str
        The step in words, without a full stop.
    positions : tuple of int
        Numbers of the plan's positions that it concerns, from 1, the first to measure first.
    """

    action: str
    sentence: str
    positions: tuple[int, ...] = ()


def next_step(results: PlannedStudy) -> NextStep:
    """Return what to do next: by the verdict of a fit, or by the prediction of a plan alone."""
    if not isinstance(results, FittedStudy):
        return _before_measuring(results)
    verdict = results.trust.verdict
    if verdict in _OF_SETTINGS:
        return NextStep("settings", _OF_SETTINGS[verdict])
    if verdict == "model error":
        return _corrected_model(results)
    if verdict == "not identifiable" and (step := _reparametrised(results)) is not None:
        return step
    return _more_measurements(results)


def _before_measuring(results: PlannedStudy) -> NextStep:
    advice = results.plan.predicted.advice
    if advice:
        steps = "; ".join(step.text for step in advice[:_STEPS_NAMED])
        return NextStep("reparametrise", f"before anyone measures, {steps}")
    count = len(results.plan.used)
    if count == 1:
        return NextStep("measure", "measure in position 1", (1,))
    if isinstance(results.plan, DesignedPlan) and results.plan.order is not None:
        where = f"in positions 1 to {count}, in this order"
        return NextStep("measure", f"measure {where}", tuple(range(1, count + 1)))
    order = tuple(int(q) + 1 for q in results.plan.nested.positions)
    first = ", ".join(map(str, order[:_LISTED])) + (", ..." if count > _LISTED else "")
    sentence = f"measure in positions 1 to {count}, the most informative first: {first}"
    return NextStep("measure", sentence, order)


def _corrected_model(results: FittedStudy) -> NextStep:
    """Return the step against an error of the model, of few positions if only these fit badly."""
    outlying = tuple(int(q) + 1 for q in results.fits.residuals.outlying)
    search = (
        "run oed structure, which tests for missing springs and wrong numbers of the robot file"
    )
    if not 0 < len(outlying) <= len(results.plan.used) / 2:
        return NextStep("correct the model", search)
    sentence = f"check or repeat the measurement in {_positions(outlying)}, which fits worst"
    return NextStep("measure again", f"{sentence}; if it stays so, {search}", outlying)


def _reparametrised(results: FittedStudy) -> NextStep | None:
    advice = results.fits.identifiability.advice
    if not advice:
        return None
    return NextStep("reparametrise", "; ".join(step.text for step in advice[:_STEPS_NAMED]))


def _more_measurements(results: FittedStudy) -> NextStep:
    """Return the positions to measure again for the parameters that are not precise."""
    std = results.trust.std
    names = [n for n, s in zip(results.trust.names, std, strict=True) if not s <= PRECISE]
    if not names:
        limit = f"{100 * PRECISE:g} %; more visits are advised above that"
        return NextStep("none", f"nothing: every relative standard deviation is at most {limit}")
    positions, gain = _best_repeated(results, names)
    whose = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    sentence = (
        f"measure again in {_positions(positions)}: the standard deviation of {whose}, more than "
        f"{100 * PRECISE:g} %, falls by a factor of about {gain:.2g}"
    )
    return NextStep("measure again", sentence, positions)


def _best_repeated(results: FittedStudy, names: list[str]) -> tuple[tuple[int, ...], float]:
    """Return positions whose repetition helps `names` most, each after the one before it."""
    plan, information = results.plan, results.fits.information
    visits: Array = plan.visit_share * np.asarray(plan.information.take(plan.used))
    positions, gain = set[int](), 1.0
    for _ in range(_REPEATED):
        additions = best_additions(information, visits, results.trust.names, names)
        best = int(additions.order[0])
        positions.add(best + 1)
        gain *= float(additions.gain[best])
        information = information + visits[best]
    return tuple(sorted(positions)), gain


def _positions(numbers: tuple[int, ...]) -> str:
    words = " and ".join(map(str, numbers))
    return f"position {words}" if len(numbers) == 1 else f"positions {words}"
