"""What a fit says of a tool in many positions: some at a time, in little memory."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.validation.bands import DRAWS, Spread
from estimators.validation.predict import Prediction
from estimators.validation.predict_tool import ToolPrediction, predict_tool
from robotmodels.common.arrays import Array
from robotmodels.common.progress import Progress
from robotmodels.elastic.robot import ElasticRobot

_MOST = 50
"""Positions at a time: the parameters' part of the work is repeated for each such number."""

_NUMBERS = 4_000_000
"""Responses at a time, of all draws: 65 MB."""


def predict_workspace(
    source: FittedModel | ElasticRobot,
    positions: Array,
    omega: Array | None = None,
    *,
    spread: Spread | None = None,
    progress: Progress | None = None,
    **words: Any,
) -> ToolPrediction:
    """Return `predict_tool` of many positions, computed some at a time.

    Parameters
    ----------
    source : Fit, RunFit or ElasticRobot
        As in `predict`.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s, optional
        Angular frequencies of responses.
    spread : Uncertainty or ndarray, (N, p), optional
        As in `predict`.
    progress : Progress, optional
        Called with the positions done and their number, before the first ones too.
    **words
        Frame, motion, motors, modes and level, as in `predict_tool`.

    Raises
    ------
    IdentificationError
        As `predict`.
    """
    draws = min(len(spread), DRAWS) if isinstance(spread, np.ndarray) else DRAWS
    numbers = 1 if omega is None else 36 * draws * len(omega)
    size = min(max(_NUMBERS // numbers, 1), _MOST)
    parts = []
    for first in range(0, len(positions), size):
        if progress is not None:
            progress(first, len(positions))
        some = positions[first : first + size]
        parts.append(predict_tool(source, some, omega=omega, spread=spread, **words))
    if progress is not None:
        progress(len(positions), len(positions))
    joined: ToolPrediction = _joined(parts)
    return joined


_OF_POSITIONS = {
    ToolPrediction: ("points", "compliance", "directions", "resonances", "damping", "response"),
    Prediction: ("positions", "values", "std", "phase_std", "lower", "upper"),
}


def _joined(parts: Sequence[Any]) -> Any:
    """Return predictions or arrays of all positions; None where there is nothing of any."""
    if isinstance(parts[0], np.ndarray) or parts[0] is None:
        return None if parts[0] is None else np.concatenate(parts)
    names = _OF_POSITIONS[type(parts[0])]
    values: dict[str, Any] = {name: _joined([getattr(p, name) for p in parts]) for name in names}
    return replace(parts[0], **values)
