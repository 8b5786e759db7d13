import struct
from dataclasses import replace
from pathlib import Path

import coal
import mujoco
import numpy as np
import pinocchio as pin
import pytest
from collision_arm import ORIGINS, SHAPES, arm, shape, urdf
from robots import built
from scipy.spatial.transform import Rotation

from robotmodels import Box, InvalidInput, Plane, Sphere, load_robot, surroundings
from robotmodels.checks.proposed_drives import moving_joints
from robotmodels.checks.sub_chain import rest_angle
from robotmodels.description.urdf import locate
from robotmodels.elastic.rigid_pose import configurations
from robotmodels.simulation.urdf_tree import read_tree

STRAIGHT = np.zeros(3)


def touching(robot, position, **entries):
    """Return the pairs that touch."""
    around = surroundings(robot, **entries)
    hits = around.touching(np.atleast_2d(position))[0]
    return {(p.first, p.second) for p, hit in zip(around.pairs, hits, strict=True) if hit}


def test_a_sphere_meets_the_floor_where_its_height_is_its_radius(tmp_path):
    """The hand's centre is 0.75 + 0.55 cos(elbow) high while the shoulder is straight."""
    robot = arm(tmp_path)
    for gap in (-1e-4, 1e-4):
        angle = np.arccos((0.3 + 0.08 + gap - 0.75) / 0.55)
        hit = touching(robot, [0.0, angle, 0.0], floor=0.3, self_collision=False)
        hit -= {("lower", "floor")}  # its lower end
        assert hit == ({("hand", "floor")} if gap < 0 else set())


def test_floor_is_against_gravity(tmp_path):
    robot = arm(tmp_path, gravity=[9.81, 0.0, 0.0])  # the arm hangs on a wall, -x is up
    assert touching(robot, [1.5, 0, 0], floor=-0.3) >= {("upper", "floor"), ("hand", "floor")}
    assert touching(robot, [-1.5, 0, 0], floor=-0.3) == set()


def test_obstacles_and_margin(tmp_path):
    robot = arm(tmp_path)
    top = 0.25 + 0.5 + 0.4 + 0.15 + 0.08
    ball = Sphere("lamp", (0.0, 0.0, top + 0.11), 0.1)  # 1 cm above the hand
    box = Box("shelf", (0.0, 0.0, top + 0.11), (0.2, 0.2, 0.2))
    wall = Plane("ceiling", (0.0, 0.0, -3.0), -(top + 0.01))
    for obstacle in (ball, box, wall):
        assert touching(robot, STRAIGHT, obstacles=[obstacle]) == set()
        hit = touching(robot, STRAIGHT, obstacles=[obstacle], margin=0.0101)
        assert hit == {("hand", obstacle.name)}
    # Turned by 45 degrees the box's edge, 1.4 times as far from its middle, comes down.
    turned = Box("shelf", (0.0, 0.0, top + 0.11), (0.2, 0.2, 0.2), (np.pi / 4, 0.0, 0.0))
    assert touching(robot, STRAIGHT, obstacles=[turned]) == {("hand", "shelf")}


def test_self_collision_and_what_is_never_compared(tmp_path):
    robot = arm(tmp_path)
    assert touching(robot, STRAIGHT) == set()
    folded = [2.4, 2.6, 0.0]  # the forearm comes back to the base
    assert ("base", "hand") in touching(robot, folded)
    pairs = {(p.first, p.second) for p in surroundings(robot).pairs}
    assert pairs == {("base", "upper"), ("base", "hand"), ("lower", "hand")}
    ignored = surroundings(robot, ignored=[("hand", "base")])
    assert ("base", "hand") not in {(p.first, p.second) for p in ignored.pairs}


def test_links_built_to_touch_are_not_compared(tmp_path):
    large = SHAPES | {"hand": shape('<sphere radius="0.45"/>')}  # around the elbow, always
    around = surroundings(arm(tmp_path, large))
    assert ("lower", "hand") in around.built_touching
    assert ("lower", "hand") not in {(p.first, p.second) for p in around.pairs}


