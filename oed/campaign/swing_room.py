"""Candidates whose excitation can swing as far as its limit lets it."""

from dataclasses import replace

import numpy as np

from oed.campaign.settings import VisitSettings
from oed.candidates.screening import ScreenedCandidates
from oed.experiment.loop_settings import per_motor
from robotmodels import ElasticRobot
from robotmodels.collision.free_moves import swing_contact
from robotmodels.collision.surroundings import Surroundings
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput


def with_room(
    candidates: ScreenedCandidates,
    settings: VisitSettings,
    robot: ElasticRobot,
    surroundings: Surroundings | None,
) -> ScreenedCandidates:
    """Return the candidates around which motors swing inside their ranges and touch nothing.

    All of them where `limits.swing` is not stated; removed ones count as "swing".

    Raises
    ------
    InvalidInput
        If none is left, naming what is in the way.
    """
    if settings.limits.swing is None:
        return candidates
    swing = per_motor("limits.swing", settings.limits.swing, tuple(robot.motor_names))
    reasons = [_obstruction(robot, surroundings, q, swing) for q in candidates.positions]
    free = np.array([not reason for reason in reasons], dtype=bool)
    if not free.any():
        raise InvalidInput(
            f"limits.swing: none of {len(reasons)} candidates has room for it; around the first, "
            f"{reasons[0]}; a smaller swing, or other candidates, are needed"
        )
    return replace(
        candidates,
        positions=candidates.positions[free],
        indices=candidates.indices[free],
        removed={**candidates.removed, "swing": int((~free).sum())},
    )


def _obstruction(
    robot: ElasticRobot, surroundings: Surroundings | None, position: Array, swing: Array
) -> str:
    """Return what is in the way of a swing around a position; empty where nothing is."""
    low, high = robot.position_limits.T
    beyond = (position - swing < low) | (position + swing > high)
    if beyond.any():
        return f"the range of motor {robot.motor_names[int(beyond.argmax())]!r} ends"
    pair = swing_contact(surroundings, position, -swing, swing)
    return "" if pair is None else f"{pair} would touch"
