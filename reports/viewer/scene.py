"""What stands in the viewer's space: the robot, obstacles, candidates, the plan."""

from typing import Literal, get_args

import numpy as np
import viser

from reports.viewer.view import View
from robotmodels import Box, Plane, Sphere
from robotmodels.collision.obstacles import Obstacle
from robotmodels.collision.surfaces import link_surfaces
from robotmodels.common.arrays import Array

_LINK, _THING, _VISIT = (150, 165, 185), (205, 150, 110), (214, 40, 90)
_PLANE = 3.0  # edge of what is drawn of a plane [m]
_NUMBER = np.array([0.05, 0.036])  # width and height of a number, seen from the camera [rad]
Anchor = Literal[
    "top-left",
    "bottom-right",
    "bottom-left",
    "top-right",
    "top-center",
    "bottom-center",
    "center-left",
    "center-right",
]
_ANCHORS: tuple[Anchor, ...] = get_args(Anchor)
_TOWARDS = {"left": 1.0, "right": -1.0, "top": -1.0, "bottom": 1.0, "center": 0.0}
"""Where a label lies that is anchored at its left, ..., along the screen's axes."""
_SMALL, _LARGE = 0.008, 0.03  # candidates without and with weight [m]
PICKED = np.deg2rad(0.7)
"""Angle between a click and a point, seen from the camera, within which it is picked [rad]."""
_REJECTED = 0.012  # rejected positions [m]
_MANY = 2000
"""Candidates above which their points shrink, so that the robot is seen between them."""


class RobotBody:
    """The robot's links, each on the frame of its joint."""

    def __init__(self, server: viser.ViserServer, view: View) -> None:
        joints = view.robot.rigid.njoints
        self._frames = [
            server.scene.add_frame(f"/robot/{joint}", show_axes=False) for joint in range(joints)
        ]
        for i, surface in enumerate(link_surfaces(view.robot)):
            server.scene.add_mesh_simple(
                f"/robot/{surface.joint}/{surface.link}/{i}",
                surface.vertices,
                surface.faces,
                color=_LINK,
                flat_shading=True,
                side="double",
            )

    def draw(self, placements: Array) -> None:
        """Draw the joints at placements (joints, 4, 4)."""
        turned = viser.transforms.SO3.from_matrix(placements[:, :3, :3]).wxyz
        for frame, wxyz, origin in zip(self._frames, turned, placements[:, :3, 3], strict=True):
            frame.wxyz, frame.position = wxyz, origin


class Candidates:
    """The tool in every candidate position; those with weight are larger, rejected ones red."""

    def __init__(self, server: viser.ViserServer, view: View) -> None:
        self._server, self._view, self._clouds = server, view, []
        self._points = view.candidate_points
        self._rejected: viser.PointCloudHandle | None = None
        if view.study is None:
            return
        weights = view.study.plan.design.weights
        self._ranked = np.argsort(-weights, kind="stable")
        small = _SMALL * min(1.0, np.sqrt(_MANY / len(weights)))
        self._members = [np.flatnonzero(weights <= 0), np.flatnonzero(weights > 0)]
        for name, members, size in zip(
            ("without weight", "with weight"), self._members, (small, _LARGE), strict=True
        ):
            self._clouds.append(self._cloud(name, self._points[members], size))
        self.colour("weight")

    def colour(self, by: str) -> None:
        """Colour the candidates by "weight" or "sensitivity", or hide them by "hidden"."""
        colours = None if by == "hidden" else self._view.colours(by)
        for cloud, members in zip(self._clouds, self._members, strict=True):
            cloud.visible = colours is not None
            if colours is not None:
                cloud.colors = colours[members]

    def show_rejected(self, shown: bool) -> None:
        """Show or hide positions that were no candidates."""
        if self._rejected is None and shown:
            points = self._view.tool_points(self._view.rejected)
            self._rejected = self._cloud("rejected", points, _REJECTED, _VISIT)
        if self._rejected is not None:
            self._rejected.visible = shown

    def picked(self, origin: Array, direction: Array) -> Array | None:
        """Return the shown position (n,) nearest to a ray (3,) and (3,) [m]; None if none is near.

        Nearest in angle, within `PICKED`; of points in one place one with the largest weight.
        """
        points, positions = [np.empty((0, 3))], [np.empty((0, self._view.candidates.shape[1]))]
        if any(cloud.visible for cloud in self._clouds):
            points.append(self._points[self._ranked])
            positions.append(self._view.candidates[self._ranked])
        if self._rejected is not None and self._rejected.visible:
            points.append(self._view.tool_points(self._view.rejected))
            positions.append(self._view.rejected)
        rays = np.concatenate(points) - origin
        along = rays @ direction / np.linalg.norm(direction)
        away = np.arccos(np.clip(along / np.linalg.norm(rays, axis=1), -1.0, 1.0))
        near = int(np.argmin(np.round(away, 6))) if len(away) else -1
        return np.concatenate(positions)[near] if len(away) and away[near] < PICKED else None

    def _cloud(
        self, name: str, points: Array, size: float, colour: tuple[int, int, int] = (0, 0, 0)
    ) -> viser.PointCloudHandle:
        return self._server.scene.add_point_cloud(
            f"/candidates/{name}", points, colour, point_size=size, point_shape="circle"
        )


