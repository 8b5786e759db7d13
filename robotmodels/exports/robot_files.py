"""Robot files written: values at full precision, the URDF found from the new folder."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import created_folder, unwritable, write_text
from robotmodels.common.errors import InvalidInput
from robotmodels.common.yaml_files import yaml_text
from robotmodels.description.friction import at_speeds
from robotmodels.description.robot_file import Fitted, RobotFile
from robotmodels.description.urdf import PACKAGE_PREFIX
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.records.records import Records


def with_values(robot: ElasticRobot, values: Array, fitted: Fitted | None = None) -> ElasticRobot:
    """Return the robot with other values of its free parameters, none of them marked as a guess.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    values : ndarray, (p,)
        Values in the order of its parameters [SI].
    fitted : Fitted, optional
        How certain they are; by default nothing is said of that.

    Raises
    ------
    InvalidInput
        If a value is not positive, or no body can have such a mass and inertia.
    """
    file = robot.elements.whole_file_at(robot.parameters.check(values))
    file = file.model_copy(update={"fitted": fitted, "guessed": {}})
    return ElasticRobot(file, robot.folder)


def with_friction(robot: ElasticRobot, levels: Array) -> ElasticRobot:
    """Return the robot whose motors have other Coulomb friction (n,) [N m], none below 0.

    That of the file stays where `levels` are not numbers.
    """
    pairs = zip(robot.file.motors, np.maximum(levels, 0.0).tolist(), strict=True)
    motors = [
        motor if np.isnan(level) else motor.model_copy(update={"coulomb": level})
        for motor, level in pairs
    ]
    return replace(robot, file=robot.file.model_copy(update={"motors": motors}))


def with_speeds(robot: ElasticRobot, speeds: Array) -> ElasticRobot:
    """Return the robot whose frequency responses count Coulomb friction as dampers.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    speeds : ndarray, (n,), rad/s
        Rms speeds of the motors' shafts under the excitation. A joint's is that of its motor over
        the gear ratio.

    Raises
    ------
    InvalidInput
        If there is not one speed above zero for each motor.
    """
    return ElasticRobot(at_speeds(robot.file, speeds), robot.folder)


def at_recorded_speeds(robot: ElasticRobot, records: Records) -> ElasticRobot:
    """Return the robot whose Coulomb friction counts as dampers at the speeds of records.

    Raises
    ------
    InvalidInput
        If the records hold no angle of some motor, or it does not move.
    """
    encoders = {o.of: i for i, o in enumerate(robot.outputs) if o.kind == "motor" and o.encoder}
    missing = [name for name in robot.motor_names if name not in encoders]
    if missing or records.angle.shape[-1] != len(robot.outputs):
        raise InvalidInput(
            f"records: {records.angle.shape[-1]} outputs; an angle of each motor is needed, "
            f"{', '.join(missing or robot.output_names)}"
        )
    return with_speeds(robot, _rms_speeds(records, [encoders[n] for n in robot.motor_names]))


def _rms_speeds(records: Records, columns: list[int]) -> Array:
    """Return the root mean square of angles' rates over all runs, (n,) [rad/s].

    Parameters
    ----------
    records : Records
        Periodic runs.
    columns : list of int
        Which of the outputs are motor angles, n of them.

    Raises
    ------
    InvalidInput
        If a motor does not move.
    """
    angle = records.angle[..., columns]
    omega = 2 * np.pi * np.fft.rfftfreq(records.samples, records.sample_time)
    spectrum = np.abs(np.fft.rfft(angle, axis=4) / records.samples) * omega[:, None]
    power = 2 * np.sum(spectrum**2, axis=4)  # Parseval
    rms = np.sqrt(np.nanmean(power, axis=(0, 1, 2, 3)))
    if not (rms > 0).all():
        raise InvalidInput(f"records: output {columns[int(np.argmin(rms))] + 1} does not move")
    return np.asarray(rms)


def save_robot(robot: ElasticRobot, path: str | Path) -> None:
    """Write a robot file that `load_robot` reads as the same robot, number by number.

    A relative path of the URDF becomes one from the new file's folder. Comments are not kept,
    entries that equal their default are left out.

    Raises
    ------
    InvalidInput
        If the path does not end in .yaml or .yml, or cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml"):
        raise InvalidInput(f"{path}: a robot file ends in .yaml or .yml")
    paths: dict[str, object] = {}
    if not robot.file.urdf.startswith(PACKAGE_PREFIX):
        paths["urdf"] = relative_to(path.parent, robot.model_file.path)
    if (xacro := robot.file.xacro) is not None:
        folders = [relative_to(path.parent, folder) for folder in robot.model_file.packages]
        paths["xacro"] = xacro.model_copy(update={"packages": folders})
    file = robot.file.model_copy(update=paths)
    write_file(path, robot_text(file))


def robot_text(file: RobotFile) -> str:
    """Return a robot file as YAML."""
    return yaml_text(file.model_dump(mode="json", by_alias=True, exclude_defaults=True))


def relative_to(folder: Path, target: Path) -> str:
    """Return the path of `target` as seen from `folder`, absolute where there is none."""
    try:
        return Path(os.path.relpath(target.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return target.resolve().as_posix()


def write_file(path: Path, text: str) -> None:
    """Write a text file, making its folder.

    Raises
    ------
    InvalidInput
        If that is impossible.
    """
    with created_folder(path.parent):
        try:
            write_text(path, text)
        except OSError as error:
            raise unwritable(path, error) from None
