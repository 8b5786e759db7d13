"""The elastic robot: an arm, its motors, its springs, and which of their numbers are free."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from robotmodels.arm import Arm, build_arm
from robotmodels.arrays import Array, IntArray
from robotmodels.elements import Elements
from robotmodels.equilibrium import Equilibrium, curvature, find_equilibrium
from robotmodels.errors import InvalidInput
from robotmodels.parameters import Parameters
from robotmodels.robot_file import RobotFile
from robotmodels.spring_network import SpringNetwork, Tangents
from robotmodels.urdf import locate, rigid_model, unknown_joint


@dataclass(frozen=True, eq=False)
class ElasticRobot:
    """A robot with lumped elasticity.

    Coordinates of its linear models are the arm's (drives and passive torsions, base to tool),
    then the motors with an elastic drive, in motor order, on the arm side.

    Attributes
    ----------
    file : the robot file.
    folder : where relative paths in it start.
    """

    file: RobotFile
    folder: Path = Path()

    def __post_init__(self) -> None:
        self._check_joints()
        _ = self.arm, self.parameters  # a robot that exists can be used

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.file.name

    @cached_property
    def rigid(self) -> pin.Model:
        """The rigid Pinocchio model, joints of `lock` held."""
        return rigid_model(locate(self.file.urdf, self.folder), self.file.lock)

    @cached_property
    def arm(self) -> Arm:
        """The elastic arm."""
        return build_arm(self.file, self.rigid)

    @cached_property
    def elements(self) -> Elements:
        """Every number that could be a parameter, and which are free."""
        prismatic = {
            name
            for name, joint in zip(self.rigid.names, self.rigid.joints, strict=True)
            if "Prismatic" in joint.shortname() or joint.shortname().startswith("JointModelP")
        }
        return Elements(self.file, prismatic)

    @cached_property
    def parameters(self) -> Parameters:
        """The free parameters."""
        return self.elements.parameters

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the n motors."""
        return tuple(m.name for m in self.file.motors)

    @property
    def motor_joints(self) -> tuple[str, ...]:
        """Names of the driven joints, in motor order."""
        return tuple(m.joint for m in self.file.motors)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the d coordinates of the linear models."""
        arm = sorted(self.arm.coordinate, key=self.arm.coordinate.__getitem__)
        return (*arm, *(self.motor_names[i] for i in self._elastic_motors))

    @cached_property
    def position_limits(self) -> Array:
        """Lower and upper joint limits of the motors' joints, (n, 2) [rad or m].

        A continuous joint, which has none, is given one turn.
        """
        limits = []
        for name in self.motor_joints:
            joint = self.rigid.joints[self.rigid.getJointId(name)]
            limits.append(
                (-np.pi, np.pi)
                if joint.nq == 2
                else (
                    self.rigid.lowerPositionLimit[joint.idx_q],
                    self.rigid.upperPositionLimit[joint.idx_q],
                )
            )
        return np.array(limits)

    def equilibrium(self, positions: Array, parameters: Array | None = None) -> Equilibrium:
        """Find the static equilibria at `positions` (Q, n).

        Raises
        ------
        NoEquilibrium : if a spring gives way.
        InvalidInput : if a position is outside the joint limits, or an array has a wrong shape.
        """
        positions = self._check_positions(positions)
        start = np.zeros((len(positions), self.arm.model.nv))
        start[:, self._drives] = positions
        rigid = [self._drives[i] for i, s in enumerate(self._drive_springs) if s is None]
        free = np.setdiff1d(np.arange(self.arm.model.nv), rigid)
        law = self.elements.laws(self.parameters.check(parameters))
        names = tuple(s.name for s in self.file.springs)
        return find_equilibrium(self.arm, start, self._incidence, free, law, names)

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network about the equilibria at `positions` (Q, n).

        Raises
        ------
        NoEquilibrium, InvalidInput : as `equilibrium`.
        """
        theta = self.parameters.check(parameters)
        return self._network(self.equilibrium(positions, theta), theta)

    def _network(self, at: Equilibrium, theta: Array) -> SpringNetwork:
        d, n = self.arm.model.nv, len(self.file.motors)
        total = d + len(self._elastic_motors)
        mass = np.zeros((len(at.coordinates), total, total))
        stiffness = np.zeros_like(mass)
        data = self.arm.model.createData()
        for i, q in enumerate(at.coordinates):
            mass[i, :d, :d] = pin.crba(self.arm.model, data, q)
            stiffness[i, :d, :d] = pin.computeGeneralizedGravityDerivatives(self.arm.model, data, q)
        damping = np.zeros((total, total))
        selector = np.zeros((total, n))
        for j, motor in enumerate(self.file.motors):
            c = self._motor_coordinates[j]
            mass[:, c, c] += motor.inertia * motor.gear_ratio**2
            damping[c, c] += motor.viscous * motor.gear_ratio**2
            selector[c, j] = motor.gear_ratio
        return SpringNetwork(
            mass=mass,
            damping=damping,
            stiffness=stiffness,
            selector=selector,
            ends=self._ends,
            spring_stiffness=at.slopes,
            spring_damping=np.tile(self.elements.dampings(theta), (len(mass), 1)),
            exponents=self.elements.exponents(theta, at.elongations),
            parameters=Parameters(self.parameters.names, theta, self.parameters.units),
        )

    def tangents(self, positions: Array, parameters: Array | None = None) -> Tangents:
        """Return how the shift of the equilibrium with ln theta changes mass and stiffness.

        Raises
        ------
        NoEquilibrium, InvalidInput : as `equilibrium`.
        """
        theta = self.parameters.check(parameters)
        at = self.equilibrium(positions, theta)
        network = self._network(at, theta)
        d, total, p = self.arm.model.nv, network.mass.shape[-1], len(theta)
        mass = np.zeros((len(at.coordinates), p, total, total))
        stiffness = np.zeros_like(mass)
        a = self._incidence
        ends = network.incidence()
        law = self.elements.laws(theta)
        load = self.elements.torque_derivatives(theta, at.elongations)  # (Q, s, p)
        held = np.setdiff1d(np.arange(d), np.flatnonzero(a.any(axis=0)))
        for i, q in enumerate(at.coordinates):
            K = network.stiffness[i, :d, :d] + (a.T * at.slopes[i]) @ a
            K[held], K[:, held] = 0.0, 0.0
            K[held, held] = 1.0
            shift = -np.linalg.solve(K, a.T @ load[i])  # dq / d ln theta, (d, p)
            by_mass, by_gravity = curvature(self.arm.model, q)
            mass[i, :, :d, :d] = np.einsum("kp,kij->pij", shift, by_mass)
            stiffness[i, :, :d, :d] = np.einsum("kp,kij->pij", shift, by_gravity)
            # The network's exponents hold each spring's torque; correct for its change.
            slide = a @ shift + load[i] / at.slopes[i][:, None]
            hardening = law.stiffening(at.elongations[i])[:, None] * slide
            stiffness[i] += np.einsum("sp,si,sj->pij", hardening, ends, ends)
        return Tangents(mass, stiffness)

    def skeleton_points(self, position: Array) -> Array:
        """Return the joint origins from base to tool, (k, 3) [m], springs unloaded."""
        q = pin.neutral(self.rigid)
        for name, angle in zip(self.motor_joints, position, strict=True):
            joint = self.rigid.joints[self.rigid.getJointId(name)]
            value = [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
            q[joint.idx_q : joint.idx_q + joint.nq] = value
        data = self.rigid.createData()
        pin.framesForwardKinematics(self.rigid, data, q)
        tool = self.rigid.nframes - 1
        origins = [np.zeros(3), *(data.oMi[i].translation for i in range(1, self.rigid.njoints))]
        return np.array([*origins, data.oMf[tool].translation])

    def _check_joints(self) -> None:
        joints = list(self.rigid.names)[1:]
        for motor in self.file.motors:
            if motor.joint not in joints:
                what = f"motor {motor.name!r}: {motor.joint!r}"
                raise InvalidInput(unknown_joint(what, motor.joint, joints))
        held = {*self.motor_joints, *(s.joint for s in self.file.springs if s.axis == "drive")}
        loose = [j for j in joints if j not in held]
        if loose:
            raise InvalidInput(
                f"joints without motor or drive spring: {', '.join(loose)}; "
                "give each a motor or hold it under 'lock'"
            )

    def _check_positions(self, positions: Array) -> Array:
        positions = np.asarray(positions, dtype=float)
        n = len(self.file.motors)
        if positions.ndim != 2 or positions.shape[1] != n:
            raise InvalidInput(
                f"positions: an array of shape {positions.shape} was given, (Q, {n}) is needed, "
                f"one column per motor: {', '.join(self.motor_names)}"
            )
        low, high = self.position_limits.T
        outside = ~((positions >= low - 1e-9) & (positions <= high + 1e-9))
        if outside.any():
            i, j = np.argwhere(outside)[0]
            raise InvalidInput(
                f"position {i}: joint {self.motor_joints[j]!r} at {positions[i, j]:.4g} is outside "
                f"its limits [{low[j]:.4g}, {high[j]:.4g}]"
            )
        return positions

    @cached_property
    def _drives(self) -> IntArray:
        """Arm coordinate of each motor's joint."""
        return np.array([self.arm.coordinate[j] for j in self.motor_joints])

    @cached_property
    def _drive_springs(self) -> list[int | None]:
        """Index of each motor's drive spring; None where the drive is rigid."""
        index = {s.joint: i for i, s in enumerate(self.file.springs) if s.axis == "drive"}
        return [index.get(joint) for joint in self.motor_joints]

    @cached_property
    def _elastic_motors(self) -> list[int]:
        return [i for i, spring in enumerate(self._drive_springs) if spring is not None]

    @cached_property
    def _motor_coordinates(self) -> list[int]:
        """Coordinate of each motor: its own behind a spring, the joint's where it is rigid."""
        own = {m: self.arm.model.nv + i for i, m in enumerate(self._elastic_motors)}
        return [own.get(i, int(self._drives[i])) for i in range(len(self.file.motors))]

    @cached_property
    def _ends(self) -> IntArray:
        """Coordinates that each spring joins, (s, 2); -1 is the ground."""
        motor_of = {spring: motor for motor, spring in enumerate(self._drive_springs)}
        ends = []
        for i, spring in enumerate(self.file.springs):
            name = spring.joint if spring.axis == "drive" else spring.name
            motor = motor_of.get(i)
            other = -1 if motor is None else self._motor_coordinates[motor]
            ends.append((self.arm.coordinate[str(name)], other))
        return np.array(ends)

    @cached_property
    def _incidence(self) -> Array:
        """Elongation of each spring per arm coordinate, motors standing still, (s, d)."""
        return np.eye(self.arm.model.nv)[self._ends[:, 0]]
