"""What springs would do to FRFs that are rigid yet: derivatives at compliance zero.

With A the dynamic stiffness of the robot that has the springs' coordinates but not the springs, T
the motions of the robot as it is, u the unit elongation of a spring, X = (T'AT)^-1 T'S and
Z = (T'AT)^-1 T'C', the rigid element reacts to motor torques with f = u'(S - A T X), and an
elongation reads as h = u'(C' - A T Z) in the outputs: dG/d compliance = h' f, of rank one. With a
damper of damping time tau beside the spring it is divided by 1 + j omega tau.
"""

from collections.abc import Sequence

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.equilibrium import Equilibrium
from robotmodels.elastic.possible_springs import with_springs
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.response import check_omega


def reaction_factors(
    robot: ElasticRobot,
    springs: Sequence[Spring],
    positions: Array,
    omega: Array,
    parameters: Array | None = None,
) -> tuple[ComplexArray, ComplexArray]:
    """Return the factors h (Q, F, c, m) and f (Q, F, c, n) of the derivatives by compliances.

    dG_ij/d compliance = h_i f_j, at the equilibria of the robot as it is: that these move with the
    compliance is left out.

    Parameters
    ----------
    robot : ElasticRobot
        The robot without the c springs.
    springs : sequence of Spring
        Springs, whose stiffness and damping do not matter.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    parameters : ndarray, (p,), optional
        Free parameters of the robot; its nominal values by default.

    Raises
    ------
    NoEquilibrium, InvalidInput
        As `ElasticRobot.equilibrium` and `with_springs`.
    """
    omega = check_omega(omega)
    model, motions, elongations = _with_coordinates(robot, springs, positions, parameters)
    parts = [_factors(model.at(q), motions, elongations, omega) for q in range(len(model.mass))]
    h, f = (np.stack(each) for each in zip(*parts, strict=True))
    return h, f


def _with_coordinates(
    robot: ElasticRobot, springs: Sequence[Spring], positions: Array, parameters: Array | None
) -> tuple[LinearModel, Array, IntArray]:
    """Return the model with the springs' coordinates, T (d, e), and elongated coordinates (c,)."""
    wider = with_springs(robot, springs, free=False)
    at, count = robot.equilibrium(positions, parameters), len(springs)
    names, motors = wider.layout.names, {m.joint: m.name for m in robot.file.motors}
    coordinates = np.zeros((len(positions), wider.layout.arm_size))
    motions = np.zeros((wider.layout.size, robot.layout.size))
    for column, name in enumerate(robot.layout.names):
        motions[names.index(name), column] = 1.0
        if column < robot.layout.arm_size:
            coordinates[:, names.index(name)] = at.coordinates[:, column]
            # A gear that is rigid yet: motor and joint move as one.
            if motors.get(name) in names and motors[name] not in robot.layout.names:
                motions[names.index(motors[name]), column] = 1.0
    none = np.zeros((len(positions), count))
    network = wider.network_about(
        Equilibrium(coordinates, np.hstack([at.elongations, none]), np.hstack([at.slopes, none])),
        parameters,
    )
    network.spring_damping[:, len(robot.file.springs) :] = 0.0
    return network.linear_model(), motions, wider.layout.sprung[len(robot.file.springs) :]


def _factors(
    model: LinearModel, motions: Array, elongations: IntArray, omega: Array
) -> tuple[ComplexArray, ComplexArray]:
    """Return h (F, c, m) and f (F, c, n) about one equilibrium."""
    A, n = model.dynamic_stiffness(omega), model.inputs
    S = model.forces(omega)
    C = np.swapaxes(model.measured.outputs(omega), -1, -2)
    both = np.concatenate([S, np.broadcast_to(C, (*S.shape[:2], C.shape[-1]))], axis=-1)
    moving = np.linalg.solve(motions.T @ A @ motions, motions.T @ both)
    reactions = both[:, elongations] - A[:, elongations] @ motions @ moving
    return reactions[..., n:], reactions[..., :n]
