"""State-space models about equilibria, for MATLAB and for python-control."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.atomic_files import atomic_write, created_folder, unwritable
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.common.extras import install
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.exports.state_matrices import state_matrices
from robotmodels.linear.response import check_omega, frequency_response, linearize

if TYPE_CHECKING:
    import control

# Characters that python-control gives a meaning of its sensor_delay in signal names.
_RESERVED = str.maketrans(".[]", "___")


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """$x' = A x + B u, y = C x + D u$ about the equilibria at Q positions; delays are beside it.

    States are deviations of the d coordinates from equilibrium, then their rates, then the l
    torques and readings with a first-order lag; inputs are deviations of the commanded motor
    torques from those that hold the arm. Angles and torques of motors are on the motor shaft in
    inputs and outputs, on the arm side in states.

    Attributes
    ----------
    robot : ElasticRobot
        The robot.
    positions : ndarray, (Q, n), rad or m
        Positions, on the arm side.
    A, B, C, D : ndarray, (Q, 2 d + l, 2 d + l), (Q, 2 d + l, n), (Q, m, 2 d + l), (Q, m, n)
        Matrices.
    input_delay, output_delay : ndarray, (n,) and (m,), s
        Delays of inputs and outputs, which the matrices leave out.
    covariance : ndarray, (p, p)
        Covariance of ln theta; not a number where it is not known.
    """

    robot: ElasticRobot
    positions: Array
    A: Array
    B: Array
    C: Array
    D: Array
    input_delay: Array
    output_delay: Array
    covariance: Array

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the n inputs."""
        return self.robot.motor_names

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the m outputs."""
        return self.robot.output_names

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: of coordinates, of their rates, of lagging torques and readings."""
        names, (motors, outputs) = self.robot.coordinate_names, _lagging(self.robot)
        return (
            *names,
            *(f"{name}.rate" for name in names),
            *(f"{self.inputs[i]}.torque" for i in motors),
            *(f"{self.outputs[i]}.reading" for i in outputs),
        )

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs."""
        return self.robot.output_units

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states."""
        motor_joints = {m.name: m.joint for m in self.robot.file.motors}
        units = [
            "m" if motor_joints.get(name, name) in self.robot.elements.prismatic else "rad"
            for name in self.robot.coordinate_names
        ]
        motors, outputs = _lagging(self.robot)
        readings = (self.output_units[i] for i in outputs)
        return (*units, *(f"{unit}/s" for unit in units), *("N m" for _ in motors), *readings)

    @cached_property
    def equilibria(self) -> Array:
        """Coordinates at equilibrium, (Q, d) [rad or m]."""
        robot = self.robot
        arm = robot.equilibrium(self.positions).coordinates
        return np.hstack([arm, self.positions[:, robot.layout.elastic_motors]])

    def frequency_response(self, omega: Array) -> Array:
        """Return G, (Q, F, m, n), of the matrices and the delays."""
        s = 1j * check_omega(omega)
        eye = np.eye(self.A.shape[-1])
        matrices = s[:, None, None] * eye - self.A[:, None]
        B = np.broadcast_to(self.B[:, None], (*matrices.shape[:-1], self.B.shape[-1]))
        X = np.linalg.solve(matrices, B)
        G = self.C[:, None] @ X + self.D[:, None]
        late = self.output_delay[:, None] + self.input_delay
        return np.asarray(G * np.exp(-s[:, None, None] * late))

    def to_control(self) -> "list[control.StateSpace]":
        """Return a `control.StateSpace` for each position, without the delays.

        Raises
        ------
        IdentificationError
            If python-control is not installed.
        """
        ct = _control()
        return [
            ct.ss(*matrices, states=[*map(_signal, self.states)], **self._signals(i))
            for i, matrices in enumerate(zip(self.A, self.B, self.C, self.D, strict=True))
        ]

    def to_control_frd(self, omega: Array) -> "list[control.FrequencyResponseData]":
        """Return `control.FRD` at `omega` (F,) [rad/s] for each position, with the delays.

        Raises
        ------
        IdentificationError
            If python-control is not installed.
        """
        ct = _control()
        responses = frequency_response(self.robot, self.positions, omega)
        return [
            ct.frd(np.moveaxis(G, 0, -1), omega, **self._signals(i))
            for i, G in enumerate(responses)
        ]

    def _signals(self, position: int) -> dict[str, Any]:
        """Return the names of the system at a position and of its signals."""
        return {
            "name": f"{_signal(self.robot.name)}_{position}",
            "inputs": [f"{_signal(name)}_torque" for name in self.inputs],
            "outputs": [_signal(name) for name in self.outputs],
        }


