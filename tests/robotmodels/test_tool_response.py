"""Compliance and receptance of points of links, against closed forms and MuJoCo's forces there."""

import pickle

import mujoco
import numpy as np
import pytest
from mujoco_arm import MujocoArm
from robots import CRANE, PARALLELOGRAM, PENDULUM, SPLIT, WALL, built

from robotmodels import (
    ElasticRobot,
    Frame,
    InvalidInput,
    compliance_ellipsoid,
    load_robot,
    tool_frame,
    tool_model,
)
from robotmodels.description.outputs import Output
from robotmodels.description.urdf import locate
from robotmodels.elastic.tool_response import frame_kinematics

TIP = Frame("rod", (0.8, 0.0, 0.0))
FRAMES = {
    "ur10": Frame("tool0", (0.1, 0.05, 0.2)),
    "split": Frame("forearm_link", (0.02, 0.0, 0.3)),
    "wall": None,
}


def robot_of(name):
    return built({"split": SPLIT, "wall": WALL}[name]) if name != "ur10" else load_robot(name)


def judge_of(robot, frame):
    sensor = Output(name="frame", link=frame.link, quantity="acceleration", at=frame.at,
                    direction=(1.0, 0.0, 0.0))  # fmt: skip
    file = robot.file.model_copy(update={"outputs": [sensor]})
    return MujocoArm(file, locate(robot.file.urdf, robot.folder))


def site_jacobian(judge, q):
    """Return the Jacobian (6, d) of the site, and its rotation."""
    judge._at(q)
    jacobian = np.zeros((6, judge.model.nv))
    site = judge.model.site("frame").id
    mujoco.mj_jacSite(judge.model, judge.data, jacobian[:3], jacobian[3:], site)
    return jacobian, judge.data.site_xmat[site].reshape(3, 3)


def test_closed_form_of_one_link():
    robot, angle, w = built(PENDULUM), 0.4, np.array([3.0, 70.0])
    model = tool_model(robot, np.array([[angle]]), TIP)
    # The drive twists under gravity; inertia 1.2, 4 kg at 0.5 m, axis along -y.
    twisted = robot.equilibrium(np.array([[angle]])).coordinates[0, 0]
    slope = 5e3 - 4 * 9.81 * 0.5 * np.sin(twisted)
    across = 0.8 * np.array([-np.sin(twisted), 0.0, np.cos(twisted)])
    column = np.concatenate([across, [0.0, -1.0, 0.0]])
    expected = np.outer(column, column)
    np.testing.assert_allclose(model.compliance()[0], expected / slope, atol=1e-15, rtol=1e-9)
    clamped = 1 / (slope - 1.2 * w**2 + 4j * w)
    for k, motion in enumerate(("displacement", "velocity", "acceleration")):
        response = model.response(w, motion)[0]
        factor = ((1j * w) ** k * clamped)[:, None, None]
        np.testing.assert_allclose(response, factor * expected, atol=1e-15, rtol=1e-9)
    # A free motor: its inertia and friction behind the spring, in series.
    spring, motor = 5e3 + 4j * w, 2500 * (-1e-3 * w**2 + 2e-3j * w)
    arm = slope - 5e3 - 1.2 * w**2
    free = 1 / (arm + spring * motor / (spring + motor))
    response = model.response(w, motors="free")[0]
    np.testing.assert_allclose(response[:, 2, 2], free * across[2] ** 2, rtol=1e-9)
    shaft = model.response(w, motors="free", at="motors")[0, :, 0, 4]
    np.testing.assert_allclose(shaft, -50 * free * spring / (spring + motor), rtol=1e-9)
    # Under an endlessly stiff position controller it is clamped.
    stiff = model.response(w, motors=lambda w: np.full((len(w), 1, 1), 1e12))[0]
    np.testing.assert_allclose(stiff, clamped[:, None, None] * expected, atol=1e-12, rtol=1e-6)


def test_ellipsoid_of_one_link():
    compliance = tool_model(built(PENDULUM), np.array([[0.0], [0.4]]), TIP).compliance()
    ellipsoid = compliance_ellipsoid(compliance)
    assert (ellipsoid.values[:, 1:] == 0).all()
    for values, directions, C in zip(
        ellipsoid.values, ellipsoid.directions, compliance, strict=True
    ):
        np.testing.assert_allclose(directions * values @ directions.T, C[:3, :3], atol=1e-18)


@pytest.mark.parametrize("name", FRAMES)
def test_responses_are_those_of_mujocos_matrices(name):
    robot = robot_of(name)
    frame = FRAMES[name] or tool_frame(robot)
    judge, w = judge_of(robot, frame), 2 * np.pi * np.array([4.0, 31.0])
    rng = np.random.default_rng(3)
    positions = rng.uniform(*robot.position_limits.T, (3, len(robot.motor_names)))
    free, axes = tool_model(robot, positions, frame), Frame(frame.link, frame.at, "link")
    responses = free.response(w, motors="free")
    turned = tool_model(robot, positions, axes).compliance()
    for i, position in enumerate(positions):
        q = judge.equilibrium(position, {})
        J, R = site_jacobian(judge, q)
        np.testing.assert_allclose(free.point[i], judge.data.site_xpos[0], atol=1e-9)
        M, D, K, _ = judge.linear_model(position, {})
        for k, x in enumerate(w):
            expected = J @ np.linalg.solve(K - x**2 * M + 1j * x * D, J.T)
            assert abs(responses[i, k] - expected).max() < 1e-6 * abs(expected).max()
        loose = np.setdiff1d(np.arange(len(q)), judge.held())
        expected = J[:, loose] @ np.linalg.solve(K[np.ix_(loose, loose)], J[:, loose].T)
        assert abs(free.compliance()[i] - expected).max() < 1e-6 * abs(expected).max()
        both = np.kron(np.eye(2), R)
        expected = both.T @ expected @ both
        assert abs(turned[i] - expected).max() < 1e-6 * abs(expected).max()


