"""The moving joints of a URDF: what a robot file for it has to give motors and springs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from robotmodels.arrays import Array
from robotmodels.description.urdf import locate, rigid_model
from robotmodels.description.urdf_check import mimics
from robotmodels.elastic.arm import motions

_LEAST_INERTIA = 1e-3
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
    """

    name: str
    prismatic: bool
    low: float
    high: float
    load: float
    across: tuple[str, ...]
    leader: str | None


def moving_joints(urdf: str, beside: Path) -> tuple[UrdfJoint, ...]:
    """Return the moving joints of a URDF, base to tool.

    Parameters
    ----------
    urdf : str
        As for `robotmodels.description.urdf.locate`.
    beside : Path
        As for `robotmodels.description.urdf.locate`.

    Raises
    ------
    InvalidInput
        If the URDF is absent or cannot be used.
    """
    path = locate(urdf, beside)
    model, leaders = rigid_model(path, {}), mimics(path)
    low, high, middle = _ranges(model)
    loads = np.diag(pin.crba(model, model.createData(), middle))
    return tuple(
        UrdfJoint(
            name=name,
            prismatic=not motion[3:].any(),
            low=float(low[j]),
            high=float(high[j]),
            load=max(float(loads[model.joints[j + 1].idx_v]), _LEAST_INERTIA),
            across=_across(motion),
            leader=leaders.get(name),
        )
        for j, (name, motion) in enumerate(zip(list(model.names)[1:], motions(model), strict=True))
    )


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
