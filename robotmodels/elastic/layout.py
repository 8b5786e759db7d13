"""Which coordinate belongs to which joint, motor and spring."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robotmodels.arrays import IntArray
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.arm import Arm


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
        return int(self.arm.model.nv)

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
    def held(self) -> IntArray:
        """Arm coordinates that rigid drives hold still."""
        rigid = [d for d, s in zip(self.drives, self.drive_springs, strict=True) if s is None]
        return np.array(rigid, dtype=np.int64)

    @cached_property
    def motors(self) -> list[int]:
        """Coordinate of each motor: its own behind a spring, the joint's where it is rigid."""
        own = {m: self.arm_size + i for i, m in enumerate(self.elastic_motors)}
        return [own.get(i, int(self.drives[i])) for i in range(len(self.file.motors))]

    @cached_property
    def ends(self) -> IntArray:
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
        return self.ends[:, 0]
