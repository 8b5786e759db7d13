"""What the viewer shows, without a browser: poses, modes, FRFs, candidates, gains of visits."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators import (
    FrfBand,
    FrfEstimate,
    Uncertainty,
    best_additions,
    covariance,
    information as frf_information,
    predict_frf,
    recommended_uncertainty,
)
from oed import information
from oed.candidates.screening import reasons
from oed.candidates.sources import Workcell
from oed.study.parts import DesignedPlan
from oed.study.results import FittedStudy, PlannedStudy
from oed.study.stages.candidates import refusals, workcell
from oed.study.stages.run import frequency_grid
from robotmodels import (
    ElasticRobot,
    Frame,
    IdentificationError,
    InvalidInput,
    RelativeNoise,
    Surroundings,
    frequency_response,
    linearize,
    resonances,
    sensitivity,
    tool_frame,
    with_values,
)
from robotmodels.collision.obstacles import Obstacle
from robotmodels.common.arrays import Array
from robotmodels.elastic.elastic_pose import frame_points, joint_placements
from robotmodels.elastic.inverse_kinematics import Tool, nearest_position
from robotmodels.elastic.rigid_pose import unloaded

_LINES = 200  # of a drawn FRF
_BAND = 2 * np.pi * 2.0, 2 * np.pi * 80.0
"""Frequencies where no study names them [rad/s]."""
SHOWN_REJECTED = 300
"""At most so many rejected positions are drawn."""
_VIRIDIS = np.array(
    [
        *([68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140]),
        *([40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37]),
    ]
)
"""That colour map, as matplotlib, whose import takes half a second, has it at nine points."""
_WEIGHTLESS = 190, 195, 200
_STEP = 1e-6  # of the deflection that scales a mode shape


@dataclass(frozen=True, eq=False)
class Pose:
    """The robot at equilibrium, and its modes.

    Attributes
    ----------
    robot : ElasticRobot
        The robot.
    coordinates : ndarray, (arm size,), rad or m
        Equilibrium of its arm.
    frequencies : ndarray, (k,), rad/s
        Undamped resonances, lowest first.
    shapes : ndarray, (arm size, k)
        Mode shapes that move the joint or the tool that moves most by 1 m.
    """

    robot: ElasticRobot
    coordinates: Array
    frequencies: Array
    shapes: Array

    def placements(self, deflection: Array | float = 0.0) -> Array:
        """Return the placements of the joints, (joints, 4, 4), deflected from equilibrium."""
        return np.asarray(joint_placements(self.robot, (self.coordinates + deflection)[None])[0])

    def in_mode(self, mode: int, amplitude: float, phase: float) -> Array:
        """Return the placements of the joints at a phase [rad] of a mode of an amplitude [m]."""
        return self.placements(amplitude * np.sin(phase) * self.shapes[:, mode])


@dataclass(frozen=True)
class Gain:
    """Gain of a plan by one more visit in a position.

    Attributes
    ----------
    factor : float
        Geometric mean, over the parameters, of the factors by which standard deviations fall.
    improved : str
        Parameter whose standard deviation falls most.
    before, after : float
        Relative standard deviation of that parameter.
    """

    factor: float
    improved: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class View:
    """A robot, and a study of it where there is one.

    Attributes
    ----------
    robot : ElasticRobot
        The robot.
    omega : ndarray, (F,), rad/s
        Angular frequencies of drawn FRFs.
    uncertainty : Uncertainty or None
        Covariance of the parameters for the band of FRFs; None draws none.
    study : PlannedStudy or None
        What a study computed.
    """

    robot: ElasticRobot
    omega: Array
    uncertainty: Uncertainty | None = None
    study: PlannedStudy | None = None

    @classmethod
    def of_robot(cls, robot: ElasticRobot) -> "View":
        """Return the view of a robot; with a band if its file has standard deviations."""
        try:
            uncertainty = recommended_uncertainty(robot)
        except InvalidInput:
            uncertainty = None
        return cls(robot, _lines(*_BAND), uncertainty)

    @classmethod
    def of_study(cls, results: PlannedStudy) -> "View":
        """Return the view of a study: with the covariance of its fit, or of its plan.

        That of a fit is Theorem 1's: the intervals one may quote take seconds to compute.
        """
        robot, omega = results.robot, results.plan.omega
        try:
            if isinstance(results, FittedStudy):
                fit = results.fits.result
                robot = with_values(robot, fit.parameters.values)
                uncertainty: Uncertainty | None = covariance(fit)
            else:
                uncertainty = _predicted(results)
        except IdentificationError:  # a combination of parameters is left open
            uncertainty = None
        return cls(robot, _lines(omega.min(), omega.max()), uncertainty, results)

    @cached_property
    def tool(self) -> Frame:
        """The point that is moved by hand."""
        return tool_frame(self.robot)

    def tool_points(self, positions: Array) -> Array:
        """Return where the tool is in positions (Q, n), springs unloaded, (Q, 3) [m]."""
        placements = joint_placements(self.robot, unloaded(self.robot, np.asarray(positions)))
        return frame_points(self.robot, self.tool, placements)

    @cached_property
    def candidate_points(self) -> Array:
        """Where the tool is in the candidates, (Q, 3) [m]."""
        return self.tool_points(self.candidates)

    def position_at(self, point: Array, near: Array) -> Array | None:
        """Return a position (n,) near another with the tool at a point; None if out of reach."""
        return nearest_position(self.robot, Tool(self.tool.link, self.tool.at), point, near)

    def pose(self, position: Array, values: Array) -> Pose:
        """Return equilibrium and modes in a position (n,) at parameters (p,) [SI].

        Raises
        ------
        NoEquilibrium
            If a spring gives way.
        """
        (coordinates,) = self.robot.equilibrium(position[None], values).coordinates
        modes = resonances(linearize(self.robot, position, values))
        shapes = modes.shapes[: len(coordinates)]
        moved = coordinates + np.vstack([np.zeros(len(coordinates)), _STEP * shapes.T])
        placements = joint_placements(self.robot, moved)
        points = np.concatenate(
            [placements[:, :, :3, 3], frame_points(self.robot, self.tool, placements)[:, None]], 1
        )
        size = np.linalg.norm(points[1:] - points[0], axis=2).max(axis=1) / _STEP
        scaled = shapes / np.where(size > 0, size, 1.0)
        return Pose(self.robot, coordinates, modes.frequencies, scaled)

    def frf(self, position: Array, values: Array, output: int, motor: int) -> Array:
        """Return |G| of one element and the ends of its band, (3, F); NaN without a band.

        Raises
        ------
        NoEquilibrium
            If a spring gives way.
        """
        at, element = position[None], np.s_[0, :, output, motor]
        if self.uncertainty is None:
            magnitude = np.abs(frequency_response(self.robot, at, self.omega, values)[element])
            return np.array([magnitude, *np.full((2, len(magnitude)), np.nan)])
        band: FrfBand = predict_frf(self.robot, values, at, self.omega, self.uncertainty)
        return np.array([np.abs(band.response[element]), band.lower[element], band.upper[element]])

    @property
    def candidates(self) -> Array:
        """Positions that the study chose from, (Q, n)."""
        if self.study is None:
            return np.empty((0, len(self.robot.motor_names)))
        return np.asarray(self.study.plan.information.positions)

    @cached_property
    def rejected(self) -> Array:
        """Some positions of the study's grid that are no candidates, (R, n), evenly chosen."""
        plan = None if self.study is None else self.study.plan
        settings = None if self.study is None else self.study.study.candidates
        if settings is None or not isinstance(plan, DesignedPlan):
            return np.empty((0, self.candidates.shape[1]))
        return refusals(settings, self.robot, plan.candidates, SHOWN_REJECTED)[0]

    def candidate(self, position: Array) -> int | None:
        """Return which candidate a position (n,) is, to a thousandth of a degree or metre."""
        near = np.where(self.robot.turning, np.pi / 180, 1.0) * 1e-3
        (indices,) = np.nonzero((np.abs(self.candidates - position) <= near).all(axis=1))
        return int(indices[0]) if len(indices) else None

    def colours(self, by: str) -> NDArray[np.uint8]:
        """Return colours of the candidates, (Q, 3) of 0 to 255, by "weight" or "sensitivity".

        Those without weight are grey by "weight".
        """
        if self.study is None:
            return np.empty((0, 3), dtype=np.uint8)
        design = self.study.plan.design
        numbers = design.weights if by == "weight" else design.sensitivity
        low, high = (0.0, numbers.max()) if by == "weight" else (numbers.min(), numbers.max())
        scaled = (numbers - low) / (high - low or 1.0)
        steps = np.linspace(0, 1, len(_VIRIDIS))
        colours = np.stack([np.interp(scaled, steps, one) for one in _VIRIDIS.T], axis=1)
        if by == "weight":
            colours[numbers <= 0] = _WEIGHTLESS
        return colours.astype(np.uint8)

    @cached_property
    def workcell(self) -> Workcell:
        """What keeps the robot from a position: as the study says, or itself."""
        settings = None if self.study is None else self.study.study.candidates
        return Workcell() if settings is None else workcell(settings)

    @cached_property
    def surroundings(self) -> Surroundings | None:
        """What the robot is compared with."""
        return self.workcell.surroundings(self.robot)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What stands around the robot."""
        return () if self.surroundings is None else self.surroundings.obstacles

    def reasons(self, position: Array) -> tuple[str, ...]:
        """Return why a study would not measure in a position (n,)."""
        torque = self.workcell.torque_limits
        return reasons(self.robot, position, self.surroundings, torque_limits=torque)

    def gain(self, position: Array) -> Gain | None:
        """Return what one more visit to a position (n,) would add; None where that is not known.

        Its noise is that of the study's law or, of measured FRFs, their mean over the positions.
        """
        visit = None if self.study is None else _information(self.study, position[None])
        if self.study is None or visit is None:
            return None
        predicted = self.study.plan.predicted
        scaled = predicted.singular_values[:, None] * predicted.directions
        additions = best_additions(scaled.T @ scaled, visit, predicted.names)
        ratio = predicted.std / additions.std[0]
        most = int(np.argmax(ratio))
        return Gain(
            float(additions.gain[0]),
            predicted.names[most],
            float(predicted.std[most]),
            float(additions.std[0, most]),
        )


def _information(results: PlannedStudy, position: Array) -> Array | None:
    """Return the information of a visit to a position (1, n), (1, p, p); None without its noise."""
    robot, plan, study = results.robot, results.plan, results.study
    if study.frequencies is not None and study.noise is not None:
        noise = RelativeNoise(
            relative=study.noise.relative,
            floor=study.noise.floor,
            by_output=len(set(robot.output_units)) > 1,
        )
        omega = frequency_grid(study.frequencies)
        return plan.visit_share * information(robot, position, omega, noise).matrices
    data = results.data.estimate if isinstance(results, FittedStudy) else None
    if not isinstance(data, FrfEstimate):
        return None
    variance = (data.variance * data.repetitions[:, None, None, None]).mean(axis=0)
    slopes = sensitivity(robot, position, data.omega)[1]
    return frf_information(slopes, 1 / variance[None])


def _lines(low: float, high: float) -> Array:
    return np.asarray(np.geomspace(low, high, _LINES))


def _predicted(results: PlannedStudy) -> Uncertainty:
    """Return the covariance that the plan predicts: the inverse of its information."""
    predicted = results.plan.predicted
    with np.errstate(divide="ignore"):
        scaled = predicted.directions / predicted.singular_values[:, None]
    return Uncertainty(predicted.names, scaled.T @ scaled, "predicted by the plan")
