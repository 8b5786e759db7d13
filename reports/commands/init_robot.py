"""The robot file that ``oed init`` writes for a model file."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from reports.commands.yaml_text import yaml_exact, yaml_number, yaml_word
from reports.page_elements import filled_text
from reports.text import listed
from robotmodels.checks.proposed_drives import Drive
from robotmodels.description.model_files import ModelFile, gravity_of


def robot_text(
    name: str,
    urdf: str,
    drives: Sequence[Drive],
    locked: dict[str, float],
    source: ModelFile,
    folder: Path,
) -> str:
    """Return the robot file of a model file, with guesses where that says nothing.

    Parameters
    ----------
    name : str
        Of the robot.
    urdf : str
        Where the model file is, as the robot file is to say.
    drives : sequence of Drive
        Of the joints that move.
    locked : dict of str to float, rad or m
        Joints that are held.
    source : ModelFile
        The model file.
    folder : Path
        Of the robot file.
    """
    joints = {*(d.joint.name for d in drives), *locked}
    motor, drive, bearing = (_prefix(word, joints) for word in ("motor", "drive", "bearing"))
    bearings = [
        {
            "name": f"{bearing}{number}{axis}",
            "joint": yaml_word(d.joint.name),
            "axis": axis,
            "stiffness": yaml_number(d.bearing_stiffness),
            "damping": yaml_number(d.bearing_damping),
            "range": _ranges(d, d.bearing_stiffness, d.bearing_damping),
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
        arguments={yaml_word(key): yaml_word(value) for key, value in source.arguments},
        packages=[yaml_word(path_from(folder, path)) for path in source.packages],
        gravity=[yaml_exact(component) for component in gravity_of(source)],
        locked={yaml_word(joint): yaml_exact(value) for joint, value in locked.items()},
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
    stated = drive.joint.stated
    exact = {
        "gear_ratio": stated.gear_ratio is not None,
        "inertia": stated.armature is not None,
        "viscous": stated.damping is not None,
        "coulomb": stated.friction is not None,
        "stiffness": False,
        "damping": False,
    }
    numbers = {
        key: yaml_exact(getattr(drive, key)) if stated_ else yaml_number(getattr(drive, key))
        for key, stated_ in exact.items()
    }
    motor = ("gear_ratio", "inertia", "viscous")
    return {
        "joint": yaml_word(drive.joint.name),
        "prismatic": drive.joint.prismatic,
        "friction": exact["coulomb"],
        "stated": listed([key for key in (*motor, "coulomb") if exact[key]]),
        "guessed": listed([key for key in motor if not exact[key]]),
        **numbers,
        "range": _ranges(drive, drive.stiffness, drive.damping),
        "spread": yaml_number(drive.spread),
        "damping_spread": yaml_number(drive.damping_spread),
    }


def _ranges(drive: Drive, stiffness: float, damping: float) -> str:
    """Return between which values a guessed spring and damper lie, in 19 of 20 cases."""
    pairs = ((stiffness, drive.spread), (damping, drive.damping_spread))
    return ", ".join(
        f"{value * math.exp(-2 * spread):.1g} to {value * math.exp(2 * spread):.1g}"
        for value, spread in pairs
    )


def path_from(folder: Path, path: Path) -> str:
    """Return `path` as seen from `folder`."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
