"""MJCF files as robots: judged by MuJoCo, which moves their bodies itself."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from reports.commands.init_files import starter_files, write_starter_files
from robotmodels import InvalidInput, load_robot
from robotmodels.checks.model_doubts import doubts_about
from robotmodels.description import mjcf_unused
from robotmodels.description.joint_drives import Coupling, JointDrive, couplings, joint_drives
from robotmodels.description.mjcf_file import files_of_mjcf
from robotmodels.description.model_files import ModelFile, gravity_of, model_digest, read_model
from robotmodels.description.unused_elements import unused_parts
from robotmodels.description.urdf import rigid_model
from robotmodels.description.urdf_check import checked_urdf, free_joints

# Several joints on a body, each about its own point; ref; frames; degrees; classes; a gimbal lock.
ARM = """\
<mujoco model="arm">
  <compiler angle="degree" eulerseq="xyz"/>
  <option gravity="0.3 -0.2 -9.7" timestep="0.001" density="1.2"/>
  <default>
    <joint armature="0.02" damping="0.4"/>
    <default class="wrist"><joint armature="0.004" frictionloss="0.3"/></default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <light pos="0 0 3"/>
    <body name="base" pos="0.1 0.2 0.3" euler="0 90 20" gravcomp="0.1">
      <inertial pos="0.1 0 0.05" mass="3" fullinertia="0.1 0.12 0.11 0.01 0.02 0.005"/>
      <joint name="turn" axis="0 0.2 1" pos="0.05 0.02 0.1" range="-120 80" ref="10"/>
      <joint name="slide" type="slide" axis="1 0 0.5" pos="1 1 1" ref="0.04" range="-0.2 0.3"/>
      <joint name="lean" axis="0 1 0" pos="0.3 0 0.2" stiffness="7" springref="3"/>
      <site name="base" pos="0.1 0 0"/>
      <frame pos="0.2 0.1 0" euler="30 0 0">
        <body name="fore" pos="0.4 0 0.1" quat="0.8 0.1 0.2 0.3">
          <joint name="elbow" axis="0 1 0" actuatorfrcrange="-80 90"/>
          <geom name="bone" type="capsule" fromto="0 0 0 0.5 0 0.1" size="0.04" density="900"/>
          <geom type="box" pos="0.1 0 0" size="0.1 0.2 0.3" mass="2" friction="0.5 0 0"/>
          <geom type="sphere" size="0.02" contype="0" conaffinity="0" rgba="1 0 0 1"/>
          <body name="hand" pos="0.5 0 0.1">
            <joint name="roll" class="wrist" axis="1 0 0" pos="0 0 0.02"/>
            <geom type="ellipsoid" size="0.1 0.05 0.02"/>
            <site name="tool" pos="0 0 0.1" euler="0 45 0"/>
            <body pos="0.1 0 0"><joint name="left" type="slide" axis="0 1 0" range="0 0.05"/>
              <geom type="cylinder" size="0.01 0.03"/></body>
            <body pos="0.1 0 0"><joint name="right" type="slide" axis="0 -1 0" range="0 0.05"/>
              <geom type="box" size="0.01 0.02 0.03"/></body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
  <equality><joint name="grip" joint1="right" joint2="left" polycoef="0.01 0.8 0 0 0"/></equality>
  <actuator>
    <motor name="a1" joint="turn" gear="-100" ctrlrange="-2 3"/>
    <general name="a2" joint="lean" gear="50" forcerange="-4 4" gainprm="9"/>
    <position name="a3" joint="roll" kp="30" ctrlrange="-1 1"/>
  </actuator>
  <sensor><jointpos joint="turn"/></sensor>
  <keyframe><key qpos="0 0 0 0 0 0 0"/></keyframe>
