"""URDF files: where they are, whether they can be used, and their rigid Pinocchio model."""

import importlib.metadata
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin

from robotmodels.errors import InvalidInput, nearest

_PACKAGE_PREFIX = "example-robot-data:"
_SUPPORTED = ("revolute", "continuous", "prismatic", "fixed")


def locate(urdf: str, beside: Path) -> Path:
    """Return the path of `urdf`, given as in a robot file that lies in folder `beside`.

    ``example-robot-data:PATH`` is a file below ``robots/`` of that installed package.

    Raises
    ------
    InvalidInput : if there is no such file.
    """
    if not urdf.startswith(_PACKAGE_PREFIX):
        path = (beside / urdf).resolve()
        if not path.is_file():
            raise InvalidInput(f"urdf: {path}: no such file")
        return path
    wanted = "/robots/" + urdf.removeprefix(_PACKAGE_PREFIX)
    files = importlib.metadata.files("example-robot-data") or []
    known = [str(f) for f in files if f.suffix == ".urdf"]
    match = next((f for f in files if str(f).endswith(wanted)), None)
    if match is None:
        names = {k.split("/robots/")[-1] for k in known}
        raise InvalidInput(
            f"urdf: {urdf}: no such file in example-robot-data"
            f"{nearest(urdf.removeprefix(_PACKAGE_PREFIX), names)}"
        )
    return Path(str(match.locate()))


def rigid_model(path: Path, lock: dict[str, float]) -> pin.Model:
    """Return the Pinocchio model of a URDF with the joints in `lock` held at an angle [rad].

    Meshes are not read and may be absent.

    Raises
    ------
    InvalidInput : if the file is malformed, has an unsupported joint type or unphysical inertias,
        or does not have a joint of `lock`.
    """
    _check_xml(path)
    model = pin.buildModelFromUrdf(str(path))
    joints = list(model.names)[1:]
    for name in lock:
        if name not in joints:
            raise InvalidInput(unknown_joint(f"lock: {name!r}", name, joints))
    configuration = pin.neutral(model)
    for name, angle in lock.items():
        joint = model.joints[model.getJointId(name)]
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

    Pinocchio leaves it its own parent, and gives it the inertia of all that the joint moved,
    bodies fixed to it included, which have frames of their own.
    """
    joint = whole.getJointId(name)
    carrier = whole.frames[whole.getFrameId(name, pin.JOINT)].parentFrame
    frame = model.frames[model.getFrameId(name, pin.FIXED_JOINT)]
    frame.parentFrame = model.getFrameId(whole.frames[carrier].name, pin.BODY)
    own = whole.inertias[joint].toDynamicParameters()
    for other in whole.frames:
        if other.type == pin.FIXED_JOINT and other.parentJoint == joint:
            own = own - other.placement.act(other.inertia).toDynamicParameters()
    massive = own[0] > 1e-12
    frame.inertia = pin.Inertia.FromDynamicParameters(own) if massive else pin.Inertia.Zero()


def unknown_joint(what: str, name: str, joints: list[str]) -> str:
    """Return the message for a joint that the URDF does not have, with those it has."""
    return f"{what} is not a joint of the URDF{nearest(name, joints)}; it has {', '.join(joints)}"


def check_inertia(inertia: pin.Inertia, who: str) -> None:
    """Refuse a body that no distribution of mass can have.

    Raises
    ------
    InvalidInput : if the mass is not positive, or the principal moments of inertia are negative
        or break the triangle inequality.
    """
    if not inertia.mass > 0:
        raise InvalidInput(f"{who} has mass {inertia.mass:g} kg; a positive mass is needed")
    moments = np.linalg.eigvalsh(inertia.inertia)
    # Published inertias are rounded: allow the triangle inequality one part in a hundred.
    if moments[0] < -1e-9 * moments[2] or moments[0] + moments[1] < 0.99 * moments[2]:
        listed = ", ".join(f"{m:.3g}" for m in moments)
        raise InvalidInput(
            f"{who} is not physically consistent: its principal moments of inertia are {listed} "
            "kg m^2; each must be >= 0 and at most the sum of the other two"
        )


def _check_xml(path: Path) -> None:
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InvalidInput(f"{path}: not a well-formed URDF: {error}") from None
    if root.tag != "robot":
        raise InvalidInput(f"{path}: not a URDF: its root is <{root.tag}>, not <robot>")
    for joint in root.findall("joint"):
        if joint.get("type") not in _SUPPORTED:
            raise InvalidInput(
                f"{path}: joint {joint.get('name')!r} is {joint.get('type')!r}; "
                f"only {', '.join(_SUPPORTED)} joints are supported"
            )
