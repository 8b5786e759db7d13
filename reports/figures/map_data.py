"""Candidates of a design as compact data, which the page's script draws over two coordinates."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from reports.figures.packed_numbers import packed
from robotmodels import Box, Plane, Sphere
from robotmodels.collision.obstacles import Obstacle
from robotmodels.common.arrays import Array

_DIGIT, _OF_SENSITIVITY = 1e-3, 5e-3


@dataclass(frozen=True, eq=False)
class MapData:
    """Candidates to draw.

    Attributes
    ----------
    names : sequence of str, (c,)
        Coordinates with their units; the last three are those of the tool [m].
    candidates : ndarray, (Q, c)
        Their values.
    sensitivity : ndarray, (Q,)
        1 at the optimum.
    weights : ndarray, (Q,)
        Shares of the visits in the relaxed design; few are above zero.
    plan : ndarray, (P, c)
        Positions of the plan.
    visits : sequence of str, (P,)
        Visits to each, in words.
    refused : ndarray, (R, c)
        Positions that were refused.
    reasons : sequence of str, (R,)
        Why.
    obstacles : sequence of Obstacle
        What the robot may not touch; planes are not drawn.
    """

    names: Sequence[str]
    candidates: Array
    sensitivity: Array
    weights: Array
    plan: Array
    visits: Sequence[str]
    refused: Array
    reasons: Sequence[str]
    obstacles: Sequence[Obstacle]

    def embedded(self) -> Markup:
        """Return the data for a page."""
        reasons = sorted(set(self.reasons))
        content = {
            "names": [*self.names],
            "candidates": packed(self.candidates, _DIGIT, 0),
            "sensitivity": packed(self.sensitivity[:, None], _OF_SENSITIVITY, 0),
            "weights": {
                int(q): float(f"{self.weights[q]:.3g}") for q in np.flatnonzero(self.weights)
            },
            "plan": self.plan.round(3).tolist(),
            "visits": [*self.visits],
            "refused": self.refused.round(3).tolist(),
            "reasons": reasons,
            "reason": [reasons.index(one) for one in self.reasons],
            "obstacles": [_extent(one) for one in self.obstacles if not isinstance(one, Plane)],
        }
        words = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
        return Markup(f'<script type="application/json" class="candidates">{words}</script>')


def _extent(obstacle: Box | Sphere) -> list[object]:
    """Return name, lowest and highest corner [m] of an obstacle."""
    half = np.full(3, obstacle.radius) if isinstance(obstacle, Sphere) else _half(obstacle)
    low, high = np.array(obstacle.center) - half, np.array(obstacle.center) + half
    return [obstacle.name, low.round(3).tolist(), high.round(3).tolist()]


def _half(box: Box) -> Array:
    """Return half the sizes of the box along the axes that surrounds a turned one, (3,)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(box.rpy), np.sin(box.rpy)
    rotation = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return np.asarray(np.abs(rotation) @ np.array(box.size) / 2)
