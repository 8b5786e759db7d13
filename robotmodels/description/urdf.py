"""URDF files: where they are, whether they can be used, and their rigid Pinocchio model."""

import importlib.metadata
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.file_paths import absolute
from robotmodels.description.model_files import ModelSource, path_of
from robotmodels.description.urdf_check import GROUND, checked_urdf, free_joints

PACKAGE_PREFIX = "example-robot-data:"
"""Of files in that installed package."""


def locate(urdf: str, beside: Path, key: str = "model file: ") -> Path:
    """Return the path of `urdf`, given as in a robot file that lies in folder `beside`.

    Errors begin with `key`.

    ``example-robot-data:PATH`` is a file below ``robots/`` of that installed package.

    Raises
    ------
    InvalidInput
        If there is no such file.
    """
    if not urdf.startswith(PACKAGE_PREFIX):
        path = absolute(beside, urdf)
        if os.path.isdir(path):
            raise InvalidInput(f"{key}{path} is a folder; the file itself is needed")
        if not os.path.isfile(path):
            raise InvalidInput(f"{key}{path}: no such file")
        return path
    ending = "/robots/" + urdf.removeprefix(PACKAGE_PREFIX)
    files = _packaged_files()
    urdfs = [str(f) for f in files if f.suffix == ".urdf"]
    match = next((f for f in files if str(f).endswith(ending)), None)
    if match is None:
        names = {k.split("/robots/")[-1] for k in urdfs}
        raise InvalidInput(
            f"{key}{urdf}: no such file in example-robot-data"
            f"{nearest(urdf.removeprefix(PACKAGE_PREFIX), names)}"
        )
    return Path(str(match.locate()))


@cache
def _packaged_files() -> tuple[importlib.metadata.PackagePath, ...]:
    """Return the files of example-robot-data: a list of a thousand, read for every robot else."""
    return tuple(importlib.metadata.files("example-robot-data") or ())


def rigid_model(source: ModelSource, lock: dict[str, float]) -> pin.Model:
    """Return the Pinocchio model of a model file with the joints in `lock` held at an angle [rad].

    Meshes are not read and may be absent. A floating or planar joint must be in `lock`, at 0.

    Raises
    ------
    InvalidInput
        If the file is malformed, has an unsupported joint type or unphysical inertias, does not
        have a joint of `lock`, or has a free joint that is not held.
    """
    tree = checked_urdf(source)
    lock = _without_free(tree, lock, path_of(source))
    model, link_names = _read_model(tree, path_of(source))
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
    _restore_names(model, link_names)
    _check_inertias(model, path_of(source))
    return model


def _without_free(tree: ET.Element, lock: dict[str, float], path: Path) -> dict[str, float]:
    """Return `lock` without floating and planar joints, each of which is to be in it."""
    free = free_joints(tree)
    for name, link in free.items():
        if name not in lock:
            raise InvalidInput(
                f"{path}: joint {name!r} leaves link {link!r} free to move; hold it where it is: "
                f"'lock: {{{name}: 0}}' in a robot file, --base {link} of oed init"
            )
        if lock[name]:
            raise InvalidInput(f"lock: free joint {name!r} at {lock[name]:g}; it is held at 0 only")
    return {name: angle for name, angle in lock.items() if name not in free}


def _read_model(tree: ET.Element, path: Path) -> tuple[pin.Model, dict[str, str]]:
    """Return the Pinocchio model of a URDF, and the own names of links that it has by another."""
    renamed = _rename_links(tree)
    try:
        return pin.buildModelFromXML(ET.tostring(tree, encoding="unicode")), renamed
    except ValueError as error:
        raise InvalidInput(f"{path}: not a valid URDF: {error}") from None


def _restore_names(model: pin.Model, link_names: dict[str, str]) -> None:
    for frame in model.frames:
        if frame.type == pin.BODY:
            frame.name = link_names.get(frame.name, frame.name)


def _check_inertias(model: pin.Model, path: Path) -> None:
    for name, inertia in zip(list(model.names)[1:], list(model.inertias)[1:], strict=True):
        if inertia.toDynamicParameters().any():  # without any, `check_mass` decides
            check_inertia(inertia, f"{path.name}: the body moved by joint {name!r}")


def _rename_links(tree: ET.Element) -> dict[str, str]:
    """Rename the links that share a name with a joint or the ground; return their own names.

    Pinocchio looks frames up by name alone while it reads and locks; afterwards by name and type.
    """
    links = [str(link.get("name")) for link in tree.findall("link")]
    joints = {str(joint.get("name")) for joint in tree.findall("joint")} | {GROUND}
    # Longer than any name, so nobody's.
    suffix = "~" * max(map(len, {*links, *joints}))
    renamed = {name: name + suffix for name in links if name in joints}
    for link in tree.findall("link"):
        link.set("name", renamed.get(str(link.get("name")), str(link.get("name"))))
    for end in (*tree.iterfind("joint/parent"), *tree.iterfind("joint/child")):
        end.set("link", renamed.get(str(end.get("link")), str(end.get("link"))))
    return {new: name for name, new in renamed.items()}


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
    if np.abs(moments).max() < _DUST:
        return
    # A point mass may have moments of rounding: those of a body of a tenth of a millimetre.
    rounding = 1e-9 * max(moments[2], 0.0) + 1e-8 * mass
    if moments[0] < -rounding or inconsistency(inertia) > _MOST_INCONSISTENT:
        listed = ", ".join(f"{m:.3g}" for m in moments)
        entries = nearest_consistent(inertia)[np.triu_indices(3)]
        raise InvalidInput(
            f"{who} is not physically consistent: its principal moments of inertia are {listed} "
            "kg m^2; each must be >= 0 and at most the sum of the other two; the nearest "
            f"that is so has xx, xy, xz, yy, yz, zz = {', '.join(f'{m:.6g}' for m in entries)}"
        )


_DUST = 1e-15
"""Moment of inertia of a grain of sand [kg m^2]: what is below stands for nothing."""

_MOST_INCONSISTENT = 0.15
"""Of inertias that are used: makers publish rounded ones, and some 8 % off."""


def inconsistency(inertia: Array) -> float:
    """Return the part by which the largest principal moment exceeds the sum of the other two."""
    moments = np.linalg.eigvalsh(inertia)
    return float(max(0.0, 1 - (moments[0] + moments[1]) / moments[2])) if moments[2] > 0 else 0.0


def nearest_consistent(inertia: Array) -> Array:
    """Return the inertia (3, 3) [kg m^2] of the body with the nearest second moments.

    The second moments tr(I)/2 - I of a distribution of mass are positive semidefinite: their
    projection (in the Frobenius norm) drops the negative eigenvalues.
    """
    values, vectors = np.linalg.eigh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    second = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return np.asarray(np.trace(second) * np.eye(3) - second)
