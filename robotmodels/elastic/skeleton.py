"""Everything of a robot but its springs, at given coordinates: mass, gravity, motors, sensors."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.symmetric_matrices import ROUNDING, scaled_eigh
from robotmodels.description.outputs import Output, outputs_of
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.arm import Arm
from robotmodels.elastic.dynamics import Gravity, mass_and_gravity, mass_matrices
from robotmodels.elastic.link_sensors import link_sensors
from robotmodels.linear.linear_model import Channels, Measurement


@dataclass(frozen=True, eq=False)
class Layout:
    """Coordinates of the linear models: the arm's, then the motors with an elastic drive."""

    file: RobotFile
    arm: Arm

    @cached_property
    def outputs(self) -> tuple[Output, ...]:
        """What is measured."""
        return outputs_of(self.file)

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the n motors."""
        return tuple(motor.name for motor in self.file.motors)

    @cached_property
    def torque_springs(self) -> IntArray | None:
        """Spring of each output that is a spring's torque, -1 of others, (m,); None without."""
        names = [spring.name for spring in self.file.springs]
        rows = [names.index(o.of) if o.kind == "spring" else -1 for o in self.outputs]
        return np.array(rows, dtype=np.int64) if max(rows) >= 0 else None

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
    def coordinate_of(self) -> dict[str, int]:
        """Coordinate of each motor, and of the joint of each friction, by name."""
        motors = {m.name: c for m, c in zip(self.file.motors, self.motors, strict=True)}
        return motors | {f.name: self.arm.coordinate[f.joint] for f in self.file.friction}

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


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A robot without its springs, linearised at Q coordinate vectors.

    Attributes
    ----------
    mass, stiffness : ndarray, (Q, d, d)
        Mass matrices, and the stiffness that gravity adds.
    damping : ndarray, (d, d) or (Q, d, d)
        Viscous friction of motors and joints, and dampers in place of Coulomb friction, by position
        where it depends on the load. Inertia and viscous friction are missing where one of them is
        free (see `Inertances`).
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


def skeleton(layout: Layout, coordinates: Array, without: Collection[str] = ()) -> Skeleton:
    """Return the skeleton at the arm's `coordinates` (Q, arm size).

    It is `without` the inertia of motors, and the viscous friction of motors and joints, named so.
    """
    file, size, arm = layout.file, layout.size, slice(0, layout.arm_size)
    count = len(coordinates)
    mass, gravity = mass_and_gravity(layout.arm, coordinates, size)
    stiffness, torques = np.zeros((count, size, size)), np.zeros((count, size))
    torques[:, arm] = gravity.torques
    gravity.write_slopes(stiffness[:, arm, arm])
    selector = np.zeros((size, len(file.motors)))
    for j, (c, motor) in enumerate(zip(layout.motors, file.motors, strict=True)):
        if motor.name not in without:
            mass[:, c, c] += motor.inertia * motor.gear_ratio**2
        selector[c, j] = motor.gear_ratio
    damping = _friction(layout, gravity, without)
    measurement = _measurement(layout, selector, coordinates)
    return Skeleton(mass, damping, stiffness, torques, selector, measurement)


def _friction(layout: Layout, gravity: Gravity, without: Collection[str]) -> Array:
    """Return viscous friction, `without` that of some names, and equivalents of Coulomb friction.

    (d, d), or (Q, d, d) where friction depends on the torque of gravity, counterbalances aside.
    """
    file, size = layout.file, layout.size
    damping = np.zeros((size, size))
    if any(item.per_load for item in file.friction):
        load = np.abs(replace(gravity, balance=None).torques)
        damping = np.zeros((len(load), size, size))
    for c, motor in zip(layout.motors, file.motors, strict=True):
        viscous = 0.0 if motor.name in without else motor.viscous
        damping[..., c, c] += (viscous + motor.equivalent) * motor.gear_ratio**2
    for item in file.friction:
        c = layout.arm.coordinate[item.joint]
        damping[..., c, c] += (0.0 if item.name in without else item.viscous) + item.equivalent
        if item.per_load:
            damping[:, c, c] += item.per_load * load[:, c]
    return damping


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
    """Return the rows of all outputs; those of springs' torques are the network's part."""
    file, outputs = layout.file, layout.outputs
    on_links = any(output.kind == "link" for output in outputs)
    # All but sensors on links read alike everywhere: one copy serves all positions then.
    count = len(coordinates) if on_links else 1
    rows = np.zeros((3, count, len(outputs), layout.size))
    feedthrough = np.zeros((len(outputs), len(file.motors)))
    for i, output in enumerate(outputs):
        if output.encoder:
            rows[output.order, :, i] = _encoder(layout, output, selector)
        elif output.kind == "motor":
            feedthrough[i, layout.motor_names.index(output.of)] = 1.0
    if on_links:
        on_link = [i for i, output in enumerate(outputs) if output.kind == "link"]
        rows[:, :, on_link, : layout.arm_size] = link_sensors(
            layout.arm, file, [outputs[i] for i in on_link], coordinates
        )
    else:
        rows = np.broadcast_to(rows, (3, len(coordinates), *rows.shape[2:]))
    sensor = Channels(*(np.array([getattr(o, k) for o in outputs]) for k in _CHANNEL))
    torque = Channels(
        *(np.array([getattr(m, f"torque_{k}") for m in file.motors]) for k in _CHANNEL)
    )
    plain = sensor.ideal and not file.outputs
    position, velocity, acceleration = rows
    return Measurement(
        position, velocity, acceleration, torque, file.delay, None if plain else sensor,
        feedthrough if feedthrough.any() else None,
    )  # fmt: skip


_CHANNEL = ("gain", "delay", "lag")


def _encoder(layout: Layout, output: Output, selector: Array) -> Array:
    """Return what an encoder of a motor or a joint sees of the coordinates, (d,)."""
    if output.kind == "motor":
        return np.asarray(selector[:, layout.motor_names.index(output.of)])
    row, arm = np.zeros(layout.size), layout.arm
    if arm.coordinate_map is None:
        row[arm.coordinate[output.of]] = 1.0
    else:
        joint = arm.model.joints[arm.model.getJointId(output.of)].idx_v
        row[: arm.size] = arm.coordinate_map.matrix[joint]
    return row
