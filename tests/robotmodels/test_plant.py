"""The simulated robot: its linear model in small motions, MuJoCo in large ones, its records."""

from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from robots import PENDULUM, SPLIT, built, changed
from simulated import UR10_POSITION, T, errors, frf, odd_lines, pendulum, records_of

import robotmodels
from robotmodels import (
    Controller,
    ElasticRobot,
    Imperfections,
    InvalidInput,
    NoEquilibrium,
    Records,
    SolverFailed,
    default_controller,
    simulate,
)
from robotmodels.description.urdf import locate
from robotmodels.simulation.imperfections import IDEAL
from robotmodels.simulation.plant_model import build_plant
from robotmodels.simulation.simulate_block import static_state


@pytest.fixture(scope="module")
def ur10_records() -> Records:
    return records_of(robotmodels.load_robot("ur10"), UR10_POSITION)


def test_small_motions_have_the_linear_models_frf(ur10_records: Records) -> None:
    expected = robotmodels.frequency_response(
        robotmodels.load_robot("ur10"), UR10_POSITION, ur10_records.omega
    )[0]
    magnitude, phase = errors(frf(ur10_records), expected)
    assert magnitude < 2e-4
    assert phase < 0.01


def test_the_hold_matters(ur10_records: Records) -> None:
    """A negative control."""
    expected = robotmodels.frequency_response(
        robotmodels.load_robot("ur10"), UR10_POSITION, ur10_records.omega
    )[0]
    assert errors(frf(ur10_records, hold=False), expected)[1] > 5.0


def test_records_obey_the_controllers_law(ur10_records: Records) -> None:
    r = ur10_records
    c = default_controller(robotmodels.load_robot("ur10"), T)
    U, Y, R = (
        np.fft.fft(s[0, 0, :, -1], axis=1)[:, r.lines] for s in (r.torque, r.angle, r.reference)
    )
    expected = c.prefilter(r.omega) * R - c.feedback(r.omega) * Y
    assert np.abs(U - expected).max() < 1e-5 * np.abs(U).max()


@pytest.mark.parametrize("nonlinear", [pytest.param(False, marks=pytest.mark.slow), True])
def test_cuts_foundations_and_hardening_gears(nonlinear: bool) -> None:
    """Small motions about gravity's torque see the tangent, whether gears harden or not."""
    robot = built(SPLIT)
    flaws = replace(IDEAL, nonlinear_gears=nonlinear)
    r = records_of(robot, UR10_POSITION, samples=2000, imperfections=flaws, amplitude=1e-4)
    expected = robotmodels.frequency_response(robot, UR10_POSITION, r.omega)[0]
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert (np.abs(frf(r) - expected) / scale).max() < 2e-4


def test_rest_is_the_robots_equilibrium() -> None:
    robot = built(SPLIT)
    plant = build_plant(robot.file, locate(robot.file.urdf, robot.folder))
    rest, hold = static_state(plant, robot, UR10_POSITION[0], "")
    found = dict(zip(plant.names, rest, strict=True))
    expected = robot.equilibrium(UR10_POSITION).coordinates[0]
    for name, value in zip(robot.coordinate_names, expected, strict=False):
        assert abs(found[name] - value) < 1e-9
    level = pendulum()
    plant = build_plant(level.file, locate(level.file.urdf, level.folder))
    _, torque = static_state(plant, level, np.zeros(1), "")
    body = level.rigid.inertias[1]
    sag = level.equilibrium(np.zeros((1, 1))).coordinates[0, 0]
    assert abs(torque[0]) == pytest.approx(9.81 * body.mass * body.lever[0] * np.cos(sag) / 50)
    assert hold.shape == (6,)


def test_a_delay_and_a_torque_gain() -> None:
    robot = built(
        changed(PENDULUM, delay=7.3e-4, motors=[PENDULUM["motors"][0] | {"torque_gain": 1.3}])
    )
    r = records_of(robot, np.zeros(1), samples=2000)
    expected = robotmodels.frequency_response(robot, np.zeros((1, 1)), r.omega)[0]
    magnitude, phase = errors(frf(r), expected)
    assert magnitude < 2e-4
    assert phase < 0.01