def test_against_mujoco(tmp_path):
    """MuJoCo leaves out parents and children too, but not those of the fixed base."""
    robot = arm(tmp_path)
    spec = mujoco.MjSpec.from_string(urdf(SHAPES))
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], pos=[0, 0, -0.1]
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    around = surroundings(robot, floor=-0.1)
    rng = np.random.default_rng(3)
    positions = rng.uniform(-3, 3, (400, 3))
    hits = around.touching(positions)
    bodies = [model.body(i).name for i in range(model.nbody)]
    wanted = {frozenset((p.first, p.second)) for p in around.pairs}
    close = 0
    for position, row in zip(positions, hits, strict=True):
        data.qpos[:] = position
        mujoco.mj_forward(model, data)
        found = set()
        for k in range(data.ncon):
            contact = data.contact[k]
            geoms = [int(g) for g in contact.geom]
            names = [
                "floor" if model.geom(g).name == "floor" else bodies[model.geom_bodyid[g]]
                for g in geoms
            ]
            names = ["base" if name == "world" else name for name in names]
            pair = frozenset(names)
            if abs(contact.dist) < 1e-3:  # two collision detectors may differ at a touch
                close += 1
                found.discard(pair)
            elif pair in wanted:
                found.add(pair)
        ours = {
            frozenset((p.first, p.second)) for p, hit in zip(around.pairs, row, strict=True) if hit
        }
        assert found <= ours, position
        assert len(ours - found) <= 1
        close += len(ours - found)
    assert hits.any(axis=0).all()
    assert close < 20


def test_floor_under_the_meshes_of_a_ur10():
    """Judged by the files' vertices and plain kinematics."""
    robot = load_robot("ur10")
    rng = np.random.default_rng(1)
    positions = rng.uniform(-2, 2, (80, 6))
    around = surroundings(robot, floor=0.0, self_collision=False)
    hit = around.touching(positions).any(axis=1)
    path = locate(robot.file.urdf, robot.folder)
    lowest = np.array([_lowest(path, robot, position) for position in positions])
    np.testing.assert_array_equal(hit, lowest < 0)
    assert 0.2 < hit.mean() < 0.9


def test_meshes_decide_where_hulls_touch():
    """Hulls of the UR10's forearm and second wrist link touch at a place where meshes do not."""
    robot = load_robot("ur10")
    around = surroundings(robot)
    shapes = {s.link: s for s in around.shapes.shapes}
    assert shapes["forearm_link"].mesh is not None
    positions = np.random.default_rng(0).uniform(-2.5, 2.5, (500, 6))
    hits = around.touching(positions)
    hulls = _without_meshes(around).touching(positions)
    assert (hits <= hulls).all()
    assert hits.any()
    assert (hits < hulls).any()


def test_a_robot_without_shapes_is_a_line_or_capsules(tmp_path):
    robot = arm(tmp_path, {})
    around = surroundings(robot, floor=0.0)
    assert "no collision shapes: self-collision is not checked" in around.shapes.notes[0]
    assert {p.second for p in around.pairs} == {"floor"}
    capsules = surroundings(robot, floor=0.0, link_radius=0.05)
    assert "capsules of radius 0.05 m" in capsules.shapes.notes[0]
    # The wrist ends the upper arm, 0.25 + 0.5 cos(shoulder) + 0.4 cos(shoulder + elbow) high.
    for height, expected in ((0.051, False), (0.049, True)):
        elbow = np.arccos((height - ORIGINS["shoulder"] - 0.5 * np.cos(1.2)) / 0.4) - 1.2
        assert (
            ("upper", "floor") in touching(robot, [1.2, elbow, 0.0], floor=0.0, link_radius=0.05)
        ) == expected
        # As a line it does not reach the floor.
        assert ("upper", "floor") not in touching(robot, [1.2, elbow, 0.0], floor=0.0)


def test_meshes_that_are_not_there_are_named(tmp_path):
    shapes = SHAPES | {"hand": shape('<mesh filename="package://nowhere/hand.stl"/>')}
    around = surroundings(arm(tmp_path, shapes))
    assert around.shapes.notes[0] == (
        "link 'hand': its mesh package://nowhere/hand.stl is not found; it is not checked for "
        "collisions"
    )
    assert around.shapes.solid
    alone = surroundings(arm(tmp_path, {"hand": shapes["hand"]}), floor=0.0)
    assert "is not found: self-collision is not checked" in alone.shapes.notes[0]


