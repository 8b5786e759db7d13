"""What ``oed init`` writes: a commented study, and a robot file from a URDF."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from reports.commands.init_options import ModelOptions, model_options
from reports.commands.init_robot import path_from, robot_text
from reports.commands.init_study import study_text
from robotmodels import ElasticRobot, load_robot
from robotmodels.checks.model_doubts import doubts_about
from robotmodels.checks.proposed_drives import (
    Drive,
    moving_joints,
    propose_drives,
)
from robotmodels.checks.sub_chain import locked_couplings, locked_joints
from robotmodels.common.errors import InvalidInput
from robotmodels.description.joint_drives import couplings
from robotmodels.description.model_files import ModelFile, refuse_other_formats
from robotmodels.description.unused_elements import unused_parts
from robotmodels.description.urdf import PACKAGE_PREFIX, locate
from robotmodels.description.urdf_check import checked_urdf

_MODELS = (".urdf", ".xml", ".mjcf", ".xacro")
_MOST_MOTORS = 64


@dataclass(frozen=True)
class StarterFiles:
    """Files by name, the robot they are about, and what its author should know."""

    robot: str
    files: dict[str, str]
    notes: tuple[str, ...] = ()


def starter_files(robot: str, folder: Path, options: ModelOptions | None = None) -> StarterFiles:
    """Return the files of a new study that will lie in `folder`.

    Parameters
    ----------
    robot : str
        A built-in robot, a robot file, or a URDF, xacro or MJCF file, for which a robot file is
        made as well.
    folder : Path
        Of the study.
    options : ModelOptions
        How a model file is read.

    Raises
    ------
    InvalidInput
        If there is no such robot, or it cannot be used.
    """
    options = options or model_options()
    if Path(robot).suffix.lower() in _MODELS:
        return _of_model_file(robot, folder, options)
    refuse_other_formats(Path(robot))
    robot_file = Path(robot).suffix.lower() in (".yaml", ".yml")
    if not robot_file and Path(robot).is_file():
        raise InvalidInput(
            f"{robot}: a URDF (.urdf), xacro (.xacro), MJCF (.xml) or robot file (.yaml) is needed"
        )
    if options != model_options():
        raise InvalidInput(f"{robot}: --lock, --tip, --base and xacro's are of model files only")
    loaded = load_robot(robot)
    reference = path_from(folder, Path(robot)) if robot_file else robot
    study, notes = study_text(loaded, reference, not robot_file)
    return StarterFiles(loaded.name, {"study.yaml": study}, notes)


def _of_model_file(robot: str, folder: Path, options: ModelOptions) -> StarterFiles:
    urdf = robot if robot.startswith(PACKAGE_PREFIX) else path_from(folder, Path(robot))
    name = default_folder(robot).name
    source = ModelFile(locate(robot, Path(), ""), options.arguments, options.packages)
    joints, checked = moving_joints(source), checked_urdf(source)
    try:
        locked = locked_joints(joints, checked, options.chain)
    except InvalidInput as error:
        raise InvalidInput(f"{robot}: {error}") from None
    locked = locked_couplings(joints, couplings(checked), locked)
    moving = [j for j in joints if j.name not in locked and j.leader is None]
    _check_count(robot, len(moving))
    drives = propose_drives(moving)
    content = robot_text(name, urdf, drives, locked, source, folder)
    study, notes = study_text(_loaded(content, folder), "robot.yaml", drives=drives)
    notes = (*doubts_about(source), *_fillers(drives), *map(str, unused_parts(source)), *notes)
    return StarterFiles(name, {"robot.yaml": content, "study.yaml": study}, notes)


def _fillers(drives: Sequence[Drive]) -> Iterator[str]:
    """Yield that limits and fillers of templates are no numbers of a drive."""
    if any(drive.joint.stated.effort or drive.joint.stated.velocity for drive in drives):
        yield (
            "effort and velocity of <limit>: not used, because limits belong to experiments; they "
            "stand in study.yaml as comments, on the motor shafts"
        )
    if any(drive.joint.fillers for drive in drives):
        names = sorted({name for drive in drives for name in drive.joint.fillers})
        yield (
            f"{', '.join(names)}: not used where they are 0 (a ratio: 1), because that is what "
            "templates have; guesses stand instead"
        )


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
    stem = _stem(robot)
    return Path(Path(robot).resolve().parent.name if stem == "robot" else stem)


def _stem(robot: str) -> str:
    """Return the name of a file without its endings, ``.urdf.xacro`` being two."""
    path = Path(Path(robot).stem)
    return path.stem if path.suffix.lower() in _MODELS else path.name


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
