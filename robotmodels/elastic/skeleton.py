"""Everything of a robot but its springs, at given coordinates: mass, gravity, motors, sensors."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.symmetric_matrices import ROUNDING, scaled_eigh
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.arm import Arm
from robotmodels.elastic.dynamics import mass_and_gravity, mass_matrices
from robotmodels.linear.linear_model import Measurement


@dataclass(frozen=True, eq=False)
class Layout:
    """Coordinates of the linear models: the arm's, then the motors with an elastic drive."""

    file: RobotFile
    arm: Arm

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates: joints, passive springs, motors."""
        arm = sorted(self.arm.coordinate, key=self.arm.coordinate.__getitem__)
        return (*arm, *(self.file.motors[i].name for i in self.elastic_motors))

    @property
    def arm_size(self) -> int:
        """Number of the arm's coordinates."""
        return self.arm.size

    @property
    def size(self) -> int:
        """Number d of coordinates."""
        return self.arm_size + len(self.elastic_motors)

    @cached_property
    def drives(self) -> IntArray:
        """Arm coordinate of each motor's joint, (n,)."""
        return np.array([self.arm.coordinate[m.joint] for m in self.file.motors])

    @cached_property
    def drive_springs(self) -> list[int | None]:
        """Index of each motor's drive spring; None where the drive is rigid."""
        index = {s.joint: i for i, s in enumerate(self.file.springs) if s.axis == "drive"}
        return [index.get(m.joint) for m in self.file.motors]

    @cached_property
    def elastic_motors(self) -> list[int]:
        """Indices of the motors behind a drive spring."""
        return [i for i, spring in enumerate(self.drive_springs) if spring is not None]

    @cached_property
    def fixed_coordinates(self) -> IntArray:
        """Arm coordinates that rigid drives hold still."""
        rigid = [d for d, s in zip(self.drives, self.drive_springs, strict=True) if s is None]
        return np.array(rigid, dtype=np.int64)

    @cached_property
    def motors(self) -> list[int]:
        """Coordinate of each motor: its shaft behind a spring, the joint where it is rigid."""
        shafts = {m: self.arm_size + i for i, m in enumerate(self.elastic_motors)}
        return [shafts.get(i, int(self.drives[i])) for i in range(len(self.file.motors))]

    @cached_property
    def nodes(self) -> IntArray:
        """Coordinates that each spring joins, (s, 2); -1 is the ground."""
        motor_of = {spring: motor for motor, spring in enumerate(self.drive_springs)}
        ends = []
        for i, spring in enumerate(self.file.springs):
            name = spring.joint if spring.axis == "drive" else spring.name
            motor = motor_of.get(i)
            other = -1 if motor is None else self.motors[motor]
            ends.append((self.arm.coordinate[str(name)], other))
        return np.array(ends, dtype=np.int64)

    @cached_property
    def sprung(self) -> IntArray:
        """Arm coordinate that each spring holds, (s,)."""
        return self.nodes[:, 0]


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
    _, values, vectors = scaled_eigh(mass)
    if values[0] < ROUNDING:
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
    reduction = layout.arm.coordinate_map
    tilt, acceleration = np.zeros((2, len(coordinates), len(file.accelerometers), model.nv))
    for i, q in enumerate(layout.arm.joints(coordinates)):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for j, sensor in enumerate(file.accelerometers):
            frame = model.getFrameId(sensor.name, pin.OP_FRAME)
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            axis = np.array(sensor.direction) / np.linalg.norm(sensor.direction)
            u = data.oMf[frame].rotation @ axis
            acceleration[i, j] = u @ jacobian[:3]
            tilt[i, j] = -np.cross(u, model.gravity.linear) @ jacobian[3:]
    if reduction is not None:
        return tilt @ reduction.matrix, acceleration @ reduction.matrix
    return tilt, acceleration
