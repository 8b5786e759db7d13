"""The elastic robot: an arm, its motors, its springs, and which of their numbers are free."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array, BoolArray, IntArray, check_ranges, real_numbers
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import absolute
from robotmodels.description.joint_drives import Coupling, couplings
from robotmodels.description.model_files import ModelFile
from robotmodels.description.outputs import Output
from robotmodels.description.parameters import Parameters
from robotmodels.description.robot_file import RobotFile, Spring
from robotmodels.description.urdf import locate, rigid_model
from robotmodels.description.urdf_check import checked_urdf
from robotmodels.elastic.arm import Arm, build_arm, motions
from robotmodels.elastic.equilibrium import Equilibrium, Labels, find_equilibrium
from robotmodels.elastic.equilibrium_derivatives import differentiate
from robotmodels.elastic.free_elements import Elements
from robotmodels.elastic.joint_checks import check_friction, check_joints
from robotmodels.elastic.segments import check_bodies
from robotmodels.elastic.skeleton import Layout, Skeleton, check_mass, skeleton
from robotmodels.linear.equilibrium_sensitivity import Tangents
from robotmodels.linear.spring_network import SpringNetwork, incidence


@dataclass(frozen=True, eq=False)
class ElasticRobot:
    """A robot with lumped elasticity.

    Coordinates of its linear models are the arm's (drives and passive torsions, base to tool),
    then the motors with an elastic drive, in motor order, on the arm side (see `Layout`).

    Attributes
    ----------
    file : RobotFile
        The robot file.
    folder : Path
        Where relative paths in it start.
    """

    file: RobotFile
    folder: Path = Path()

    def __post_init__(self) -> None:
        check_joints(self.file, list(self.rigid.names)[1:], self._all_couplings)
        check_friction(self.file, self.rigid, self.couplings)
        check_bodies(self.file, self.rigid)
        check_mass(self.layout)
        _ = self.parameters  # a robot that exists can be used
        self.elements.check_fitted()

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.file.name

    @cached_property
    def model_file(self) -> ModelFile:
        """The file of its bodies and joints."""
        path, xacro = locate(self.file.urdf, self.folder), self.file.xacro
        if xacro is None:
            return ModelFile(path)
        folders = tuple(absolute(self.folder, folder) for folder in xacro.packages)
        return ModelFile(path, xacro.argument_words, folders)

    @cached_property
    def _all_couplings(self) -> dict[str, Coupling]:
        return couplings(checked_urdf(self.model_file))

    @cached_property
    def couplings(self) -> dict[str, Coupling]:
        """Joints that follow others (``<mimic>``) and are not locked."""
        joints = set(self.rigid.names)
        return {name: c for name, c in self._all_couplings.items() if name in joints}

    @property
    def locked_followers(self) -> dict[str, str]:
        """Joints that are locked although they follow one that moves, and which."""
        lock, all_couplings = self.file.lock, self._all_couplings.items()
        return {n: c.leader for n, c in all_couplings if n in lock and c.leader not in lock}

    @cached_property
    def rigid(self) -> pin.Model:
        """The rigid Pinocchio model with the joints of `lock` fixed."""
        return rigid_model(self.model_file, self.file.lock)

    @cached_property
    def arm(self) -> Arm:
        """The elastic arm."""
        return build_arm(self.file, self.rigid, self.couplings)

    def arm_with(self, sensor: Output, theta: Array) -> Arm:
        """Return the arm at `theta` (p,) with the frame of one more sensor on a link.

        It is built once for frames in a row that are the same, where no parameter changes its
        bodies.
        """
        name = None if self.elements.extra_columns else (sensor.of, sensor.at)
        latest = self._arms_with_sensors.get(name)
        if latest is not None:
            return latest
        file = self.elements.file_at(theta).model_copy(update={"outputs": [sensor]})
        arm = build_arm(file, self.rigid, self.couplings)
        if name is not None:
            self._arms_with_sensors.clear()  # arms of many frames would travel with the robot
            self._arms_with_sensors[name] = arm
        return arm

    @cached_property
    def _arms_with_sensors(self) -> dict[object, Arm]:
        return {}

    @cached_property
    def layout(self) -> Layout:
        """Which coordinate belongs to which joint, motor and spring."""
        return Layout(self.file, self.arm)

    @cached_property
    def elements(self) -> Elements:
        """Every number that could be a parameter, and which are free."""
        prismatic = frozenset(
            name
            for name, motion in zip(list(self.rigid.names)[1:], motions(self.rigid), strict=True)
            if not motion[3:].any()
        )
        return Elements(self.file, prismatic)

    def _layout(self, theta: Array) -> Layout:
        """Return the layout whose arm has the payload and the cuts of `theta`."""
        if not self.elements.extra_columns:
            return self.layout
        file = self.elements.file_at(theta)
        moved = any(a.at != b.at for a, b in zip(file.springs, self.file.springs, strict=True))
        entries = ("payload", "counterbalances")
        same = not moved and all(getattr(file, e) == getattr(self.file, e) for e in entries)
        return Layout(file, self.arm if same else build_arm(file, self.rigid, self.couplings))

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

    @property
    def outputs(self) -> tuple[Output, ...]:
        """The m outputs: those of the file, or its motors and then its accelerometers."""
        return self.layout.outputs

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the m outputs."""
        return tuple(output.label for output in self.outputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the m outputs."""
        sliding, springs = self.elements.prismatic, {s.name: s for s in self.file.springs}
        return tuple(
            o.unit(self.elements.linear(springs[o.of]) if o.kind == "spring" else o.of in sliding)
            for o in self.outputs
        )

    @property
    def encoders(self) -> IntArray:
        """Output that is each motor's encoder, (n,); -1 where it is not measured."""
        rows = {o.of: i for i, o in enumerate(self.outputs) if o.kind == "motor" and o.encoder}
        return np.array([rows.get(name, -1) for name in self.motor_names])

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the d coordinates of the linear models."""
        return self.layout.names

    @cached_property
    def position_limits(self) -> Array:
        """Lower and upper joint limits of the motors' joints, (n, 2) [rad or m].

        A continuous joint, which has none, gets one turn. Those of joints that follow count too.
        """
        limits = {name: self._limits_of(name) for name in self.motor_joints}
        for follower, coupling in self.couplings.items():
            if coupling.leader in limits and coupling.multiplier:
                low, high = sorted(
                    (end - coupling.offset) / coupling.multiplier
                    for end in self._limits_of(follower)
                )
                least, most = limits[coupling.leader]
                limits[coupling.leader] = max(low, least), min(high, most)
        return np.array([limits[name] for name in self.motor_joints])

    def _limits_of(self, name: str) -> tuple[float, float]:
        joint = self.rigid.joints[self.rigid.getJointId(name)]
        if joint.nq == 2:
            return -np.pi, np.pi
        low, high = self.rigid.lowerPositionLimit, self.rigid.upperPositionLimit
        return float(low[joint.idx_q]), float(high[joint.idx_q])

    @cached_property
    def turning(self) -> BoolArray:
        """Which motors turn their joints, (n,): a whole turn leads to the same configuration."""
        prismatic = self.elements.prismatic
        return np.array([joint not in prismatic for joint in self.motor_joints])

    def checked_positions(self, positions: Array) -> Array:
        """Return `positions` (Q, n) as an array.

        Raises
        ------
        InvalidInput
            If a position is outside the joint limits, or the shape is a wrong one.
        """
        positions = real_numbers(positions, "positions")
        n = len(self.file.motors)
        if positions.ndim != 2 or positions.shape[1] != n:
            raise InvalidInput(
                f"positions: an array of shape {positions.shape} was given, (Q, {n}) is needed, "
                f"one column per motor: {', '.join(self.motor_names)}"
            )
        names = [f"joint {joint!r}" for joint in self.motor_joints]
        check_ranges(positions, self.position_limits, "position", names, 1e-9)
        return positions

    def equilibrium(self, positions: Array, parameters: Array | None = None) -> Equilibrium:
        """Find the static equilibria at `positions` (Q, n).

        Raises
        ------
        NoEquilibrium
            If a spring gives way.
        InvalidInput
            If a position is outside the joint limits, or an array has a wrong shape.
        """
        positions = self.checked_positions(positions)
        theta = self.parameters.check(parameters)
        layout = self._layout(theta)
        start = np.zeros((len(positions), layout.arm_size))
        start[:, layout.drives] = positions
        laws = self.elements.laws(theta)
        labels = Labels(
            springs=[_called(spring) for spring in self.file.springs],
            forces=[self.elements.linear(spring) for spring in self.file.springs],
            position=lambda i: f"position {i}, {np.round(positions[i], 3).tolist()}",
        )
        return find_equilibrium(
            layout.arm, start, layout.sprung, layout.fixed_coordinates, laws, labels
        )

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network about the equilibria at `positions` (Q, n).

        Raises
        ------
        NoEquilibrium, InvalidInput
            As `equilibrium`.
        """
        return self.network_about(self.equilibrium(positions, parameters), parameters)

    def network_about(self, at: Equilibrium, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network about equilibria that are known already."""
        theta = self.parameters.check(parameters)
        return self._network(at, theta, self._skeleton(theta, at.coordinates))

    def _network(self, at: Equilibrium, theta: Array, matrices: Skeleton) -> SpringNetwork:
        measured = matrices.measurement
        plain = measured.motor_order(matrices.selector) == 2 and measured.delay == 0
        plain = plain and measured.torque.ideal
        return SpringNetwork(
            mass=matrices.mass,
            damping=matrices.damping,
            stiffness=matrices.stiffness,
            selector=matrices.selector,
            nodes=self.layout.nodes,
            spring_stiffness=at.slopes,
            spring_damping=np.tile(self.elements.dampings(theta), (len(matrices.mass), 1)),
            exponents=self.elements.exponents(theta, at.elongations),
            parameters=Parameters(self.parameters.names, theta, self.parameters.units),
            measurement=None if plain else measured,
            inertances=self.elements.inertances(theta, self.layout.coordinate_of),
            non_spring_parameters=tuple(
                self.parameters.names[j] for j in self.elements.extra_columns
            ),
            torque_springs=self.layout.torque_springs,
        )

    @renamed_keywords(since="0.2", sag="equilibrium_shift")
    def tangents(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> Tangents | None:
        """Return derivatives of the matrices that `network` omits from sensitivities, or None.

        With `equilibrium_shift`, how the equilibrium's shift with ln theta changes everything;
        always, the direct effect of parameters that are neither spring nor damper.

        Raises
        ------
        NoEquilibrium, InvalidInput
            As `equilibrium`.
        """
        return self.linearization(positions, parameters, equilibrium_shift=equilibrium_shift)[1]

    @renamed_keywords(since="0.2", sag="equilibrium_shift")
    def linearization(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> tuple[SpringNetwork, Tangents | None]:
        """Return `network` and `tangents` about the same equilibria, computed once.

        Raises
        ------
        NoEquilibrium, InvalidInput
            As `equilibrium`.
        """
        theta = self.parameters.check(parameters)
        at = self.equilibrium(positions, theta)
        matrices = self._skeleton(theta, at.coordinates)
        network = self._network(at, theta, matrices)
        if not equilibrium_shift and not self.elements.extra_columns:
            return network, None
        return network, self._tangents(at, theta, matrices, equilibrium_shift)

    def _tangents(
        self, at: Equilibrium, theta: Array, matrices: Skeleton, equilibrium_shift: bool
    ) -> Tangents:
        extra = self.elements.extra_columns
        shift = np.zeros((*at.coordinates.shape, len(theta)))
        fixed = differentiate(self._skeleton, matrices, theta, at.coordinates, shift, extra)
        if not equilibrium_shift:
            return fixed
        load = self.elements.torque_derivatives(theta, at.elongations)  # (Q, s, p)
        arm, sprung, fixed_coordinates = (
            self.layout.arm_size,
            self.layout.sprung,
            self.layout.fixed_coordinates,
        )
        K = matrices.stiffness[:, :arm, :arm].copy()
        K[:, sprung, sprung] += at.slopes
        force = np.swapaxes(fixed.gravity, 1, 2)[:, :arm].copy()
        force[:, sprung] += load
        force[:, fixed_coordinates] = K[:, fixed_coordinates, :] = K[:, :, fixed_coordinates] = 0.0
        K[:, fixed_coordinates, fixed_coordinates] = 1.0
        shift = np.asarray(-np.linalg.solve(K, force))
        tangents = differentiate(self._skeleton, matrices, theta, at.coordinates, shift, extra)
        law = self.elements.laws(theta)
        if law.linear:
            return tangents
        # The network's exponents hold each spring's torque; correct for its change.
        slide = shift[:, sprung] + load / at.slopes[..., None]
        hardening = law.stiffening(at.elongations)[..., None] * slide
        ends = incidence(self.layout.nodes, self.layout.size)
        change = np.einsum("qsp,si,sj->qpij", hardening, ends, ends, optimize=True)
        return replace(tangents.stiffened(change), rows=self._with_torques(tangents, hardening))

    def _with_torques(self, tangents: Tangents, hardening: Array) -> Array | None:
        """Return the rows' derivatives with slopes (Q, s, p) that torque sensors feel."""
        springs = self.layout.torque_springs
        if springs is None:
            return tangents.rows
        q, p, d = tangents.gravity.shape
        of_rows, ends = np.flatnonzero(springs >= 0), incidence(self.layout.nodes, d)
        rows = np.zeros((3, q, p, len(springs), d)) if tangents.rows is None else tangents.rows
        change = np.swapaxes(hardening[:, springs[of_rows]], 1, 2)
        rows[0][:, :, of_rows] -= change.reshape(q, p, -1, 1) * ends[springs[of_rows]]
        return rows

    def _skeleton(self, theta: Array, coordinates: Array) -> Skeleton:
        return skeleton(self._layout(theta), coordinates, self.elements.inertial_names)


def _called(spring: Spring) -> str:
    """Return what errors call a spring."""
    attached_to = f"joint {spring.joint!r}" if spring.joint else f"link {spring.link!r}"
    return f"spring {spring.name!r} of {attached_to}"
