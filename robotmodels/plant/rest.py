"""Where a plant rests, how fast its fastest mode is, and what its gears are there."""

import numpy as np

from robotmodels.arrays import Array, ComplexArray
from robotmodels.description.robot_file import Hardening, RobotFile
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.errors import NoEquilibrium
from robotmodels.plant.loop import STABILITY
from robotmodels.plant.mujoco_model import PlantModel

_SAFETY = 1.15  # of poles, for positions nearby


def find_rest(
    plant: PlantModel, robot: ElasticRobot, position: Array, where: str
) -> tuple[Array, Array]:
    """Return the coordinates (d,) at which the motors stand at `position`, and their torques (n,).

    The torques are those on the motor shafts that hold the arm against gravity [N m].

    Raises
    ------
    NoEquilibrium
        If there is none.
    """
    q = np.zeros(plant.model.nv)
    for joint, motor, angle in zip(robot.motor_joints, plant.motors, position, strict=True):
        q[plant.coordinate(joint)] = angle
        q[motor] = angle
    free = np.setdiff1d(np.arange(len(q)), plant.motors)
    step = 1e-6
    for _ in range(50):
        forces = plant.static_forces(q)
        slopes = [
            plant.static_forces(q + step * e) - plant.static_forces(q - step * e)
            for e in np.eye(len(q))[free]
        ]
        K = np.array(slopes)[:, free].T / (2 * step)
        change = np.linalg.solve(K, forces[free])
        q[free] -= change
        if not (np.abs(change) < 1.0).all():
            break
        # Differences limit the slopes, and so the rate of convergence, not its end.
        if np.abs(change).max(initial=0.0) < 1e-12:
            ratio = np.array([m.gear_ratio for m in robot.file.motors])
            return q, -plant.static_forces(q)[plant.motors] / ratio
    raise NoEquilibrium(f"{where}: the springs cannot carry the robot's weight")


def linearise_gears(plant: PlantModel, rest: Array) -> None:
    """Replace the gears' characteristics by their tangents at `rest`, the torques kept."""
    model = plant.model
    plant.static_forces(rest)
    for i in range(model.ntendon):
        x = float(plant.data.ten_length[i])
        low, (_, cubic) = model.tendon_stiffness[i], model.tendon_stiffnesspoly[i]
        slope = low + 3 * cubic * x**2
        model.tendon_stiffness[i], model.tendon_stiffnesspoly[i] = slope, 0.0
        model.tendon_lengthspring[i] = x - (low + cubic * x**2) * x / slope


def open_gears(plant: PlantModel, rest: Array, gaps: Array) -> Array:
    """Give the gears their gaps (n,); return `rest` with each motor moved to the flank it needs."""
    rest = rest.copy()
    plant.static_forces(rest)
    for motor, gear, gap in zip(plant.motors, plant.gears, gaps, strict=True):
        if gear >= 0 and gap > 0:
            middle = plant.model.tendon_lengthspring[gear].mean()
            side = np.sign(plant.data.ten_length[gear] - middle)
            plant.model.tendon_lengthspring[gear] = middle + gap * np.array([-0.5, 0.5])
            rest[motor] -= side * gap / 2
    return rest


def substeps(plant: PlantModel, file: RobotFile, rest: Array, sample_time: float) -> int:
    """Return the least number of steps per sample with which the integration is stable."""
    poles = _SAFETY * _poles(plant, file, rest) * sample_time
    count = 1
    while (np.abs(np.polyval(STABILITY, poles / count)) > 1 + 1e-9).any():
        count += 1
    return count


def _poles(plant: PlantModel, file: RobotFile, rest: Array) -> ComplexArray:
    """Return the poles, gravity left out, hardening springs at their hardest [rad/s]."""
    d = plant.model.nv
    damping, stiffness = np.zeros((2, d, d))
    motor_of = {m.joint: m.name for m in file.motors}
    for spring in file.springs:
        a = np.zeros(d)
        a[plant.coordinate(str(spring.joint if spring.axis == "drive" else spring.name))] = 1.0
        if spring.axis == "drive" and spring.joint in motor_of:
            a[plant.coordinate(motor_of[spring.joint])] = -1.0
        k = spring.stiffness
        stiffness += (max(k.low, k.high) if isinstance(k, Hardening) else k) * np.outer(a, a)
        damping += spring.damping * np.outer(a, a)
    for motor, c in zip(file.motors, plant.motors, strict=True):
        damping[c, c] += motor.viscous * motor.gear_ratio**2
    both = np.linalg.solve(plant.mass(rest), np.hstack([stiffness, damping]))
    companion = np.block([[np.zeros((d, d)), np.eye(d)], [-both]])
    poles = np.linalg.eigvals(companion)
    # Rigid modes are at zero but for rounding, which may put them to the right of it.
    return np.where(poles.real > 0, 1j * poles.imag, poles)
