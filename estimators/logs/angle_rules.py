"""Angles and velocities in a proposal: units, sides, factors, lags."""

from collections.abc import Sequence

import numpy as np

from estimators.logs.families import Family
from estimators.logs.findings import pose_findings
from estimators.logs.search import Search
from estimators.logs.shift_regression import Relation, angle_relation, velocity_relation
from estimators.logs.unit_hypotheses import (
    ANGLES,
    Hypothesis,
    angle_hypotheses,
    rate_hypotheses,
    usual_angle_unit,
    without_jumps,
)
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.units import is_counts, stated_unit

_MANY_COUNTS = 64.0
_MOST_SAMPLES_LATE = 3.0
"""Samples of lag above which a velocity is a filtered one and is left out."""


def propose_angles(search: Search) -> None:
    """Add motor angles and, where there are some, link angles.

    Raises
    ------
    InvalidInput
        If the angles leave the limits of the joints in every usual unit, or are counts.
    """
    family = search.members["motor_angle"]
    unit = _stated_angle_unit(search)
    _, values = search.samples("motor_angle")
    continuous = without_jumps(values, unit)
    spans = np.stack([np.nanmin(continuous, axis=0), np.nanmax(continuous, axis=0)], axis=1)
    ratios, limits = _joint_facts(search)
    links = _link_relations(search)
    sides, reason = _sides(links, ratios)
    hypotheses = angle_hypotheses(
        spans, ratios, limits, unit, sides, values[0], bool((continuous != values).any())
    )
    doubt = _doubt(values)
    if not hypotheses:
        raise InvalidInput(
            f"{search.log.where}: {family.pattern}: in no usual unit are these angles within "
            f"the limits of the joints{doubt}; state unit, side and start_pose in a mapping"
        )
    search.angle = hypotheses[0]
    evidence = _angle_evidence(family, hypotheses, reason, doubt)
    search.add("motor_angle", search.angle.unit, evidence, {"side": search.angle.side})
    scale = ANGLES[search.angle.unit] / (ratios if search.angle.side == "motor" else 1.0)
    angles = np.sort(spans * np.broadcast_to(scale, len(spans))[:, None], axis=1)
    search.findings += pose_findings(angles, limits, family.joints or search.joints)
    if links:
        _propose_link(search, links)


def _stated_angle_unit(search: Search) -> str:
    family = search.members["motor_angle"]
    if is_counts(family.unit):
        raise InvalidInput(
            f"{search.log.where}: {family.pattern}: in counts of encoders; state counts_per_turn "
            "and side in a mapping"
        )
    return usual_angle_unit(stated_unit(family.unit, "motor_angle"))


def _doubt(values: Array) -> str:
    """Return what speaks for counts of encoders, in words."""
    if np.ptp(values) > _MANY_COUNTS and np.array_equal(values, np.rint(values)):
        return "; all are whole numbers, perhaps counts of encoders (counts_per_turn)"
    return ""


def _angle_evidence(
    family: Family, hypotheses: Sequence[Hypothesis], reason: str, doubt: str
) -> str:
    """Return what unit and side of motor angles rest on, and what else would fit."""
    bare = "taken for angles, as no name tells any; " if family.by_default else ""
    told = "unit by its name" if family.unit else "unit by the range alone"
    others = " or ".join(f"{h.unit} on the {h.side} side" for h in hypotheses[1:])
    return f"{bare}{told}, {reason}{doubt}{f'; {others} would fit too' if others else ''}"


def _joint_facts(search: Search) -> tuple[Array, Array | None]:
    """Return gear ratios and limits of the joints that have an angle."""
    if search.robot is None:
        return search.ratios, None
    names = search.members["motor_angle"].joints or search.joints
    index = [search.joints.index(name) for name in names]
    return search.ratios[index], search.robot.position_limits[index]


def _link_relations(search: Search) -> tuple[Relation | None, ...]:
    if "link_angle" not in search.members:
        return ()
    stamps, motor = search.samples("motor_angle")
    link_stamps, link = search.samples("link_angle")
    if stamps.shape != link_stamps.shape or link.shape != motor.shape:
        return ()
    return tuple(angle_relation(stamps, motor[:, j], link[:, j]) for j in range(motor.shape[1]))


def _sides(links: Sequence[Relation | None], ratios: Array) -> tuple[tuple[str, ...], str]:
    """Return the sides of the gear that motor angles may be on, and why."""
    slopes = [link.factor for link in links if link is not None and link.determined]
    if not slopes:
        return ("joint", "motor"), "side by the range"
    slope, gear = float(np.median(np.abs(slopes))), _usual_gear(ratios)
    if not np.isfinite(gear):
        return ("joint", "motor"), "side by the range"
    # Motor over link: a ratio of units, times the gear's where the motor side was recorded.
    units = (1.0, ANGLES["deg"], 1 / ANGLES["deg"])
    sides = {"joint": [slope / u for u in units], "motor": [slope / u / gear for u in units]}
    side = min(sides, key=lambda name: min(abs(np.log(value)) for value in sides[name]))
    told = f"{min(slopes):.4f} to {max(slopes):.4f}"
    return (side,), f"{side} side: slope against the link's angle {told}"