</mujoco>
"""
JOINTS = ("turn", "slide", "lean", "elbow", "roll", "left", "right")


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM, encoding="utf-8")
    return path


def configuration(model, names, values):
    q = pin.neutral(model)
    for name, value in zip(names, values, strict=True):
        joint = model.joints[model.getJointId(name)]
        angle = [np.cos(value), np.sin(value)] if joint.nq == 2 else value
        q[joint.idx_q : joint.idx_q + joint.nq] = angle
    return q


def misfit(path, seed, rounding=0.0):
    """Return how far mass matrix and gravity are from MuJoCo's, relative to their largest."""
    rng = np.random.default_rng(seed)
    judge = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(judge)
    model = rigid_model(path, dict.fromkeys(free_joints(checked_urdf(path)), 0.0))
    model.gravity.linear = np.array(gravity_of(path))
    names = list(model.names)[1:]
    hinges = [judge.joint(name) for name in names]
    values = rng.uniform(-2, 2, len(names)) * (1 + rounding * rng.normal(size=len(names)))
    data.qpos[[int(h.qposadr[0]) for h in hinges]] = values
    mujoco.mj_forward(judge, data)
    dofs = [int(h.dofadr[0]) for h in hinges]
    mass = np.zeros((judge.nv, judge.nv))
    mujoco.mj_fullM(judge, data, mass)
    mass, gravity = mass[np.ix_(dofs, dofs)], data.qfrc_bias[dofs]
    own = model.createData()
    q = configuration(model, names, values)
    order = [model.joints[model.getJointId(name)].idx_v for name in names]
    upper = np.triu(pin.crba(model, own, q))
    drives = joint_drives(checked_urdf(path))
    armature = np.diag([drives[name].armature or 0.0 for name in names])
    whole = (upper + np.triu(upper, 1).T)[np.ix_(order, order)] + armature
    torque = pin.computeGeneralizedGravity(model, own, q)[order]
    return (
        np.abs(whole - mass).max() / np.abs(mass).max(),
        np.abs(torque - gravity).max() / np.abs(gravity).max(),
    )


@pytest.mark.parametrize("seed", range(5))
def test_mass_matrix_and_gravity_are_mujocos(arm, seed):
    assert list(rigid_model(arm, {}).names)[1:] == list(JOINTS)
    assert max(misfit(arm, seed)) < 1e-12
    assert max(misfit(arm, seed, 1e-13)) < 1e-12
    # The judge sees a point of a joint moved by a hair.
    arm.write_text(ARM.replace('pos="0.3 0 0.2"', 'pos="0.3001 0 0.2"'))
    moved = mujoco.MjModel.from_xml_path(str(arm)).jnt_pos[2, 0]
    assert moved == 0.3001
    assert max(misfit(arm, seed)) < 1e-12


def test_a_base_that_is_free_in_mujoco_stands_still(arm):
    free = '<freejoint name="root"/><inertial'
    content = ARM.replace("<inertial", free, 1).replace('qpos="0 0 0 0 0 0 0"', "")
    for name in ("turn", "slide", "lean"):
        start = content.index(f'<joint name="{name}"')
        content = content[:start] + content[content.index("/>", start) + 2 :]
    content = content.replace('<motor name="a1" joint="turn" gear="-100" ctrlrange="-2 3"/>', "")
    content = content.replace('joint="lean"', 'joint="elbow"').replace(
        'joint="turn"', 'joint="roll"'
    )
    arm.write_text(content)
    assert max(misfit(arm, 0)) < 1e-12
    message = "joint 'root' leaves link '.*' free to move; hold it where it is: 'lock: {root: 0}'"
    with pytest.raises(InvalidInput, match=message):
        rigid_model(arm, {})
    with pytest.raises(InvalidInput, match=r"lock: free joint 'root' at .*; it is held at 0 only"):
        rigid_model(arm, {"root": 0.2})
    words = [str(part) for part in unused_parts(arm)]
    assert any("(root): not used, because the body is held where it is" in line for line in words)


def test_what_the_conversion_assumes_is_said(arm):
    round_ = "links hand: boxes stand for ellipsoids, which hold less"
    assert [line for line in doubts_about(arm) if "slides" in line or "boxes" in line] == [round_]
    slide = next(line for line in ARM.splitlines() if 'name="slide"' in line)
    start = slide.index(' range="')
    free = slide[:start] + slide[slide.index('"', start + 8) + 1 :]
    arm.write_text(ARM.replace(slide, free).replace('"ellipsoid"', '"box"'))
    lines = doubts_about(arm)
    assert "joint 'slide' slides without limits: -10 to 10 m are taken" in lines
    assert round_ not in lines


def test_a_changed_included_file_is_noticed(arm, tmp_path):
    (tmp_path / "parts").mkdir()
    part = '<mujoco><worldbody><body name="stone"><geom size="{}"/></body></worldbody></mujoco>'
    (tmp_path / "parts" / "part.xml").write_text(part.format(0.1))
    arm.write_text(ARM.replace("<worldbody>", '<include file="parts/part.xml"/><worldbody>', 1))
    before = model_digest(ModelFile(arm))
    assert model_digest(ModelFile(arm)) == before
    (tmp_path / "parts" / "part.xml").write_text(part.format(0.25))
    assert model_digest(ModelFile(arm)) != before
    assert tmp_path / "parts" / "part.xml" in set(files_of_mjcf(arm))


