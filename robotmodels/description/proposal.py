"""Numbers to start a robot file with: plausible, and no more than that."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robotmodels.description.urdf_joints import UrdfJoint

FIRST_HERTZ, LAST_HERTZ = 8.0, 20.0
"""Resonances of the drives from base to tip, motors held: those of industrial robots."""

RELATIVE_DAMPING = 0.04
BEARING_STIFFNESS = 2.5
"""Stiffness of a bearing over that of its drive."""

REVOLUTE_RATIO, PRISMATIC_RATIO = 100.0, 300.0
"""Gear ratio [-] and [rad/m]."""

FRICTION_RATE = 5.0
"""Viscous friction of a motor over its inertia [1/s]."""


@dataclass(frozen=True)
class Drive:
    """A motor, its gear and the bearing of its joint: guesses from the URDF's masses.

    Attributes
    ----------
    joint : UrdfJoint
        Joint that it drives.
    gear_ratio, inertia, viscous : float
        Of the motor, on its shaft [kg m^2, N m s/rad].
    stiffness, damping : float
        Of the gear on the arm side [N m/rad, N m s/rad; N/m, N s/m].
    bearing_stiffness, bearing_damping : float
        Of a torsion across the joint [N m/rad, N m s/rad].
    """

    joint: UrdfJoint
    gear_ratio: float
    inertia: float
    viscous: float
    stiffness: float
    damping: float
    bearing_stiffness: float
    bearing_damping: float


def propose_drives(joints: Sequence[UrdfJoint]) -> tuple[Drive, ...]:
    """Return a drive for each joint: the motor matches its load, the spring resonates with it."""
    hertz = np.linspace(FIRST_HERTZ, LAST_HERTZ, max(len(joints), 2))
    return tuple(_drive(joint, 2 * np.pi * f) for joint, f in zip(joints, hertz, strict=False))


def _drive(joint: UrdfJoint, omega: float) -> Drive:
    ratio = PRISMATIC_RATIO if joint.prismatic else REVOLUTE_RATIO
    inertia = joint.load / ratio**2
    stiffness = omega**2 * joint.load
    damping = 2 * RELATIVE_DAMPING * stiffness / omega
    return Drive(
        joint=joint,
        gear_ratio=ratio,
        inertia=inertia,
        viscous=FRICTION_RATE * inertia,
        stiffness=stiffness,
        damping=damping,
        bearing_stiffness=BEARING_STIFFNESS * stiffness,
        bearing_damping=BEARING_STIFFNESS * damping,
    )
