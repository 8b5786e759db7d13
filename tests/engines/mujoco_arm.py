"""An elastic robot in MuJoCo, made from the robot file and the URDF alone.

An independent judge of `robotmodels`: it shares the schema of the robot file and nothing else.
Rigid-body terms come from MuJoCo, everything else from a few plain formulas:

- motors behind a drive spring are balls on their own hinges beside the arm,
- derivatives of gravity are finite differences,
- responses are dense solves of (M, D, K).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation
from urdf_tree import Inertial, Joint, Tree, read_tree

from robotmodels.robot_file import Body, Hardening, RobotFile, Spring

UNIT = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class MujocoArm:
    """The robot of `file`, with the URDF at `urdf`."""

    file: RobotFile
    urdf: Path

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model; its joints are the drives, the torsions and the elastic motors."""
        return _Builder(self.file, read_tree(self.urdf)).compile()

    @cached_property
    def data(self) -> mujoco.MjData:
        """MuJoCo's working memory."""
        return mujoco.MjData(self.model)

    @cached_property
    def _unloaded(self) -> dict[bytes, np.ndarray]:
        """Gravity's derivatives found so far, by coordinates."""
        return {}

    @cached_property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        return [self.model.joint(i).name for i in range(self.model.njnt)]

    def order(self, names: tuple[str, ...]) -> np.ndarray:
        """Return where the coordinates `names` are in this model."""
        assert sorted(names) == sorted(self.names)
        return np.array([self.names.index(name) for name in names])

    def mass(self, q: np.ndarray) -> np.ndarray:
        """Return the mass matrix, motors included."""
        self._at(q)
        mujoco.mj_makeM(self.model, self.data)
        dense = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, dense)
        return dense

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """Return the generalised torques that hold the arm against gravity."""
        self._at(q)
        bias = np.zeros(self.model.nv)
        mujoco.mj_rne(self.model, self.data, 0, bias)  # at rest: gravity alone
        return bias

    def gravity_stiffness(self, q: np.ndarray) -> np.ndarray:
        """Return dg/dq by central differences of fourth order."""
        h = 1e-3
        columns = []
        for e in h * np.eye(len(q)):
            near = self.gravity(q + e) - self.gravity(q - e)
            far = self.gravity(q + 2 * e) - self.gravity(q - 2 * e)
            columns.append((8 * near - far) / (12 * h))
        return np.array(columns).T

    def _at(self, q: np.ndarray) -> None:
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    # Springs and motors

    def elongations(self) -> np.ndarray:
        """Return each spring's elongation per coordinate, (s, d)."""
        motor = {m.joint: m.name for m in self.file.motors}
        a = np.zeros((len(self.file.springs), self.model.nv))
        for row, spring in zip(a, self.file.springs, strict=True):
            if spring.axis == "drive":
                row[self.names.index(spring.joint)] = 1.0
                row[self.names.index(motor[spring.joint])] = -1.0
            else:
                row[self.names.index(spring.name)] = 1.0
        return a

    def held(self) -> np.ndarray:
        """Return the coordinates that motors hold: their own, or joints that they drive rigidly."""
        return np.array([self.names.index(name) for name in self._motor_coordinates()])

    def _motor_coordinates(self) -> list[str]:
        return [m.name if m.name in self.names else m.joint for m in self.file.motors]

    def rest(self, position: np.ndarray) -> np.ndarray:
        """Return the coordinates with unloaded springs."""
        q = np.zeros(self.model.nv)
        for motor, angle in zip(self.file.motors, position, strict=True):
            q[self.names.index(motor.joint)] = angle
        q[self.held()] = position
        return q

    def equilibrium(self, position: np.ndarray, factors: dict[str, float]) -> np.ndarray:
        """Return the coordinates where springs and gravity balance, motors standing still."""
        q = self.rest(position)
        free = np.setdiff1d(np.arange(len(q)), self.held())
        a = self.elongations()
        # That of the unloaded arm will do: Newton's steps stay nearly exact.
        by_q = self._unloaded.get(q.tobytes())
        if by_q is None:
            by_q = self._unloaded[q.tobytes()] = self.gravity_stiffness(q)
        for _ in range(50):
            force, slope = self._springs(a @ q, factors)
            K = by_q + a.T @ np.diag(slope) @ a
            step = np.linalg.solve(K[np.ix_(free, free)], (self.gravity(q) + a.T @ force)[free])
            q[free] -= step
            if np.abs(step).max(initial=0.0) < 1e-12:
                return q
        raise AssertionError("MuJoCo's equilibrium did not converge")

    def _springs(
        self, elongation: np.ndarray, factors: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return torques and slopes; `factors` multiply the file's numbers, by name."""
        torque, slope = np.zeros_like(elongation), np.zeros_like(elongation)
        for i, spring in enumerate(self.file.springs):
            k, x = spring.stiffness, elongation[i]
            if isinstance(k, Hardening):
                low = k.low * factors.get(f"{spring.name}.stiffness.low", 1.0)
                high = k.high * factors.get(f"{spring.name}.stiffness.high", 1.0)
                kappa = (high - low) / (3 * (3 * k.torque / (2 * low + high)) ** 2)
                torque[i], slope[i] = low * x + kappa * x**3, low + 3 * kappa * x**2
            else:
                slope[i] = k * factors.get(f"{spring.name}.stiffness", 1.0)
                torque[i] = slope[i] * x
        return torque, slope

    # Linear model

    def linear_model(
        self, position: np.ndarray, factors: dict[str, float], *, sag: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return mass, damping, stiffness and selector; without `sag` at unloaded springs."""
        q = self.equilibrium(position, factors) if sag else self.rest(position)
        a = self.elongations()
        slope = self._springs(a @ q, factors)[1]
        c = [s.damping * factors.get(f"{s.name}.damping", 1.0) for s in self.file.springs]
        damping = a.T @ np.diag(c) @ a
        selector = np.zeros((len(q), len(self.file.motors)))
        for j, (motor, i) in enumerate(zip(self.file.motors, self.held(), strict=True)):
            damping[i, i] += motor.viscous * motor.gear_ratio**2
            selector[i, j] = motor.gear_ratio
        stiffness = self.gravity_stiffness(q) + a.T @ np.diag(slope) @ a
        return self.mass(q), damping, stiffness, selector

    def frequency_response(
        self,
        positions: np.ndarray,
        omega: np.ndarray,
        factors: dict[str, float] | None = None,
        *,
        sag: bool = True,
    ) -> np.ndarray:
        """Return G, (Q, F, n, n): motor torque to motor acceleration, by dense solves."""
        response = []
        for position in positions:
            M, D, K, S = self.linear_model(position, factors or {}, sag=sag)
            receptances = [np.linalg.solve(K - w**2 * M + 1j * w * D, S) for w in omega]
            response.append([-(w**2) * S.T @ X for w, X in zip(omega, receptances, strict=True)])
        return np.array(response)


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
