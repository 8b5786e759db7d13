"""URDF files: where they are, whether they can be used, and their rigid Pinocchio model."""

import importlib.metadata
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.file_paths import absolute
from robotmodels.description.urdf_check import checked_urdf

PACKAGE_PREFIX = "example-robot-data:"


def locate(urdf: str, beside: Path) -> Path:
    """Return the path of `urdf`, given as in a robot file that lies in folder `beside`.

    ``example-robot-data:PATH`` is a file below ``robots/`` of that installed package.

    Raises
    ------
    InvalidInput
        If there is no such file.
    """
    if not urdf.startswith(PACKAGE_PREFIX):
        path = absolute(beside, urdf)
        if os.path.isdir(path):
            raise InvalidInput(f"urdf: {path} is a folder; the URDF file itself is needed")
        if not os.path.isfile(path):
            raise InvalidInput(f"urdf: {path}: no such file")
        return path
    ending = "/robots/" + urdf.removeprefix(PACKAGE_PREFIX)
    files = importlib.metadata.files("example-robot-data") or []
    urdfs = [str(f) for f in files if f.suffix == ".urdf"]
    match = next((f for f in files if str(f).endswith(ending)), None)
    if match is None:
        names = {k.split("/robots/")[-1] for k in urdfs}
        raise InvalidInput(
            f"urdf: {urdf}: no such file in example-robot-data"
            f"{nearest(urdf.removeprefix(PACKAGE_PREFIX), names)}"
        )
    return Path(str(match.locate()))


def rigid_model(path: Path, lock: dict[str, float]) -> pin.Model:
    """Return the Pinocchio model of a URDF with the joints in `lock` held at an angle [rad].

    Meshes are not read and may be absent.

    Raises
    ------
    InvalidInput
        If the file is malformed, has an unsupported joint type or unphysical inertias, or does not
        have a joint of `lock`.
    """
    xml = ET.tostring(checked_urdf(path), encoding="unicode")
    try:
        model = pin.buildModelFromXML(xml)
    except ValueError as error:
        raise InvalidInput(f"{path}: not a valid URDF: {error}") from None
    joints = list(model.names)[1:]
    configuration = pin.neutral(model)
    for name, angle in lock.items():
        if name not in joints:
            raise InvalidInput(unknown_joint(f"lock: {name!r}", name, joints))
        joint = model.joints[model.getJointId(name)]
        _check_locked(model, joint, name, angle)
        # A continuous joint stores cosine and sine.
        value = [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value
    whole = model
    model = pin.buildReducedModel(model, [model.getJointId(n) for n in lock], configuration)
    for name in lock:
        _mend_locked_frame(model, whole, name)
    for name, inertia in zip(list(model.names)[1:], list(model.inertias)[1:], strict=True):
        check_inertia(inertia, f"{path.name}: the body moved by joint {name!r}")
    return model


def _mend_locked_frame(model: pin.Model, whole: pin.Model, name: str) -> None:
    """Make the frame of a locked joint like that of a fixed one.

    Pinocchio makes it its own parent, and gives it the inertia of all that the joint moved, bodies
    fixed to it included, although these have frames too.
    """
    joint = whole.getJointId(name)
    carrier = whole.frames[whole.getFrameId(name, pin.JOINT)].parentFrame
    frame = model.frames[model.getFrameId(name, pin.FIXED_JOINT)]
    frame.parentFrame = model.getFrameId(whole.frames[carrier].name, pin.BODY)
    inertia = whole.inertias[joint].toDynamicParameters()
    for other in whole.frames:
        if other.type == pin.FIXED_JOINT and other.parentJoint == joint:
            inertia = inertia - other.placement.act(other.inertia).toDynamicParameters()
    massive = inertia[0] > 1e-12
    frame.inertia = pin.Inertia.FromDynamicParameters(inertia) if massive else pin.Inertia.Zero()


def _check_locked(model: pin.Model, joint: pin.JointModel, name: str, angle: float) -> None:
    low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
    if joint.nq == 1 and not low - 1e-9 <= angle <= high + 1e-9:
        raise InvalidInput(
            f"lock: joint {name!r} at {angle:g} is outside its limits [{low:.4g}, {high:.4g}]"
        )


def unknown_joint(what: str, name: str, joints: list[str], locked: Iterable[str] = ()) -> str:
    """Return the message for a joint that does not move, with those that do."""
    if name in locked:
        return f"{what} is held under 'lock'; a locked joint has neither motor nor springs"
    names = ", ".join(joints) or "none"
    return f"{what} is not a moving joint of the URDF{nearest(name, joints)}; there are {names}"


def check_inertia(inertia: pin.Inertia, who: str) -> None:
    """Refuse a body that no distribution of mass can have.

    Raises
    ------
    InvalidInput
        As `check_moments`.
    """
    check_moments(float(inertia.mass), inertia.inertia, who)


def check_moments(mass: float, inertia: Array, who: str) -> None:
    """Refuse a mass [kg] and an inertia about its centre (3, 3) [kg m^2] that no body can have.

    Raises
    ------
    InvalidInput
        If the mass is not positive, or the principal moments of inertia are negative or break the
        triangle inequality.
    """
    if not mass > 0:
        raise InvalidInput(f"{who} has mass {mass:g} kg; a positive mass is needed")
    moments = np.linalg.eigvalsh(inertia)
    # Published inertias are rounded: allow the triangle inequality one part in a hundred.
    if moments[0] < -1e-9 * moments[2] or moments[0] + moments[1] < 0.99 * moments[2]:
        listed = ", ".join(f"{m:.3g}" for m in moments)
        raise InvalidInput(
            f"{who} is not physically consistent: its principal moments of inertia are {listed} "
            "kg m^2; each must be >= 0 and at most the sum of the other two"
        )
