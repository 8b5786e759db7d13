"""A MuJoCo model of an elastic robot: torsions as hinges, cuts and payload as bodies.

Motors behind a drive spring are balls on their own hinges beside the arm.
"""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation
from urdf_tree import Inertial, Joint, Tree

from robotmodels.robot_file import Body, RobotFile, Spring

UNIT = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def compiled(file: RobotFile, tree: Tree) -> mujoco.MjModel:
    """Return the model; its joints are the drives, the torsions and the elastic motors."""
    return _Builder(file, tree).compile()


class _Builder:
    def __init__(self, file: RobotFile, tree: Tree) -> None:
        self.file = file
        self.tree = tree
        self.spec = mujoco.MjSpec()
        self.spec.compiler.degree = False
        self.spec.compiler.fusestatic = False
        self.spec.option.gravity = file.gravity
        self.elastic = {s.joint for s in file.springs if s.axis == "drive"}

    def compile(self) -> mujoco.MjModel:
        self._add_link(self.tree.root, self.spec.worldbody.add_body(name="root"))
        for motor in self.file.motors:
            if motor.joint in self.elastic:
                ball = Inertial(1.0, np.zeros(3), motor.inertia * motor.gear_ratio**2 * np.eye(3))
                body = self.spec.worldbody.add_body(name=f"motor {motor.name}")
                _set_inertia(body, ball)
                body.add_joint(name=motor.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=UNIT["z"])
        for sensor in self.file.accelerometers:
            self.spec.add_sensor(
                type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=sensor.name,
            )
        return self.spec.compile()

    def _add_link(self, link: str, body: mujoco.MjsBody) -> None:
        """Fill `body` with the URDF link, its cuts and all that it carries."""
        inertial = self.tree.inertials[link]
        frame = np.zeros(3)  # origin of the link frame, seen from the body
        for point, springs in self._cuts(link).items():
            distal = next((_from_body(s.distal) for s in springs if s.distal), inertial)
            rest = None if distal is inertial else inertial.minus(distal)
            _set_inertia(body, _shift(rest, frame))
            at = np.array(point)
            body = body.add_body(name=f"{link} beyond {point}", pos=frame + at)
            for spring in springs:
                _add_hinge(body, spring.name, UNIT[spring.axis])
            inertial, frame = distal, -at
        _set_inertia(body, _shift(inertial, frame))
        payload = self.file.payload
        if payload is not None and payload.link == link:
            _set_inertia(body.add_body(name="payload", pos=frame), _from_body(payload))
        for sensor in self.file.accelerometers:
            if sensor.link == link:
                body.add_site(name=sensor.name, pos=frame + np.array(sensor.at))
        for joint in self.tree.joints[link]:
            self._add_joint(joint, body, frame)

    def _add_joint(self, joint: Joint, parent: mujoco.MjsBody, frame: np.ndarray) -> None:
        position, rotation = joint.position, joint.rotation
        held = joint.name in self.file.lock
        if held and joint.kind == "prismatic":
            position = position + rotation.apply(self.file.lock[joint.name] * joint.axis)
        elif held:
            rotation = rotation * Rotation.from_rotvec(self.file.lock[joint.name] * joint.axis)
        quaternion = rotation.as_quat(scalar_first=True)
        body = parent.add_body(name=joint.child, pos=frame + position, quat=quaternion)
        if joint.kind != "fixed" and not held:
            for spring in self.file.springs:
                if spring.joint == joint.name and spring.axis != "drive":
                    _add_hinge(body, spring.name, UNIT[spring.axis])
            self._add_drive(joint, body)
        self._add_link(joint.child, body)

    def _add_drive(self, joint: Joint, body: mujoco.MjsBody) -> None:
        kind = "SLIDE" if joint.kind == "prismatic" else "HINGE"
        drive = body.add_joint(
            name=joint.name, type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"), axis=joint.axis
        )
        for motor in self.file.motors:
            if motor.joint == joint.name and joint.name not in self.elastic:
                drive.armature = motor.inertia * motor.gear_ratio**2

    def _cuts(self, link: str) -> dict[tuple[float, float, float], list[Spring]]:
        cuts: dict[tuple[float, float, float], list[Spring]] = {}
        for spring in self.file.springs:
            if spring.link == link:
                cuts.setdefault(spring.at, []).append(spring)
        return cuts


def _add_hinge(body: mujoco.MjsBody, name: str, axis: tuple[float, float, float]) -> None:
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)


def _from_body(body: Body) -> Inertial:
    xx, xy, xz, yy, yz, zz = body.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(body.mass, np.array(body.com), inertia)


def _shift(inertial: Inertial | None, by: np.ndarray) -> Inertial | None:
    return inertial and Inertial(inertial.mass, inertial.com + by, inertial.inertia)


def _set_inertia(body: mujoco.MjsBody, inertial: Inertial | None) -> None:
    body.explicitinertial = True
    if inertial is None or inertial.mass == 0:
        return
    I = inertial.inertia  # noqa: E741
    body.mass, body.ipos = inertial.mass, inertial.com
    body.fullinertia = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
