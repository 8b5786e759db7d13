"""All that a fit says of a tool: compliance, modes and, on request, responses, with bands."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.uncertainty.recommended import recommended_uncertainty
from estimators.validation.bands import Spread
from estimators.validation.predict import Prediction, predict
from estimators.validation.quantities import (
    DampingRatios,
    Resonances,
    ToolCompliance,
    ToolResponse,
)
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import (
    Frame,
    Motion,
    compliance_ellipsoid,
    tool_frame,
    tool_model,
    underlying_robot,
)


@dataclass(frozen=True, eq=False)
class ToolPrediction:
    """What is predicted of a frame in Q positions.

    Attributes
    ----------
    frame : Frame
        The point and its axes.
    points : ndarray, (Q, 3), m
        Where it is, in the base's axes.
    compliance : Prediction
        Half axes of the compliance ellipsoid, (Q, 3) [m/N], motors clamped.
    directions : ndarray, (Q, 3, 3)
        Their directions, one a column.
    resonances : Prediction
        Lowest ones, (Q, k) [rad/s].
    damping : Prediction
        Damping ratios of the lowest modes, (Q, k).
    omega : ndarray, (F,), rad/s
        Angular frequencies of the response, none without.
    response : Prediction or None
        As `ToolResponse`, (Q, F, 6, 6).
    motion, motors : str
        Which motion, and what motors do, of response, resonances and damping.
    """

    frame: Frame
    points: Array
    compliance: Prediction
    directions: Array
    resonances: Prediction
    damping: Prediction
    omega: Array
    response: Prediction | None
    motion: Motion
    motors: Literal["clamped", "free"]


def predict_tool(
    source: FittedModel | ElasticRobot,
    positions: Array,
    frame: Frame | None = None,
    omega: Array | None = None,
    *,
    motion: Motion = "displacement",
    motors: Literal["clamped", "free"] = "clamped",
    modes: int = 2,
    spread: Spread | None = None,
    level: float = 0.95,
) -> ToolPrediction:
    """Return compliance, resonances, damping and response of a frame with their bands.

    Parameters
    ----------
    source : Fit, RunFit or ElasticRobot
        As in `predict`.
    positions : ndarray, (Q, n), rad
        Positions, one or a whole workspace.
    frame : Frame, optional
        By default the end of the last link.
    omega : ndarray, (F,), rad/s, optional
        Where responses are wanted.
    motion : {"displacement", "velocity", "acceleration"}
        Of responses.
    motors : {"clamped", "free"}
        Of responses, resonances and damping; compliance is that with clamped motors.
    modes : int
        Number of resonances and damping ratios.
    spread : Uncertainty or ndarray, (N, p), optional
        As in `predict`.
    level : float
        As in `predict`.

    Raises
    ------
    IdentificationError
        As `predict`.
    """
    model = source if isinstance(source, ElasticRobot) else source.model
    spread = recommended_uncertainty(source) if spread is None else spread
    at = np.atleast_2d(real_numbers(positions, "positions"))
    frame = frame or tool_frame(underlying_robot(model))
    tool = tool_model(model, at, frame, np.asarray(source.parameters.values))

    def band(quantity: ToolCompliance | ToolResponse | Resonances | DampingRatios) -> Prediction:
        return predict(source, quantity, at, spread=spread, level=level)

    return ToolPrediction(
        frame=frame,
        points=tool.point,
        compliance=band(ToolCompliance(frame)),
        directions=compliance_ellipsoid(tool.compliance()).directions,
        resonances=band(Resonances(modes, motors)),
        damping=band(DampingRatios(modes, motors)),
        omega=np.empty(0) if omega is None else omega,
        response=None if omega is None else band(ToolResponse(omega, frame, motion, motors)),
        motion=motion,
        motors=motors,
    )
