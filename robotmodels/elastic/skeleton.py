"""Everything of a robot but its springs, at given coordinates: mass, gravity, motors, sensors."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.arrays import Array
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.dynamics import mass_and_gravity, mass_matrices
from robotmodels.elastic.layout import Layout
from robotmodels.elastic.measurement import Measurement
from robotmodels.errors import InvalidInput

_ORDER = {"position": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A robot without its springs, linearised at Q coordinate vectors.

    Attributes
    ----------
    mass, stiffness : ndarray, (Q, d, d)
        Mass matrices, and the stiffness that gravity adds.
    damping : ndarray, (d, d)
        Viscous friction of the motors. Motors whose inertia or friction is free are missing from
        both (see `Inertances`).
    gravity : ndarray, (Q, d)
        Gravity torques.
    selector : ndarray, (d, n)
        Selector.
    measurement : Measurement
        Measurement with leading axis Q.
    """

    mass: Array
    damping: Array
    stiffness: Array
    gravity: Array
    selector: Array
    measurement: Measurement


def skeleton(layout: Layout, coordinates: Array, without: Collection[int] = ()) -> Skeleton:
    """Return the skeleton at the arm's `coordinates` (Q, arm size), `without` some motors' mass."""
    file, size, arm = layout.file, layout.size, slice(0, layout.arm_size)
    count = len(coordinates)
    mass, gravity = mass_and_gravity(layout.arm, coordinates, size)
    stiffness, torques = np.zeros((count, size, size)), np.zeros((count, size))
    torques[:, arm] = gravity.torques
    gravity.write_slopes(stiffness[:, arm, arm])
    damping = np.zeros((size, size))
    selector = np.zeros((size, len(file.motors)))
    for j, (c, motor) in enumerate(zip(layout.motors, file.motors, strict=True)):
        if j not in without:
            mass[:, c, c] += motor.inertia * motor.gear_ratio**2
            damping[c, c] += motor.viscous * motor.gear_ratio**2
        selector[c, j] = motor.gear_ratio
    measurement = _measurement(layout, selector, coordinates)
    return Skeleton(mass, damping, stiffness, torques, selector, measurement)


def check_mass(layout: Layout) -> None:
    """Refuse a robot in which some motion moves no mass at all.

    Raises
    ------
    InvalidInput
        Naming a joint or spring that this motion moves.
    """
    # No joint angle of a robot at rest in a generic position is a special one.
    generic = 0.3 + np.sin(np.arange(layout.arm_size, dtype=float))
    mass = mass_matrices(layout.arm, generic[None])[0]
    for c, motor in zip(layout.motors, layout.file.motors, strict=True):
        if c < layout.arm_size:
            mass[c, c] += motor.inertia * motor.gear_ratio**2
    scale = np.sqrt(np.maximum(np.diag(mass), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
    if values[0] < 1e-12:
        worst = layout.names[int(np.argmax(np.abs(vectors[:, 0])))]
        raise InvalidInput(
            f"a motion about {worst!r} moves no mass: the links beyond it need moments of inertia"
        )


def _measurement(layout: Layout, selector: Array, coordinates: Array) -> Measurement:
    """Return the rows of the motors, then those of the accelerometers."""
    file: RobotFile = layout.file
    n, sensors = len(file.motors), len(file.accelerometers)
    # Motors are read alike everywhere: one copy serves all positions where there are no sensors.
    rows = np.zeros((3, len(coordinates) if sensors else 1, n + sensors, layout.size))
    rows[_ORDER[file.output], :, :n] = selector.T
    if not sensors:
        rows = np.broadcast_to(rows, (3, len(coordinates), n, layout.size))
    else:
        rows[0, :, n:, : layout.arm_size], rows[2, :, n:, : layout.arm_size] = _accelerometers(
            layout, coordinates
        )
    gain = np.array([m.torque_gain for m in file.motors])
    return Measurement(rows[0], rows[1], rows[2], gain, file.delay)


def _accelerometers(layout: Layout, coordinates: Array) -> tuple[Array, Array]:
    """Return C0 and C2 of the accelerometers, (Q, sensors, arm size).

    An accelerometer feels u . (a - g): the point's acceleration, and gravity as its axis u
    tilts, du . (-g) = -(u x g) . (rotation).
    """
    model, file = layout.arm.model, layout.file
    data = model.createData()
    tilt, acceleration = np.zeros((2, len(coordinates), len(file.accelerometers), model.nv))
    for i, q in enumerate(coordinates):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for j, sensor in enumerate(file.accelerometers):
            frame = model.getFrameId(sensor.name, pin.OP_FRAME)
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            axis = np.array(sensor.direction) / np.linalg.norm(sensor.direction)
            u = data.oMf[frame].rotation @ axis
            acceleration[i, j] = u @ jacobian[:3]
            tilt[i, j] = -np.cross(u, model.gravity.linear) @ jacobian[3:]
    return tilt, acceleration