def state_space(
    robot: ElasticRobot, positions: Array, covariance: Array | None = None
) -> StateSpaceModel:
    """Return state-space models about the equilibria at `positions` (Q, n) or (n,).

    Parameters
    ----------
    robot : ElasticRobot
        Robot, such as `estimators.Fit.robot` returns.
    positions : ndarray, (Q, n) or (n,), rad or m
        Positions.
    covariance : ndarray, (p, p), optional
        Covariance of ln theta that goes along; by default the squared standard deviations of the
        robot file's ``fitted`` on the diagonal, not a number for parameters without one.

    Raises
    ------
    NoEquilibrium
        If a spring is too weak for gravity.
    InvalidInput
        If a position is outside the joint limits, or an array has a wrong shape.
    """
    positions = np.atleast_2d(real_numbers(positions, "positions"))
    model = linearize(robot, positions)
    A, B, C, D = state_matrices(model, len(positions))
    measured = model.measured
    sensor_delay = np.zeros(len(C[0])) if measured.sensor is None else measured.sensor.delay
    return StateSpaceModel(
        robot=robot,
        positions=positions,
        A=A,
        B=B,
        C=C,
        D=D,
        input_delay=measured.torque.delay,
        output_delay=measured.delay + sensor_delay,
        covariance=_covariance(robot, covariance),
    )


def _lagging(robot: ElasticRobot) -> tuple[list[int], list[int]]:
    """Return the motors whose torques, and the outputs whose readings have a first-order lag."""
    motors = [i for i, motor in enumerate(robot.file.motors) if motor.torque_lag]
    return motors, [i for i, output in enumerate(robot.outputs) if output.lag]


def write_state_space(model: StateSpaceModel, path: Path) -> None:
    """Write state-space models as MATLAB's .mat; positions are the last axis there, as in ``ss``.

    Raises
    ------
    InvalidInput
        If the file cannot be written.
    """
    from scipy.io import savemat

    parameters = model.robot.parameters
    content: dict[str, Any] = {
        **{name: np.moveaxis(getattr(model, name), 0, -1) for name in "ABCD"},
        "input_delay": model.input_delay[:, None],
        "output_delay": model.output_delay[:, None],
        "positions": model.positions,
        "equilibria": model.equilibria,
        "inputs": _cells(model.inputs),
        "input_units": _cells(["N m"] * len(model.inputs)),
        "outputs": _cells(model.outputs),
        "output_units": _cells(model.output_units),
        "states": _cells(model.states),
        "state_units": _cells(model.state_units),
        "parameter_names": _cells(parameters.names),
        "parameter_units": _cells(parameters.units),
        "parameter_values": parameters.values[:, None],
        "covariance_of_ln_parameters": model.covariance,
        "robot": model.robot.name,
    }
    with created_folder(path.parent):
        try:
            with atomic_write(path) as unfinished:
                savemat(unfinished, content)
        except OSError as error:
            raise unwritable(path, error) from None


def _covariance(robot: ElasticRobot, covariance: Array | None) -> Array:
    names = robot.parameters.names
    if covariance is None:
        std = robot.file.fitted.relative_std if robot.file.fitted else {}
        variances = np.array([std.get(name, np.nan) for name in names]) ** 2
        return np.where(np.eye(len(names), dtype=bool), variances[:, None], np.nan)
    covariance = real_numbers(covariance, "covariance")
    if covariance.shape != (len(names), len(names)):
        raise InvalidInput(
            f"covariance: shape {covariance.shape} given; "
            f"({len(names)}, {len(names)}) is needed, of {', '.join(names)}"
        )
    return covariance


def _cells(words: Any) -> Any:
    """Return text as MATLAB's cell column."""
    cells = np.empty((len(words), 1), dtype=object)
    cells[:, 0] = list(words)
    return cells


def _signal(name: str) -> str:
    return name.translate(_RESERVED)


def _control() -> Any:
    try:
        import control
    except ImportError:
        raise IdentificationError(
            f"python-control is not installed; run: {install('control')}"
        ) from None
    return control
