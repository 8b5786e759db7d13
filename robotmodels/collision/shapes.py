"""What a robot's links look like to a collision: the URDF's ``<collision>`` shapes, or capsules."""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from robotmodels.collision.convex_hull import enclosing_shape
from robotmodels.common.arrays import Array, check_above_zero
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.description.model_files import ModelFile
from robotmodels.description.urdf_check import checked_urdf
from robotmodels.description.xml_reader import read_xml
from robotmodels.elastic.robot import ElasticRobot

LINE_RADIUS = 1e-3
"""Of links that have neither shape nor radius: lines between joints, to a millimetre [m]."""

_PACKAGE = "package://"
_MOST_MESH = 30_000_000  # bytes; 600 000 triangles, whose hull takes a quarter of a minute
_INDICES = ("p", "v", "h", "vcount")  # of COLLADA: what has indices into other arrays


@dataclass(frozen=True, eq=False)
class Shape:
    """A rigid shape on a link.

    Attributes
    ----------
    link : str
        The link's name.
    joint : int
        Number of the rigid model's joint that moves it, 0 for the ground.
    placement : pin.SE3
        Placement in the frame of that joint.
    hull : coal.CollisionGeometry
        The shape, or the convex hull of its mesh.
    mesh : coal.CollisionGeometry or None
        The surface of a mesh, else None.
    """

    link: str
    joint: int
    placement: pin.SE3
    hull: coal.CollisionGeometry
    mesh: coal.CollisionGeometry | None = None

    def __reduce__(self) -> tuple[Callable[..., "Shape"], tuple[object, ...]]:
        if isinstance(self.hull, coal.Halfspace):
            # Coal writes its infinite bounds, but cannot read them.
            plane = np.array(self.hull.n), self.hull.d
            return _half_space, (self.link, self.joint, self.placement, *plane)
        return Shape, (self.link, self.joint, self.placement, self.hull, self.mesh)


def _half_space(link: str, joint: int, placement: pin.SE3, normal: Array, offset: float) -> Shape:
    return Shape(link, joint, placement, coal.Halfspace(normal, offset))


@dataclass(frozen=True, eq=False)
class RobotShapes:
    """The shapes of a robot, and what has none.

    Attributes
    ----------
    shapes : tuple of Shape
        Shapes of all links that have one.
    solid : bool
        Whether they are the links' own; lines between joints are not.
    notes : tuple of str
        What is not checked, one sentence each.
    """

    shapes: tuple[Shape, ...]
    solid: bool
    notes: tuple[str, ...]


def robot_shapes(robot: ElasticRobot, link_radius: float | None = None) -> RobotShapes:
    """Return the collision shapes of the URDF; without any, capsules from joint to joint.

    Parameters
    ----------
    robot : ElasticRobot
        Gives the URDF and the joints held rigid.
    link_radius : float, m, optional
        Link radius of the capsules, for a URDF without collision shapes.

    Raises
    ------
    InvalidInput
        If a shape of the URDF cannot be read, or `link_radius` is not positive or is given although
        the URDF has shapes.
    """
    if link_radius is not None:
        check_above_zero(link_radius, "link_radius [m]")
    path = robot.model_file.path
    drawn, missing, boxed = _own_shapes(robot)
    if drawn and link_radius is not None:
        raise InvalidInput(
            f"link_radius: {path.name} has collision shapes of its own, which are used; leave "
            "the radius out"
        )
    if drawn:
        return RobotShapes(
            drawn, True, (*_notes(robot, drawn, missing), *boxed, *_payload_note(robot))
        )
    capsules = tuple(_capsules(robot.rigid, link_radius or LINE_RADIUS))
    why = f"{path.name} has no collision shapes" if not missing else "; ".join(missing)
    if link_radius is None:
        note = (
            f"{why}: self-collision is not checked, and obstacles only against the lines between "
            "joints; a link_radius would make capsules of them"
        )
    else:
        note = f"{why}: links are taken for capsules of radius {link_radius:g} m between joints"
    return RobotShapes(capsules, link_radius is not None, (note, *_payload_note(robot)))