def test_a_mesh_beside_the_urdf_is_found(tmp_path):
    (tmp_path / "meshes").mkdir()
    _write_tetrahedron(tmp_path / "meshes" / "hand.stl", 0.1)
    for name in ("meshes/hand.stl", f"package://{tmp_path.name}/meshes/hand.stl"):
        robot = arm(tmp_path, SHAPES | {"hand": shape(f'<mesh filename="{name}"/>')})
        around = surroundings(robot, floor=0.0)
        assert around.shapes.notes == ()
        assert {p.first for p in around.pairs if p.obstacle} == {"lower", "upper", "hand"}


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"margin": -1.0}, r"margin \[m\]: -1.0 is not a number >= 0"),
        ({"link_radius": 0.1}, "link_radius: arm.urdf has collision shapes of its own"),
        ({"link_radius": -0.1}, r"link_radius \[m\]: -0.1 is not a number > 0"),
        ({"floor": np.nan}, "floor is nan; a finite number"),
        ({"ignored": [("hand", "bse")]}, r"'bse' is not a link .*did you mean 'base'"),
        (
            {"obstacles": [Sphere("a", (0, 0, 9), 1), Sphere("a", (0, 0, 9), 1)]},
            "'a' is used twice",
        ),
    ],
)
def test_surroundings_that_make_no_sense(tmp_path, entries, message):
    with pytest.raises(InvalidInput, match=message):
        surroundings(arm(tmp_path), **entries)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere("s", (0, 0, 0), 0.0), "obstacle 's': radius 0 m; a positive"),
        (lambda: Sphere("s", (0, 0), 1.0), "obstacle 's': center is .*three finite"),
        (lambda: Box("b", (0, 0, 0), (1, -1, 1)), "obstacle 'b': size .*three positive"),
        (lambda: Box("b", (0, 0, np.inf), (1, 1, 1)), "obstacle 'b': center"),
        (lambda: Plane("p", (0, 0, 0), 0.0), "obstacle 'p': normal is zero"),
    ],
)
def test_obstacles_that_are_none(make, message):
    with pytest.raises(InvalidInput, match=message):
        make()


def test_no_floor_without_gravity(tmp_path):
    with pytest.raises(InvalidInput, match="gravity is zero, so that nothing is up"):
        surroundings(arm(tmp_path, gravity=[0, 0, 0]), floor=0.0)


def test_a_shape_that_cannot_be_read(tmp_path):
    shapes = SHAPES | {"hand": shape("<nonsense/>")}
    with pytest.raises(InvalidInput, match=r"arm\.urdf: link 'hand': collision shape 1"):
        surroundings(arm(tmp_path, shapes))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("nan.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 nan\nf 1 2 3\nf 1 2 4\n", "finite numbers"),
        ("far.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1e30\nf 1 2 3\nf 1 2 4\n", "finite numbers"),
        ("empty.stl", "", "File is empty"),
        ("large.stl", " " * 30_000_001, "30 MB; a file of this kind has at most 30"),
        ("a.dae", "<a><p>0 1 1.5</p></a>", "<p> has '.5'; whole numbers are needed"),
        ("cut.dae", "<COLLADA><p>0 1", "not a well-formed COLLADA file"),
        ("none.xyz", "a", "No suitable reader"),
    ],
)
def test_meshes_that_are_no_bodies(tmp_path, name, content, said):
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInput, match=said) as error:
        surroundings(arm(tmp_path, SHAPES | {"hand": shape(f'<mesh filename="{name}"/>')}))
    assert "\n" not in str(error.value)
    assert name in str(error.value)