def label_anchors(points: Array, eye: Array, target: Array) -> list[Anchor]:
    """Return at which corner or side each number touches its point, so that none covers another.

    Parameters
    ----------
    points : ndarray, (N, 3), m
        What is numbered.
    eye, target : ndarray, (3,), m
        Where the camera is and what it looks at; from other directions numbers may meet.
    """
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(forward, [0.0, 0.0, 1.0]))
    rays = points - eye
    on_screen = rays @ np.stack([right, np.cross(right, forward)]).T / (rays @ forward)[:, None]
    sides = np.array([[_TOWARDS[word] for word in one.split("-")[::-1]] for one in _ANCHORS])
    anchors: list[Anchor] = []
    placed = np.empty((0, 2))
    for point in on_screen:
        centres = point + sides * _NUMBER / 2
        clearances = (np.abs(centres[:, None] - placed) / _NUMBER).max(axis=-1)
        best = int(np.argmax(clearances.min(axis=1, initial=1.0)))
        anchors.append(_ANCHORS[best])
        placed = np.vstack([placed, centres[best]])
    return anchors


def add_plan(server: viser.ViserServer, view: View, eye: Array, target: Array) -> None:
    """Draw the positions of the plan, numbered and joined in the order of visits.

    The numbers are placed for a camera at `eye` (3,) that looks at `target` (3,) [m].
    """
    if view.study is None:
        return
    points = view.tool_points(view.study.plan.positions)
    anchors = label_anchors(points, eye, target)
    for k, (point, anchor) in enumerate(zip(points, anchors, strict=True), start=1):
        server.scene.add_label(f"/plan/{k}", str(k), position=point, anchor=anchor)
    if len(points) > 1:
        paths = np.stack([points[:-1], points[1:]], axis=1)
        server.scene.add_line_segments("/plan/order", paths, _VISIT, thickness=0.006)


def add_obstacles(server: viser.ViserServer, view: View) -> None:
    """Draw what stands around the robot."""
    for obstacle in view.obstacles:
        _add_obstacle(server, f"/obstacles/{obstacle.name}", obstacle)


def _add_obstacle(server: viser.ViserServer, name: str, obstacle: Obstacle) -> None:
    scene = server.scene
    if isinstance(obstacle, Box):
        turned = viser.transforms.SO3.from_rpy_radians(*obstacle.rpy).wxyz
        scene.add_box(
            name,
            _THING,
            dimensions=obstacle.size,
            opacity=0.6,
            wxyz=turned,
            position=obstacle.center,
        )
    elif isinstance(obstacle, Sphere):
        scene.add_icosphere(name, obstacle.radius, _THING, opacity=0.6, position=obstacle.center)
    elif isinstance(obstacle, Plane):
        normal = obstacle.direction
        across = np.linalg.svd(normal[None])[2][1:]
        axes = np.stack([across[0], np.cross(normal, across[0]), normal], axis=1)
        scene.add_box(
            name,
            _THING,
            dimensions=(_PLANE, _PLANE, 0.002),
            opacity=0.35,
            wxyz=viser.transforms.SO3.from_matrix(axes).wxyz,
            position=obstacle.offset * normal,
        )
