"""FRFs of studies laid over each other, in positions and at lines that both have."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import robotmodels
from oed.study.results import StudyResults
from reports import text
from reports.figures.response_data import ElementView, ResponseData
from reports.figures.response_panels import lines_drawn, response_panels
from reports.page_elements import Figure, Section, figure, filled
from reports.sections.plan_labels import prismatic
from robotmodels.common.arrays import Array, ComplexArray, IntArray

_SAME = 1e-6
"""Of angles [rad], lengths [m] and relative frequencies."""


@dataclass(frozen=True, eq=False)
class _Pair:
    """A study beside the first one: (P, 2) positions in common, and what is drawn of each."""

    name: str
    study: StudyResults
    positions: IntArray
    fitted: bool


def section(studies: Mapping[str, StudyResults]) -> Section:
    """Return the section: FRFs of later studies over those of the first, and why some are not."""
    (first, reference), *others = studies.items()
    lines, reasons = np.empty(0, dtype=np.int64), []
    pairs: list[_Pair] = []
    for name, other in others:
        reason = obstacle(reference, other)
        if not reason:
            common = _common_lines(reference, other)
            common = np.intersect1d(lines, common) if pairs else common
            reason = "" if common.size else "they have no frequency in common"
        if reason:
            reasons.append(f"Frequency responses of {first} and {name} are not compared: {reason}.")
            continue
        lines = common
        positions = _common_rows(*(r.data.frf.positions for r in (reference, other)))
        same = _same_data(reference, other, positions)
        pairs.append(_Pair(name, other, positions, same))
    contents = _drawn(first, reference, pairs, lines) if pairs else {}
    body = filled("comparison_responses.html.j2", first=first, reasons=reasons, **contents)
    return Section("responses", "Frequency responses", body)


def obstacle(reference: StudyResults, other: StudyResults) -> str:
    """Return why FRFs of two studies cannot be compared; nothing where they can."""
    if reference.study.fits_runs or other.study.fits_runs:
        return "they need FRFs, and runs are fitted"
    for what in ("motor_names", "output_names", "output_units"):
        if getattr(reference.robot, what) != getattr(other.robot, what):
            return f"their {what.replace('_', ' ')} differ"
    positions = _common_rows(*(r.data.frf.positions for r in (reference, other)))
    return "" if len(positions) else "they have no position in common"


def _drawn(
    first: str, reference: StudyResults, pairs: list[_Pair], lines: IntArray
) -> dict[str, object]:
    """Return the figures, and the data of single elements."""
    robot = reference.robot
    count = sum(len(pair.positions) for pair in pairs)
    G = reference.data.frf.response
    lines = lines[lines_drawn((count, len(lines), *G.shape[2:]))]
    omega = reference.data.frf.omega[lines]
    ours, theirs, labels = [], [], []
    for pair in pairs:
        at = [np.argmin(np.abs(pair.study.data.frf.omega - w)) for w in omega]
        ours.append(_responses(reference, pair.positions[:, 0], lines, pair.fitted))
        theirs.append(_responses(pair.study, pair.positions[:, 1], np.array(at), pair.fitted))
        labels += _labels(first, reference, pair)
    (one, one_std), (other, other_std) = (
        tuple(np.concatenate(part) for part in zip(*both, strict=True)) for both in (ours, theirs)
    )
    size = np.maximum(np.abs(other), np.finfo(float).tiny)
    once = np.ones(count, dtype=np.int64)
    shown = ResponseData(omega, one, one_std, once, omega, other, other_std / size)
    panels = [_panels(reference, shown, k, label) for k, label in enumerate(labels)]
    names = [(first, pair.name) for pair in pairs for _ in pair.positions]
    element = ElementView("shared position", names=names, views=3, paired=True)
    ids, units = [panel.id for panel in panels], robot.output_units
    return {
        "panels": panels,
        "embedded": shown.embedded(ids, robot.motor_names, robot.output_names, units, element),
        "others": [pair.name for pair in pairs],
        "fitted": [pair.name for pair in pairs if pair.fitted],
        "units": dict.fromkeys(unit.replace("^2", "²") for unit in units),
    }


def _panels(reference: StudyResults, shown: ResponseData, k: int, label: str) -> Figure:
    robot = reference.robot
    drawing = response_panels(
        shown.omega,
        shown.measured[k],
        shown.std[k],
        None if shown.model is None else shown.model[k],
        robot.motor_names,
        outputs=robot.output_names,
        dashed=True,
    )
    alt = f"Magnitudes and phases of both studies' frequency responses, {label}"
    return figure(f"shared-{k + 1}", drawing, alt, label=label, wide=True)


def _labels(first: str, reference: StudyResults, pair: _Pair) -> list[str]:
    straight, positions = prismatic(reference), reference.data.frf.positions
    return [
        f"Position {i + 1} of {first}, {j + 1} of {pair.name}: "
        + ", ".join(text.format_position(positions[i], straight))
        for i, j in pair.positions
    ]


def _responses(
    results: StudyResults, positions: IntArray, lines: IntArray, fitted: bool
) -> tuple[ComplexArray, Array]:
    """Return FRFs (P, F, m, n) of the fit or of the data, and their standard deviations."""
    estimate = results.data.frf
    among = np.ix_(positions, lines)
    if not fitted:
        return estimate.response[among], np.sqrt(estimate.variance[among])
    values = results.fits.result.parameters.values
    at, omega = estimate.positions[positions], estimate.omega[lines]
    G = robotmodels.frequency_response(results.robot, at, omega, values)
    certain = results.responses
    return G, np.zeros(G.shape) if certain is None else np.abs(G) * certain.std[among]


def _common_rows(one: Array, other: Array) -> IntArray:
    """Return the rows (P, 2) in which two lists of positions agree, each once."""
    equal = np.abs(one[:, None] - other).max(axis=-1) <= _SAME
    return np.array([(i, int(row.argmax())) for i, row in enumerate(equal) if row.any()]).reshape(
        -1, 2
    )


def _common_lines(reference: StudyResults, other: StudyResults) -> IntArray:
    """Return which lines of the reference the other has too."""
    one, two = (r.data.frf.omega for r in (reference, other))
    return np.flatnonzero((np.abs(one[:, None] / two - 1) <= _SAME).any(axis=1))


def _same_data(reference: StudyResults, other: StudyResults, positions: IntArray) -> bool:
    """Return whether two studies have the same FRFs, so that only their fits differ."""
    one, two = (
        r.data.frf.response[rows] for r, rows in zip((reference, other), positions.T, strict=True)
    )
    return one.shape == two.shape and bool(np.array_equal(one, two))
