"""Moving joints of a model file, drives proposed for them, and joints without a use."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.common.errors import NoEquilibrium
from robotmodels.description.joint_drives import (
    Coupling,
    JointDrive,
    couplings,
    drive_fillers,
    joint_drives,
)
from robotmodels.description.model_files import ModelSource
from robotmodels.description.urdf import rigid_model
from robotmodels.description.urdf_check import checked_urdf, free_joints
from robotmodels.elastic.arm import motions
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.response import linearize

_LEAST_INERTIA = 1e-6
"""[kg m^2 or kg] Taken for joints beyond which a URDF has next to no mass."""


@dataclass(frozen=True)
class UrdfJoint:
    """A joint that moves.

    Attributes
    ----------
    name : str
        Name in the URDF.
    prismatic : bool
        Whether it slides.
    low, high : float, rad or m
        Its limits; one turn where it has none.
    load : float
        Inertia about its axis [kg m^2], or mass along it [kg], of all beyond it, joints in the
        middle of their range.
    across : tuple of str
        Axes of its frame, of x, y and z, that are orthogonal to its own; empty where its own lies
        along none.
    leader : str or None
        Joint it follows (``<mimic>``), or None.
    carrier : str or None
        Moving joint before it, or None.
    stated : JointDrive
        What the file says of its drive.
    fillers : tuple of str
        Of that, numbers that templates have and no drive: 0, or a gear ratio of 1.
    """

    name: str
    prismatic: bool
    low: float
    high: float
    load: float
    across: tuple[str, ...]
    leader: str | None
    carrier: str | None = None
    stated: JointDrive = field(default_factory=JointDrive)
    fillers: tuple[str, ...] = ()


def moving_joints(source: ModelSource) -> tuple[UrdfJoint, ...]:
    """Return the moving joints of a model file, base to tool.

    Raises
    ------
    InvalidInput
        If the file is absent or cannot be used.
    """
    checked = checked_urdf(source)
    model = rigid_model(source, dict.fromkeys(free_joints(checked), 0.0))
    followers, drives, fillers = couplings(checked), joint_drives(checked), drive_fillers(checked)
    low, high, middle = _ranges(model)
    loads = _loads(model, middle, followers)
    return tuple(
        UrdfJoint(
            name=name,
            prismatic=not motion[3:].any(),
            low=float(low[j]),
            high=float(high[j]),
            load=max(loads[name], _LEAST_INERTIA),
            across=_across(motion),
            leader=followers[name].leader if name in followers else None,
            carrier=model.names[model.parents[j + 1]] if model.parents[j + 1] else None,
            stated=drives[name],
            fillers=fillers[name],
        )
        for j, (name, motion) in enumerate(zip(list(model.names)[1:], motions(model), strict=True))
    )


def _loads(model: pin.Model, middle: Array, followers: Mapping[str, Coupling]) -> dict[str, float]:
    """Return what each joint moves [kg m^2 or kg], followers of a leader with it."""
    names = list(model.names)[1:]
    mass = pin.crba(model, model.createData(), middle)
    column = {name: model.joints[model.getJointId(name)].idx_v for name in names}
    loads = {}
    for name in names:
        motion = np.zeros(model.nv)
        motion[column[name]] = 1.0
        for follower, coupling in followers.items():
            if coupling.leader == name:
                motion[column[follower]] = coupling.multiplier
        loads[name] = float(motion @ mass @ motion)
    return loads


def _ranges(model: pin.Model) -> tuple[list[float], list[float], Array]:
    """Return the limits of every joint, and the configuration in the middle."""
    low, high, middle = [], [], pin.neutral(model)
    for joint in list(model.joints)[1:]:
        if joint.nq == 2:  # a continuous joint stores cosine and sine
            low.append(-np.pi)
            high.append(np.pi)
            continue
        low.append(float(model.lowerPositionLimit[joint.idx_q]))
        high.append(float(model.upperPositionLimit[joint.idx_q]))
        middle[joint.idx_q] = (low[-1] + high[-1]) / 2
    return low, high, middle


def _across(motion: Array) -> tuple[str, ...]:
    axis = motion[3:] if motion[3:].any() else motion[:3]
    along = np.abs(axis) > 1 - 1e-6
    return tuple(name for name, same in zip("xyz", along, strict=True) if not same) * any(along)


FIRST_HERTZ, LAST_HERTZ = 8.0, 20.0
"""Resonances of the drives from base to tip, motors held: those of industrial robots."""

RELATIVE_DAMPING = 0.04
BEARING_STIFFNESS = 2.5
"""Stiffness of a bearing over that of its drive."""

REVOLUTE_RATIO, PRISMATIC_RATIO = 100.0, 300.0
"""Gear ratio [-] and [rad/m]."""

SPREAD, SPREAD_PER_LOAD, MOST_SPREAD = 1.0, 0.35, 3.5
"""Standard deviation of ln of a guessed stiffness: at the joint with the largest load, more for
each e times less load, and at most. Gears of wrists are for payloads, which model files lack."""

DAMPING_SPREAD = 0.7
"""Standard deviation of ln of a guessed damping beside that of its stiffness."""

FRICTION_RATE = 5.0
"""Viscous friction of a motor over its inertia [1/s]."""


@dataclass(frozen=True)
class Drive:
    """A motor, its gear and the bearing of its joint: as the file states, else guesses.

    Attributes
    ----------
    joint : UrdfJoint
        Joint that it drives.
    gear_ratio, inertia, viscous, coulomb : float
        Of the motor, on its shaft [kg m^2, N m s/rad, N m].
    stiffness, damping : float
        Of the gear on the arm side [N m/rad, N m s/rad; N/m, N s/m].
    bearing_stiffness, bearing_damping : float
        Of a torsion across the joint [N m/rad, N m s/rad].
    spread : float
        Standard deviation of ln of the guessed stiffnesses.
    """

    joint: UrdfJoint
    gear_ratio: float
    inertia: float
    viscous: float
    coulomb: float
    stiffness: float
    damping: float
    bearing_stiffness: float
    bearing_damping: float
    spread: float

    @property
    def damping_spread(self) -> float:
        """Standard deviation of ln of the guessed dampings."""
        return math.hypot(self.spread, DAMPING_SPREAD)


def propose_drives(joints: Sequence[UrdfJoint]) -> tuple[Drive, ...]:
    """Return a drive for each joint: the motor matches its load, the spring resonates with it.

    Gear ratios, rotors and friction that the file states come before guesses.

    Resonances rise evenly along each branch, so that equal arms get equal drives.
    """
    span, most = LAST_HERTZ - FIRST_HERTZ, _largest_loads(joints)
    return tuple(
        _drive(joint, 2 * np.pi * (FIRST_HERTZ + span * along), most[joint.prismatic])
        for joint, along in zip(joints, _along_branches(joints), strict=True)
    )


def _along_branches(joints: Sequence[UrdfJoint]) -> list[float]:
    """Return where each joint is on the longest branch through it: 0 at its base, 1 at its tip."""
    before = {joint.name: joint.carrier for joint in joints}
    depth, height = dict.fromkeys(before, 0), dict.fromkeys(before, 0)
    for joint in joints:
        steps, carrier = 0, joint.carrier
        while carrier in before:
            steps += 1
            height[carrier] = max(height[carrier], steps)
            carrier = before[carrier]
        depth[joint.name] = steps
    return [depth[n] / max(depth[n] + height[n], 1) for n in before]


def _largest_loads(joints: Sequence[UrdfJoint]) -> dict[bool, float]:
    """Return the largest load of joints that turn (False) and of those that slide (True)."""
    most: dict[bool, float] = {}
    for joint in joints:
        most[joint.prismatic] = max(most.get(joint.prismatic, 0.0), joint.load)
    return most


def _drive(joint: UrdfJoint, omega: float, most_load: float) -> Drive:
    stated = joint.stated
    ratio = stated.gear_ratio or (PRISMATIC_RATIO if joint.prismatic else REVOLUTE_RATIO)
    inertia = (stated.armature or joint.load) / ratio**2
    viscous = FRICTION_RATE * inertia if stated.damping is None else stated.damping / ratio**2
    stiffness = omega**2 * joint.load
    damping = 2 * RELATIVE_DAMPING * stiffness / omega
    return Drive(
        joint=joint,
        gear_ratio=ratio,
        inertia=inertia,
        viscous=viscous,
        coulomb=(stated.friction or 0.0) / abs(ratio),
        stiffness=stiffness,
        damping=damping,
        bearing_stiffness=BEARING_STIFFNESS * stiffness,
        bearing_damping=BEARING_STIFFNESS * damping,
        spread=min(SPREAD + SPREAD_PER_LOAD * math.log(most_load / joint.load), MOST_SPREAD),
    )


# Frequencies [rad/s] and parts of the joints' ranges without meaning: any would do.
_OMEGA = 2 * np.pi * np.array([4.0, 23.0])
_STEP = 0.13
_GOLDEN = (np.sqrt(5) - 1) / 2
# Far above rounding, far below what noise would leave of a change.
_CHANGE = 1e-6


def idle_joints(robot: ElasticRobot) -> tuple[str, ...]:
    """Return the motor joints that need not be varied: no response changes when they move.

    Mostly that is the first joint, vertical on a rigid base. It is not idle where springs lie
    between it and the ground, or where it is not vertical. None is idle where gravity is too much
    for the springs.
    """
    low, high = robot.position_limits.T
    parts = 0.2 + 0.4 * (np.arange(1, len(low) + 1) * _GOLDEN % 1)
    position = low + parts * (high - low)
    try:
        reference = linearize(robot, position).frequency_response(_OMEGA)
        moved = linearize(robot, position + _STEP * np.diag(high - low)).frequency_response(_OMEGA)
    except NoEquilibrium:
        return ()
    change = np.abs(moved - reference).max(axis=(1, 2, 3))
    idle = change < _CHANGE * np.abs(reference).max()
    idle &= high > low  # what cannot turn shows nothing
    return tuple(name for name, still in zip(robot.motor_joints, idle, strict=True) if still)
