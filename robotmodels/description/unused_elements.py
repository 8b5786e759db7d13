"""What of a model file is not used, and why: all that its reader has not read."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from robotmodels.description.joint_drives import joint_drives
from robotmodels.description.mjcf_unused import unused_of_mjcf
from robotmodels.description.model_files import ModelSource, is_mjcf, path_of, read_model
from robotmodels.description.urdf_check import check_robot
from robotmodels.description.xml_reader import XmlElement

_DRAWN = (
    *("link/visual", "link/collision/material", "link/collision@name", "link/collision/verbose"),
    *("link/collision/geometry@name", "link@type", "material", "transmission@name"),
    *("transmission@type", "transmission/type", "transmission/plugin", "transmission/joint@role"),
    *("transmission/joint/role", "transmission/joint/hardwareInterface", "transmission/actuator"),
)
"""Drawings and names, which move nothing."""

_DRIVERS = "drivers and controllers are no part of the model"
_CONTACT = "contact forces are no part of the model"
_REASONS = {
    "gazebo": "settings of the simulator Gazebo are no part of the model",
    "mujoco": "settings of MuJoCo for URDFs are no part of the model",
    "drake": "settings of Drake are no part of the model",
    "ros2_control": _DRIVERS,
    "sensor": "sensors stand in the robot file",
    "transmission": "only a mechanicalReduction of a single joint is read",
    "link/contact": _CONTACT,
    "link/surface": _CONTACT,
    "link/origin": "frames of links are those of their joints",
    "joint/safety_controller": "positions stay within <limit>",
    "joint/calibration": _DRIVERS,
    "joint/dynamics": "only damping, friction and armature are read",
    "joint/limit": "only lower and upper of joints with ends, effort and velocity are read",
}
"""By the path of an element, those below it included."""

_UNKNOWN = "it is no part of a URDF that is read here"
_MOTORS = "the motors of the robot file have their own"
_LIMITS = "limits of torque and speed stand in study and experiment"
_STATED = {
    "gear_ratio": ("transmission/mechanicalReduction", _MOTORS),
    "damping": ("joint/dynamics@damping", _MOTORS),
    "friction": ("joint/dynamics@friction", _MOTORS),
    "armature": ("joint/dynamics@armature", _MOTORS),
    "effort": ("joint/limit@effort", _LIMITS),
    "velocity": ("joint/limit@velocity", _LIMITS),
}
"""Of `JointDrive`: read for a new robot file, not used beside one."""


@dataclass(frozen=True)
class UnusedPart:
    """A kind of element or attribute of a model file that is not used.

    Attributes
    ----------
    path : str
        Its path, ``joint/safety_controller`` or ``joint/limit@current``.
    owners : tuple of str
        Names of the links, joints or others that have it.
    reason : str
        Why it is not used.
    """

    path: str
    owners: tuple[str, ...]
    reason: str

    @property
    def label(self) -> str:
        """The element or attribute, and who has it."""
        element, _, attribute = self.path.partition("@")
        tag = f"<{element.rpartition('/')[2]}>"
        what = f"{attribute} of {tag}" if attribute else tag
        names = ", ".join(self.owners[:_NAMED])
        more = f" and {len(self.owners) - _NAMED} more" if len(self.owners) > _NAMED else ""
        at = f" ({names}{more})" if names else ""
        return f"{what}{at}"

    def __str__(self) -> str:
        return f"{self.label}: not used, because {self.reason}"


_NAMED = 3


def unused_parts(source: ModelSource, *, beside_robot_file: bool = False) -> tuple[UnusedPart, ...]:
    """Return what of a model file is not used, drawings and names aside.

    Parameters
    ----------
    source : Path or ModelFile
        A URDF, xacro or MJCF file.
    beside_robot_file : bool
        Whether a robot file has the motors, instead of a new one that takes over what the model
        file says of drives.

    Raises
    ------
    InvalidInput
        If the file cannot be used.
    """
    root = read_model(source)
    checked = check_robot(root, path_of(source), shapes=True)
    owners: dict[tuple[str, str], list[str]] = {}
    for path, name, reason in _unread(root, source):
        owners.setdefault((path, reason), []).append(name)
    if beside_robot_file:
        for key, stated in _STATED.items():
            drives = joint_drives(checked).items()
            names = [name for name, drive in drives if getattr(drive, key) is not None]
            owners |= {stated: names} if names else {}
    parts = [UnusedPart(path, _distinct(names), why) for (path, why), names in owners.items()]
    return tuple(sorted(parts, key=lambda part: part.path))


def _unread(root: XmlElement, source: ModelSource) -> Iterator[tuple[str, str, str]]:
    """Yield the path, the owner's name and the reason of each part that was not used."""
    if is_mjcf(source):
        yield from unused_of_mjcf(path_of(source))
        return
    for top in root:
        if not isinstance(top, XmlElement):
            continue
        name = str(top.attrib.get("name", top.attrib.get("reference", "")))
        fixed = top.attrib.get("type") == "fixed" and top.tag == "joint"
        for part in top.unread(top.tag):
            path = part.removeprefix("ros2_control/") if "/transmission/" in part else part
            if not (_below(path, _DRAWN) or (fixed and path.count("/"))):
                yield path, name, _reason(path)


def _distinct(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for name in names if name))


def _below(path: str, paths: Iterable[str]) -> bool:
    return any(path == p or path.startswith((f"{p}/", f"{p}@")) for p in paths)


def _reason(path: str) -> str:
    return next((why for above, why in _REASONS.items() if _below(path, [above])), _UNKNOWN)
