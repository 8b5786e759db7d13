"""The commented study that ``oed init`` writes for a robot."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from oed.candidates.free_ranges import free_margin, free_ranges
from oed.candidates.grids import candidate_positions
from oed.candidates.sources import Workcell
from oed.candidates.starting_cell import starting_cell
from reports import text
from reports.commands.yaml_text import yaml_number, yaml_word
from reports.page_elements import filled_text
from robotmodels import ElasticRobot
from robotmodels.checks.proposed_drives import Drive, idle_joints
from robotmodels.collision.shapes import RobotShapes, robot_shapes
from robotmodels.common.arrays import Array
from robotmodels.common.errors import NoEquilibrium
from robotmodels.linear.modes import resonances
from robotmodels.linear.response import linearize

MOST_CANDIDATES = 1500
"""Candidates of a new study: a first answer within a minute."""

_INSET = 0.03
"""Part of a joint's range to stay away from either end."""

_MARGINS = (0.02, 0.01, 0.005)
"""Distances to keep from what may be touched, the usual one first [m]."""

_LINK_RADIUS = 0.05
"""Of links without collision shapes [m]."""

_BAND = (2.0, 80.0)
"""Of the responses, unless resonances lie outside [Hz]."""

_JUDGED = 256
"""Positions of the grid that the workcell is judged by."""

_FLOOR, _BURIED = 0.01, 0.3
"""Noise relative to the largest element, and the most that it may be of a motor's own response."""


