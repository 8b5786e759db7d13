"""Exported files, each loaded by the program they are for, against the robot they came from."""

import importlib
import json
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import control
import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml
from reloaded_mjcf import ReloadedMjcf
from robots import (
    BALANCED,
    CRANE,
    PANDA,
    PARALLELOGRAM,
    SENSED,
    SPLIT,
    WALL,
    built,
    changed,
)
from scipy.io import loadmat

import robotmodels
from robotmodels import ElasticRobot, IdentificationError, InvalidInput
from robotmodels.collision.shapes import robot_shapes
from robotmodels.description.robot_file import Choice
from robotmodels.elastic.dynamics import gravity_torques, mass_matrices
from robotmodels.linear.modes import damped_modes

OMEGA = 2 * np.pi * np.geomspace(1.0, 100.0, 8)
OWN = {
    "split": SPLIT,
    "sensed": SENSED,
    "wall": WALL,
    "panda": PANDA,
    "crane": CRANE,
    "balanced": BALANCED,
    "parallelogram": PARALLELOGRAM,
}
SMALL = ("manutec_r3_hardening", "sensed", "wall", "crane", "balanced", "parallelogram")
SLOW = sorted({*robotmodels.builtin_robots(), *OWN} - set(SMALL))
ROBOTS = [*SMALL, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
TOLERANCE = 1e-6  # of each element's largest value


@dataclass(frozen=True, eq=False)
class Case:
    """A robot that was identified, five random positions and its responses there."""

    robot: ElasticRobot
    positions: np.ndarray
    expected: np.ndarray


@pytest.fixture(params=ROBOTS)
def case(request: pytest.FixtureRequest) -> Case:
    name = request.param
    robot = built(OWN[name]) if name in OWN else robotmodels.load_robot(name)
    rng = np.random.default_rng(7)
    values = robot.parameters.values * np.exp(0.05 * rng.standard_normal(len(robot.parameters)))
    robot = robotmodels.with_values(robot, values)
    # The distance of a cut is a norm: rounding of three coordinates.
    exact = [not parameter.endswith(".at") for parameter in robot.parameters.names]
    np.testing.assert_array_equal(robot.parameters.values[exact], values[exact])
    np.testing.assert_allclose(robot.parameters.values, values, rtol=1e-15)
    positions = rng.uniform(*robot.position_limits.T, (5, len(robot.motor_names)))
    return Case(robot, positions, robotmodels.frequency_response(robot, positions, OMEGA))


def relative(response: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest error of an element, relative to its largest value over frequencies."""
    scale = np.abs(expected).max(axis=1, keepdims=True)
    # Elements that symmetry makes zero are rounding in both.
    scale = np.maximum(scale, 1e-9 * scale.max(axis=(2, 3), keepdims=True))
    return float((np.abs(response - expected) / scale).max())


def test_a_robot_file(case: Case, tmp_path: Path) -> None:
    path = tmp_path / "new" / "robot.yaml"
    assert robotmodels.export(case.robot, path, "robot") == ()
    again = robotmodels.load_robot(path)
    assert again.file.model_copy(update={"urdf": case.robot.file.urdf}) == case.robot.file
    response = robotmodels.frequency_response(again, case.positions, OMEGA)
    np.testing.assert_array_equal(response, case.expected)
    robotmodels.save_robot(again, tmp_path / "robot.yaml")
    robotmodels.load_robot(tmp_path / "robot.yaml")


def test_mjcf(case: Case, tmp_path: Path) -> None:
    robot, path = case.robot, tmp_path / "robot.xml"
    robotmodels.export(robot, path, "mjcf", case.positions)
    plain = ReloadedMjcf(path)
    joints, sensors = list(robot.motor_joints), len(robot.file.accelerometers)
    late = np.exp(-1j * OMEGA * robot.file.delay)[:, None, None]
    responses = []
    for i, position in enumerate(case.positions):
        q = plain.equilibrium(position, joints)
        responses.append(plain.response(q, OMEGA, sensors) * late)
        np.testing.assert_allclose(plain.model.key_qpos[i], q, rtol=0, atol=1e-9)
        check_deflections(plain, q, robot, position)
        keyframe = plain.model.key_qpos[i], 0 * q, plain.model.key_ctrl[i]
        weight = np.abs(plain.forces(q, 0 * q, 0 * plain.model.key_ctrl[i])).max()
        assert np.abs(plain.forces(*keyframe)).max() < 1e-4 * max(weight, 1.0)
    shafts = len(robot.motor_names)
    expected = case.expected
    if robot.file.output != "acceleration":
        order = {"velocity": 1, "position": 2}[robot.file.output]
        expected = expected.copy()
        expected[:, :, :shafts] *= ((1j * OMEGA) ** order)[:, None, None]
    assert relative(np.array(responses), expected) < TOLERANCE


def check_deflections(
    plain: ReloadedMjcf, q: np.ndarray, robot: ElasticRobot, position: np.ndarray
) -> None:
    """Compare points half a metre from each driven joint, under gravity and payload."""
    plain.forces(q, 0 * q, np.zeros(plain.model.nu))
    data = robot.arm.model.createData()
    coordinates = robot.equilibrium(position[None]).coordinates
    pin.forwardKinematics(robot.arm.model, data, robot.arm.joints(coordinates)[0])
    offset = np.array([0.3, -0.2, 0.35])
    for name in robot.arm.urdf_joints:
        body = plain.model.joint(name).bodyid[0]
        point = plain.data.xpos[body] + plain.data.xmat[body].reshape(3, 3) @ offset
        expected = data.oMi[robot.arm.model.getJointId(name)].act(offset)
        np.testing.assert_allclose(point, expected, rtol=0, atol=1e-9)


def test_mjcf_shows_shapes_limits_and_the_delay(tmp_path: Path) -> None:
    robot = robotmodels.load_robot("ur5")
    file = robot.file.model_copy(update={"delay": 0.004})
    robotmodels.export(ElasticRobot(file, robot.folder), tmp_path / "ur5.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "ur5.xml"))
    drawn = {model.body(i).name for i in model.geom_bodyid}
    assert {"shoulder_link", "forearm_link", "wrist_3_link"} <= drawn
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    limits = np.array([model.jnt_range[model.joint(name).id] for name in robot.motor_names])
    np.testing.assert_allclose(limits, robot.position_limits, rtol=1e-5)
    assert model.numeric_data.tolist() == [0.004]
    # Points of the forearm's mesh, where Pinocchio has them.
    position = np.array([0.3, -1.2, 1.0, 0.2, 0.5, -0.4])
    (shape,) = (s for s in robot_shapes(robot).shapes if s.link == "forearm_link")
    rigid = robot.rigid
    data = rigid.createData()
    pin.forwardKinematics(rigid, data, position)
    assert shape.mesh is not None
    points = np.asarray(shape.mesh.vertices())
    expected = np.array([data.oMi[shape.joint].act(shape.placement).act(p) for p in points])
    plain = mujoco.MjData(model)
    for name, joint, angle in zip(robot.motor_names, robot.motor_joints, position, strict=True):
        plain.qpos[model.joint(name).qposadr[0]] = angle
        plain.qpos[model.joint(joint).qposadr[0]] = angle
    mujoco.mj_kinematics(model, plain)
    (geom,) = (i for i in range(model.ngeom) if model.geom(i).name.endswith("forearm_link"))
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    local = model.mesh_vert[first : first + count]
    seen = plain.geom_xpos[geom] + local @ plain.geom_xmat[geom].reshape(3, 3).T
    np.testing.assert_allclose(seen.min(axis=0), expected.min(axis=0), atol=2e-5)
    np.testing.assert_allclose(seen.max(axis=0), expected.max(axis=0), atol=2e-5)


def test_state_space(case: Case, tmp_path: Path) -> None:
    robot, path = case.robot, tmp_path / "robot.mat"
    robotmodels.export(robot, path, "state_space", case.positions)
    file = loadmat(path, simplify_cells=True)
    delays = np.reshape(file["output_delay"], (-1, 1)) + np.reshape(file["input_delay"], -1)
    late = np.exp(-1j * OMEGA * delays[..., None])
    responses = []
    for i in range(len(case.positions)):
        matrices = [file[name][..., i] for name in "ABCD"]
        G = control.ss(*matrices)(1j * OMEGA, squeeze=False)
        responses.append(np.moveaxis(G * late, -1, 0))
    assert relative(np.array(responses), case.expected) < TOLERANCE
    np.testing.assert_array_equal(file["positions"], np.squeeze(case.positions))
    rest = robot.equilibrium(case.positions).coordinates
    np.testing.assert_array_equal(file["equilibria"][:, : rest.shape[1]], rest)
    assert tuple(np.atleast_1d(file["outputs"])) == robot.output_names
    assert len(file["states"]) == len(file["state_units"]) == len(file["A"])
    assert tuple(np.atleast_1d(file["parameter_names"])) == robot.parameters.names
    own = robotmodels.state_space(robot, case.positions).frequency_response(OMEGA)
    assert relative(own, case.expected) < TOLERANCE


def test_urdf(case: Case, tmp_path: Path) -> None:
    robot, path = case.robot, tmp_path / "robot.urdf"
    left_out = robotmodels.export(robot, path, "urdf")
    for balance in robot.file.counterbalances:
        assert f"counterbalance {balance.name}" in left_out
    file = robot.file.model_copy(update={"counterbalances": [], "parameters": Choice()})
    robot = ElasticRobot(file, robot.folder)
    assert any(robot.file.springs[0].name in line for line in left_out)
    rigid = pin.buildModelFromUrdf(str(path))
    rigid.gravity.linear = np.array(robot.file.gravity)
    data, layout = rigid.createData(), robot.layout
    unsprung = np.zeros((len(case.positions), layout.arm_size))
    unsprung[:, layout.drives] = case.positions
    columns = [robot.arm.coordinate[name] for name in robot.motor_joints]
    order = [rigid.joints[rigid.getJointId(name)].idx_v for name in robot.motor_joints]
    T, offset = followers(path, rigid)
    for position, q in zip(case.positions, unsprung, strict=True):
        v = offset.copy()
        v += T[:, order] @ position
        there = pin.integrate(rigid, pin.neutral(rigid), v)
        mass = T.T @ pin.crba(rigid, data, there) @ T
        expected = mass_matrices(robot.arm, q[None])[0][np.ix_(columns, columns)]
        difference = mass[np.ix_(order, order)] - expected
        assert np.abs(difference).max() < 1e-12 * np.abs(expected).max()
        weight = (T.T @ pin.computeGeneralizedGravity(rigid, data, there))[order]
        load = gravity_torques(robot.arm, q[None])[0, columns]
        assert np.abs(weight - load).max() < 1e-12 * max(np.abs(load).max(), 1.0)


def followers(path: Path, rigid: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return T and c of v = T v + c, which moves joints that follow one that does not (mimic)."""
    T, offset = np.eye(rigid.nv), np.zeros(rigid.nv)
    for joint in ET.parse(path).getroot().iterfind("joint[mimic]"):
        mimic = joint.find("mimic")
        assert mimic is not None
        row, leader = (
            rigid.joints[rigid.getJointId(str(n))].idx_v
            for n in (joint.get("name"), mimic.get("joint"))
        )
        T[row], offset[row] = 0.0, float(mimic.get("offset", "0"))
        T[row, leader] = float(mimic.get("multiplier", "1"))
    return T @ T, T @ offset + offset  # the leader may follow too


def test_modes(case: Case, tmp_path: Path) -> None:
    robot, path = case.robot, tmp_path / "robot.json"
    robotmodels.export(robot, path, "modes", case.positions[:2])
    content = json.loads(path.read_text())
    assert content["coordinates"] == list(robot.coordinate_names)
    model = robotmodels.linearize(robot, case.positions[:2])
    for i, there in enumerate(content["positions"]):
        assert there["position"] == case.positions[i].tolist()
        expected = damped_modes(model.at(i))
        frequencies = [mode["frequency"] for mode in there["modes"]]
        np.testing.assert_allclose(frequencies, expected.frequencies, rtol=1e-12)
        for mode in there["modes"]:  # each solves (s^2 M + s D + K) shape = 0
            s = complex(*mode["pole"])
            shape = np.array(mode["shape"]["real"]) + 1j * np.array(mode["shape"]["imaginary"])
            K, D, M = (getattr(model.at(i), n) for n in ("stiffness", "damping", "mass"))
            forces = (s**2 * M + s * D + K) @ shape
            assert np.abs(forces).max() < 1e-6 * np.abs(K @ shape).max()


def test_a_wrong_spring_is_noticed(tmp_path: Path) -> None:
    """A negative control."""
    robot = robotmodels.load_robot("manutec_r3_hardening")
    position = np.array([[0.3, 0.5, -0.4, 0.2, 0.6, 0.1]])
    robotmodels.export(robot, tmp_path / "robot.xml", "mjcf", position)
    text = (tmp_path / "robot.xml").read_text()
    stiff = next(s for s in robot.file.springs if s.name == "b3y").stiffness
    assert text.count(f'"{stiff!r} 0.0 0.0"') > 0
    wrong = text.replace(f'"{stiff!r} 0.0 0.0"', f'"{stiff * (1 + 1e-4)!r} 0.0 0.0"')
    (tmp_path / "robot.xml").write_text(wrong)
    plain = ReloadedMjcf(tmp_path / "robot.xml")
    q = plain.equilibrium(position[0], list(robot.motor_joints))
    expected = robotmodels.frequency_response(robot, position, OMEGA)
    assert relative(plain.response(q, OMEGA, 0)[None], expected) > TOLERANCE


def test_mjcf_stands_still_at_its_keyframe(tmp_path: Path) -> None:
    """As MuJoCo runs it, friction and time step included."""
    robot = built(SENSED)
    robotmodels.export(robot, tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(200):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos, model.key_qpos[0], rtol=0, atol=1e-8)
    np.testing.assert_array_equal(model.opt.gravity, robot.file.gravity)


def test_mjcf_has_friction_and_sensors_of_the_shafts(tmp_path: Path) -> None:
    motors = [m | {"coulomb": 0.02, "torque_gain": 0.9} for m in WALL["motors"]]
    robot = built(changed(WALL, motors=motors))
    robotmodels.export(robot, tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[0] = 2.0
    mujoco.mj_forward(model, data)
    for i, motor in enumerate(robot.file.motors):
        shaft = model.actuator(motor.name).trnid[0]
        friction = model.dof_frictionloss[model.jnt_dofadr[shaft]]
        assert friction == pytest.approx(0.02 * abs(motor.gear_ratio))
        angle = data.sensor(f"{motor.name}.position").data[0]
        assert angle == pytest.approx(motor.gear_ratio * data.qpos[model.jnt_qposadr[shaft]])
        if i == 0:
            force = data.qfrc_actuator[model.jnt_dofadr[shaft]]
            assert force == pytest.approx(0.9 * motor.gear_ratio * 2.0)


def test_python_control_objects_have_named_signals() -> None:
    robot = built(SENSED)
    model = robotmodels.state_space(robot, np.zeros(len(robot.motor_names)))
    (system,) = model.to_control()
    (data,) = model.to_control_frd(OMEGA)
    assert system.input_labels == data.input_labels == [f"{n}_torque" for n in robot.motor_names]
    assert system.output_labels == data.output_labels == list(robot.output_names)
    late = np.exp(-1j * OMEGA * (model.output_delay[:, None] + model.input_delay)[..., None])
    np.testing.assert_allclose(
        system(1j * OMEGA) * late, data(1j * OMEGA), rtol=0, atol=1e-6 * np.abs(data.frdata).max()
    )
    assert model.output_units[-1] == "m/s^2"


def test_python_control_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = built(SENSED)
    model = robotmodels.state_space(robot, np.zeros(len(robot.motor_names)))
    monkeypatch.setitem(__import__("sys").modules, "control", None)
    with pytest.raises(IdentificationError, match=r"pip install 'elastic-robot-oed\[control\]'"):
        model.to_control()


def test_covariance_goes_along(tmp_path: Path) -> None:
    content = changed(SPLIT, fitted={"relative_std": {"d1.stiffness": 0.1}})
    robot = built(content)
    p = len(robot.parameters)
    position = np.zeros(6)
    covariance = robotmodels.state_space(robot, position).covariance
    assert covariance[0, 0] == pytest.approx(0.01)
    assert np.isnan(covariance).sum() == p * p - 1
    robotmodels.export(robot, tmp_path / "x.mat", "state_space", position, 0.2 * np.eye(p))
    stored = loadmat(tmp_path / "x.mat")["covariance_of_ln_parameters"]
    np.testing.assert_array_equal(stored, 0.2 * np.eye(p))
    with pytest.raises(InvalidInput, match=r"covariance: shape \(2, 2\) given"):
        robotmodels.state_space(robot, position, np.eye(2))


def test_odd_names_survive(tmp_path: Path) -> None:
    motors = [m | {"name": name} for m, name in zip(WALL["motors"], HOSTILE, strict=True)]
    content = changed(WALL, name="yes: no # é\t\"'", source="a\nb: {", motors=motors)
    robot = built(content)
    robotmodels.save_robot(robot, tmp_path / "robot.yaml")
    again = robotmodels.load_robot(tmp_path / "robot.yaml")
    assert again.motor_names == HOSTILE
    assert (again.file.name, again.file.source) == (robot.file.name, robot.file.source)
    robotmodels.export(robot, tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert tuple(model.actuator(i).name for i in range(5)) == HOSTILE
    robotmodels.export(robot, tmp_path / "robot.urdf", "urdf")
    pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))


HOSTILE = ("yes", "1e3", "<m & 'n'>", "ключ #1", "null")


def test_meshes_of_a_urdf_are_found_from_its_new_folder(tmp_path: Path) -> None:
    source = (Path(__file__).parents[1] / "engines" / "crane.urdf").read_text()
    mesh = '<visual><geometry><mesh filename="meshes/a.stl"/></geometry></visual>'
    head, tail = source.split("<inertial>", 1)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "crane.urdf").write_text(f"{head}{mesh}<inertial>{tail}")
    text = yaml.safe_dump(CRANE)
    (tmp_path / "old" / "crane.yaml").write_text(text)
    robot = robotmodels.load_robot(tmp_path / "old" / "crane.yaml")
    robotmodels.export(robot, tmp_path / "new" / "sub" / "crane.urdf", "urdf")
    assert 'filename="../../old/meshes/a.stl"' in (tmp_path / "new/sub/crane.urdf").read_text()


def test_mistakes_are_named(tmp_path: Path) -> None:
    robot = built(SPLIT)
    with pytest.raises(InvalidInput, match=r"format: 'mujoco' is unknown.*mjcf, urdf"):
        robotmodels.export(robot, tmp_path / "x", "mujoco")  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match=r"ends in \.yaml"):
        robotmodels.save_robot(robot, tmp_path / "robot.xml")
    with pytest.raises(InvalidInput, match="outside its limits"):
        robotmodels.export(robot, tmp_path / "x.xml", position=np.full(6, 10.0))
    with pytest.raises(InvalidInput, match=r"relative_std: 'd1.stifness' is not a parameter.*d1.s"):
        built(changed(SPLIT, fitted={"relative_std": {"d1.stifness": 0.1}}))
    (tmp_path / "file").write_text("")
    for format in ("mjcf", "robot", "state_space"):
        with pytest.raises(InvalidInput, match="cannot be written"):
            robotmodels.export(robot, tmp_path / "file" / "x.yaml", format)


def test_the_room_does_not_hide_the_function() -> None:
    importlib.import_module("robotmodels.exports.formats")
    assert callable(robotmodels.export)
