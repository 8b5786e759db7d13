"""Collision shapes of MuJoCo's compiled model as those of a URDF."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pinocchio as pin

from robotmodels.description.urdf_elements import number_text


def add_shapes(link: ET.Element, model: Any, body: int, path: Path) -> None:
    """Add to a link the geoms of a body that collide; planes, height fields and others are not.

    Parameters
    ----------
    link : Element
        Link of a URDF.
    model : mujoco.MjModel
        The compiled model.
    body : int
        Number of the body.
    path : Path
        Path of the MJCF file, from which those of meshes start.
    """
    import mujoco

    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    for g in range(first, first + count):
        if not (model.geom_contype[g] or model.geom_conaffinity[g]):
            continue
        kind = mujoco.mjtGeom(model.geom_type[g]).name.removeprefix("mjGEOM_").lower()
        for tag, entries in _shape(model, g, kind, path):
            collision = ET.SubElement(link, "collision")
            placement = _pose(model.geom_pos[g], model.geom_quat[g])
            if tag == "mesh":  # MuJoCo moves a mesh's points to its own centre and axes
                m = model.geom_dataid[g]
                placement = placement * _pose(model.mesh_pos[m], model.mesh_quat[m]).inverse()
            rpy = pin.rpy.matrixToRpy(placement.rotation)
            origin = {"xyz": placement.translation.tolist(), "rpy": rpy.tolist()}
            ET.SubElement(collision, "origin", {k: number_text(v) for k, v in origin.items()})
            ET.SubElement(ET.SubElement(collision, "geometry"), tag, entries)


def _shape(model: Any, g: int, kind: str, path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the element of a URDF that a geom is, if any."""
    size = model.geom_size[g].tolist()
    if kind == "sphere":
        yield "sphere", {"radius": repr(size[0])}
    elif kind in ("capsule", "cylinder"):
        yield kind, {"radius": repr(size[0]), "length": repr(2 * size[1])}
    elif kind in ("box", "ellipsoid"):
        around = {} if kind == "box" else {"around": kind}
        yield "box", {"size": number_text([2 * half for half in size])} | around
    elif kind == "mesh":
        m = model.geom_dataid[g]
        start = int(model.mesh_pathadr[m])
        if start >= 0:
            name = model.paths[start : model.paths.index(b"\0", start)].decode()
            scale = number_text(model.mesh_scale[m].tolist())
            yield "mesh", {"filename": str((path.parent / name).resolve()), "scale": scale}


def _pose(at: Any, quaternion: Any) -> pin.SE3:
    w, x, y, z = quaternion
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), at)
