"""Modal parameters as plain data: what a controller's notch filters and observers ask for."""

from typing import Any

import numpy as np

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.plain_data import json_data
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.modes import anti_resonances, damped_modes, resonances
from robotmodels.linear.response import linearize


def modal_parameters(robot: ElasticRobot, positions: Array) -> dict[str, Any]:
    """Return the flexible modes at `positions` (Q, n) or (n,), ``schema: modes/1``.

    Shapes are in the coordinates that the document names and of unit length in the mass matrix;
    the rigid modes, one per motor, are left out.

    Raises
    ------
    NoEquilibrium
        If a spring is too weak for gravity.
    InvalidInput
        If a position is outside the joint limits.
    SolverFailed
        If a mode is so overdamped that it cannot be told from a rigid one.
    """
    positions = np.atleast_2d(real_numbers(positions, "positions"))
    content = {
        "schema": "modes/1",
        "robot": robot.name,
        "motors": robot.motor_names,
        "coordinates": robot.coordinate_names,
        "units": {"position": "rad or m", "frequency": "rad/s", "pole": "rad/s"},
        "positions": [_at(robot, position) for position in positions],
    }
    plain: dict[str, Any] = json_data(content)
    return plain


def _at(robot: ElasticRobot, position: Array) -> dict[str, Any]:
    model = linearize(robot, position)
    modes = damped_modes(model)
    return {
        "position": position.tolist(),
        "undamped_frequencies": resonances(model).frequencies.tolist(),
        "anti_resonances": {
            name: anti_resonances(model, i).tolist() for i, name in enumerate(robot.motor_names)
        },
        "modes": [
            {
                "frequency": abs(pole),
                "damping_ratio": ratio,
                "pole": [pole.real, pole.imag],
                "shape": {"real": shape.real.tolist(), "imaginary": shape.imag.tolist()},
            }
            for pole, ratio, shape in zip(
                modes.poles.tolist(), modes.damping_ratios.tolist(), modes.shapes.T, strict=True
            )
        ],
    }