def test_a_flat_mesh_is_compared_as_its_bounding_box(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    robot = arm(tmp_path, SHAPES | {"hand": shape('<mesh filename="flat.obj"/>')})
    shapes = surroundings(robot).shapes
    (note,) = [note for note in shapes.notes if "flat.obj" in note]
    assert note.startswith("link 'hand': mesh flat.obj: its points lie in a plane")
    hand = next(s for s in shapes.shapes if s.link == "hand")
    assert np.allclose(hand.hull.halfSide, [0.5, 0.5, 5e-4])


def test_a_capsule_is_a_cylinder_with_round_ends(tmp_path):
    ends = '<origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/>'
    drawn = (
        f'<collision>{ends}<geometry><capsule radius="0.1" length="0.4"/></geometry></collision>'
    )
    robot = arm(tmp_path, SHAPES | {"hand": drawn})
    parts = [s for s in surroundings(robot).shapes.shapes if s.link == "hand"]
    at = parts[0].placement
    capsule, whole = coal.Capsule(0.1, 0.4), coal.Transform3s(at.rotation, at.translation)
    rng = np.random.default_rng(0)
    for point in at.translation + rng.normal(scale=0.3, size=(100, 3)):
        probe, seat = coal.Sphere(1e-9), coal.Transform3s(np.eye(3), point)

        def distance(shape, placement, probe=probe, seat=seat):
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            return coal.distance(shape, placement, probe, seat, request, result)

        nearest = min(
            distance(s.hull, coal.Transform3s(s.placement.rotation, s.placement.translation))
            for s in parts
        )
        assert max(nearest, 0) == pytest.approx(max(distance(capsule, whole), 0), abs=1e-6)


@pytest.mark.parametrize("name", ["package://", "package:///etc/passwd", "package://a/../../b.stl"])
def test_meshes_of_a_package_stay_inside_it(tmp_path, name):
    with pytest.raises(InvalidInput, match="the path of a file inside a package is needed"):
        surroundings(arm(tmp_path, SHAPES | {"hand": shape(f'<mesh filename="{name}"/>')}))


def test_obstacles_hold_the_numbers_that_were_checked():
    box = Box("box", np.array([1, 2, 3]), [1, 1, 1])
    assert box.center == (1.0, 2.0, 3.0)
    assert all(type(x) is float for x in (*box.center, *box.size))
    for wrong in (["0.2_0", "1", "1"], [True, None, 1.0]):
        with pytest.raises(InvalidInput, match="obstacle 'box': center"):
            Box("box", wrong, [1, 1, 1])


def _without_meshes(around):
    shapes = tuple(replace(s, mesh=None) for s in around.shapes.shapes)
    return replace(around, shapes=replace(around.shapes, shapes=shapes))


def _lowest(path, robot, position):
    """Return the least height of all moving links' vertices."""
    tree, angles = read_tree(path), dict(zip(robot.motor_joints, position, strict=True))
    folder = Path(path).parent.parent / "meshes" / "ur10" / "collision"
    drawn = {
        "shoulder_link": "shoulder",
        "upper_arm_link": "upperarm",
        "forearm_link": "forearm",
        "wrist_1_link": "wrist1",
        "wrist_2_link": "wrist2",
        "wrist_3_link": "wrist3",
    }
    lowest = np.inf
    stack = [(tree.root, Rotation.identity(), np.zeros(3))]
    while stack:
        link, rotation, at = stack.pop()
        if link in drawn:
            vertices = _vertices(folder / f"{drawn[link]}.stl")
            lowest = min(lowest, (rotation.apply(vertices) + at)[:, 2].min())
        if link == "ee_link":  # a box 1 cm wide, drawn 1 cm behind its frame
            corners = 0.005 * np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
            lowest = min(
                lowest, (rotation.apply(corners - np.array([0.01, 0, 0])) + at)[:, 2].min()
            )
        for joint in tree.joints[link]:
            turn = Rotation.from_rotvec(angles.get(joint.name, 0.0) * joint.axis)
            there = rotation.apply(joint.position) + at
            stack.append((joint.child, rotation * joint.rotation * turn, there))
    return lowest


def _vertices(path):
    """Return the vertices of a binary STL file."""
    content = path.read_bytes()
    (count,) = struct.unpack("<I", content[80:84])
    facets = np.frombuffer(content[84:], dtype="(3,)<f4,(3,3)<f4,<u2", count=count)
    return facets["f1"].reshape(-1, 3).astype(float)


def _write_tetrahedron(path, size):
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    facets = np.zeros(4, dtype="(3,)<f4,(3,3)<f4,<u2")
    facets["f1"] = corners[np.array(faces)]
    path.write_bytes(b"\0" * 80 + struct.pack("<I", 4) + facets.tobytes())


def test_collisions_of_a_position_depend_on_it_alone_and_are_those_of_distances(tmp_path):
    """At a margin of exactly 0 Coal forgets some pairs, by what it compared before."""
    reference = "example-robot-data:baxter_description/urdf/baxter.urdf"
    axes = ("s1", "e0", "e1", "w0", "w1")
    joints = [f"{side}_{axis}" for side in ("left", "right") for axis in axes]
    held = [j for j in moving_joints(locate(reference, tmp_path)) if j.name not in joints]
    content = {
        "schema": "robot/1",
        "name": "baxter",
        "urdf": reference,
        "lock": {joint.name: rest_angle(joint) for joint in held},
        "motors": [
            {"name": f"m{i}", "joint": j, "gear_ratio": 100, "inertia": 1e-4}
            for i, j in enumerate(joints)
        ],
        "springs": [
            {"name": f"d{i}", "joint": j, "axis": "drive", "stiffness": 1e5, "damping": 1}
            for i, j in enumerate(joints)
        ],
    }
    robot = built(content)
    low, high = robot.position_limits.T
    positions = np.random.default_rng(0).uniform(low, high, (60, len(low)))
    checker = surroundings(robot)._checker
    configured = configurations(robot, positions)
    forwards, backwards = checker(configured), checker(configured[::-1])[::-1]
    assert np.array_equal(forwards, backwards)
    data = robot.rigid.createData()
    for q, touching in zip(configured[:20], forwards[:20], strict=True):
        pin.forwardKinematics(robot.rigid, data, q)
        for (i, j), touches in zip(checker.pairs, touching, strict=True):
            first, second = checker.shapes[i], checker.shapes[j]
            if first.mesh is not None and second.mesh is not None:
                continue
            placements = [data.oMi[s.joint] * s.placement for s in (first, second)]
            at = [coal.Transform3s(p.rotation, p.translation) for p in placements]
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            distance = coal.distance(first.hull, at[0], second.hull, at[1], request, result)
            assert abs(distance) < 1e-5 or touches == (distance < 0)
