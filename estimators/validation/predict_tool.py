"""All that a fit says of a tool: compliance, modes and, on request, responses, with bands."""

from collections.abc import Callable
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
from robotmodels.common.arrays import Array, ComplexArray, real_numbers
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import (
    Frame,
    Motion,
    ToolModel,
    compliance_ellipsoid,
    tool_frame,
    tool_model,
    underlying_robot,
)
from robotmodels.linear.linear_model import LinearModel


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
    tools: dict[bytes, ToolModel] = {}

    def tool_at(theta: Array) -> ToolModel:
        """Return the linear models at parameters, which all quantities share."""
        if theta.tobytes() not in tools:
            tools[theta.tobytes()] = tool_model(model, at, frame, theta)
        return tools[theta.tobytes()]

    def linear_at(theta: Array) -> LinearModel:
        if isinstance(model, ElasticRobot):
            return tool_at(theta).model
        return model.network(at, theta).linear_model()

    def band(quantity: Callable[[Array], Array | ComplexArray]) -> Prediction:
        return predict(source, lambda _, __, theta: quantity(theta), at, spread=spread, level=level)

    tool = tool_at(np.asarray(source.parameters.values))
    resonances, damping = Resonances(modes, motors), DampingRatios(modes, motors)
    response = None if omega is None else ToolResponse(omega, frame, motion, motors)

    return ToolPrediction(
        frame=frame,
        points=tool.point,
        compliance=band(lambda theta: ToolCompliance(frame).of(tool_at(theta))),
        directions=compliance_ellipsoid(tool.compliance()).directions,
        resonances=band(lambda theta: resonances.of(linear_at(theta))),
        damping=band(lambda theta: damping.of(linear_at(theta))),
        omega=np.empty(0) if omega is None else omega,
        response=None if response is None else band(lambda theta: response.of(tool_at(theta))),
        motion=motion,
        motors=motors,
    )
