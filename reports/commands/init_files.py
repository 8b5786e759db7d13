"""What ``oed init`` writes: a commented study, and a robot file from a URDF."""

import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from oed.candidates.free_ranges import free_margin, free_ranges
from oed.candidates.sources import Workcell
from reports import text
from reports.page_elements import filled_text
from robotmodels import ElasticRobot, load_robot
from robotmodels.checks.proposed_drives import (
    Drive,
    UrdfJoint,
    idle_joints,
    moving_joints,
    propose_drives,
)
from robotmodels.collision.shapes import robot_shapes
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.yaml_reader import reads_as_text

MOST_CANDIDATES = 1500
"""Candidates of a new study: a first answer within a minute."""

_TRUTH = ("y", "n", "yes", "no", "on", "off")

_INSET = 0.03
"""Part of a joint's range to stay away from either end."""

_MARGINS = (0.02, 0.01, 0.005)
"""Distances to keep from what may be touched, the usual one first [m]."""

_LINK_RADIUS = 0.05
"""Of links without collision shapes [m]."""

_FLOOR, _BURIED = 0.01, 0.3
"""Noise relative to the largest element, and its upper limit relative to a motor's response."""


@dataclass(frozen=True)
class StarterFiles:
    """Files by name, and the robot they are about."""

    robot: str
    files: dict[str, str]


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
    if not robot.endswith((".urdf", ".xml")):
        if not robot.endswith((".yaml", ".yml")) and Path(robot).is_file():
            raise InvalidInput(f"{robot}: a URDF (.urdf, .xml) or a robot file (.yaml) is needed")
        elastic_robot = load_robot(robot)
        builtin = not robot.endswith((".yaml", ".yml"))
        reference = robot if builtin else _from(folder, Path(robot))
        return StarterFiles(
            elastic_robot.name, {"study.yaml": _study(elastic_robot, reference, builtin)}
        )
    urdf = robot if ":" in robot else _from(folder, Path(robot))
    name = Path(robot).stem
    joints = moving_joints(robot, Path())
    coupled = {name for j in joints if j.leader for name in (j.name, j.leader)}
    moving = [j for j in joints if j.name not in coupled]
    locked = [j for j in joints if j.name in coupled]
    if not moving:
        raise InvalidInput(f"{robot}: no joint moves by itself; a robot has one at least")
    content = _robot(name, urdf, propose_drives(moving), locked)
    elastic_robot = _loaded(content, folder)
    return StarterFiles(
        name, {"robot.yaml": content, "study.yaml": _study(elastic_robot, "robot.yaml")}
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
    bearings = [
        {
            "name": f"b{number}{axis}",
            "joint": yaml_word(d.joint.name),
            "axis": axis,
            "stiffness": _yaml(d.bearing_stiffness),
            "damping": _yaml(d.bearing_damping),
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
        locked={yaml_word(j.name): _yaml(min(max(0.0, j.low), j.high)) for j in locked},
        drives=[_entries(d) for d in drives],
        any_prismatic=any(d.joint.prismatic for d in drives),
        bearings=bearings,
    )


def _entries(drive: Drive) -> dict[str, Any]:
    numbers = ("gear_ratio", "inertia", "viscous", "stiffness", "damping")
    return {
        "joint": yaml_word(drive.joint.name),
        "prismatic": drive.joint.prismatic,
        **{key: _yaml(getattr(drive, key)) for key in numbers},
    }


def _study(robot: ElasticRobot, reference: str, builtin: bool = False) -> str:
    idle = idle_joints(robot)
    points = grid_points([name not in idle for name in robot.motor_joints])
    shapes = robot_shapes(robot).solid
    ranges = _ranges(robot, points)
    cell = Workcell(floor=0.0, link_radius=None if shapes else _LINK_RADIUS)
    margin = free_margin(robot, ranges, cell, _MARGINS)
    narrowed = free_ranges(robot, ranges, replace(cell, margin=margin))
    return filled_text(
        "study.yaml.j2",
        name=robot.name,
        robot=yaml_word(reference),
        builtin=builtin,
        file="study.yaml",
        joints=[
            {
                "name": yaml_word(name),
                "points": number,
                "low": _yaml(low, 3),
                "high": _yaml(high, 3),
            }
            for name, number, (low, high) in zip(robot.motor_joints, points, narrowed, strict=True)
        ],
        noise_floor=_yaml(noise_floor([m.inertia for m in robot.file.motors]), 1),
        link_radius=None if shapes else _LINK_RADIUS,
        margin=margin,
        usual_margin=_MARGINS[0],
        narrowed=bool(np.any(narrowed != ranges)),
        candidates=math.prod(points),
        idle=text.listed([yaml_word(name) for name in idle]),
        units="[rad; m]" if robot.elements.prismatic else "[rad]",
        walkers=max(64, 4 * len(robot.parameters.names)),
        runs=max(50, 2 * len(robot.parameters.names)),
    )


def _ranges(robot: ElasticRobot, points: Sequence[int]) -> Array:
    """Return a range for each joint, (n, 2), a little inside its limits."""
    middle, half = robot.position_limits.mean(axis=1), np.diff(robot.position_limits)[:, 0] / 2
    half *= 1 - 2 * _INSET
    for j, name in enumerate(robot.motor_joints):
        if name not in robot.elements.prismatic:  # no point of the grid a whole turn from another
            half[j] = min(half[j], math.pi * (1 - 1 / max(points[j], 2)))
    return np.stack([middle - half, middle + half], axis=1)


def noise_floor(inertias: Sequence[float]) -> float:
    """Return the floor of the noise law: 1 %, or less for motors of very unlike inertias.

    Responses of a heavy motor are smaller than those of a light one by the ratio of inertias; a
    floor that is 1 % of the largest would bury them.
    """
    return min(_FLOOR, _BURIED * min(inertias) / max(inertias))


def grid_points(varied: Sequence[bool]) -> list[int]:
    """Return points per joint: one where a joint need not be `varied`, else what is affordable."""
    points = [1] * len(varied)
    most = {1: 15, 2: 15, 3: 9}.get(sum(varied), 5)
    grown = True
    while grown:
        grown = False
        for j in np.flatnonzero(varied):
            if (
                points[j] < most
                and math.prod(points) // points[j] * (points[j] + 1) <= MOST_CANDIDATES
            ):
                points[j] += 1
                grown = True
    return points


def _from(folder: Path, path: Path) -> str:
    """Return `path` as seen from `folder`."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def yaml_word(word: str) -> str:
    """Return a text that YAML reads as one, quoted where it must be."""
    plain = re.fullmatch(r"[A-Za-z_./][\w./-]*(:[\w./-]+)*", word)
    # Readers of YAML 1.1, such as most editors, take some words for truth.
    return (
        word if plain and reads_as_text(word) and word.lower() not in _TRUTH else json.dumps(word)
    )


def _yaml(value: float, digits: int = 2) -> str:
    """Return a number that YAML reads as one."""
    word = f"{float(f'{value:.{digits - 1}e}'):g}" if digits < 3 else f"{value:.{digits}f}"
    mantissa, e, exponent = word.partition("e")
    return word if not e else f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
