"""What ``oed init`` writes: a commented study, and a robot file from a URDF."""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from reports.commands.init_study import study_text
from reports.commands.yaml_text import yaml_number, yaml_word
from reports.page_elements import filled_text
from robotmodels import ElasticRobot, load_robot
from robotmodels.checks.proposed_drives import (
    Drive,
    UrdfJoint,
    moving_joints,
    propose_drives,
    unit_doubts,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.description.urdf import PACKAGE_PREFIX

_MOST_MOTORS = 64


@dataclass(frozen=True)
class StarterFiles:
    """Files by name, the robot they are about, and what its author should know."""

    robot: str
    files: dict[str, str]
    notes: tuple[str, ...] = ()


def starter_files(robot: str, folder: Path) -> StarterFiles:
    """Return the files of a new study that will lie in `folder`.

    Parameters
    ----------
    robot : str
        A built-in robot, a robot file, or a URDF, for which a robot file is made as well.

    Raises
    ------
    InvalidInput
        If there is no such robot, or it cannot be used.
    """
    ending = Path(robot).suffix.lower()
    if ending not in (".urdf", ".xml"):
        robot_file = ending in (".yaml", ".yml")
        if not robot_file and Path(robot).is_file():
            raise InvalidInput(f"{robot}: a URDF (.urdf, .xml) or a robot file (.yaml) is needed")
        loaded = load_robot(robot)
        reference = _from(folder, Path(robot)) if robot_file else robot
        study, notes = study_text(loaded, reference, not robot_file)
        return StarterFiles(loaded.name, {"study.yaml": study}, notes)
    urdf = robot if robot.startswith(PACKAGE_PREFIX) else _from(folder, Path(robot))
    name = Path(robot).stem
    joints = moving_joints(robot, Path())
    coupled = {name for j in joints if j.leader for name in (j.name, j.leader)}
    moving = [j for j in joints if j.name not in coupled]
    locked = [j for j in joints if j.name in coupled]
    _check_count(robot, len(moving))
    content = _robot(name, urdf, propose_drives(moving), locked)
    study, notes = study_text(_loaded(content, folder), "robot.yaml")
    notes = (*unit_doubts(robot, Path()), *notes)
    return StarterFiles(name, {"robot.yaml": content, "study.yaml": study}, notes)


def _check_count(robot: str, moving: int) -> None:
    if not moving:
        raise InvalidInput(f"{robot}: no joint moves by itself; a robot has one at least")
    if moving > _MOST_MOTORS:
        raise InvalidInput(
            f"{robot}: {moving} joints move; at most {_MOST_MOTORS} are driven: make those of "
            "hands, say, type 'fixed' in a copy of the URDF"
        )


def default_folder(robot: str) -> Path:
    """Return where the files of a new study go: a folder of the robot's name.

    ``robot.yaml``, as `starter_files` calls every robot file, is no name; its folder's is.
    """
    path = Path(robot)
    return Path(path.resolve().parent.name if path.stem == "robot" else path.stem)


def write_starter_files(starter: StarterFiles, folder: Path) -> list[Path]:
    """Write the files; none if one of them is there already.

    Raises
    ------
    InvalidInput
        If a file is there already, or the folder cannot be written to.
    """
    paths = [folder / name for name in starter.files]
    for path in paths:
        if path.exists():
            raise InvalidInput(f"{path} is there already; nothing was written, choose another -o")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, content in zip(paths, starter.files.values(), strict=True):
            with path.open("x", encoding="utf-8") as file:
                file.write(content)
    except OSError as error:
        raise InvalidInput(f"{folder} cannot be written to ({error.strerror})") from None
    return paths


def _loaded(content: str, folder: Path) -> ElasticRobot:
    """Return the robot of a robot file that is still to be written: what cannot be used is not."""
    from robotmodels.common.yaml_files import parse_yaml
    from robotmodels.description.robot_file import RobotFile

    return ElasticRobot(parse_yaml(content, RobotFile, "robot.yaml"), folder)


def _robot(name: str, urdf: str, drives: tuple[Drive, ...], locked: list[UrdfJoint]) -> str:
    joints = {*(d.joint.name for d in drives), *(j.name for j in locked)}
    motor, drive, bearing = (_prefix(word, joints) for word in ("motor", "drive", "bearing"))
    bearings = [
        {
            "name": f"{bearing}{number}{axis}",
            "joint": yaml_word(d.joint.name),
            "axis": axis,
            "stiffness": yaml_number(d.bearing_stiffness),
            "damping": yaml_number(d.bearing_damping),
        }
        for number, d in enumerate(drives, start=1)
        for axis in d.joint.across
        if not d.joint.prismatic
    ]
    return filled_text(
        "robot.yaml.j2",
        name=yaml_word(name),
        urdf=yaml_word(urdf),
        file="robot.yaml",
        locked={yaml_word(j.name): yaml_number(min(max(0.0, j.low), j.high)) for j in locked},
        drives=[
            _entries(d) | {"motor": f"{motor}{number}", "spring": f"{drive}{number}"}
            for number, d in enumerate(drives, start=1)
        ],
        any_prismatic=any(d.joint.prismatic for d in drives),
        bearings=bearings,
    )


def _prefix(word: str, joints: set[str]) -> str:
    """Return the first letter of a word; all of it where joints have names like that."""
    letter = word[0]
    alike = any(re.fullmatch(rf"{letter}\d+[xyz]?", joint) for joint in joints)
    while alike and any(joint.startswith(word) for joint in joints):
        word += "_"
    return word if alike else letter


def _entries(drive: Drive) -> dict[str, Any]:
    numbers = ("gear_ratio", "inertia", "viscous", "stiffness", "damping")
    return {
        "joint": yaml_word(drive.joint.name),
        "prismatic": drive.joint.prismatic,
        **{key: yaml_number(getattr(drive, key)) for key in numbers},
    }


def _from(folder: Path, path: Path) -> str:
    """Return `path` as seen from `folder`."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
