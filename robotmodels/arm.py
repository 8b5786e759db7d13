"""The elastic arm as a Pinocchio model: torsion joints inserted before drives and at cuts."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, nearest
from robotmodels.robot_file import Body, RobotFile, Spring
from robotmodels.urdf import check_inertia, unknown_joint

_AXES = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2]}
_REVOLUTE = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}
_PRISMATIC = {"x": pin.JointModelPX, "y": pin.JointModelPY, "z": pin.JointModelPZ}


@dataclass(frozen=True, eq=False)
class Arm:
    """A Pinocchio model whose joints are the drives and the passive torsions.

    Attributes
    ----------
    model : one degree of freedom per joint; joint names are URDF joint names and spring names.
    coordinate : place of each joint name in the configuration vector.
    urdf_joints : names of the URDF's joints, base to tool.
    """

    model: pin.Model
    coordinate: dict[str, int]
    urdf_joints: tuple[str, ...]


def build_arm(file: RobotFile, rigid: pin.Model) -> Arm:
    """Insert the passive torsions of `file` into the rigid model.

    Raises
    ------
    InvalidInput : if a spring or payload names a joint or link that does not exist, a torsion
        axis is not orthogonal to its drive, or a part cut off a link is not physically consistent.
    """
    return _Builder(file, rigid).build()


@dataclass
class _Segment:
    """A rigid part of a joint's body: all of it, or what lies between two cuts."""

    placement: pin.SE3  # in the frame of the joint whose body is cut
    inertia: pin.Inertia
    frames: set[int]
    springs: list[Spring]  # of the cut that starts it


