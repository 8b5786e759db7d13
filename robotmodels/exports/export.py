"""One robot in the format of another program."""

from pathlib import Path
from typing import get_args

import numpy as np

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import check_word
from robotmodels.common.plain_data import json_text
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.exports.formats import Format, left_out
from robotmodels.exports.robot_files import save_robot, write_file


def export(
    robot: ElasticRobot,
    path: str | Path,
    format: Format = "mjcf",
    position: Array | None = None,
    covariance: Array | None = None,
) -> tuple[str, ...]:
    """Write a robot for another program and return what the format leaves out, one line each.

    Parameters
    ----------
    robot : ElasticRobot
        Robot, such as `estimators.Fit.robot` returns.
    path : str or Path
        File to write; its folder is made.
    format : {"mjcf", "urdf", "state_space", "modes", "robot"}
        MuJoCo's model; the rigid robot; MATLAB's .mat; JSON; a robot file.
    position : ndarray, (n,) or (Q, n), rad or m, optional
        Positions of MJCF's keyframes, of state-space models and of modes; by default the middle
        of all ranges.
    covariance : ndarray, (p, p), optional
        Covariance of ln theta that goes along with state-space models, see `state_space`.

    Raises
    ------
    InvalidInput
        If there is no such format, the file cannot be written, or a position is outside the joint
        limits.
    NoEquilibrium
        If a spring is too weak for gravity.
    """
    check_format(format)
    path = Path(path)
    if position is None:
        position = robot.position_limits.mean(axis=1)
    positions = robot.checked_positions(np.atleast_2d(real_numbers(position, "position")))
    if format == "robot":
        save_robot(robot, path)
    elif format == "state_space":
        from robotmodels.exports.state_space import state_space, write_state_space

        write_state_space(state_space(robot, positions, covariance), path)
    else:
        write_file(path, _text(robot, path.parent, format, positions))
    return left_out(robot.file, format)


def _text(robot: ElasticRobot, folder: Path, format: Format, positions: Array) -> str:
    """Return the text of a file in `folder`."""
    if format == "urdf":
        from robotmodels.exports.urdf_file import urdf_text

        return urdf_text(robot, folder)
    if format == "mjcf":
        from robotmodels.exports.mjcf import mjcf_text

        return mjcf_text(robot, positions)
    from robotmodels.exports.modes import modal_parameters

    return json_text(modal_parameters(robot, positions)) + "\n"


def check_format(format: str) -> None:
    """Refuse an unknown format.

    Raises
    ------
    InvalidInput
        Naming those there are.
    """
    check_word("format:", format, get_args(Format))
