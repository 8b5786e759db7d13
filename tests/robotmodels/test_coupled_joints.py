"""Joints that follow others (mimic, joint equalities): judged by MuJoCo's constraints."""

import mujoco
import numpy as np
import pytest
from derivatives import by_logarithms
from robots import HERE
from scipy.linalg import eigh, null_space
from simulated import T, errors, frf, records_of

from reports.commands.init_files import starter_files, write_starter_files
from robotmodels import InvalidInput, load_robot
from robotmodels.checks.proposed_drives import moving_joints
from robotmodels.checks.sub_chain import locked_couplings
from robotmodels.common.yaml_files import parse_yaml
from robotmodels.description.joint_drives import couplings
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf_check import checked_urdf
from robotmodels.elastic.dynamics import gravity, mass_matrices
from robotmodels.elastic.inverse_kinematics import Tool, inverse_kinematics
from robotmodels.elastic.rigid_pose import joint_origins
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.exports.export import export
from robotmodels.linear.response import frequency_response, linearize, sensitivity

ARM = (HERE / "parallelogram.xml").read_text()
ROBOT = (HERE / "parallelogram.yaml").read_text().replace("parallelogram.xml", "arm.xml")
POSITION = np.array([0.35, -0.4])


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "robot.yaml").write_text(ROBOT)
    return tmp_path


def rigid(folder):
    """Return the robot without its passive torsion, payload and sensor."""
    content = "\n".join(line for line in ROBOT.split("payload")[0].splitlines() if "b1" not in line)
    return ElasticRobot(parse_yaml(content, RobotFile, "robot.yaml"), folder)


def judged(folder, q):
    """Return MuJoCo's reduced mass matrix and gravity, (2, 2) and (2,), at lift and nod."""
    model = mujoco.MjModel.from_xml_path(str(folder / "arm.xml"))
    data = mujoco.MjData(model)
    level = 0.1 - 0.9 * q[0]
    data.qpos[:] = q[0], level, q[1], 0.02 - 1.1 * level
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-14
    jacobian = np.zeros((model.nv, model.nv))
    for i in range(data.ne):
        unit = np.zeros(data.nefc)
        unit[i] = 1.0
        mujoco.mj_mulJacTVec(model, data, jacobian[i], unit)
    free = null_space(jacobian[: data.ne])
    free = free @ np.linalg.inv(free[[0, 2]])  # a unit of lift, a unit of nod
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return free.T @ mass @ free, free.T @ data.qfrc_bias


@pytest.mark.parametrize("rounding", [0.0, 1e-13])
def test_mass_and_gravity_are_mujocos(folder, rounding):
    robot = rigid(folder)
    assert robot.coordinate_names == ("lift", "nod", "m1", "m2")
    q = np.array([0.3, -0.7]) * (1 + rounding)
    mass, torques = judged(folder, q)
    network = robot.network(POSITION[None])
    here = gravity(robot.arm, q[None])
    assert np.allclose(here.torques[0], torques, rtol=1e-10)
    assert np.allclose(mass_matrices(robot.arm, q[None])[0], mass, rtol=1e-10)
    assert network.mass.shape == (1, 4, 4)
    step = 1e-5
    slopes = [
        (judged(folder, q + d)[1] - judged(folder, q - d)[1]) / (2 * step) for d in step * np.eye(2)
    ]
    assert np.allclose(here.slopes[0], slopes, rtol=1e-7, atol=1e-7 * np.abs(slopes).max())
    shift = np.array([[0.3, -0.8]])
    assert np.allclose(here.slopes_times(shift)[0], here.slopes[0] @ shift[0], rtol=1e-12)
    assert np.all(np.abs(here.slopes[0]).sum(axis=1) <= here.slope_bounds[0] * (1 + 1e-12))


def test_resonances_are_those_of_the_constrained_robot(folder):
    robot = rigid(folder)
    q = robot.equilibrium(POSITION[None]).coordinates[0]
    mass, torques = judged(folder, q)
    stiffness = np.array([9.0e4, 3.0e3])
    assert np.allclose(stiffness * (q - POSITION), -torques, rtol=1e-9)
    step = 1e-5
    slopes = np.array(
        [
            (judged(folder, q + d)[1] - judged(folder, q - d)[1]) / (2 * step)
            for d in step * np.eye(2)
        ]
    )
    motors = np.array([1.0e-3 * 100**2, 2.0e-5 * 80**2])
    K = np.block(
        [
            [np.diag(stiffness) + slopes, -np.diag(stiffness)],
            [-np.diag(stiffness), np.diag(stiffness)],
        ]
    )
    M = np.block([[mass, np.zeros((2, 2))], [np.zeros((2, 2)), np.diag(motors)]])
    model = linearize(robot, POSITION)
    own = eigh(model.stiffness.reshape(4, 4), model.mass.reshape(4, 4), eigvals_only=True)
    assert np.allclose(own, eigh(K, M, eigvals_only=True), rtol=1e-6, atol=1e-3)
    # A locked follower is another robot.
    content = robot.file.model_copy(update={"lock": {"level": 0.0, "rod": 0.0}})
    locked = ElasticRobot(content, folder)
    assert locked.locked_followers == {"level": "lift", "rod": "lift"}
    stiff = linearize(locked, POSITION)
    other = eigh(stiff.stiffness.reshape(4, 4), stiff.mass.reshape(4, 4), eigvals_only=True)
    assert np.abs(other / own - 1).max() > 0.05


