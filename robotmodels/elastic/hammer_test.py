"""Forces at a frame instead of motor torques: a hammer test or a shaker as a model to fit."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from robotmodels.common.arrays import Array, IntArray, real_numbers
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.description.parameters import Parameters
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.segments import link_frame
from robotmodels.elastic.tool_response import Frame, frame_kinematics
from robotmodels.linear.linear_model import Channels
from robotmodels.linear.spring_network import SpringNetwork

_CLAMPED = 1e9
"""Stiffness of brakes, beside the stiffest spring."""


@dataclass(frozen=True, eq=False)
class HammerTest:
    """FRFs from forces at a point to the robot's sensors on links, by the robot's parameters.

    It is a model for `estimators.simulate_frf` and `estimators.fit`, with FRFs (Q, F, m, k) of m
    sensors and k directions. Fitted with the prior of a fit to motor-side data (`robot_prior` of
    its robot with covariance), it adds to what these said.

    Attributes
    ----------
    model : ElasticRobot
        Robot whose file has the sensors (outputs on links, such as accelerometers).
    frame : Frame
        Where the force acts.
    directions : ndarray, (k, 3)
        Directions of the hits, unit vectors in the frame's axes.
    motors : {"clamped", "free"}
        Held by brakes, or without any torque.

    Raises
    ------
    InvalidInput
        If a direction is no vector, there is no such link, or the robot has no sensor on one.
    """

    model: ElasticRobot
    frame: Frame
    directions: Array
    motors: Literal["clamped", "free"] = "clamped"

    def __post_init__(self) -> None:
        directions = np.atleast_2d(real_numbers(self.directions, "hammer test: directions"))
        length = np.linalg.norm(directions, axis=-1, keepdims=True)
        if directions.shape[1:] != (3,) or not (np.isfinite(length) & (length > 0)).all():
            raise InvalidInput(
                f"hammer test: directions {directions.tolist()}; three finite numbers each, "
                "not all zero, are needed"
            )
        link_frame(self.model.rigid, self.frame.link, "hammer test: frame")
        object.__setattr__(self, "directions", directions / length)
        check_word("hammer test: motors", self.motors, ("clamped", "free"))
        if not self._sensors.size:
            raise InvalidInput(
                f"hammer test: robot {self.model.name!r} has no output on a link, such as an "
                "accelerometer"
            )

    @property
    def parameters(self) -> Parameters:
        """The free parameters."""
        return self.model.parameters

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the m sensors."""
        return tuple(self.model.output_names[i] for i in self._sensors)

    @property
    def _sensors(self) -> IntArray:
        return np.flatnonzero([output.kind == "link" for output in self.model.outputs])

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the network about the equilibria at `positions`, forces in place of torques.

        Raises
        ------
        NoEquilibrium, InvalidInput
            As `ElasticRobot.equilibrium`.
        """
        theta = self.parameters.check(parameters)
        at = self.model.equilibrium(positions, theta)
        network = self.model.network_about(at, theta)
        measurement, stiffness = network.measurement, network.stiffness
        assert measurement is not None  # there are sensors
        jacobian, _ = frame_kinematics(self.model, self.frame, at.coordinates, theta)
        selector = np.zeros((*stiffness.shape[:2], len(self.directions)))
        along = self.directions @ jacobian[:, :3]
        selector[:, : along.shape[2]] = np.swapaxes(along, 1, 2)
        if self.motors == "clamped":
            shafts = np.diag(network.selector.any(axis=1).astype(float))
            stiffness = stiffness + _CLAMPED * network.spring_stiffness.max(initial=1.0) * shafts
        measured = replace(
            measurement.of_outputs(self._sensors),
            torque=Channels.plain(np.ones(len(self.directions))),
            delay=0.0,
            feedthrough=None,
        )
        springs = network.torque_springs
        return replace(
            network,
            stiffness=stiffness,
            selector=selector,
            measurement=measured,
            torque_springs=None if springs is None else springs[self._sensors],
        )