def lowest_of_base(robot: ElasticRobot) -> float:
    """Return the height of the lowest point of what does not move [m]; 0 without shapes.

    The height is above the root link's origin, against gravity.
    """
    gravity = np.array(robot.file.gravity)
    if not gravity.any():
        return 0.0
    up = -gravity / np.linalg.norm(gravity)
    heights = [0.0]
    for shape in _own_shapes(robot)[0]:
        if shape.joint == 0:
            shape.hull.computeLocalAABB()
            box, at = shape.hull.aabb_local, shape.placement
            middle = at.act((np.asarray(box.min_) + np.asarray(box.max_)) / 2)
            half = (np.asarray(box.max_) - np.asarray(box.min_)) / 2
            heights.append(float(up @ middle - np.abs(at.rotation.T @ up) @ half))
    return min(heights)


def mesh_files(robot: ElasticRobot) -> dict[str, Path | None]:
    """Return the collision meshes as the URDF names them, and where each is; None if nowhere."""
    meshes = checked_urdf(robot.model_file, shapes=True).iterfind("link/collision/geometry/mesh")
    names = [mesh.get("filename", "") for mesh in meshes]
    return {name: _mesh_file(name, robot.model_file) for name in names}


def _own_shapes(
    robot: ElasticRobot,
) -> tuple[tuple[Shape, ...], tuple[str, ...], tuple[str, ...]]:
    """Return `_read_shapes`, read again only where a file has changed."""
    files = (robot.model_file.path, *mesh_files(robot).values())
    stamps = (os.stat(file) for file in files if file is not None)
    return _read_shapes(robot, tuple((stamp.st_mtime_ns, stamp.st_size) for stamp in stamps))


