"""Encoders, torque sensors and sensors on links as rows of FRFs; their gains, delays and lags."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from reloaded_mjcf import ReloadedMjcf, differences
from robots import PENDULUM, built, with_spring

import estimators
import oed
import robotmodels
from estimators.frf.file_formats import read_records, write_records
from estimators.frf.spectra import spectra
from estimators.sampling.log_posterior import batched_frequency_response
from oed.information_sets.line_information import sensor_information
from robotmodels import ElasticRobot, InvalidInput, Records, kernel
from robotmodels.description.robot_file import RobotFile, read_robot_file
from robotmodels.simulation.plant_model import build_plant
from robotmodels.simulation.readings import _spring_torque
from robotmodels.simulation.simulate_block import linearise_gears, open_gears

LIBRARY = Path(robotmodels.__file__).parent / "library"
OMEGA = 2 * np.pi * np.array([3.0, 11.0, 25.0, 60.0])
POSITIONS = np.array([[0.3, -1.0, 0.8, -0.4, 0.9, 0.2], [-0.5, -0.3, -1.2, 0.6, -0.7, 1.0]])
LOAD = {"mass": 5.0, "com": [0.05, 0.02, 0.2], "inertia": [0.05, 0.04, 0.03]}
OUTPUTS: list[dict[str, Any]] = [
    {"motor": "m1", "quantity": "angle"},
    {"motor": "m2", "quantity": "velocity"},
    {"motor": "m3", "quantity": "torque"},
    {"joint": "shoulder_lift_joint", "quantity": "angle"},
    {"joint": "elbow_joint", "quantity": "acceleration"},
    {"spring": "d2", "quantity": "torque"},
    {"spring": "b6z", "quantity": "torque"},
    {"link": "forearm_link", "quantity": "acceleration", "at": [0, 0, 0.3], "direction": [1, 0, 0]},
    {"link": "wrist_3_link", "quantity": "angular_velocity", "direction": [0.3, 1, 0.2]},
    {
        "name": "fz", "link": "tool0", "quantity": "force", "at": [0, 0.02, 0.1],
        "direction": [0.1, 0.4, 1],
    },
    {
        "name": "tx", "link": "tool0", "quantity": "torque", "at": [0, 0.02, 0.1],
        "direction": [1, 0.4, 0.1],
    },
]  # fmt: skip
CHANNELS = {1: {"gain": -1.1, "delay": 1e-3, "lag": 2e-3}, 2: {"lag": 1e-3}, 3: {"delay": 3e-3}}
FREE = [
    "m1.torque_lag",
    "m4.torque_delay",
    "m2 velocity.gain",
    "m2 velocity.delay",
    "m2 velocity.lag",
    "payload.mass",
    "payload.com.z",
    "m2.inertia",
]


def ur10(outputs: list[dict[str, Any]], **changes: Any) -> ElasticRobot:
    content = read_robot_file(LIBRARY / "ur10.yaml").model_dump(by_alias=True, exclude_unset=True)
    content["springs"][1]["stiffness"] = {"low": 2e4, "high": 6e4, "torque": 150.0}
    content |= {"payload": {"link": "tool0", **LOAD}, "outputs": outputs}
    return ElasticRobot(RobotFile.model_validate(content | changes), LIBRARY)


def late() -> ElasticRobot:
    """Return the robot with gains, delays and lags, all of them free, of torques too."""
    outputs = [output | CHANNELS.get(i, {}) for i, output in enumerate(OUTPUTS)]
    path = LIBRARY / "ur10.yaml"
    motors = deepcopy(read_robot_file(path).model_dump(exclude_unset=True)["motors"])
    motors[0]["torque_lag"], motors[3]["torque_delay"] = 1e-3, 5e-4
    return ur10(outputs, motors=motors, parameters={"extra": FREE})


def test_sensitivities_are_central_differences() -> None:
    robot = late()
    G, J = robotmodels.sensitivity(robot, POSITIONS, OMEGA)
    np.testing.assert_allclose(
        G, robotmodels.frequency_response(robot, POSITIONS, OMEGA), rtol=1e-10
    )
    rows = (0, 1, 3)
    step = 1e-4
    for i, name in enumerate(robot.parameters.names):

        def response(steps: int, i: int = i) -> np.ndarray:
            theta = robot.parameters.values.copy()
            theta[i] *= np.exp(steps * step)
            return robotmodels.frequency_response(robot, POSITIONS, OMEGA, theta)

        difference = (8 * (response(1) - response(-1)) - response(2) + response(-2)) / (12 * step)
        scale = np.abs(difference).max(axis=rows) + 1e-6 * np.abs(G).max(axis=rows)
        error = np.abs(J[..., i] - difference).max(axis=rows)
        assert (error < 1e-5 * scale).all(), name


def test_the_state_space_has_the_same_responses() -> None:
    robot = late()
    expected = robotmodels.frequency_response(robot, POSITIONS, OMEGA)
    model = robotmodels.state_space(robot, POSITIONS)
    error = np.abs(model.frequency_response(OMEGA) - expected).max(axis=(0, 1, 3))
    assert (error < 1e-8 * np.abs(expected).max(axis=(0, 1, 3))).all()
    assert model.states[-3:] == ("m1.torque", "m2 velocity.reading", "m3 torque.reading")
    assert len(model.states) == len(model.state_units) == model.A.shape[-1]


def test_mujocos_own_sensors_read_the_same(tmp_path: Path) -> None:
    robot = ur10(OUTPUTS)
    left_out = robotmodels.export(robot, tmp_path / "robot.xml", "mjcf", POSITIONS)
    assert [line for line in left_out if "no such sensor" in line] == [
        "output 'elbow_joint acceleration': MuJoCo has no such sensor",
        "output 'b6z torque': MuJoCo has no such sensor",
    ]
    plain = ReloadedMjcf(tmp_path / "robot.xml")
    sensors = {plain.model.sensor(i).name for i in range(plain.model.nsensor)}
    rows = [i for i, name in enumerate(robot.output_names) if name in sensors]
    assert len(rows) == 6
    names = [robot.output_names[i] for i in rows]
    expected = robotmodels.frequency_response(robot, POSITIONS, OMEGA)[:, :, rows]
    for position, response in zip(POSITIONS, expected, strict=True):
        q = plain.equilibrium(position, list(robot.motor_joints))
        error = np.abs(sensor_response(plain, q, names) - response).max(axis=(0, 2))
        assert (error < 1e-9 * np.abs(response).max(axis=(0, 2))).all()


def sensor_response(plain: ReloadedMjcf, q: np.ndarray, names: list[str]) -> np.ndarray:
    """Return the FRFs of MuJoCo's sensors, (F, m, n), by differences of readings and forces."""
    model, data, still, off = plain.model, plain.data, 0 * q, np.zeros(plain.model.nu)

    def read(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, 0.0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        data.qacc[:] = a
        mujoco.mj_rnePostConstraint(model, data)
        for evaluate in (mujoco.mj_sensorPos, mujoco.mj_sensorVel, mujoco.mj_sensorAcc):
            evaluate(model, data)
        last = [model.sensor(name).adr[0] + model.sensor(name).dim[0] - 1 for name in names]
        return data.sensordata[last].copy()

    K = -differences(lambda x: plain.forces(x, still, off), q, 1e-3)
    D = -differences(lambda x: plain.forces(q, x, off), still, 1e-3)
    S = differences(lambda x: plain.forces(q, still, x), off, 1.0)
    plain.forces(q, still, off)
    M = np.eye(model.nv)
    for column in M:  # mj_fullM takes other arguments before MuJoCo 3.8
        mujoco.mj_mulM(model, data, column, column.copy())
    C0 = differences(lambda x: read(x, still, still), q, 1e-3)
    C1 = differences(lambda x: read(q, x, still), still, 1e-3)
    C2 = differences(lambda x: read(q, still, x), still, 1.0)
    w = OMEGA[:, None, None]
    X = np.linalg.solve(K - w**2 * M + 1j * w * D, np.broadcast_to(S, (len(w), *S.shape)))
    return (C0 + 1j * w * C1 - w**2 * C2) @ X


MANUTEC: list[dict[str, Any]] = [
    {"motor": "m1", "quantity": "acceleration"},
    {"motor": "m2", "quantity": "angle", "lag": 2e-3, "delay": 1.3e-3},
    {"motor": "m3", "quantity": "torque", "lag": 1e-3},
    {"joint": "joint2", "quantity": "angle", "delay": 3.3e-3},
    {"joint": "joint3", "quantity": "acceleration", "gain": -1.0},
    {"spring": "g2", "quantity": "torque"},
    {"link": "link6", "quantity": "acceleration", "at": [0, 0, 0.3], "direction": [1, 0, 0.2]},
    {"link": "link6", "quantity": "angular_velocity", "direction": [0.3, 1, 0.2]},
    {"name": "fz", "link": "link6", "quantity": "force", "direction": [0.1, 0.4, 1]},
    {"name": "tx", "link": "link6", "quantity": "torque", "direction": [1, 0.4, 0.1]},
]
AT = np.array([[0.0, 0.5, -0.8, 0.0, 0.6, 0.0]])


def manutec(outputs: list[dict[str, Any]]) -> ElasticRobot:
    path = LIBRARY / "manutec_r3.yaml"
    content = read_robot_file(path).model_dump(by_alias=True, exclude_unset=True)
    content |= {"payload": {"link": "link6", **LOAD}, "outputs": outputs}
    content["motors"][0]["torque_lag"] = 4e-3
    content["motors"][1]["torque_delay"] = 1.5e-3
    return ElasticRobot(RobotFile.model_validate(content), LIBRARY)


def records(robot: ElasticRobot, sample_time: float, **noise: Any) -> Records:
    """Return closed-loop records of one position, the transient gone."""
    rng = np.random.default_rng(1)
    samples = round(1 / sample_time)
    band = (2 * np.pi, 2 * np.pi * 40)
    multisine = oed.band_multisine(samples, sample_time, band, inputs=6, count=8)
    plan = oed.experiment_plan(
        robot, AT, multisine, blocks=1, periods=1, speed=1.0, acceleration=2.0, rng=rng
    )
    controller = robotmodels.default_controller(robot, sample_time)
    parts = robotmodels.simulate(
        robot, plan.visited, plan.signals, controller, lines=multisine.lines, rng=rng,
        transient=4, periods=2, **noise,
    )  # fmt: skip
    return Records.join(list(parts))


def test_simulated_readings_are_those_of_the_linear_model() -> None:
    """Held torques would alias into readings that no spring parts from them."""
    robot = manutec(MANUTEC)
    measured = spectra(records(robot, 1e-3))
    outputs, inputs, _ = measured.averaged()

    def errors(model: ElasticRobot) -> np.ndarray:
        expected = robotmodels.frequency_response(model, AT, measured.omega)[0] @ inputs[0]
        error = np.abs(outputs[0] - expected).max(axis=2) / np.abs(expected).max(axis=2)
        return np.asarray(error.max(axis=0))

    assert (errors(robot) < 1e-3).all()
    prompt = [motor.model_copy(update={"torque_lag": 0.0}) for motor in robot.file.motors]
    file = robot.file.model_copy(update={"motors": prompt})
    assert errors(ElasticRobot(file, robot.folder))[0] > 0.1


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("gap", [0.0, 2e-3])
def test_torque_sensors_read_gears_as_they_are_simulated(linear: bool, gap: float) -> None:
    """MuJoCo's own passive forces, of a hardening gear under gravity, perhaps with a gap."""
    stiffness = {"low": 2e3, "high": 9e3, "torque": 40.0}
    robot = built(with_spring(PENDULUM, "g", stiffness=stiffness))
    motors = [motor.model_copy(update={"viscous": 0.0}) for motor in robot.file.motors]
    file = robot.file.model_copy(update={"motors": motors})
    plant = build_plant(file, robot.model_file)
    state = np.array([0.1, 0.11])
    if linear:
        linearise_gears(plant, state)
    state = open_gears(plant, state, np.array([gap]))
    motion = np.random.default_rng(1).normal(size=(2, 50, 2)) * [[[0.01]], [[0.1]]]
    motion[0] += state
    forces = []
    for plant.data.qpos[:], plant.data.qvel[:] in motion.swapaxes(0, 1):
        mujoco.mj_forward(plant.model, plant.data)
        forces.append(-plant.data.qfrc_passive[plant.coordinate("m")])
    readings = _spring_torque(plant, file, "g", motion)
    np.testing.assert_allclose(readings, forces, rtol=1e-9, atol=1e-9)


def test_springs_from_a_joint_encoder_and_a_torque_sensor() -> None:
    """Three outputs, six torques, one run."""
    robot = manutec([MANUTEC[i] for i in (0, 3, 5)])
    noise = robotmodels.Imperfections(
        friction=0.0, nonlinear_gears=False, angle_noise=1e-6, output_noise=[0.0, 1e-9, 1e-3]
    )
    measured = records(robot, 0.5e-3, imperfections=noise)
    fit = estimators.fit(robot, estimators.run_spectra(measured, "periods"))
    assert fit.converged
    truth = robot.parameters.values[:3]
    np.testing.assert_allclose(fit.parameters.values[:3], truth, rtol=0.02)


def test_posteriors_know_that_a_springs_torque_changes_with_the_spring() -> None:
    network = ur10(OUTPUTS).network(POSITIONS)
    theta = network.parameters.values * np.array([[1.0], [1.3]])
    expected = [network.frequency_response(OMEGA, each) for each in theta]
    batch = batched_frequency_response(network, theta, OMEGA)
    np.testing.assert_allclose(batch, expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("ending", [".h5", ".csv", ".mat"])
def test_records_keep_what_is_differentiated(ending: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    shape = (1, 1, 2, 1, 16)
    made = Records(
        np.zeros((1, 2)), 1e-3, *(rng.normal(size=(*shape, k)) for k in (2, 2, 3)),
        lines=np.array([1, 3]), detection=np.array([2]),
        saturated=np.zeros((1, 1, 2, 1, 2), dtype=bool), derivatives=np.array([0, 2, 1]),
    )  # fmt: skip
    write_records(tmp_path / f"records{ending}", made)
    again = read_records(tmp_path / f"records{ending}")
    np.testing.assert_array_equal(again.derivatives, made.derivatives)
    plain = spectra(made).output / spectra(again).output
    np.testing.assert_allclose(plain, 1.0)
    with pytest.raises(InvalidInput, match=r"derivatives: .* 0, 1 or 2 for each of the 3 outputs"):
        Records(**{**vars(made), "derivatives": np.array([0, 1])})


def test_every_output_beside_the_encoders_can_be_bought() -> None:
    robot = ur10(OUTPUTS)
    base, added = sensor_information(robot, POSITIONS, OMEGA, robotmodels.RelativeNoise())
    assert len(added) == len(OUTPUTS) - 2
    assert set(added) == set(robot.output_names) - {"m1 angle", "m2 velocity"}
    # Without a floor the errors of all rows are as independent here as there.
    robot, without_floor = ur10(OUTPUTS[3:] + OUTPUTS[:2]), robotmodels.RelativeNoise(0.03, 0.0)
    whole = oed.information(robot, POSITIONS, OMEGA, without_floor).matrices
    base, added = sensor_information(robot, POSITIONS, OMEGA, without_floor)
    parts = base.matrices + sum(one.matrices for one in added.values())
    np.testing.assert_allclose(parts, whole, atol=1e-9 * np.abs(whole).max())


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ({"motor": "m7", "quantity": "angle"}, "output 'm7 angle': no motor 'm7'; there are m1"),
        ({"spring": "x", "quantity": "torque"}, "output 'x torque': no spring 'x'"),
        ({"joint": "elbow", "quantity": "angle"}, "output 'elbow angle': 'elbow'.*elbow_joint"),
        ({"joint": "elbow_joint", "quantity": "torque"}, "'torque' is not measured on a joint"),
        ({"quantity": "angle"}, "give one of motor, joint, spring and link, not 0"),
        ({"motor": "m1", "link": "tool0", "quantity": "angle"}, "and link, not 2"),
        ({"link": "tool0", "quantity": "acceleration"}, "a direction other than zero is needed"),
        ({"motor": "m1", "quantity": "angle", "gain": 0.0}, "gain must not be zero"),
        ({"motor": "m1", "quantity": "angle", "at": [0, 0, 1]}, "belong to sensors on links"),
        (
            {"link": "forearm_link", "quantity": "force", "direction": [0, 0, 1]},
            "is that of the payload, which is on tool0",
        ),
        ({"motor": "m2", "quantity": "angle", "name": "m1"}, "'m1' is used 2 times"),
    ],
)
def test_outputs_that_do_not_exist(output: dict[str, Any], message: str) -> None:
    with pytest.raises((ValueError, InvalidInput), match=message):
        ur10([output])


def test_angles_of_all_motors_by_name_are_those_without_outputs() -> None:
    """Ideal encoders that a file names leave the compiled way open; one with a gain does not."""
    robot = ur10([])
    named: list[dict[str, Any]] = [{"motor": m, "quantity": "angle"} for m in robot.motor_names]
    network = ur10(named).network(POSITIONS)
    assert network.only_motors
    response = kernel.frequency_response(network, OMEGA)
    plain = robot.network(POSITIONS).frequency_response(OMEGA) / -(OMEGA**2)[:, None, None]
    np.testing.assert_allclose(response, plain, rtol=0, atol=1e-12 * np.abs(plain).max())
    named[0] = {**named[0], "gain": 1.01}
    assert not ur10(named).network(POSITIONS).only_motors


def test_the_older_keys_stand_alone() -> None:
    for older in ({"output": "velocity"}, {"accelerometers": []}):
        with pytest.raises(ValueError, match="give either 'outputs' or"):
            ur10(OUTPUTS, **older)