def test_limits_drives_and_couplings(arm):
    checked = checked_urdf(arm)
    drives = joint_drives(checked)
    assert drives["turn"] == JointDrive(-100, 0.4, None, 0.02, 300, None)
    assert drives["lean"] == JointDrive(50, 0.4, None, 0.02, 200, None)
    assert drives["elbow"] == JointDrive(None, 0.4, None, 0.02, 90, None)
    assert drives["roll"] == JointDrive(None, 0.4, 0.3, 0.004, None, None)
    assert couplings(checked) == {"right": Coupling("left", 0.8, 0.01)}
    limit = {j.get("name"): j.find("limit") for j in checked.iter("joint")}
    low, high = (float(limit["turn"].get(end)) for end in ("lower", "upper"))
    assert (low, high) == pytest.approx(tuple(np.radians([-120, 80])))
    assert limit["elbow"] is None
    assert gravity_of(arm) == (0.3, -0.2, -9.7)


def test_couplings_count_from_reference_angles(arm):
    arm.write_text(ARM.replace('name="left" type', 'ref="0.02" name="left" type'))
    judge = mujoco.MjModel.from_xml_path(str(arm))
    data = mujoco.MjData(judge)
    follower = couplings(checked_urdf(arm))["right"]
    data.joint("left").qpos = 0.03
    data.joint("right").qpos = follower.multiplier * 0.03 + follower.offset
    mujoco.mj_forward(judge, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-15
    assert data.ne == 1


def test_sites_and_bodies_are_links_where_mujoco_has_them(arm):
    model = rigid_model(arm, {})
    judge = mujoco.MjModel.from_xml_path(str(arm))
    data = mujoco.MjData(judge)
    values = np.linspace(-0.5, 0.7, 7)
    data.qpos[:] = values
    mujoco.mj_forward(judge, data)
    own = model.createData()
    pin.framesForwardKinematics(model, own, configuration(model, JOINTS, values))
    for name, at, turn in (
        ("base", data.body("base").xpos, data.body("base").xmat),
        ("base site", data.site("base").xpos, data.site("base").xmat),
        ("tool", data.site("tool").xpos, data.site("tool").xmat),
        ("hand", data.body("hand").xpos, data.body("hand").xmat),
    ):
        placement = own.oMf[model.getFrameId(name, pin.BODY)]
        assert np.allclose(placement.translation, at, atol=1e-14)
        assert np.allclose(placement.rotation, turn.reshape(3, 3), atol=1e-14)


def test_collision_shapes(arm, tmp_path):
    vertices = np.array([[0.1, 0, 0], [0.5, 0, 0], [0.1, 0.3, 0], [0.1, 0, 0.2]])
    faces = ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "part.obj").write_text("\n".join(lines))
    asset = '<asset><mesh name="part" file="part.obj" scale="2 1 1"/></asset><worldbody>'
    geom = '<geom name="m" type="mesh" mesh="part" pos="0.2 0 0" euler="0 0 40"/><geom name="bone"'
    content = ARM.replace("<worldbody>", asset, 1).replace('<geom name="bone"', geom)
    arm.write_text(content.replace("<compiler ", '<compiler meshdir="meshes" '))
    (link,) = (e for e in checked_urdf(arm, shapes=True).iter("link") if e.get("name") == "fore")
    shapes = [(c.find("geometry")[0].tag, c) for c in link.iter("collision")]
    # A capsule is a cylinder and two spheres; the sphere that touches nothing is left out.
    assert [tag for tag, _ in shapes] == ["mesh", "cylinder", "sphere", "sphere", "box"]
    mesh = shapes[0][1]
    assert mesh.find("geometry/mesh").get("filename") == str(tmp_path / "meshes" / "part.obj")
    judge = mujoco.MjModel.from_xml_path(str(arm))
    geom = judge.geom("m")
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, geom.quat)
    theirs = judge.mesh_vert[:4] @ turn.reshape(3, 3).T + geom.pos
    xyz, rpy = (np.array(mesh.find("origin").get(k).split(), float) for k in ("xyz", "rpy"))
    ours = (vertices * [2, 1, 1]) @ pin.rpy.rpyToMatrix(rpy).T + xyz
    apart = np.linalg.norm(theirs[:, None] - ours, axis=2).min(axis=1)
    assert apart.max() < 1e-6  # MuJoCo's vertices are of single precision
    box = [float(x) for x in shapes[4][1].find("geometry/box").get("size").split()]
    assert box == [0.2, 0.4, 0.6]


