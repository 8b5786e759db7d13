"""The robot of a robot file in MuJoCo: torsions as hinges, gears as tendons to hinges beside it.

Made from the robot file and the URDF alone; only MuJoCo computes with it.
"""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.description.counterbalances import Counterbalance
from robotmodels.description.joint_drives import Coupling
from robotmodels.description.outputs import outputs_of
from robotmodels.description.robot_file import Body, Hardening, Motor, RobotFile, Spring
from robotmodels.simulation.urdf_tree import Inertial, Joint, Tree

UNIT = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_LEAST_INERTIA = 1e-10  # MuJoCo knows no point masses [kg m^2]
_LEAST_MASS = 1e-14  # nor moving bodies without mass [kg, kg m^2]
SENSORS = {
    "acceleration": mujoco.mjtSensor.mjSENS_ACCELEROMETER,
    "angular_velocity": mujoco.mjtSensor.mjSENS_GYRO,
    "force": mujoco.mjtSensor.mjSENS_FORCE,
    "torque": mujoco.mjtSensor.mjSENS_TORQUE,
}
"""Of quantities of sensors on links."""


class PlantBuilder:
    """Builds the model of `file`, whose URDF is `tree`; `fuse` merges bodies fixed to others."""

    def __init__(self, file: RobotFile, tree: Tree, *, fuse: bool = True) -> None:
        self.file = file
        self.tree = tree
        self.spec = mujoco.MjSpec()
        self.spec.compiler.degree = False
        self.spec.compiler.fusestatic = fuse
        self.spec.compiler.boundmass = self.spec.compiler.boundinertia = _LEAST_MASS
        self.spec.option.gravity = file.gravity
        self.spec.option.disableflags = int(
            mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
        )
        self.drives = {s.joint: s for s in file.springs if s.axis == "drive"}
        self.balances = [b for b in file.counterbalances if b.in_mujoco]
        self.couplings = {n: c for n, c in tree.couplings.items() if n not in file.lock}
        self.sensors = [output for output in outputs_of(file) if output.kind == "link"]

    def compile(self) -> mujoco.MjModel:
        """Return the compiled model.

        Raises
        ------
        InvalidInput
            If MuJoCo refuses a body, whose moments of inertia must fit each other exactly, also
            where bodies fixed to it make up for them.
        """
        self._add_link(self.tree.root, self.spec.worldbody.add_body(name="the root link"))
        for motor in self.file.motors:
            if motor.joint in self.drives:
                self._add_motor(motor, self.drives[motor.joint])
        for balance in self.balances:
            self._add_balance(balance)
        for follower, coupling in self.couplings.items():
            self._add_coupling(follower, coupling)
        for output in self.sensors:
            self.spec.add_sensor(
                name=output.label,
                type=SENSORS[output.quantity],
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=output.label,
            )
        try:
            return self.spec.compile()
        except ValueError as error:
            cause = " ".join(str(error).split())
            raise InvalidInput(f"MuJoCo, which simulates, refuses the robot: {cause}") from None

    def _add_motor(self, motor: Motor, spring: Spring) -> None:
        """Add a motor on its own hinge and the gear that joins it to its joint."""
        square = motor.gear_ratio**2
        body = self.spec.worldbody.add_body(name=f"motor {motor.name}")
        _set_inertia(body, Inertial(1.0, np.zeros(3), motor.inertia * square * np.eye(3)))
        hinge = body.add_joint(name=motor.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=UNIT["z"])
        hinge.damping = [motor.viscous * square, 0.0, 0.0]
        gear = self.spec.add_tendon(name=motor.joint)
        gear.wrap_joint(motor.joint, 1.0)
        gear.wrap_joint(motor.name, -1.0)
        gear.stiffness, gear.damping = stiffness_polynomial(spring), [spring.damping, 0.0, 0.0]
        gear.springlength = [0.0, 0.0]

    def _add_balance(self, balance: Counterbalance) -> None:
        """Add the tendon between the two sites of a counterbalance."""
        tendon = self.spec.add_tendon(name=balance.name)
        for i in range(2):
            tendon.wrap_site(_site(balance, i))
        if balance.sinusoid is not None:
            tendon.stiffness, length = [balance.sinusoid.amplitude, 0.0, 0.0], 0.0
        elif balance.spring is not None:
            tendon.stiffness = [balance.spring.stiffness, 0.0, 0.0]
            length = balance.spring.unloaded_length
        tendon.springlength = [length, length]

    def _add_coupling(self, follower: str, coupling: Coupling) -> None:
        equality = self.spec.add_equality(name1=follower, name2=coupling.leader)
        equality.type, equality.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
        equality.data[:2] = coupling.offset, coupling.multiplier
        equality.data[2:5] = 0.0

    def _add_link(self, link: str, body: mujoco.MjsBody) -> None:
        """Fill `body` with the URDF link, its cuts and all that it carries."""
        inertial = self.tree.inertials[link]
        frame = np.zeros(3)  # origin of the link frame, seen from the body
        for point, springs in self._cuts(link).items():
            beyond = next((_from_body(s.distal) for s in springs if s.distal), None)
            distal = beyond or inertial
            remainder = inertial.minus(beyond) if inertial and beyond else None
            _set_inertia(body, _shift(remainder, frame))
            at = np.array(point)
            body = body.add_body(name=f"{link} beyond {point}", pos=frame + at)
            for spring in springs:
                _add_torsion(body, spring)
            inertial, frame = distal, -at
        _set_inertia(body, _shift(inertial, frame))
        payload, carried = self.file.payload, body
        if payload is not None and payload.link == link:
            carried = body.add_body(name="the payload", pos=frame)
            _set_inertia(carried, _from_body(payload))
        self._add_sites(link, body, carried, frame)
        for joint in self.tree.joints[link]:
            self._add_joint(joint, body, frame)

    def _add_sites(
        self, link: str, body: mujoco.MjsBody, carried: mujoco.MjsBody, frame: Array
    ) -> None:
        """Add the sites of sensors and of springs between two points.

        Forces are measured between the link and the payload that it carries.
        """
        for output in (output for output in self.sensors if output.link == link):
            if output.quantity in ("force", "torque"):
                carried.add_site(name=output.label, pos=np.array(output.point))
            else:
                body.add_site(name=output.label, pos=frame + np.array(output.point))
        for balance in self.balances:
            for i, end in enumerate(balance.points or ()):
                if end.link == link:
                    body.add_site(name=_site(balance, i), pos=frame + np.array(end.at))

    def _add_joint(self, joint: Joint, parent: mujoco.MjsBody, frame: Array) -> None:
        position, rotation = joint.position, joint.rotation
        locked = joint.name in self.file.lock
        if locked and joint.kind == "prismatic":
            position = position + rotation.apply(self.file.lock[joint.name] * joint.axis)
        elif locked:
            rotation = rotation * Rotation.from_rotvec(self.file.lock[joint.name] * joint.axis)
        quaternion = rotation.as_quat(scalar_first=True)
        # MuJoCo's own name for the ground is no link's.
        name = joint.child if joint.child != "world" else "link world"
        body = parent.add_body(name=name, pos=frame + position, quat=quaternion)
        if joint.kind != "fixed" and not locked:
            for spring in self.file.springs:
                if spring.joint == joint.name and spring.axis != "drive":
                    _add_torsion(body, spring)
            self._add_drive(joint, body)
            self._add_arms(joint, body, parent, pin_point=(frame + position, rotation))
        self._add_link(joint.child, body)

    def _add_drive(self, joint: Joint, body: mujoco.MjsBody) -> None:
        kind = "SLIDE" if joint.kind == "prismatic" else "HINGE"
        drive = body.add_joint(
            name=joint.name, type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"), axis=joint.axis
        )
        motor = next((m for m in self.file.motors if m.joint == joint.name), None)
        spring = self.drives.get(joint.name)
        if motor is not None and spring is None:
            drive.armature = motor.inertia * motor.gear_ratio**2
            drive.damping = [motor.viscous * motor.gear_ratio**2, 0.0, 0.0]
        elif motor is None and spring is not None:
            drive.stiffness, drive.damping = (
                stiffness_polynomial(spring),
                [spring.damping, 0.0, 0.0],
            )
        for item in self.file.friction:
            if item.joint == joint.name:
                drive.damping = [drive.damping[0] + item.viscous, 0.0, 0.0]

    def _add_arms(
        self,
        joint: Joint,
        body: mujoco.MjsBody,
        parent: mujoco.MjsBody,
        pin_point: tuple[Array, Rotation],
    ) -> None:
        """Add the sites of sinusoids: a spring of no length between arms of 1 m across the axis.

        Its torque is -stiffness sin(angle between the arms).
        """
        origin, rotation = pin_point
        arm = np.linalg.svd(joint.axis[None])[2][1]  # across the axis
        for balance in self.balances:
            if balance.sinusoid is not None and balance.joint == joint.name:
                turn = Rotation.from_rotvec((np.pi - balance.sinusoid.phase) * joint.axis)
                still = origin + rotation.apply(turn.apply(arm))
                parent.add_site(name=_site(balance, 0), pos=still)
                body.add_site(name=_site(balance, 1), pos=arm)

    def _cuts(self, link: str) -> dict[tuple[float, float, float], list[Spring]]:
        cuts: dict[tuple[float, float, float], list[Spring]] = {}
        for spring in self.file.springs:
            if spring.link == link and spring.at is not None:
                cuts.setdefault(spring.at, []).append(spring)
        return cuts


