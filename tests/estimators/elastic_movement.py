"""A movement of an elastic kr300, integrated forward, with what its sensors would tell."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import robotmodels
from robotmodels import ElasticRobot
from robotmodels.records.movement import Movement

T = 0.004
DELAY = 3.0e-3
COULOMB, VISCOUS = np.array([300.0, 460.0, 400.0]), np.array([2000.0, 2000.0, 1600.0])
START = np.radians([0.0, -90.0, 90.0, 0.0, 20.0, 0.0])


@dataclass(frozen=True, eq=False)
class Truth:
    """The robot, and what its record must give."""

    robot: ElasticRobot
    movement: Movement
    gears: np.ndarray  # torques, (N, 3)


def loaded(mass: float) -> ElasticRobot:
    robot = robotmodels.load_robot("kr300")
    assert robot.file.payload is not None
    payload = robot.file.payload.model_copy(update={"mass": mass})
    return ElasticRobot(robot.file.model_copy(update={"payload": payload}), robot.folder)


@cache
def elastic_movement(mass: float = 150.0, duration: float = 12.0, seed: int = 0) -> Truth:
    """Return sums of slow sines of the motors, the links' answer and all torques."""
    robot = loaded(mass)
    time = np.arange(0, duration, T)
    rng = np.random.default_rng(seed)
    motor = np.tile(START, (len(time), 1))
    rise = np.sin(np.pi * np.clip(time / duration, 0, 1)) ** 2
    for j, size in enumerate((0.5, 0.35, 0.35, 0.1, 0.1, 0.1)):
        for hertz in (0.11, 0.23, 0.37):
            motor[:, j] += size / 2 * rise * np.sin(2 * np.pi * (hertz * time + rng.random()))
    motor = motor - motor[0] + START
    links, gears = answer(robot, CubicSpline(time, motor), time)
    late = motor.copy()
    late[:, :3] = CubicSpline(time, links)(time - DELAY)
    late[:, 3:] = np.nan
    curve = CubicSpline(time, motor)
    ratio = np.array([m.gear_ratio for m in robot.file.motors])
    inertia = np.array([m.inertia for m in robot.file.motors]) * ratio**2
    torque = inertia * curve(time, 2)
    torque[:, :3] += gears + COULOMB * np.sign(curve(time, 1)[:, :3])
    torque[:, :3] += VISCOUS * curve(time, 1)[:, :3]
    signals = {"motor_angle": motor, "link_angle": late, "motor_torque": torque}
    return Truth(robot, Movement(robot.motor_names, T, signals), gears)


def answer(
    robot: ElasticRobot, motor: CubicSpline, time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles behind the three gears, and the gears' torques, (N, 3)."""
    model, law = robot.arm.model, robot.arm.counterbalances[0].law
    data = model.createData()
    k, d = np.array([[s.stiffness, s.damping] for s in robot.file.springs]).T

    def gear(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return k * (motor(t)[:3] - q) + d * (motor(t, 1)[:3] - v)

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        q, v, a = motor(t), motor(t, 1), motor(t, 2)
        q[:3], v[:3], a[:3] = state[:3], state[3:], 0.0
        force = pin.rnea(model, data, q, v, a)[:3]
        force[1] -= law(q[1])[0]
        mass = pin.crba(model, data, q)[:3, :3]
        return np.concatenate([v[:3], np.linalg.solve(mass, gear(t, q[:3], v[:3]) - force)])

    q = motor(0.0)
    for _ in range(20):  # at rest
        load = pin.computeGeneralizedGravity(model, data, q)[:3]
        load[1] -= law(q[1])[0]
        q[:3] = motor(0.0)[:3] - load / k
    run = solve_ivp(slope, (0, time[-1]), [*q[:3], 0, 0, 0], "RK45", time, rtol=1e-6, atol=1e-9)
    q, v = run.y[:3].T, run.y[3:].T
    return q, k * (motor(time)[:, :3] - q) + d * (motor(time, 1)[:, :3] - v)
