"""Fingerprints of a robot: of its file, its URDF and its meshes."""

from typing import TYPE_CHECKING

from robotmodels.common.fingerprints import file_digest, json_digest

if TYPE_CHECKING:
    from robotmodels import ElasticRobot


def mesh_digests(robot: "ElasticRobot") -> dict[str, str | None]:
    """Return the SHA-256 of each mesh that collisions are checked with; None for a missing one."""
    from robotmodels.collision.shapes import mesh_files

    return {
        name: None if file is None else file_digest(file)
        for name, file in mesh_files(robot).items()
    }


def robot_digest(robot: "ElasticRobot") -> str:
    """Return the SHA-256 of a robot file's content and of the URDF it names, not of their paths.

    How certain its values are is no part of it: responses do not depend on that. Nor are meshes,
    which matter to collisions only, see `mesh_digests`.
    """
    from robotmodels.description.model_files import model_digest

    urdf = model_digest(robot.model_file)
    content = robot.file.model_dump(
        mode="json", by_alias=True, exclude={"urdf", "xacro", "guessed", "fitted"}
    )
    return json_digest({"file": content, "urdf": urdf})