def _usual_gear(ratios: Array) -> float:
    """Return the median size of the gear ratios, NaN where none is stated."""
    sizes = np.abs(ratios[np.isfinite(ratios)])
    return float(np.median(sizes)) if len(sizes) else np.nan


def _propose_link(search: Search, links: tuple[Relation | None, ...]) -> None:
    _, values = search.samples("link_angle")
    absent = [c for c, v in zip(search.members["link_angle"].channels, values.T, strict=True)
              if not np.ptp(v) > 0]  # fmt: skip
    lags = ", ".join(lag_text(link) for link in links if link is not None)
    evidence = f"late against the motor angle by {lags} ms"
    if absent:
        evidence += f"; {', '.join(absent)} constant, hence absent"
    unit = stated_unit(search.members["link_angle"].unit, "link_angle") or search.angle.unit
    search.add("link_angle", unit, evidence, relations=links)


def lag_text(relation: Relation) -> str:
    """Return a lag in ms with its standard error, or that it is not determined."""
    if not relation.determined:
        return "not determined"
    return f"{1e3 * relation.lag:.2f} +- {1e3 * relation.lag_std:.2g}"


def propose_velocity(search: Search, role: str) -> None:
    """Add velocities: unit, side and sign by the factor between their integral and the angle."""
    angle_role = "link_angle" if role == "link_velocity" else "motor_angle"
    if angle_role not in search.members:
        return
    stamps, angle = search.samples(angle_role)
    family = search.members[role]
    times, rate = search.samples(role)
    if angle.shape != rate.shape or not np.allclose(times, stamps, rtol=0, atol=1e-3):
        search.add(role, "", "on another clock than the angle: not determined", used=False)
        return
    relations = tuple(velocity_relation(stamps, a, v) for a, v in zip(angle.T, rate.T, strict=True))
    if any(r is not None and r.determined for r in relations):
        _add_rate(search, role, relations)
        return
    stated = stated_unit(family.unit, role)
    evidence = "not determined: nothing moves enough, or it is no derivative of the angle"
    more = {"side": search.angle.side} if role == "motor_velocity" else {}
    used = bool(stated) or role == "motor_velocity"
    search.add(role, stated or f"{search.angle.unit}/s", evidence, more, relations, used)


def _add_rate(search: Search, role: str, relations: tuple[Relation | None, ...]) -> None:
    """Add velocities whose integral is the angle, or tell that they are too late to be used."""
    moving = [i for i, r in enumerate(relations) if r is not None and r.determined]
    good = [relation for relation in relations if relation is not None and relation.determined]
    factors = np.array([1 / relation.factor for relation in good])
    ratio = _usual_gear(search.ratios) if search.angle.side == "joint" else np.nan
    sizes = _alike(np.abs(factors), np.abs(search.ratios[moving]), ratio)
    hits = rate_hypotheses(float(np.median(sizes)), search.angle.unit, ratio)
    told = (
        f"derivative of the angle times {factors.mean():.4f} (channels {factors.min():.4f} to "
        f"{factors.max():.4f}), late by {', '.join(lag_text(r) for r in good)} ms"
    )
    step = search.times[search.members[role].table.name].clock.sample_time
    late = float(np.median([relation.lag for relation in good])) > _MOST_SAMPLES_LATE * step
    if late or not hits:
        reason = "that late it is unfit and left out" if late else "no usual unit has this factor"
        search.add(role, "", f"{told}; {reason}", None, relations, used=False)
        return
    best = hits[0][1]
    gears = search.ratios if best.side == "motor" else np.ones(len(relations))
    signs = [
        int(np.sign(r.factor * gear)) if r is not None and r.determined else 1
        for r, gear in zip(relations, gears, strict=True)
    ]
    more: dict[str, object] = {"sign": signs[0] if len(set(signs)) == 1 else tuple(signs)}
    if role == "motor_velocity":
        more["side"] = best.side if best.side == "motor" else search.angle.side
    search.add(role, best.unit, told, more, relations)


def _alike(sizes: Array, ratios: Array, usual: float) -> Array:
    """Return factors at the usual ratio, where that makes those of different gears more alike."""
    at_usual = sizes * usual / ratios
    if np.isfinite(at_usual).all() and np.ptp(np.log(at_usual)) < np.ptp(np.log(sizes)):
        return at_usual
    return sizes
