"""Built-in robots: one robot file each, with a note on where its numbers come from."""

from pathlib import Path

from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.description.robot_file import read_robot_file
from robotmodels.elastic.robot import ElasticRobot

_FOLDER = Path(__file__).parent


def builtin_robots() -> tuple[str, ...]:
    """Return the names of the built-in robots."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def load_robot(name: str | Path) -> ElasticRobot:
    """Load a built-in robot by name, or any robot by the path of its file.

    Raises
    ------
    InvalidInput
        If there is no such robot, or its file cannot be used.
    """
    if str(name) in builtin_robots():
        path = _FOLDER / f"{name}.yaml"
    elif (path := Path(name)).suffix not in (".yaml", ".yml") and not path.exists():
        names = builtin_robots()
        raise InvalidInput(
            f"robot {str(name)!r} is neither a built-in robot{nearest(str(name), names)} "
            f"nor the path of a robot file; built in are {', '.join(names)}"
        )
    if path.suffix in (".urdf", ".xacro"):
        raise InvalidInput(
            f"{path} is a URDF; a robot file (YAML) is needed, which names it; "
            f"`oed init {path}` writes one"
        )
    try:
        return ElasticRobot(read_robot_file(path), path.parent)
    except InvalidInput as error:
        if str(error).startswith(str(path)):
            raise
        raise InvalidInput(f"{path}: {error}") from None
