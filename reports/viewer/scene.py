"""What stands in the viewer's space: the robot, obstacles, candidates, the plan."""

import numpy as np
import viser

from reports.viewer.view import View
from robotmodels import Box, Plane, Sphere
from robotmodels.collision.obstacles import Obstacle
from robotmodels.collision.surfaces import link_surfaces
from robotmodels.common.arrays import Array

_LINK, _THING, _VISIT = (150, 165, 185), (205, 150, 110), (214, 40, 90)
_PLANE = 4.0  # edge of what is drawn of a plane [m]
_SMALL, _LARGE = 0.008, 0.03  # candidates without and with weight [m]
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
    """The tool in every candidate position; those with weight are larger."""

    def __init__(self, server: viser.ViserServer, view: View) -> None:
        self._view, self._clouds = view, []
        if view.study is None:
            return
        points, weights = view.tool_points(view.candidates), view.study.plan.design.weights
        small = _SMALL * min(1.0, np.sqrt(_MANY / len(points)))
        self._members = [np.flatnonzero(weights <= 0), np.flatnonzero(weights > 0)]
        for name, members, size in zip(
            ("without weight", "with weight"), self._members, (small, _LARGE), strict=True
        ):
            self._clouds.append(
                server.scene.add_point_cloud(
                    f"/candidates/{name}",
                    points[members],
                    (0, 0, 0),
                    point_size=size,
                    point_shape="circle",
                )
            )
        self.colour("weight")

    def colour(self, by: str) -> None:
        """Colour the candidates by "weight" or "sensitivity", or hide them by "hidden"."""
        colours = None if by == "hidden" else self._view.colours(by)
        for cloud, members in zip(self._clouds, self._members, strict=True):
            cloud.visible = colours is not None
            if colours is not None:
                cloud.colors = colours[members]


def add_plan(server: viser.ViserServer, view: View) -> None:
    """Draw the positions of the plan, numbered and joined in the order of visits."""
    if view.study is None:
        return
    points = view.tool_points(view.study.plan.positions)
    for number, point in enumerate(points, start=1):
        server.scene.add_label(f"/plan/{number}", str(number), position=point)
    if len(points) > 1:
        ways = np.stack([points[:-1], points[1:]], axis=1)
        server.scene.add_line_segments("/plan/order", ways, _VISIT, thickness=0.006)


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
