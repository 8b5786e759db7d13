"""The elastic arm as a Pinocchio model: torsion joints inserted before drives and at cuts."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.description.joint_drives import Coupling
from robotmodels.description.outputs import outputs_of
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf import unknown_joint
from robotmodels.elastic.coordinate_map import CoordinateMap, coordinate_map
from robotmodels.elastic.counterbalances import (
    JointTorque,
    check_counterbalance,
    joint_torque,
)
from robotmodels.elastic.segments import Segment, link_frame, segments

AXES = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2]}
_REVOLUTE = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}
_PRISMATIC = {"x": pin.JointModelPX, "y": pin.JointModelPY, "z": pin.JointModelPZ}


@dataclass(frozen=True, eq=False)
class Arm:
    """A Pinocchio model whose joints are the drives and the passive torsions.

    Attributes
    ----------
    model : pin.Model
        One degree of freedom per joint; joint names are URDF joint names and spring names.
    coordinate : dict of str to int
        Index of each joint that follows none among the d coordinates.
    urdf_joints : tuple of str
        Names of the URDF's joints, base to tool.
    coordinate_map : CoordinateMap or None
        From the d coordinates to those of all joints; None where no joint follows another.
    counterbalances : tuple of JointTorque
        Torques on joints over their angles.
    """

    model: pin.Model
    coordinate: dict[str, int]
    urdf_joints: tuple[str, ...]
    coordinate_map: CoordinateMap | None = None
    counterbalances: tuple[JointTorque, ...] = ()

    @property
    def size(self) -> int:
        """Number d of independent coordinates."""
        return len(self.coordinate)

    def joints(self, coordinates: Array) -> Array:
        """Return the coordinates of all D joints, (Q, D), at independent ones, (Q, d)."""
        reduction = self.coordinate_map
        return coordinates if reduction is None else reduction.joints(coordinates)

    @cached_property
    def carries(self) -> BoolArray:
        """Whether the joint of one coordinate moves that of another, or is it, (d, d)."""
        column = [joint.idx_v for joint in self.model.joints]
        carries = np.zeros((self.model.nv, self.model.nv), dtype=bool)
        for chain in list(self.model.supports)[1:]:
            carries[[column[joint] for joint in list(chain)[1:]], column[chain[-1]]] = True
        return carries

    @property
    def serial(self) -> bool:
        """Whether of any two joints one carries the other."""
        return bool(np.all(self.carries | self.carries.T))

    @cached_property
    def carrier_first(self) -> IntArray:
        """Flat index of each entry i, j of a (d, d) matrix, or of j, i where joint j carries i."""
        entries = np.arange(self.carries.size).reshape(self.carries.shape)
        return np.where(self.carries, entries, entries.T).ravel()


def build_arm(
    file: RobotFile, rigid: pin.Model, couplings: Mapping[str, Coupling] | None = None
) -> Arm:
    """Insert the passive torsions of `file` into the rigid model; some of its joints follow others.

    Raises
    ------
    InvalidInput
        If a spring or payload names a joint or link that does not exist, a torsion axis is not
        orthogonal to its drive, or a part cut off a link is not physically consistent.
    """
    return _Builder(file, rigid).build(couplings or {})


class _Builder:
    def __init__(self, file: RobotFile, rigid: pin.Model) -> None:
        self.file = file
        self.rigid = rigid
        self.motions = motions(rigid)
        self.model = pin.Model()
        self.model.name = file.name
        self.model.gravity.linear = np.array(file.gravity)
        self.sensors = [output for output in outputs_of(file) if output.kind == "link"]
        self.joint_springs = {
            name: [s for s in file.springs if s.joint == name and s.axis != "drive"]
            for name in rigid.names
        }

    def build(self, couplings: Mapping[str, Coupling]) -> Arm:
        self._check_names()
        self._add_body(0, 0)
        names = list(self.model.names)[1:]
        order = {n: self.model.joints[self.model.getJointId(n)].idx_q for n in names}
        coordinate, reduction = coordinate_map(sorted(names, key=order.__getitem__), couplings)
        urdf_joints = tuple(n for n in names if self.rigid.existJointName(n))
        return Arm(self.model, coordinate, urdf_joints, reduction, self._counterbalances())

    def _counterbalances(self) -> tuple[JointTorque, ...]:
        ids = {b.name: self.model.getJointId(b.joint) for b in self.file.counterbalances}
        turns = {
            n: m[3:].any() for n, m in zip(list(self.rigid.names)[1:], self.motions, strict=True)
        }
        return tuple(
            joint_torque(b, self.rigid, self.model.joints[ids[b.name]].idx_v, turns[b.joint])
            for b in self.file.counterbalances
        )

    def _check_names(self) -> None:
        joints = list(self.rigid.names)[1:]
        for sensor in self.sensors:
            link_frame(self.rigid, sensor.of, sensor.who)
        for spring in self.file.springs:
            if spring.joint is not None and spring.joint not in joints:
                what = f"spring {spring.name!r}: {spring.joint!r}"
                raise InvalidInput(unknown_joint(what, spring.joint, joints, self.file.lock))
        for balance in self.file.counterbalances:
            check_counterbalance(balance, self.rigid, self.file.lock)
        for kind, items in (
            ("spring", self.file.springs),
            ("motor", self.file.motors),
            ("counterbalance", self.file.counterbalances),
        ):
            for item in items:
                if item.name in (*joints, *self.file.lock):
                    raise InvalidInput(f"{kind} {item.name!r} has the name of a joint of the URDF")

    def _add_body(self, old: int, new: int) -> None:
        """Add the body of rigid joint `old` to the new joint `new`, then all that it carries."""
        children = [c for c in range(1, self.rigid.njoints) if self.rigid.parents[c] == old]
        # The joint that each part is fastened to, and where that joint is.
        fastened: dict[Segment | None, tuple[int, pin.SE3]] = {None: (new, pin.SE3.Identity())}
        for segment in segments(self.file, self.rigid, old):
            joint, placement = fastened[segment.parent]
            for spring in segment.springs:
                at = placement.actInv(segment.placement)
                joint = self._add_joint(joint, _REVOLUTE[spring.axis](), at, spring.name)
                placement = segment.placement
            fastened[segment] = joint, placement
            if joint:
                self.model.appendBodyToJoint(joint, segment.inertia, placement.inverse())
            self._add_sensors(segment, joint, placement)
            for child in children:
                if self._carrier(child) in segment.links:
                    self._add_drive(child, joint, placement)

    def _add_sensors(self, segment: Segment, joint: int, placement: pin.SE3) -> None:
        for sensor in self.sensors:
            link = link_frame(self.rigid, sensor.of, sensor.who)
            if link in segment.links and joint == 0:
                raise InvalidInput(f"{sensor.who}: link {sensor.of!r} does not move")
            if link in segment.links:
                at = self.rigid.frames[link].placement * pin.SE3(np.eye(3), np.array(sensor.point))
                frame = pin.Frame(sensor.label, joint, placement.actInv(at), pin.OP_FRAME)
                self.model.addFrame(frame)

    def _add_drive(self, old: int, parent: int, placement: pin.SE3) -> None:
        name = self.rigid.names[old]
        joint = _one_coordinate(self.motions[old - 1])
        drive_axis = self.motions[old - 1][:3] + self.motions[old - 1][3:]
        at = placement.actInv(self.rigid.jointPlacements[old])
        for spring in self.joint_springs[name]:
            if abs(AXES[spring.axis] @ drive_axis) > 1e-6:
                raise InvalidInput(
                    f"spring {spring.name!r}: axis {spring.axis!r} is not orthogonal to the drive "
                    f"axis {(np.round(drive_axis, 3) + 0.0).tolist()} of joint {name!r}"
                )
            parent = self._add_joint(parent, _REVOLUTE[spring.axis](), at, spring.name)
            at = pin.SE3.Identity()
        self._add_body(old, self._add_joint(parent, joint, at, name))

    def _add_joint(self, parent: int, joint: pin.JointModel, at: pin.SE3, name: str) -> int:
        return int(self.model.addJoint(parent, joint, at, name))

    def _carrier(self, joint: int) -> int:
        """Return the body frame that carries rigid joint `joint`."""
        frame = self.rigid.frames[self.rigid.getFrameId(self.rigid.names[joint], pin.JOINT)]
        return int(frame.parentFrame)


def motions(rigid: pin.Model) -> Array:
    """Return the unit twists of the joints in their own frames, (njoints - 1, 6), linear first."""
    data = rigid.createData()
    pin.computeJointJacobians(rigid, data, pin.neutral(rigid))
    return np.array(
        [
            # Pinocchio returns a vector where there is but one joint.
            pin.getJointJacobian(rigid, data, i, pin.LOCAL).reshape(6, -1)[:, rigid.joints[i].idx_v]
            for i in range(1, rigid.njoints)
        ]
    )


def _one_coordinate(motion: Array) -> pin.JointModel:
    """Return the joint of a unit twist; a continuous joint becomes an unlimited revolute one."""
    linear, angular = motion[:3], motion[3:]
    axis, aligned, oblique = (
        (angular, _REVOLUTE, pin.JointModelRevoluteUnaligned)
        if np.any(angular)
        else (linear, _PRISMATIC, pin.JointModelPrismaticUnaligned)
    )
    for name, unit in AXES.items():
        if np.array_equal(axis, unit):
            return aligned[name]()
    return oblique(axis)
