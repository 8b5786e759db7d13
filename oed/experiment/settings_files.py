"""Files of settings of studies, campaigns and experiments, with the paths that they all have."""

from pathlib import Path
from typing import Any, TypeVar

from robotmodels.common.file_paths import existing_file, output_folder, robot_reference
from robotmodels.common.yaml_files import FileSection, read_yaml

_Settings = TypeVar("_Settings", bound=FileSection)


def read_settings(path: str | Path, schema: type[_Settings]) -> _Settings:
    """Read a file of settings; its output, robots and lists of candidates become absolute paths.

    Raises
    ------
    InvalidInput
        If the file is absent, is not YAML, or does not fit the schema; the key is named.
    """
    path = Path(path)
    settings: Any = read_yaml(path, schema)
    changed: dict[str, object] = {"output": output_folder(path, settings.output)}
    for key in ("robot", "truth"):
        if (robot := getattr(settings, key, None)) is not None:
            changed[key] = robot_reference(path, robot)
    if (candidates := getattr(settings, "candidates", None)) is not None:
        files = tuple(existing_file(path, "candidates.files", file) for file in candidates.files)
        changed["candidates"] = candidates.model_copy(update={"files": files})
    updated: _Settings = settings.model_copy(update=changed)
    return updated