def test_init_takes_rotors_friction_and_gears_over(arm, tmp_path):
    content = ARM.replace("</equality>", "</equality>").replace('range="0 0.05"', 'range="0 0.05"')
    arm.write_text(content)
    starter = starter_files(str(arm), tmp_path / "new")
    write_starter_files(starter, tmp_path / "new")
    robot = load_robot(tmp_path / "new" / "robot.yaml")
    assert robot.file.gravity == (0.3, -0.2, -9.7)
    motors = {m.joint: m for m in robot.file.motors}
    assert motors["turn"].gear_ratio == -100
    for name, reflected in (("turn", 0.02), ("lean", 0.02), ("roll", 0.004)):
        motor = motors[name]
        assert motor.inertia * motor.gear_ratio**2 == pytest.approx(reflected, rel=1e-12)
        assert motor.viscous * motor.gear_ratio**2 == pytest.approx(0.4, rel=1e-12)
    assert motors["roll"].coulomb * motors["roll"].gear_ratio == pytest.approx(0.3, rel=1e-12)
    assert any("tendon" in n or "controllers stand" in n for n in starter.notes)


def outcome(path):
    try:
        return ET.tostring(read_model(path))
    except InvalidInput as error:
        return str(error)


def test_every_attribute_is_used_or_listed(arm):
    """Each attribute of the file is changed: the robot changes, or the list has it."""
    root = ET.fromstring(ARM)
    reference = outcome(arm)
    paths = {part.path for part in unused_parts(arm)}
    count = 0
    for element in root.iter():
        for key, value in list(element.items()):
            element.set(key, " ".join(map(_other, value.split())))
            arm.write_bytes(ET.tostring(root))
            if outcome(arm) == reference:
                count += 1
                assert _listed(element, key, paths), (element.tag, key)
            element.set(key, value)
    assert count > 10


def _other(word):
    try:
        return repr(1.07 * float(word) + 0.003)
    except ValueError:
        return word + "x"


def _listed(element, key, paths):
    """Whether something is listed, or moves nothing: drawings, names, settings of the solver."""
    tag = element.tag
    if tag == "light" or key in ("timestep", "name", "rgba") or element.get("type") == "plane":
        return True
    if (element.get("type"), key) == ("slide", "pos"):
        return True
    if tag in ("motor", "general", "position"):
        return any(path.startswith("actuator@") for path in paths)
    return any(path.endswith((f"{tag}@{key}", f"/{tag}")) for path in paths)


def test_additions_are_listed(arm):
    for old, new, path in (
        ("</worldbody>", '</worldbody><contact><exclude body1="hand" body2="base"/></contact>',
         "contact/exclude"),
        ("<actuator>", '<tendon><fixed><joint joint="turn" coef="1"/></fixed></tendon><actuator>',
         "tendon/fixed"),
        ('density="1.2"', 'wind="1 0 0"', "option@wind"),
        ('gainprm="9"', 'dyntype="filter" dynprm="0.1" gainprm="9"', "actuator@dynprm"),
        ('name="elbow"', 'name="elbow" solreflimit="0.01 1"', "body/joint@solreflimit"),
    ):  # fmt: skip
        assert old in ARM
        arm.write_text(ARM.replace(old, new, 1))
        assert path in {part.path for part in unused_parts(arm)}, path
    assert all(mjcf_unused._REASONS.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<joint name="elbow"', '<joint type="ball" name="elbow"', "joint 'elbow' is a ball joint"),
        ("<equality>", '<equality><connect body1="hand" body2="base" anchor="0 0 0"/>',
         r"equality 0 \(connect\) closes a loop of bodies"),
        ("0.01 0.8 0 0 0", "0.01 0.8 0.1 0 0", r"equality 'grip' \(joint\) is not linear in a sec"),
        ('joint2="left"', "", r"equality 'grip' \(joint\) is not linear in a second joint"),
        ('name="a1"', 'nam="a1"', "MuJoCo refuses it: XML Error: Schema violation"),
        ('class="wrist" axis', 'class="arm" axis', "MuJoCo refuses it: .*arm"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(arm, old, new, message):
    assert old in ARM
    content = ARM.replace(old, new, 1)
    if "ball" in new:
        content = content.replace('qpos="0 0 0 0 0 0 0"', "").replace(
            'actuatorfrcrange="-80 90"', ""
        )
    arm.write_text(content)
    with pytest.raises(InvalidInput, match=message) as error:
        read_model(arm)
    assert str(error.value).startswith(str(arm))
    assert "\n" not in str(error.value)


def test_what_mujoco_will_not_read_some_day_leaves_no_log(tmp_path, monkeypatch):
    """MuJoCo's own handler of warnings writes MUJOCO_LOG.TXT into the working folder."""
    monkeypatch.chdir(tmp_path)
    deprecated = ARM.replace('angle="degree"', 'angle="degree" settotalmass="9"')
    (tmp_path / "arm.xml").write_text(deprecated, encoding="utf-8")
    before = mujoco.get_mju_user_warning()
    assert read_model(tmp_path / "arm.xml") is not None
    assert mujoco.get_mju_user_warning() is before
    assert [path.name for path in tmp_path.iterdir()] == ["arm.xml"]