LARGE = [
    ("manutec_r3_26", 6.0, T, 1.5e-5),
    ("manutec_r3_26", 60.0, T, 1.5e-4),
    ("ur10", 60.0, T, 4e-5),
    ("ur10", 6.0, 4e-3, 3e-5),
    ("kr300", 60.0, T, 2e-5),
]


@pytest.mark.parametrize(("name", "amplitude", "sample_time", "tolerance"), LARGE)
def test_large_motions_follow_mujocos_own_steps(
    name: str, amplitude: float, sample_time: float, tolerance: float
) -> None:
    """The recorded torques, replayed through mj_step in small steps.

    Geometry is held over a millisecond at most, so velocity terms err in proportion to the
    amplitude squared. The KR300 has a counterbalance between points, in MuJoCo a tendon.
    """
    robot = robotmodels.load_robot(name)
    flaws = replace(IDEAL, nonlinear_gears=True)
    position = np.array([0.3, -0.5, 0.8, 0.5, 0.7, 0.2])
    r = records_of(
        robot,
        position,
        samples=500,
        amplitude=amplitude,
        transient=0,
        imperfections=flaws,
        experiments=1,
        lines=odd_lines(500, high=60.0 if sample_time == T else 5.0),
        controller=default_controller(robot, sample_time),
    )
    plant = build_plant(robot.file, locate(robot.file.urdf, robot.folder))
    model, data = plant.model, plant.data
    data.qpos[:], _ = static_state(plant, robot, position, "")
    data.qvel[:] = 0.0
    steps = round(sample_time / T * 4)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = sample_time / steps
    ratio = np.array([m.gear_ratio for m in robot.file.motors])
    angles = []
    for u in r.torque[0, 0, 0, 0]:
        angles.append(ratio * data.qpos[plant.motors])
        data.qfrc_applied[plant.motors] = ratio * u
        mujoco.mj_step(model, data, steps)
    moved = np.abs(np.array(angles) - angles[0]).max()
    assert moved > 0.05 * amplitude  # [rad] of a motor
    assert np.abs(r.angle[0, 0, 0, 0] - angles).max() < tolerance * moved


def test_records_say_what_was_done() -> None:
    robot = pendulum()
    lines = np.array([1, 5])
    signals = np.random.default_rng(0).normal(size=(3, 2, 100, 1)) * 1e-3
    calls: list[tuple[int, int]] = []
    parts = list(
        simulate(
            robot,
            np.array([[0.0], [0.4]]),
            signals,
            default_controller(robot, T),
            lines=lines,
            detection=np.array([3]),
            rng=np.random.default_rng(0),
            periods=2,
            transient=0,
            progress=lambda done, total: calls.append((done, total)),
        )
    )
    assert calls == [(i, 6) for i in range(1, 7)]
    r = Records.join(parts)
    assert r.torque.shape == (2, 3, 2, 2, 100, 1)
    assert r.saturated.shape == (2, 3, 2, 2, 1)
    np.testing.assert_array_equal(r.positions, [[0.0], [0.4]])
    np.testing.assert_array_equal(r.reference[1, :, :, 0], signals)
    assert (r.lines.tolist(), r.detection.tolist(), r.sample_time) == ([1, 5], [3], T)
    start = r.angle[:, :, :, 0, 0, 0]
    np.testing.assert_allclose(start, np.array([0.0, 20.0])[:, None, None] * np.ones((2, 3, 2)))


def test_the_transient_dies_out() -> None:
    robot = pendulum()
    r = records_of(robot, np.zeros(1), samples=1000, transient=3, periods=2)
    first, second = r.angle[0, 0, 0, :, :, 0]
    assert 0 < np.abs(first - second).max() < 1e-3 * np.ptp(first)


