import coal
import numpy as np
import pinocchio as pin
import pytest
from collision_arm import volume

from robotmodels import Frame, load_robot, tool_frame
from robotmodels.collision.shapes import Shape, robot_shapes
from robotmodels.collision.surfaces import _surface, link_surfaces
from robotmodels.elastic.elastic_pose import frame_points, joint_placements
from robotmodels.elastic.inverse_kinematics import Tool, nearest_position
from robotmodels.elastic.rigid_pose import joint_origins, unloaded


@pytest.fixture(scope="module")
def ur10():
    return load_robot("ur10")


POLYGON = 12 * np.sin(np.pi / 12) / np.pi  # area of 24 sides over that of their circle


@pytest.mark.parametrize(
    ("shape", "exact", "accuracy"),
    [
        (coal.Box(0.3, 0.2, 0.1), 0.006, 1e-12),
        (coal.Cylinder(0.1, 0.4), 0.004 * np.pi * POLYGON, 1e-12),
        (coal.Sphere(0.2), 4 / 3 * np.pi * 0.008, 0.03),
        (coal.Capsule(0.05, 0.6), np.pi * 0.0025 * (0.6 + 0.2 / 3), 0.03),
    ],
    ids=["box", "cylinder", "sphere", "capsule"],
)
def test_triangles_enclose_the_volume_of_the_shape(shape, exact, accuracy):
    at = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 1.1), np.array([0.4, -0.2, 0.7]))
    surface = _surface(Shape("link", 1, at, shape))
    assert volume(surface) == pytest.approx(exact, rel=accuracy)
    assert surface.vertices.mean(axis=0) == pytest.approx(at.translation, abs=1e-9)


def test_a_robot_with_meshes_has_them(ur10):
    surfaces, shapes = link_surfaces(ur10), robot_shapes(ur10).shapes
    assert [s.link for s in surfaces] == [shape.link for shape in shapes]
    for surface, shape in zip(surfaces, shapes, strict=True):
        shape.hull.computeLocalAABB()
        around = shape.hull.aabb_local.volume()
        assert 0 < volume(surface) <= around * (1 + 1e-9)
        assert surface.faces.max() < len(surface.vertices)


def test_a_robot_without_shapes_has_capsules_between_its_joints():
    robot = load_robot("manutec_r3")
    assert not robot_shapes(robot).solid
    surfaces = link_surfaces(robot)
    assert len(surfaces) >= len(robot.motor_names) - 1
    assert all(volume(surface) > 1e-4 for surface in surfaces)


def test_unloaded_joints_are_where_the_rigid_robot_has_them(ur10):
    position = np.array([0.3, -1.2, 0.9, -0.4, 0.7, 0.2])
    placements = joint_placements(ur10, unloaded(ur10, position[None]))
    origins = joint_origins(ur10, position)
    assert placements[0, :, :3, 3] == pytest.approx(origins[: len(placements[0])], abs=1e-12)
    tool = frame_points(ur10, tool_frame(ur10), placements)
    assert tool[0] == pytest.approx(origins[-1], abs=1e-12)


def test_a_torsion_turns_all_beyond_it_about_its_axis(ur10):
    """b1x turns about the x axis of joint 1, so that a point moves by axis x arm."""
    position = np.array([0.3, -1.2, 0.9, -0.4, 0.7, 0.2])
    rest = unloaded(ur10, position[None])
    names = list(ur10.coordinate_names)
    spring = next(s for s in ur10.file.springs if s.axis == "x")
    turned = rest.copy()
    turned[0, names.index(spring.name)] += 1e-6
    before, after = (joint_placements(ur10, q) for q in (rest, turned))
    joint = ur10.rigid.getJointId(spring.joint)
    drive = turned[0, names.index(spring.joint)]
    # The joint's frame has turned by the drive; the torsion sits before it.
    axis = before[0, joint, :3, :3] @ pin.exp3(np.array([0, 0, -drive])) @ [1.0, 0.0, 0.0]
    frame = Frame(tool_frame(ur10).link, (0.1, 0.0, 0.05))
    a, b = (frame_points(ur10, frame, at)[0] for at in (before, after))
    arm = a - before[0, joint, :3, 3]
    assert (b - a) / 1e-6 == pytest.approx(np.cross(axis, arm), abs=1e-5)


def test_the_nearest_position_reaches_the_point_and_turns_little(ur10):
    link = tool_frame(ur10).link
    start = np.array([0.3, -1.2, 0.9, -0.4, 0.7, 0.2])

    def tool(position):
        at = joint_placements(ur10, unloaded(ur10, position[None]))
        return frame_points(ur10, tool_frame(ur10), at)[0]

    target = tool(start) + np.array([0.03, -0.02, 0.04])
    position = nearest_position(ur10, Tool(link), target, start)
    assert tool(position) == pytest.approx(target, abs=2e-6)
    assert np.abs(position - start).max() < 0.2
    assert nearest_position(ur10, Tool(link), np.array([9.0, 0.0, 0.0]), start) is None