class _Builder:
    def __init__(self, file: RobotFile, rigid: pin.Model) -> None:
        self.file = file
        self.rigid = rigid
        self.motions = motions(rigid)
        self.model = pin.Model()
        self.model.name = file.name
        self.model.gravity.linear = np.array(file.gravity)
        self.joint_springs = {
            name: [s for s in file.springs if s.joint == name and s.axis != "drive"]
            for name in rigid.names
        }

    def build(self) -> Arm:
        self._check_names()
        self._add_body(0, 0)
        names = list(self.model.names)[1:]
        order = {n: self.model.joints[self.model.getJointId(n)].idx_q for n in names}
        urdf_joints = tuple(n for n in names if self.rigid.existJointName(n))
        return Arm(self.model, order, urdf_joints)

    def _check_names(self) -> None:
        joints = list(self.rigid.names)[1:]
        if self.file.payload is not None:
            self._link(self.file.payload.link, "payload")
            if self.file.payload.mass > 0:
                check_inertia(_inertia(self.file.payload), "payload")
        for sensor in self.file.accelerometers:
            self._link(sensor.link, f"accelerometer {sensor.name!r}")
        for spring in self.file.springs:
            if spring.joint is not None and spring.joint not in joints:
                what = f"spring {spring.name!r}: {spring.joint!r}"
                raise InvalidInput(unknown_joint(what, spring.joint, joints, self.file.lock))
        for kind, items in (("spring", self.file.springs), ("motor", self.file.motors)):
            for item in items:
                if item.name in joints:
                    raise InvalidInput(f"{kind} {item.name!r} has the name of a joint of the URDF")

    def _add_body(self, old: int, new: int) -> None:
        """Add the body of rigid joint `old` to the new joint `new`, then all that it carries."""
        children = [c for c in range(1, self.rigid.njoints) if self.rigid.parents[c] == old]
        placement = pin.SE3.Identity()
        for segment in self._segments(old):
            for spring in segment.springs:
                at = placement.actInv(segment.placement)
                new = self._add_joint(new, _REVOLUTE[spring.axis](), at, spring.name)
                placement = segment.placement
            if new:
                self.model.appendBodyToJoint(new, segment.inertia, placement.inverse())
            self._add_sensors(segment, new, placement)
            for child in children:
                if self._carrier(child) in segment.frames:
                    self._add_drive(child, new, placement)

    def _add_sensors(self, segment: _Segment, joint: int, placement: pin.SE3) -> None:
        for sensor in self.file.accelerometers:
            link = self._link(sensor.link, f"accelerometer {sensor.name!r}")
            if link in segment.frames:
                at = self.rigid.frames[link].placement * pin.SE3(np.eye(3), np.array(sensor.at))
                frame = pin.Frame(sensor.name, joint, placement.actInv(at), pin.OP_FRAME)
                self.model.addFrame(frame)

    def _add_drive(self, old: int, parent: int, placement: pin.SE3) -> None:
        name = self.rigid.names[old]
        joint = _one_coordinate(self.motions[old - 1])
        drive_axis = self.motions[old - 1][:3] + self.motions[old - 1][3:]
        at = placement.actInv(self.rigid.jointPlacements[old])
        for spring in self.joint_springs[name]:
            if abs(_AXES[spring.axis] @ drive_axis) > 1e-6:
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

    def _segments(self, old: int) -> list[_Segment]:
        """Return the parts of a body from its joint outwards; one part where nothing is cut."""
        frames = {i for i, f in enumerate(self.rigid.frames) if f.parentJoint == old}
        whole = self.rigid.inertias[old].copy()
        parts = [_Segment(pin.SE3.Identity(), whole, frames, [])]
        for springs in self._cuts(old):
            parts.append(self._cut(parts[-1], springs, old))
        payload = self.file.payload
        if payload is not None and (frame := self._link(payload.link, "payload")) in frames:
            carrier = next(p for p in reversed(parts) if frame in p.frames)
            carrier.inertia += self.rigid.frames[frame].placement.act(_inertia(payload))
        for i, part in enumerate(parts):
            if old or part.springs:
                check_inertia(part.inertia, self._part_name(old, parts, i))
        return parts

    def _cuts(self, old: int) -> list[list[Spring]]:
        """Return the cuts through the body of rigid joint `old`, in file order."""
        cuts: dict[tuple[str, object], list[Spring]] = {}
        for spring in self.file.springs:
            if spring.link is None:
                continue
            frame = self.rigid.frames[self._link(spring.link, f"spring {spring.name!r}")]
            if frame.parentJoint == old:
                cuts.setdefault((spring.link, spring.at), []).append(spring)
        return list(cuts.values())

    def _cut(self, near: _Segment, springs: list[Spring], old: int) -> _Segment:
        """Take the part beyond a cut off the segment `near` and return it."""
        who = f"spring {springs[0].name!r}"
        link = self._link(str(springs[0].link), who)
        if link not in near.frames:
            raise InvalidInput(
                f"{who}: link {springs[0].link!r} does not lie beyond the cut of spring "
                f"{near.springs[0].name!r}; the cuts through one rigid body follow each other "
                "outwards, in file order"
            )
        frame = self.rigid.frames[link]
        beyond = {i for i in near.frames if self._descends(i, link)}
        distal = [s.distal for s in springs if s.distal is not None]
        if len(distal) > 1:
            raise InvalidInput(f"spring {springs[1].name!r}: 'distal' is given twice for one cut")
        if not distal and old:
            raise InvalidInput(
                f"{who}: a cut through link {springs[0].link!r} needs "
                "'distal', the mass, com and inertia of the part beyond it"
            )
        if distal:
            check_inertia(_inertia(distal[0]), f"{who}: 'distal'")
        # Bodies fixed to the far end of the link lie beyond the cut; below an elastic
        # foundation (a cut through the root link) everything does.
        beyond_inertia = (
            _sum([frame.placement.act(_inertia(distal[0])), *self._fixed_bodies(beyond)])
            if distal
            else near.inertia.copy()
        )
        near.inertia = _difference(near.inertia, beyond_inertia)
        near.frames -= beyond | {link}
        at = frame.placement * pin.SE3(np.eye(3), np.array(springs[0].at))
        return _Segment(at, beyond_inertia, beyond | {link}, springs)

    def _fixed_bodies(self, frames: set[int]) -> list[pin.Inertia]:
        parts = (self.rigid.frames[i] for i in sorted(frames))
        return [f.placement.act(f.inertia) for f in parts if f.type == pin.FIXED_JOINT]

    def _descends(self, frame: int, ancestor: int) -> bool:
        while frame != ancestor:
            parent = self.rigid.frames[frame].parentFrame
            if parent == frame:
                return False
            frame = parent
        return True

    def _link(self, name: str, who: str) -> int:
        if not self.rigid.existFrame(name, pin.BODY):
            links = [f.name for f in self.rigid.frames if f.type == pin.BODY]
            raise InvalidInput(
                f"{who}: {name!r} is not a link of the URDF{nearest(name, links)}; "
                f"it has {', '.join(links)}"
            )
        return int(self.rigid.getFrameId(name, pin.BODY))

    def _part_name(self, old: int, parts: list[_Segment], i: int) -> str:
        body = f"the body moved by joint {self.rigid.names[old]!r}" if old else "the root link"
        if i + 1 < len(parts):
            return f"spring {parts[i + 1].springs[0].name!r}: what its cut leaves of {body}"
        if parts[i].springs:
            return f"spring {parts[i].springs[0].name!r}: the part of {body} beyond the cut"
        return body


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
    for name, unit in _AXES.items():
        if np.array_equal(axis, unit):
            return aligned[name]()
    return oblique(axis)


def _inertia(body: Body) -> pin.Inertia:
    xx, xy, xz, yy, yz, zz = body.inertia
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return pin.Inertia(body.mass, np.array(body.com), about_com)


def _sum(parts: list[pin.Inertia]) -> pin.Inertia:
    # The ten inertial parameters about the frame's origin are additive.
    total = np.sum([p.toDynamicParameters() for p in parts], axis=0)
    return _from_parameters(total)


def _difference(whole: pin.Inertia, part: pin.Inertia) -> pin.Inertia:
    return _from_parameters(whole.toDynamicParameters() - part.toDynamicParameters())


def _from_parameters(parameters: Array) -> pin.Inertia:
    if abs(parameters[0]) < 1e-12:
        return pin.Inertia.Zero()
    return pin.Inertia.FromDynamicParameters(parameters)