def study_text(
    robot: ElasticRobot, reference: str, builtin: bool = False, drives: Sequence[Drive] = ()
) -> tuple[str, tuple[str, ...]]:
    """Return the study file of a robot, and sentences on what it leaves out.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    reference : str
        What the study calls it.
    builtin : bool
        Whether that is a name, not a path.
    drives : sequence of Drive
        Drives whose limits of effort and velocity are mentioned.
    """
    idle = idle_joints(robot)
    still = [
        n for n, (a, b) in zip(robot.motor_joints, robot.position_limits, strict=True) if a == b
    ]
    points = grid_points([name not in (*idle, *still) for name in robot.motor_joints])
    shapes = robot_shapes(robot)
    ranges = _ranges(robot, points)
    # Joints that are not varied stay in the middle, as in the grid.
    judged = np.where(np.array(points)[:, None] > 1, ranges, ranges.mean(axis=1, keepdims=True))
    rng = np.random.default_rng(0)
    drawn = rng.uniform(judged[:, 0], judged[:, 1], (_JUDGED // 2, len(judged)))
    first = starting_cell(
        robot, drawn, Workcell(floor=0.0, link_radius=None if shapes.solid else _LINK_RADIUS)
    )
    margin = free_margin(robot, judged, first.cell, _MARGINS)
    narrowed = free_ranges(robot, judged, replace(first.cell, margin=margin))
    grid = candidate_positions(robot, points, _written_ranges(narrowed, robot, points))
    some = rng.permutation(grid)[:_JUDGED]
    last = starting_cell(robot, some, replace(first.cell, margin=margin))
    below = first.below or last.below
    low, high = _band(robot)
    content = filled_text(
        "study.yaml.j2",
        name=robot.name,
        robot=yaml_word(reference),
        builtin=builtin,
        file="study.yaml",
        band=(yaml_number(low), yaml_number(high)),
        joints=[
            {
                "name": yaml_word(name),
                "points": number,
                "low": yaml_number(low, 3),
                "high": yaml_number(high, 3),
            }
            for name, number, (low, high) in zip(robot.motor_joints, points, narrowed, strict=True)
        ],
        noise_floor=yaml_number(noise_floor([m.inertia for m in robot.file.motors]), 1),
        link_radius=None if shapes.solid else _LINK_RADIUS,
        floor=None if last.cell.floor is None else yaml_number(last.cell.floor, 3),
        below=text.listed([yaml_word(link) for link in below[:_NAMED]]),
        ignored=[[yaml_word(a), yaml_word(b)] for a, b in last.ignored],
        margin=margin,
        usual_margin=_MARGINS[0],
        narrowed=bool(np.any(narrowed != judged)),
        candidates=math.prod(points),
        idle=text.listed([yaml_word(name) for name in idle if name not in still]),
        units="[rad; m]" if robot.elements.prismatic else "[rad]",
        torque=_limits(drives, "effort", -1),
        speed=_limits(drives, "velocity", 1),
        walkers=max(64, 4 * len(robot.parameters.names)),
        runs=max(50, 2 * len(robot.parameters.names)),
    )
    return content, tuple(_notes(shapes, still, below, last.ignored))


def _limits(drives: Sequence[Drive], key: str, power: int) -> list[str]:
    """Return limits stated on the arm side as those of the motor shafts; none if one lacks."""
    stated = [getattr(drive.joint.stated, key) for drive in drives]
    if None in stated:
        return []
    ratios = [abs(drive.gear_ratio) for drive in drives]
    return [yaml_number(v * r**power) for v, r in zip(stated, ratios, strict=True)]


def _notes(
    shapes: RobotShapes,
    still: Sequence[str],
    below: Sequence[str],
    ignored: Sequence[tuple[str, str]],
) -> Iterator[str]:
    """Yield sentences on what the study leaves out, and why."""
    yield from (note for note in shapes.notes if "bounding box" in note)
    yield from (f"joint {name!r} has equal limits and stays where it is" for name in still)
    if below:
        links = ", ".join(map(repr, below[:_NAMED]))
        yield f"no floor: {links} would be below that of the base"
    if ignored:
        pairs = "; ".join(f"{a} and {b}" for a, b in ignored[:_NAMED])
        more = f" and {len(ignored) - _NAMED} pairs more" if len(ignored) > _NAMED else ""
        yield f"not compared, as they touch at zero angles or in most positions: {pairs}{more}"


_NAMED = 4
"""Links or pairs that a sentence names."""


def _written_ranges(ranges: Array, robot: ElasticRobot, points: Sequence[int]) -> Array:
    """Return the ranges as the study file has them, within the joints' limits."""
    written = np.array([[float(yaml_number(end, 3)) for end in pair] for pair in ranges])
    low, high = robot.position_limits.T[:, :, None]
    return np.asarray(np.clip(written, low, high))


def _band(robot: ElasticRobot) -> tuple[float, float]:
    """Return the frequencies [Hz] from below the first resonance to above the last."""
    low, high = _BAND
    try:
        model = linearize(robot, robot.position_limits.mean(axis=1))
    except NoEquilibrium:
        return low, high
    hertz = resonances(model).frequencies / (2 * np.pi)
    hertz = hertz[hertz > 0]
    return min([low, *(0.5 * hertz)]), max([high, *(1.2 * hertz)])


def _ranges(robot: ElasticRobot, points: Sequence[int]) -> Array:
    """Return a range for each joint, (n, 2), a little inside its limits."""
    middle, half = robot.position_limits.mean(axis=1), np.diff(robot.position_limits)[:, 0] / 2
    half *= 1 - 2 * _INSET
    for j, name in enumerate(robot.motor_joints):
        if name not in robot.elements.prismatic:  # no point of the grid a whole turn from another
            half[j] = min(half[j], math.pi * (1 - 1 / max(points[j], 2)))
    return np.stack([middle - half, middle + half], axis=1)


def noise_floor(inertias: Sequence[float]) -> float:
    """Return the floor of the noise law: 1 %, or less for motors of very unlike inertias.

    Responses of a heavy motor are smaller than those of a light one by the ratio of inertias; a
    floor that is 1 % of the largest would bury them.
    """
    return min(_FLOOR, _BURIED * min(inertias) / max(inertias))


def grid_points(varied: Sequence[bool]) -> list[int]:
    """Return points per joint: one where a joint need not be `varied`, else what is affordable."""
    points = [1] * len(varied)
    most = {1: 15, 2: 15, 3: 9}.get(sum(varied), 5)
    grown = True
    while grown:
        grown = False
        for j in np.flatnonzero(varied):
            if (
                points[j] < most
                and math.prod(points) // points[j] * (points[j] + 1) <= MOST_CANDIDATES
            ):
                points[j] += 1
                grown = True
    return points
