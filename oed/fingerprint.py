"""Fingerprints of what a result depends on: settings, files, robots."""

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robotmodels import ElasticRobot

_CHUNK = 1 << 20


def json_digest(content: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def folder_digest(folder: Path, leave_out: frozenset[str] = frozenset()) -> str:
    """Return the SHA-256 of all files of a folder, names included."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in leave_out)
    return json_digest({p.relative_to(folder).as_posix(): file_digest(p) for p in files})


def mesh_digests(robot: "ElasticRobot") -> dict[str, str | None]:
    """Return the SHA-256 of each mesh that collisions are checked with; None of one not found."""
    from robotmodels.collision.shapes import mesh_files

    return {
        name: None if file is None else file_digest(file)
        for name, file in mesh_files(robot).items()
    }


def robot_digest(robot: "ElasticRobot") -> str:
    """Return the SHA-256 of a robot file's content and of the URDF it names, not of their paths.

    Meshes are no part of it: they matter to collisions only, see `mesh_digests`.
    """
    from robotmodels.description.urdf import locate

    urdf = file_digest(Path(locate(robot.file.urdf, robot.folder)))
    content = robot.file.model_dump(mode="json", by_alias=True, exclude={"urdf"})
    return json_digest({"file": content, "urdf": urdf})
