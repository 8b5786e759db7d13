"""What a fit says of a controller: margins with bands, stability of all loops, what may help."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.validation.margin_bands import (
    MarginBand,
    Suggestion,
    predict_margins,
    suggestions,
)
from robotmodels.common.arrays import Array
from robotmodels.common.progress import Progress
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import underlying_robot
from robotmodels.simulation.determinant_locus import DeterminantLocus, determinant_loci
from robotmodels.simulation.linear_feedback import LinearFeedback


@dataclass(frozen=True, eq=False)
class ControllerMargins:
    """What a fit says of a controller.

    Attributes
    ----------
    band : MarginBand
        Margins in Q positions.
    loci : tuple of DeterminantLocus
        Nyquist curves of all loops at once, at the fitted values, by position.
    motors : tuple of str
        Names of the n motors.
    remedies : tuple of Suggestion
        Values to begin tuning with.
    """

    band: MarginBand
    loci: tuple[DeterminantLocus, ...]
    motors: Sequence[str]
    remedies: tuple[Suggestion, ...]

    @property
    def weakest(self) -> int:
        """Position of the largest singular value of S, an unstable one first."""
        return int(np.argmax(self.band.nominal.largest_sensitivity))


def controller_margins(
    source: FittedModel | ElasticRobot,
    feedback: LinearFeedback,
    positions: Array,
    draws: Array,
    progress: Progress | None = None,
) -> ControllerMargins:
    """Return all in positions (Q, n), with bands by draws (N, p) of ln theta.

    Parameters, errors: see `predict_margins`.
    """
    robot = underlying_robot(source if isinstance(source, ElasticRobot) else source.model)
    theta = np.asarray(source.parameters.values)
    none = np.random.default_rng(0)  # draws are there
    return ControllerMargins(
        predict_margins(source, feedback, positions, rng=none, draws=draws, progress=progress),
        determinant_loci(robot, positions, feedback, theta),
        robot.motor_names,
        suggestions(robot, feedback, positions, theta),
    )