def test_a_ramp_leaves_less_of_the_transient() -> None:
    left = []
    N = 1000
    rise = np.minimum(4 * np.arange(N) / N, 1)
    for envelope in (None, (1 - np.cos(np.pi * rise)) / 2):
        r = records_of(
            pendulum(), np.zeros(1), samples=N, transient=1, periods=3, envelope=envelope
        )
        first, _, last = r.angle[0, 0, 0, :, :, 0]
        left.append(np.abs(first - last).max() / np.ptp(last))
        np.testing.assert_array_equal(r.reference[0, 0, :, 0], r.reference[0, 0, :, -1])
    assert left[1] < left[0] / 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"envelope": np.ones(3)}, "envelope: 100 finite numbers"),
        ({"envelope": np.zeros(100), "transient": 0}, "envelope: the first period is recorded"),
    ],
)
def test_envelopes_that_do_not_fit_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        records_of(pendulum(), np.zeros(1), samples=100, lines=np.array([1]), **options)


def seeded(seed: int, executor: Executor | None = None) -> Records:
    robot = pendulum(coulomb=0.01)
    flaws = Imperfections(angle_noise=1e-5, torque_disturbance=1e-3)
    signals = np.random.default_rng(0).normal(size=(2, 2, 100, 1))
    return Records.join(
        list(
            simulate(
                robot,
                np.array([[0.0], [0.4]]),
                signals,
                default_controller(robot, T),
                lines=np.array([1]),
                imperfections=flaws,
                rng=np.random.default_rng(seed),
                executor=executor,
            )
        )
    )


def test_a_seed_gives_the_same_records_in_parallel_or_not() -> None:
    alone = seeded(1)
    with ThreadPoolExecutor(2) as pool:
        together = seeded(1, pool)
    np.testing.assert_array_equal(alone.angle, together.angle)
    np.testing.assert_array_equal(alone.torque, together.torque)
    assert not np.array_equal(alone.angle, seeded(2).angle)
    assert not np.array_equal(alone.angle[0, 0], alone.angle[0, 1])


# Mistakes


def run(robot: ElasticRobot, signals: np.ndarray, **options: Any) -> None:
    n = len(robot.motor_names)
    arguments = {
        "positions": np.zeros((1, n)),
        "controller": default_controller(robot, T),
        "lines": np.array([1]),
        "rng": np.random.default_rng(0),
    }
    arguments |= options
    positions, controller = arguments.pop("positions"), arguments.pop("controller")
    list(simulate(robot, positions, signals, controller, **arguments))


@pytest.mark.parametrize(
    ("signals", "options", "message"),
    [
        (np.zeros((2, 100, 1)), {}, "signals: shape"),
        (np.zeros((1, 1, 100, 2)), {}, "signals: shape"),
        (np.zeros((2, 1, 1, 100, 1)), {}, "each of the 1 positions"),
        (np.full((1, 1, 100, 1), np.nan), {}, "signals: not all values are finite"),
        (np.zeros((1, 1, 100, 1)), {"periods": 0}, "periods: 0 measured"),
        (np.zeros((1, 1, 100, 1)), {"lines": np.array([50])}, "lines"),
        (np.zeros((1, 1, 100, 1)), {"positions": np.full((1, 1), 99.0)}, "outside its limits"),
        (
            np.zeros((1, 1, 100, 1)),
            {"imperfections": Imperfections(backlash=[0.1, 0.1])},
            "backlash has 2 values",
        ),
        (
            np.zeros((1, 1, 100, 1)),
            {"controller": Controller(np.ones(2), np.ones(2), np.ones(2), T)},
            "controller: 2 motors, the robot has 1",
        ),
    ],
)
def test_what_does_not_fit_is_refused(
    signals: np.ndarray, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        run(pendulum(), signals, **options)


def test_an_unstable_loop_is_told() -> None:
    robot = pendulum()
    c = default_controller(robot, T)
    wild = replace(c, speed_gain=100 * c.speed_gain)
    signals = np.full((1, 1, 100, 1), 1e-3)
    with pytest.raises(SolverFailed, match=r"position 1, block 1, run 1: .* after"):
        run(robot, signals, controller=wild, periods=20)


def test_a_robot_that_cannot_stand() -> None:
    soft = changed(PENDULUM, springs=[PENDULUM["springs"][0] | {"stiffness": 10.0}])
    with pytest.raises(NoEquilibrium):
        run(built(soft), np.zeros((1, 1, 100, 1)))
