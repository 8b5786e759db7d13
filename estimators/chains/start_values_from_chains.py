"""Start values of a robot's gray-box fit from what its motors show as chains."""

import numpy as np

from estimators.chains.mode_search import fit_modes
from estimators.chains.model_order import clear_modes
from estimators.chains.modes import FittedModes
from estimators.chains.whitened_frf import Data, prepared
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.spring_network import SpringNetwork

_ROUNDS = 15
_MOST_LINES = 120  # that the modes of a start need


def chain_start_values(robot: ElasticRobot, estimate: FrfEstimate, position: int = 0) -> Array:
    """Return start values (p,) for `estimators.fit` from the FRFs in one position.

    Each motor behind a drive spring is the first mass of a chain whose inertia the robot file
    knows. Its spring is K_1 = m_1^2 sum_r w_r lambda_r, [HBH] (14) and (17), and its damper takes
    the modes' damping; neither needs any start. Springs without a motor, such as passive
    torsions, are scaled by the mean factor of the drives. Factors of tied parameters are averaged.

    Parameters
    ----------
    robot : ElasticRobot
        Robot whose free parameters are sought; its own values matter for springs without a motor.
    estimate : FrfEstimate
        FRFs, motor torque to motor acceleration.
    position : int
        Index of the position among those of the estimate.

    Raises
    ------
    InvalidInput
        If there is no such position, or the robot has other motors or outputs.
    NotIdentifiable
        If no drive spring shows in the FRFs.
    """
    if not 0 <= position < len(estimate.positions):
        raise InvalidInput(
            f"position {position}: the estimate has positions 0 to {len(estimate.positions) - 1}"
        )
    network = robot.network(estimate.positions[[position]])
    motors, springs = _drives(network)
    n = network.selector.shape[1]
    if estimate.response.shape[2:] != (n, n):
        raise InvalidInput(
            f"estimate: FRFs of shape {estimate.response.shape[2:]}; the robot has {n} motors"
        )
    if not len(motors):
        raise NotIdentifiable(
            robot.parameters.names, f"{robot.name} has no spring behind a motor to begin with"
        )
    data = _between(estimate, position, motors)
    modes = _modes(data, len(network.nodes))
    inertia = _motor_inertias(network)[motors]
    weights = modes.shapes**2
    stiffness = inertia**2 * (weights * modes.omega[:, None] ** 2).sum(axis=0)
    # Of a spring that all of a mode's motion goes through, 2 zeta omega = c omega^2/k.
    share = weights * modes.omega[:, None] ** 2
    time = (share * (2 * modes.damping / modes.omega)[:, None]).sum(axis=0) / share.sum(axis=0)
    # The selector turns shaft torques into those of its coordinates: by the gear ratio.
    arm_side = stiffness * np.abs(network.selector[:, motors]).max(axis=0) ** 2
    return _scaled(robot, network, springs, arm_side, arm_side * time)


def _drives(network: SpringNetwork) -> tuple[IntArray, IntArray]:
    """Return motors that drive through a spring of their attached, and these springs."""
    coordinates = [int(np.argmax(np.abs(column))) for column in network.selector.T]
    motors, springs = [], []
    for motor, coordinate in enumerate(coordinates):
        attached = np.flatnonzero((network.nodes == coordinate).any(axis=1))
        if len(attached) == 1:
            motors.append(motor)
            springs.append(int(attached[0]))
    return np.array(motors, dtype=np.int64), np.array(springs, dtype=np.int64)


def _motor_inertias(network: SpringNetwork) -> Array:
    """Return the motors' inertias on their shafts, (n,)."""
    S = network.selector
    mass = network.linear_model().mass[0]
    return np.array([mass[i, i] / S[i, k] ** 2 for k, i in enumerate(np.abs(S).argmax(axis=0))])


def _between(estimate: FrfEstimate, position: int, motors: IntArray) -> Data:
    """Return the FRFs among these motors; the others turn freely."""
    from estimators.frf.frf_estimate import vec

    n = estimate.response.shape[-1]
    count = min(len(estimate.omega), _MOST_LINES)
    lines = np.unique(np.linspace(0, len(estimate.omega) - 1, count).round().astype(np.int64))
    submatrix = np.ix_(np.arange(len(lines)), motors, motors)
    covariance = estimate.covariance[position][lines]
    if estimate.has_full_covariance:
        elements = vec(np.arange(n * n).reshape(n, n).T[np.ix_(motors, motors)])
        covariance = covariance[:, elements[:, None], elements]
    else:
        covariance = covariance[submatrix]
    return prepared(
        estimate.omega[lines], estimate.response[position][lines][submatrix], covariance
    )


def _modes(data: Data, springs: int) -> FittedModes:
    """Return one mode for each spring, or two for each motor if that is less.

    The sum over modes that K_1 is needs no single one of them to be right, only their whole.

    Raises
    ------
    NotIdentifiable
        If none of them is clear of the noise.
    """
    modes = fit_modes(data, min(springs, 2 * data.chains), _ROUNDS, "real")
    if not clear_modes(modes).any():
        raise NotIdentifiable(("drive springs",), "no clear resonance in these FRFs")
    return modes


def _scaled(
    robot: ElasticRobot, network: SpringNetwork, springs: IntArray, stiffness: Array, damping: Array
) -> Array:
    """Return the robot's parameters with its springs at these places scaled to fit."""
    s = len(network.nodes)
    nominal = np.concatenate([network.spring_stiffness[0], network.spring_damping[0]])
    factors = np.full(2 * s, np.nan)
    factors[springs] = np.log(stiffness / nominal[springs])
    damped = damping * nominal[s + springs] > 0
    dampers = s + springs[damped]
    factors[dampers] = np.log(damping[damped] / nominal[dampers])
    for part in (slice(0, s), slice(s, 2 * s)):
        mean = np.nanmean(factors[part]) if np.isfinite(factors[part]).any() else 0.0
        factors[part] = np.where(np.isfinite(factors[part]), factors[part], mean)
    exponents = np.abs(network.exponents[0])
    total = exponents.sum(axis=0)
    shift = (exponents.T @ factors) / np.where(total > 0, total, 1.0)
    return np.asarray(robot.parameters.values * np.exp(shift))