@lru_cache(maxsize=2)
def _read_shapes(
    robot: ElasticRobot, stamps: tuple[tuple[int, int], ...]
) -> tuple[tuple[Shape, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the shapes of the URDF, and sentences on meshes not there and meshes simplified."""
    rigid, path = robot.rigid, robot.model_file.path
    tree, missing = _with_absolute_meshes(robot.model_file)
    xml = ET.tostring(tree, encoding="unicode")
    try:
        geometry = pin.buildGeomFromUrdfString(rigid, xml, pin.COLLISION)
    except (ValueError, RuntimeError) as error:
        parts = " ".join(str(error).split()).partition("message: ")
        cause = parts[2].removesuffix("Hint: the mesh directory may be wrong.") or parts[0]
        raise InvalidInput(f"{path}: {_unreadable(tree, cause.strip())}") from None
    shapes, notes = [], []
    for item in geometry.geometryObjects:
        link = rigid.frames[item.parentFrame].name
        hull, mesh, placement = item.geometry, None, item.placement
        if isinstance(hull, coal.BVHModelBase):
            mesh, name = hull, f"link {link!r}: mesh {Path(item.meshPath).name}"
            hull, moved, note = enclosing_shape(mesh.vertices(), f"{path}: {name}")
            # Surfaces decide only where the hull is in the frame of its mesh.
            mesh = mesh if moved is None else None
            placement = placement if moved is None else placement * moved
            notes += [f"{name}: {note}"] if note else []
        shapes.append(Shape(link, int(item.parentJoint), placement, hull, mesh))
    return tuple(shapes), missing, tuple(notes)


def _with_absolute_meshes(source: ModelFile) -> tuple[ET.Element, tuple[str, ...]]:
    """Return the URDF with absolute mesh paths, without the meshes not found, and their names."""
    robot = checked_urdf(source, shapes=True)
    missing = []
    for link in robot.findall("link"):
        for collision in link.findall("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is None:
                continue
            filename = mesh.get("filename", "")
            file = _mesh_file(filename, source)
            if file is None:
                missing.append(f"link {link.get('name')!r}: its mesh {filename} is not found")
                link.remove(collision)
            else:
                _check_mesh(file)
                mesh.set("filename", str(file))
    return robot, tuple(missing)


def _unreadable(tree: ET.Element, cause: str) -> str:
    """Return what is said of a collision shape that cannot be read, naming its link."""
    for link in tree.iterfind("link"):
        for mesh in link.iterfind("collision/geometry/mesh"):
            if mesh.get("filename", "") in cause:
                remedy = "mend the mesh, or leave the link's <collision> out"
                return f"link {link.get('name')!r}: its mesh cannot be read: {cause}; {remedy}"
    return f"collision shapes: {cause}"


def _check_mesh(path: Path) -> None:
    """Refuse a mesh that is too large, or over which its reader does not end.

    assimp goes round for ever over an index in a COLLADA file that is no number.
    """
    check_file(path, _MOST_MESH)
    if path.suffix.lower() != ".dae":
        return
    for element in read_xml(path, _MOST_MESH, "COLLADA file").iter():
        tag, text = element.tag.rpartition("}")[2], element.text or ""
        wrong = tag in _INDICES and re.search(r"[^\s0-9]\S*", text, re.ASCII)
        if wrong:
            raise InvalidInput(f"{path}: <{tag}> has {wrong[0][:40]!r}; whole numbers are needed")


def _mesh_file(filename: str, source: ModelFile) -> Path | None:
    """Return where a mesh is.

    A ``package://NAME/...`` is sought in folders NAME, or that hold NAME, around the URDF and on
    ROS's search paths, and stays inside NAME; another path starts at the URDF's folder.
    """
    urdf = source.path
    if not filename.startswith(_PACKAGE):
        path = urdf.parent / filename.removeprefix("file://")
        return path if os.path.isfile(path) else None
    inside = Path(filename.removeprefix(_PACKAGE))
    if not inside.parts or inside.is_absolute() or ".." in inside.parts:
        raise InvalidInput(
            f"{urdf}: mesh {filename!r}: package:// and the path of a file inside a package is "
            "needed"
        )
    ros = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
    roots = [Path(p) for v in ros for p in os.environ.get(v, "").split(os.pathsep) if p]
    for folder in (*source.packages, *urdf.parents, *roots, *(p / "share" for p in roots)):
        candidates = [folder / inside]
        if folder.name == inside.parts[0]:
            candidates.append(folder.parent / inside)
        for candidate in candidates:
            if os.path.isfile(candidate):
                return candidate
    return None


def _notes(
    robot: ElasticRobot, shapes: tuple[Shape, ...], missing: tuple[str, ...]
) -> Iterator[str]:
    yield from (f"{sentence}; it is not checked for collisions" for sentence in missing)
    seen = {shape.joint for shape in shapes}
    for joint in range(1, robot.rigid.njoints):
        if joint not in seen and robot.rigid.inertias[joint].mass > 0:
            link = _link_of(robot.rigid, joint)
            yield f"link {link!r} has no collision shape and is not checked"


def _payload_note(robot: ElasticRobot) -> tuple[str, ...]:
    payload = robot.file.payload
    if payload is None or payload.mass == 0:
        return ()
    return (f"the payload on {payload.link!r} has no shape and is not checked for collisions",)


def _capsules(rigid: pin.Model, radius: float) -> Iterator[Shape]:
    """Yield a capsule from each joint's origin to those of the joints it carries, or its end."""
    for joint in range(rigid.njoints):
        ends = [
            rigid.jointPlacements[child].translation
            for child in range(1, rigid.njoints)
            if rigid.parents[child] == joint
        ]
        if not ends:
            placements = (f.placement for f in rigid.frames if f.parentJoint == joint)
            ends = [max((p.translation for p in placements), key=np.linalg.norm)]
        for end in ends:
            length = float(np.linalg.norm(end))
            if length > LINE_RADIUS:
                at = pin.SE3(_towards(end / length), end / 2)
                yield Shape(_link_of(rigid, joint), joint, at, coal.Capsule(radius, length))


def _towards(direction: Array) -> Array:
    """Return a rotation matrix whose z axis is the unit vector `direction`."""
    return np.asarray(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction).matrix())


def _link_of(rigid: pin.Model, joint: int) -> str:
    links = [f.name for f in rigid.frames if f.parentJoint == joint and f.type == pin.BODY]
    return str(links[0]) if links else str(rigid.names[joint])
