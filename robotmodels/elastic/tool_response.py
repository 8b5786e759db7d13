"""How a point of a link moves under forces and torques there: compliance and frequency responses.

The wrench w = (force, torque) at a frame acts on the coordinates q as J^T w, with J (6, d) the
Jacobian of the frame at the static equilibrium, so that with the dynamic stiffness A

    (displacement, rotation) = J A^-1 J^T w,    motor angles = S^T A^-1 J^T w.

Motors are clamped, as by brakes: their coordinates are left out of A; free; or under a position
controller with torques u = -F y of the motor angles y: A + S F S^T stands for A.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.description.outputs import Output
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.segments import link_frame
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.response import Elastic, check_omega

Motors = Literal["clamped", "free"] | Callable[[Array], ComplexArray]
"""Clamped, free, or F of their controllers: torque per angle, (F, n, n), at omega (F,)."""
Motion = Literal["displacement", "velocity", "acceleration"]
MOTIONS: dict[Motion, str] = {
    "displacement": "receptance",
    "velocity": "mobility",
    "acceleration": "accelerance",
}
"""What the response to a force is called by the motion."""

_ROUNDING = 1e-13
"""Of compliances, beside the largest one: directions in which nothing gives way."""


@dataclass(frozen=True)
class Frame:
    """A point of a link, where forces act and motions are read.

    Attributes
    ----------
    link : str
        Link of the URDF.
    at : tuple of float, (3,), m
        Point in the link's frame.
    axes : {"base", "link"}
        Whose axes forces and motions are along, the root link's or the link's.

    Raises
    ------
    InvalidInput
        If the point is not three finite numbers, or there are no such axes.
    """

    link: str
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: Literal["base", "link"] = "base"

    def __post_init__(self) -> None:
        if np.shape(self.at) != (3,) or not np.isfinite(self.at).all():
            raise InvalidInput(f"frame: at {self.at}; x, y, z in the link's frame [m] are needed")
        check_word("frame: axes", self.axes, ("base", "link"))


def tool_frame(robot: ElasticRobot) -> Frame:
    """Return the origin of the last link, at the end of the longest chain of joints."""
    rigid = robot.rigid
    last = max(map(list, rigid.supports), key=len)[-1]
    links = [f.name for f in rigid.frames if f.type == pin.BODY and f.parentJoint == last]
    return Frame(links[-1])


def underlying_robot(model: Elastic) -> ElasticRobot:
    """Return the robot that a model is made of, as others at parameters or under forces are.

    Raises
    ------
    InvalidInput
        If it is none.
    """
    while not isinstance(model, ElasticRobot) and hasattr(model, "model"):
        model = model.model
    if not isinstance(model, ElasticRobot):
        raise InvalidInput(
            f"robot: the model is a {type(model).__name__}; a robot of a robot file is needed"
        )
    return model


@dataclass(frozen=True, eq=False)
class ToolModel:
    """Linear models of a robot about Q equilibria, with the Jacobians of a frame.

    Attributes
    ----------
    model : LinearModel
        With leading axis Q.
    jacobian : ndarray, (Q, 6, d)
        Displacement [m] and rotation [rad] of the frame per coordinate.
    point : ndarray, (Q, 3), m
        Where the frame is, in the base's axes.
    """

    model: LinearModel
    jacobian: Array
    point: Array

    def compliance(self) -> Array:
        """Return the static compliance with clamped motors, (Q, 6, 6) [m/N, rad/N, rad/(N m)]."""
        loose = self._loose
        stiffness, jacobian = self.model.stiffness[:, loose][..., loose], self.jacobian[..., loose]
        return np.asarray(jacobian @ np.linalg.solve(stiffness, np.swapaxes(jacobian, 1, 2)))

    def response(
        self,
        omega: Array,
        motion: Motion = "displacement",
        motors: Motors = "clamped",
        at: Literal["frame", "motors"] = "frame",
    ) -> ComplexArray:
        """Return responses to the wrench, (Q, F, 6, 6), or (Q, F, n, 6) of the motors' shafts.

        Parameters
        ----------
        omega : ndarray, (F,), rad/s
            Angular frequencies, positive.
        motion : {"displacement", "velocity", "acceleration"}
            Receptance, mobility or accelerance.
        motors : {"clamped", "free"} or callable
            Or the torques per motor angle of controllers, see the module.
        at : {"frame", "motors"}
            Whose motion.

        Raises
        ------
        InvalidInput
            If a frequency is not positive, or the motion of clamped motors is asked for.
        """
        if at == "motors" and motors == "clamped":
            raise InvalidInput(
                "tool response: clamped motors do not move; set motors to free for their responses"
            )
        w = check_omega(omega)
        model = self._flexible if motors == "clamped" else self.model
        A = model.dynamic_stiffness(w)
        output = self.jacobian if at == "frame" else self.model.selector.T
        force = np.swapaxes(self.jacobian, 1, 2)
        if motors == "clamped":
            output, force = output[..., self._loose], force[:, self._loose]
        elif callable(motors):
            late = np.exp(-1j * w * self.model.measured.delay)[:, None, None]
            A = A + self.model.forces(w) @ (late * motors(w)) @ self.model.selector.T
        motions = (1j * w[:, None, None]) ** list(MOTIONS).index(motion)
        columns = np.broadcast_to(force[:, None], (*A.shape[:-1], 6))
        rows = output[:, None] if at == "frame" else output
        return np.asarray(motions * (rows @ np.linalg.solve(A, columns)))

    @property
    def _flexible(self) -> LinearModel:
        """The model of the coordinates that clamped motors leave free."""
        loose, model = self._loose, self.model
        M, D, K = (
            a[..., loose, :][..., loose] for a in (model.mass, model.damping, model.stiffness)
        )
        return LinearModel(M, D, K, model.selector[loose])

    @property
    def _loose(self) -> Array:
        """Mask of the coordinates that clamped motors leave free, (d,)."""
        return np.asarray(~self.model.selector.any(axis=1))


def tool_model(
    robot: Elastic, positions: Array, frame: Frame, parameters: Array | None = None
) -> ToolModel:
    """Return the linear models about the static equilibria at `positions` (Q, n), with the frame.

    Raises
    ------
    NoEquilibrium
        If a spring is too weak for gravity.
    InvalidInput
        If a position is outside the joint limits, or the frame on no link that moves.
    """
    elastic = underlying_robot(robot)
    theta = elastic.parameters.check(robot.parameters.values if parameters is None else parameters)
    at = elastic.equilibrium(positions, theta)
    model, coordinates = elastic.network_about(at, theta).linear_model(), at.coordinates
    jacobian = np.zeros((len(coordinates), 6, model.mass.shape[-1]))
    of_arm, points = frame_kinematics(elastic, frame, coordinates, theta)
    jacobian[..., : coordinates.shape[1]] = of_arm
    return ToolModel(model, jacobian, points)


def frame_kinematics(
    robot: ElasticRobot, frame: Frame, coordinates: Array, theta: Array
) -> tuple[Array, Array]:
    """Return Jacobians (Q, 6, arm size) and positions (Q, 3) at the arm's `coordinates`."""
    link_frame(robot.rigid, frame.link, "frame")
    sensor = Output(
        name="frame",
        link=frame.link,
        quantity="angular_velocity",
        at=frame.at,
        direction=(1.0, 0.0, 0.0),
    )
    arm = robot.arm_with(sensor, theta)
    axes = pin.LOCAL if frame.axes == "link" else pin.LOCAL_WORLD_ALIGNED
    data, index = arm.model.createData(), arm.model.getFrameId(sensor.label, pin.OP_FRAME)
    rows, points = [], []
    for q in arm.joints(coordinates):
        # Pinocchio returns a vector where there is but one joint.
        rows.append(pin.computeFrameJacobian(arm.model, data, q, index, axes).reshape(6, -1))
        points.append(pin.updateFramePlacement(arm.model, data, index).translation.copy())
    jacobians, reduction = np.array(rows), arm.coordinate_map
    if reduction is not None:
        jacobians = np.asarray(jacobians @ reduction.matrix)
    return jacobians, np.array(points)


@dataclass(frozen=True, eq=False)
class ComplianceEllipsoid:
    """Principal compliances of a point, softest first: where a unit force takes it.

    Attributes
    ----------
    values : ndarray, (..., 3), m/N
        Half axes.
    directions : ndarray, (..., 3, 3)
        Unit vectors in the frame's axes, one a column; of either sign.
    """

    values: Array
    directions: Array


def compliance_ellipsoid(compliance: Array) -> ComplianceEllipsoid:
    """Return the ellipsoid of displacements under unit forces of compliances (..., 6, 6)."""
    values, vectors = np.linalg.eigh(np.asarray(compliance)[..., :3, :3])
    values = np.where(values > _ROUNDING * values[..., -1:], values, 0.0)
    return ComplianceEllipsoid(values[..., ::-1], vectors[..., ::-1])
