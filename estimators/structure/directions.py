"""Changes of FRFs by what a model of a robot may lack: springs, and single numbers."""

from collections.abc import Iterator, Sequence

import numpy as np

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.fit_trust import acts, model_columns
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.description.robot_file import Hardening, Payload, Spring
from robotmodels.elastic.rigid_elements import reaction_factors
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import underlying_robot
from robotmodels.linear.response import frequency_response

_PAYLOAD = 1e-3
"""Mass by which the derivative of FRFs with respect to an absent payload is computed [kg]."""


def spring_columns(
    problem: FitProblem, springs: Sequence[Spring], values: Array, damping_times: Array
) -> Iterator[ComplexArray]:
    """Yield the derivatives of FRFs by each spring's compliance, (Q, F, m, n, t).

    The last axis is over the damping times.
    """
    omega = problem.omega
    h, f = reaction_factors(
        underlying_robot(problem.model), springs, problem.positions, omega, values
    )
    damped = 1 / (1 + 1j * np.multiply.outer(omega, damping_times))
    for i in range(len(springs)):
        product = h[:, :, i, :, None] * f[:, :, i, None, :]
        yield product[..., None] * damped[:, None, None, :]


def number_columns(
    problem: FitProblem, values: Array, at: tuple[ComplexArray, ComplexArray]
) -> Iterator[tuple[str, str, bool, ComplexArray]]:
    """Yield name, unit, whether it cannot be negative, and change of FRFs (Q, F, m, n) per unit.

    Those that the verdict rests on (delay, gains, gear ratios, fixed numbers), and what the robot
    file has not: friction behind gears, a payload, gears that harden.
    """
    robot, positions, omega = underlying_robot(problem.model), problem.positions, problem.omega
    for name, unit, column in model_columns(robot, positions, omega, values, at[0]):
        yield name, unit, False, column
    yield from _gear_columns(robot, positions, omega, values)
    if robot.file.payload is None:
        column = _payload_column(robot, positions, omega, values, at[0])
        if acts(column, at[0]):
            yield "payload.mass", "kg", False, column


def _gear_columns(
    robot: ElasticRobot, positions: Array, omega: Array, values: Array
) -> Iterator[tuple[str, str, bool, ComplexArray]]:
    """Yield the directions of friction behind gears, and of gears that harden."""
    network = robot.network(positions, values)
    X, Z = network.linear_model().receptances(omega)
    at_rest = robot.equilibrium(positions, values)
    ends, springs = network.incidence(), robot.file.springs
    rubbed = {item.joint for item in robot.file.friction if item.viscous > 0}
    for motor, i, c in zip(
        robot.file.motors, robot.layout.drive_springs, robot.layout.drives, strict=True
    ):
        if i is None:
            continue
        if motor.joint not in rubbed:
            product = Z[:, :, c, :, None] * X[:, :, c, None, :]
            name = f"friction behind the gear of {motor.joint}"
            yield name, "N m s/rad", True, -1j * omega[:, None, None] * product
        loads = np.square(at_rest.elongations[:, i] * at_rest.slopes[:, i])
        if loads.any() and not isinstance(springs[i].stiffness, Hardening):
            y, v = (part.swapaxes(-1, -2) @ ends[i] for part in (Z, X))
            slope = network.spring_stiffness[:, i] * loads / loads.max()
            column = -slope[:, None, None, None] * y[..., :, None] * v[..., None, :]
            yield f"hardening of {springs[i].name}", "relative", False, column


def _payload_column(
    robot: ElasticRobot, positions: Array, omega: Array, values: Array, response: ComplexArray
) -> ComplexArray:
    """Return the change of FRFs with a point mass on the last link."""
    link = [
        frame.name for frame in robot.rigid.frames if frame.parentJoint == robot.rigid.njoints - 1
    ]
    payload = Payload(link=link[-1], mass=_PAYLOAD, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6)
    other = ElasticRobot(robot.file.model_copy(update={"payload": payload}), robot.folder)
    return (frequency_response(other, positions, omega, values) - response) / _PAYLOAD
