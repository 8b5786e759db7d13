"""A robot at a glance: bodies, parameters, motors, springs under load, modes; all in SI units."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from robotmodels.checks.bodies import BodyState, bodies
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.common.symmetric_matrices import unit_diagonal_scaling
from robotmodels.description.robot_file import Choice, Hardening
from robotmodels.elastic.dynamics import gravity, mass_matrices
from robotmodels.elastic.equilibrium import Equilibrium
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.modes import anti_resonances, damped_modes, resonances, rigid_modes
from robotmodels.linear.noise import RelativeNoise
from robotmodels.linear.response import linearize, sensitivity
from robotmodels.linear.spring_network import SpringNetwork

FREQUENCIES = 80  # over the band, logarithmic
BAND = (2.0, 80.0)  # default [Hz]
_INSEPARABLE = 200.0  # the ur10 at mid-range has a pair at 110
State = Literal["free", "fixed", "tied"]


@dataclass(frozen=True)
class ParameterState:
    """A number of the robot file that could be estimated.

    Attributes
    ----------
    name : str
        Name of the parameter.
    value : float
        Value in SI units.
    unit : str
        SI unit.
    state : State
        Free, fixed, or tied to the free parameter `tied_to`.
    sensitivity : float, dimensionless
        Largest |dG / d ln value| of any FRF in the band at this position, each relative to the
        largest FRF of the same output at the same frequency.
    """

    name: str
    value: float
    unit: str
    state: State
    tied_to: str | None
    sensitivity: float


@dataclass(frozen=True)
class MotorState:
    """A motor and its drive at a position.

    Attributes
    ----------
    name : str
        As in the robot file.
    joint : str
        As in the robot file.
    gear_ratio : float
        As in the robot file.
    inertia, viscous : float
        On the motor shaft [kg m^2], [N m s/rad].
    reflected : float
        Inertia times ratio squared [kg m^2; kg where the joint is prismatic].
    load : float
        Inertia about the joint's axis of all that the joint carries, in the same unit.
    spring : str or None
        Name of its drive spring; None where the drive is rigid.
    prismatic : bool
        Whether the joint is.
    angle : float, rad or m
        Position.
    torque : float, N m
        Motor torque that holds the arm there.
    anti_resonances : tuple of float, rad/s
        Undamped zeros of the motor's own FRF.
    """

    name: str
    joint: str
    gear_ratio: float
    inertia: float
    viscous: float
    reflected: float
    load: float
    spring: str | None
    prismatic: bool
    angle: float
    torque: float
    anti_resonances: tuple[float, ...]


@dataclass(frozen=True)
class SpringState:
    """A spring in equilibrium.

    Attributes
    ----------
    name, axis : str
        As in the robot file.
    attached_to : str
        Its joint, or the link it cuts.
    at : tuple of (float, float, float) or None, m
        Where it cuts the link; None at a joint.
    linear : bool
        Whether it is a spring of a prismatic joint, in N/m and m.
    deflection : float, rad or m
        Elongation under gravity.
    torque : float, N m or N
        Spring torque of that elongation.
    unloaded_stiffness, stiffness : float, N m/rad or N/m
        Its slope unloaded and under this load.
    gravity : float, N m/rad or N/m
        What gravity adds to the stiffness of its coordinate.
    """

    name: str
    axis: str
    attached_to: str
    at: tuple[float, float, float] | None
    linear: bool
    deflection: float
    torque: float
    unloaded_stiffness: float
    stiffness: float
    gravity: float


@dataclass(frozen=True)
class Mode:
    """A damped flexible mode that oscillates.

    Attributes
    ----------
    frequency : float, rad/s
        Magnitude of the pole.
    damping_ratio : float, dimensionless
        Damping ratio.
    energy : tuple of float, dimensionless
        Share of each spring in the elastic energy, in file order.
    """

    frequency: float
    damping_ratio: float
    energy: tuple[float, ...]


@dataclass(frozen=True)
class InseparablePair:
    """Two free parameters that change every response alike.

    Attributes
    ----------
    names : tuple of str
        Both.
    inflation : float, dimensionless
        Factor by which the standard deviation of either exceeds that with the other one fixed.
    """

    names: tuple[str, str]
    inflation: float


@dataclass(frozen=True)
class Diagnosis:
    """A robot at a position.

    Attributes
    ----------
    robot : str
        Name of the robot.
    source : str
        Where the numbers come from.
    coordinates : tuple of str
        Names of the coordinates.
    outputs : tuple of str
        Names of the outputs.
    output_units : tuple of str
        Units of the outputs.
    delay : float
        Common delay.
    band : tuple of (float, float), rad/s
        Lowest and highest angular frequency of interest.
    bodies : tuple of BodyState
        Bodies, base to tool.
    parameters : tuple of ParameterState
        State of each parameter.
    motors : tuple of MotorState
        State of each motor, in file order.
    springs : tuple of SpringState
        State of each spring, in file order.
    inseparable : tuple of InseparablePair
        Pairs of free parameters whose effects in the band differ by less than a two-hundredth, in
        this position, with errors of 3 % and 1 % of the largest element.
    resonances : tuple of float, rad/s
        Undamped flexible modes.
    modes : tuple of Mode
        Damped ones that oscillate; empty if they cannot be told from rigid ones.
    overdamped : tuple of float, rad/s
        Magnitudes of real poles, two for each overdamped mode.
    modes_failed : str
        Why `modes` is empty; else empty.
    rigid_squares : tuple of float, rad^2/s^2
        Squared frequencies of the rigid modes, one per motor, as gravity leaves them; negative
        where gravity makes them unstable while the motors are free.
    """

    robot: str
    source: str
    coordinates: tuple[str, ...]
    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
    delay: float
    band: tuple[float, float]
    bodies: tuple[BodyState, ...]
    parameters: tuple[ParameterState, ...]
    motors: tuple[MotorState, ...]
    springs: tuple[SpringState, ...]
    inseparable: tuple[InseparablePair, ...]
    resonances: tuple[float, ...]
    modes: tuple[Mode, ...]
    overdamped: tuple[float, ...]
    modes_failed: str
    rigid_squares: tuple[float, ...]


def diagnose(
    robot: ElasticRobot, position: Array, band: tuple[float, float] | None = None
) -> Diagnosis:
    """Return the diagnosis of `robot` at `position` (n,) and its nominal parameters.

    Parameters
    ----------
    robot : ElasticRobot
        Any robot.
    position : ndarray, (n,), rad or m
        Position.
    band : tuple of (float, float), rad/s, optional
        Angular frequencies of interest; 2 to 80 Hz by default.

    Raises
    ------
    InvalidInput
        If the position has a wrong size or is outside the joint limits, or the band is not a pair
        of rising positive frequencies.
    NoEquilibrium
        If a spring is too weak for gravity.
    """
    low, high = (2 * np.pi * f for f in BAND) if band is None else band
    if not (np.isfinite([low, high]).all() and 0 < low < high):
        raise InvalidInput(f"band: {low:g} to {high:g} rad/s are not rising positive frequencies")
    position = np.asarray(position, dtype=float)
    everything = _all_free(robot)
    network = everything.network(position[None])
    at = everything.equilibrium(position[None])
    model = linearize(everything, position)
    modes, overdamped, failed = _modes(model, network)
    omega = np.geomspace(low, high, FREQUENCIES)
    slopes = sensitivity(everything, position[None], omega, equilibrium_shift=False)
    return Diagnosis(
        robot=robot.name,
        source=robot.file.source,
        coordinates=robot.coordinate_names,
        outputs=robot.output_names,
        output_units=robot.output_units,
        delay=robot.file.delay,
        band=(low, high),
        bodies=bodies(robot),
        parameters=_parameters(robot, everything, *slopes),
        motors=_motors(robot, position, at, model),
        springs=_springs(robot, at),
        inseparable=_inseparable(robot, *slopes),
        resonances=_floats(resonances(model).frequencies),
        modes=modes,
        overdamped=overdamped,
        modes_failed=failed,
        rigid_squares=_floats(rigid_modes(model).squares),
    )


def _all_free(robot: ElasticRobot) -> ElasticRobot:
    """Return the robot with every parameter free, so that the fixed ones can be looked at too."""
    choice = Choice(extra=robot.file.parameters.extra)
    return ElasticRobot(robot.file.model_copy(update={"parameters": choice}), robot.folder)


def _parameters(
    robot: ElasticRobot, everything: ElasticRobot, response: ComplexArray, slopes: ComplexArray
) -> tuple[ParameterState, ...]:
    of_output = np.maximum(np.abs(response).max(axis=-1), np.finfo(float).tiny)[..., None, None]
    relative = (np.abs(slopes) / of_output).max(axis=(0, 1, 2, 3))
    states, table = [], everything.parameters
    for i, (name, tie) in enumerate(zip(table.names, robot.elements.ties, strict=True)):
        head = robot.parameters.names[int(np.argmax(tie))] if tie.any() else None
        tied = head if head != name else None
        state: State = "tied" if tied else "free" if head else "fixed"
        value, change = float(table.values[i]), float(relative[i])
        states.append(ParameterState(name, value, table.units[i], state, tied, change))
    return tuple(states)


def _inseparable(
    robot: ElasticRobot, response: ComplexArray, slopes: ComplexArray
) -> tuple[InseparablePair, ...]:
    """Return pairs of free parameters with nearly the same effect, such as springs in series."""
    names, free = robot.parameters.names, slopes @ robot.elements.ties
    weights = 1 / RelativeNoise(by_output=bool(robot.file.outputs)).variance(response)
    flat = (np.sqrt(weights)[..., None] * free).reshape(-1, len(names))
    information = (np.conj(flat).T @ flat).real
    s = unit_diagonal_scaling(information)
    correlation = s[:, None] * information * s
    uncorrelated = np.sqrt(np.maximum(1 - correlation**2, np.finfo(float).eps))
    pairs = np.argwhere(np.triu(uncorrelated < 1 / _INSEPARABLE, 1))
    return tuple(
        InseparablePair((names[i], names[j]), float(1 / uncorrelated[i, j])) for i, j in pairs
    )


def _motors(
    robot: ElasticRobot, position: Array, at: Equilibrium, model: LinearModel
) -> tuple[MotorState, ...]:
    layout, file = robot.layout, robot.file
    torques = gravity(layout.arm, at.coordinates).torques[0]
    loads = np.diag(mass_matrices(layout.arm, at.coordinates)[0])
    states = []
    for j, motor in enumerate(file.motors):
        joint, spring = layout.drives[j], layout.drive_springs[j]
        states.append(
            MotorState(
                name=motor.name,
                joint=motor.joint,
                gear_ratio=motor.gear_ratio,
                inertia=motor.inertia,
                viscous=motor.viscous,
                reflected=motor.inertia * motor.gear_ratio**2,
                load=float(loads[joint]),
                spring=None if spring is None else file.springs[spring].name,
                prismatic=motor.joint in robot.elements.prismatic,
                angle=float(position[j]),
                torque=float(torques[joint]) / motor.gear_ratio,
                anti_resonances=_floats(anti_resonances(model, j)),
            )
        )
    return tuple(states)


def _springs(robot: ElasticRobot, at: Equilibrium) -> tuple[SpringState, ...]:
    layout = robot.layout
    load = gravity(layout.arm, at.coordinates)
    torques, slopes = load.torques, load.slopes
    states = []
    for i, (spring, c) in enumerate(zip(robot.file.springs, layout.sprung, strict=True)):
        k = spring.stiffness
        states.append(
            SpringState(
                name=spring.name,
                axis=spring.axis,
                attached_to=str(spring.joint or spring.link),
                at=spring.at,
                linear=robot.elements.linear(spring),
                deflection=float(at.elongations[0, i]),
                torque=-float(torques[0, c]),
                unloaded_stiffness=k.low if isinstance(k, Hardening) else k,
                stiffness=float(at.slopes[0, i]),
                gravity=float(slopes[0, c, c]),
            )
        )
    return tuple(states)


def _modes(
    model: LinearModel, network: SpringNetwork
) -> tuple[tuple[Mode, ...], tuple[float, ...], str]:
    """Return the oscillating modes, the real poles, and why there are none."""
    try:
        damped = damped_modes(model)
    except SolverFailed as error:
        return (), (), str(error)
    elongations = network.incidence() @ damped.shapes
    energy = network.spring_stiffness[0][:, None] * np.abs(elongations) ** 2
    energy /= energy.sum(axis=0)
    modes = [
        Mode(float(frequency), float(ratio), _floats(share))
        for frequency, ratio, share in zip(
            damped.frequencies, damped.damping_ratios, energy.T, strict=True
        )
    ]
    real = damped.poles.imag == 0
    oscillating = tuple(mode for mode, is_real in zip(modes, real, strict=True) if not is_real)
    return oscillating, _floats(damped.frequencies[real]), ""


def _floats(array: Array) -> tuple[float, ...]:
    return tuple(float(x) for x in array)