def test_receptance_is_that_of_a_simulated_force_at_the_site():
    """A sinusoidal force at the tool, MuJoCo's own dynamics, motors held by huge inertias."""
    ur10, frame = load_robot("ur10"), FRAMES["ur10"]
    # Transients die away sooner.
    damped = [s.model_copy(update={"damping": 3 * s.damping}) for s in ur10.file.springs]
    robot = ElasticRobot(ur10.file.model_copy(update={"springs": damped}))
    heavy = [m.model_copy(update={"inertia": 1e6}) for m in robot.file.motors]
    judge = judge_of(ElasticRobot(robot.file.model_copy(update={"motors": heavy})), frame)
    position = np.array([0.3, -1.2, 0.9, 0.4, -0.7, 0.2])
    q = judge.equilibrium(position, {})
    model, data = judge.model, mujoco.MjData(judge.model)
    frequency, period, force = 16.0, 500, 5.0
    model.opt.timestep = 1 / frequency / period
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data.qpos[:], site = q, model.site("frame")
    w, body = 2 * np.pi * frequency, model.site_bodyid[site.id]
    vector, moves = np.array([0.6, 0.0, -0.8]), []
    for step in range(40 * period):  # transients die away in the first ones
        mujoco.mj_forward(model, data)
        moves.append(data.site_xpos[site.id].copy())
        data.qfrc_applied[:] = 0.0
        # The force of the middle of the step is that of its hold.
        push = force * np.sin(w * (step + 0.5) * model.opt.timestep) * vector
        point = data.site_xpos[site.id]
        mujoco.mj_applyFT(model, data, push, np.zeros(3), point, body, data.qfrc_applied)
        mujoco.mj_step(model, data)
    last = np.array(moves[-2 * period :])
    turn = np.exp(-2j * np.pi * np.arange(len(last)) / period)[:, None]
    measured = 2 / len(last) * (last * turn).sum(axis=0) * 1j / force
    expected, control = (
        tool_model(robot, position[None], at).response(np.array([w]))[0, 0, :3, :3] @ vector
        for at in (frame, Frame("tool0"))
    )
    assert abs(measured - expected).max() < 2e-3 * abs(expected).max()
    assert abs(measured - control).max() > 0.02 * abs(expected).max()


@pytest.mark.parametrize("content", [CRANE, PARALLELOGRAM, SPLIT], ids=lambda c: c["name"])
def test_jacobians_are_derivatives_of_the_point_by_coordinates(content):
    """Also where joints follow others, and motors stay behind."""
    robot = built(content)
    low, high = robot.position_limits.T
    position = (0.6 * low + 0.4 * high)[None]
    frame, theta = tool_frame(robot), robot.parameters.values
    coordinates = robot.equilibrium(position).coordinates
    jacobian = tool_model(robot, position, frame).jacobian[0]
    assert not jacobian[:, coordinates.shape[1] :].any()
    for j, step in enumerate(1e-6 * np.eye(coordinates.shape[1])):
        ahead, behind = (
            frame_kinematics(robot, frame, coordinates + h, theta)[1][0] for h in (step, -step)
        )
        np.testing.assert_allclose(jacobian[:3, j], (ahead - behind) / 2e-6, atol=1e-7)


def test_robots_do_not_grow_with_the_frames_that_are_asked_for():
    robot, at = built(PENDULUM), np.array([[0.4]])
    sizes = []
    for height in (0.1, 0.2, 0.3):
        tool_model(robot, at, Frame("rod", (0.8, 0.0, height)))
        sizes.append(len(pickle.dumps(robot)))
    assert sizes[2] == sizes[0]


def test_mistakes_name_frame_and_motors():
    robot, at = built(PENDULUM), np.array([[0.4]])
    with pytest.raises(InvalidInput, match=r"^frame: 'rood' is not a link of the URDF.*rod"):
        tool_model(robot, at, Frame("rood"))
    with pytest.raises(InvalidInput, match="frame: axes 'tool' is unknown"):
        Frame("rod", axes="tool")
    with pytest.raises(InvalidInput, match="x, y, z in the link's frame"):
        Frame("rod", (0.1, 0.2))
    with pytest.raises(InvalidInput, match="link 'base' does not move"):
        tool_model(robot, at, Frame("base"))
    with pytest.raises(InvalidInput, match="clamped motors do not move"):
        tool_model(robot, at, TIP).response(np.array([1.0]), at="motors")