def test_sensitivities_with_torsions_payload_and_sensors(folder):
    robot = load_robot(folder / "robot.yaml")
    assert robot.coordinate_names == ("lift", "b1", "nod", "m1", "m2")
    omega = 2 * np.pi * np.array([5.0, 17.0, 40.0])
    _, J = sensitivity(robot, POSITION[None], omega)
    changes = by_logarithms(
        lambda theta: linearize(robot, POSITION, theta).frequency_response(omega),
        robot.parameters.values,
    )
    assert np.abs(J - changes.reshape(J.shape)).max() < 1e-6 * np.abs(J).max()


def test_small_motions_of_the_simulation_have_the_linear_models_frf(folder):
    content = parse_yaml(ROBOT.split("accelerometers")[0], RobotFile, "robot.yaml")
    robot = ElasticRobot(content, folder)
    records = records_of(robot, POSITION, samples=2000, amplitude=1e-4, transient=4)
    expected = frequency_response(robot, POSITION[None], records.omega)[0]
    magnitude, phase = errors(frf(records), expected)
    assert magnitude < 2e-4
    assert phase < 0.01
    # A negative control: the follower locked.
    locked = ElasticRobot(content.model_copy(update={"lock": {"rod": 0.0}}), folder)
    other = frequency_response(locked, POSITION[None], records.omega)[0]
    assert errors(frf(records), other)[0] > 0.01


def test_large_motions_follow_mujocos_own_constraints(folder):
    """The recorded torques, replayed through mj_step with MuJoCo's soft constraints."""
    robot = ElasticRobot(
        parse_yaml(ROBOT.split("accelerometers")[0], RobotFile, "robot.yaml"), folder
    )
    records = records_of(robot, POSITION, samples=400, amplitude=20.0, transient=0, experiments=1)
    export(robot, folder / "out.xml", position=POSITION)
    model = mujoco.MjModel.from_xml_path(str(folder / "out.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    model.opt.timestep, model.opt.integrator = T / 16, mujoco.mjtIntegrator.mjINT_RK4
    model.eq_solref[:, 0] = T / 8
    angles = []
    for u in records.torque[0, 0, 0, 0]:
        angles.append(data.actuator_length.copy() if angles else records.angle[0, 0, 0, 0, 0])
        data.ctrl[:] = u
        mujoco.mj_step(model, data, 16)
    moved = np.abs(np.array(angles) - angles[0]).max()
    assert moved > 1.0
    assert np.abs(records.angle[0, 0, 0, 0] - angles).max() < 1e-3 * moved


def test_poses_limits_and_inverse_kinematics(folder):
    robot = rigid(folder)
    # The leader stays where its followers can go with it.
    content = ARM.replace('range="-0.9 1.4"', 'range="-0.6 0.5"')
    (folder / "narrow").mkdir()
    (folder / "narrow" / "arm.xml").write_text(content)
    narrow = rigid(folder / "narrow")
    assert narrow.position_limits[0] == pytest.approx(((0.5 - 0.1) / -0.9, (-0.6 - 0.1) / -0.9))
    assert robot.position_limits[0] == pytest.approx((-1, 1))
    model = mujoco.MjModel.from_xml_path(str(folder / "arm.xml"))
    data = mujoco.MjData(model)
    level = 0.1 - 0.9 * POSITION[0]
    data.qpos[:] = POSITION[0], level, POSITION[1], 0.02 - 1.1 * level
    mujoco.mj_forward(model, data)
    assert np.allclose(joint_origins(robot, POSITION)[-2], data.body("hand").xpos, atol=1e-14)
    point = data.body("hand").xpos + data.body("hand").xmat.reshape(3, 3) @ [0, 0, 0.2]
    rng = np.random.default_rng(0)
    tool = Tool("hand", (0.0, 0.0, 0.2))
    reached = inverse_kinematics(robot, tool, point, solutions=9, starts=20, rng=rng)
    assert np.abs(reached - POSITION).max(axis=1).min() < 1e-4


def test_init_keeps_coupled_axes_and_locks_grippers(folder):
    starter = starter_files(str(folder / "arm.xml"), folder / "new")
    write_starter_files(starter, folder / "new")
    robot = load_robot(folder / "new" / "robot.yaml")
    assert robot.motor_joints == ("lift", "nod")
    assert robot.file.lock == {}
    joints = {j.name: j for j in moving_joints(folder / "arm.xml")}
    assert joints["lift"].load == pytest.approx(judged(folder, np.zeros(2))[0][0, 0], rel=0.05)
    checked = checked_urdf(folder / "arm.xml")
    locked = locked_couplings(tuple(joints.values()), couplings(checked), {"lift": 0.5})
    assert locked == pytest.approx({"lift": 0.5, "level": -0.35, "rod": 0.02 + 1.1 * 0.35})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("urdf: arm.xml", "urdf: arm.xml\nlock: {lift: 0.5}", "'lift' is held under 'lock'"),
        ("joint: nod, gear", "joint: level, gear", r"'level' follows 'lift' \(mimic\) and has nei"),
    ],
)  # fmt: skip
def test_mistakes_are_named(folder, old, new, message):
    (folder / "robot.yaml").write_text(ROBOT.replace(old, new))
    with pytest.raises(InvalidInput, match=message):
        load_robot(folder / "robot.yaml")


def test_circles_and_chains_of_couplings(folder):
    assert couplings(checked_urdf(folder / "arm.xml"))["rod"].leader == "lift"
    assert couplings(checked_urdf(folder / "arm.xml"))["rod"].multiplier == pytest.approx(0.99)
    (folder / "arm.xml").write_text(ARM.replace('joint2="lift"', 'joint2="rod"'))
    with pytest.raises(InvalidInput, match="mimics itself, by way of"):
        load_robot(folder / "robot.yaml")