def _site(balance: Counterbalance, end: int) -> str:
    return f"{balance.name} end {end + 1}"


def stiffness_polynomial(spring: Spring) -> list[float]:
    """Return the coefficients of elongation, its square and its cube (see the robot file)."""
    k = spring.stiffness
    if isinstance(k, Hardening):
        elongation = 3 * k.torque / (2 * k.low + k.high)  # where the slope is `high`
        return [k.low, 0.0, (k.high - k.low) / (3 * elongation**2)]
    return [k, 0.0, 0.0]


def _add_torsion(body: mujoco.MjsBody, spring: Spring) -> None:
    hinge = body.add_joint(
        name=spring.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=UNIT[spring.axis]
    )
    hinge.stiffness, hinge.damping = stiffness_polynomial(spring), [spring.damping, 0.0, 0.0]


def _from_body(body: Body) -> Inertial:
    return Inertial(body.mass, np.array(body.com), body.inertia_matrix)


def _shift(inertial: Inertial | None, by: Array) -> Inertial | None:
    return inertial and Inertial(inertial.mass, inertial.com + by, inertial.inertia)


def _set_inertia(body: mujoco.MjsBody, inertial: Inertial | None) -> None:
    body.explicitinertial = True
    if inertial is None or inertial.mass == 0:
        return
    moments, axes = np.linalg.eigh(inertial.inertia)
    axes[:, 2] *= np.linalg.det(axes)  # right-handed
    body.mass, body.ipos = inertial.mass, inertial.com
    body.inertia = np.maximum(moments, _LEAST_INERTIA)
    body.iquat = Rotation.from_matrix(axes).as_quat(scalar_first=True)
