"""Sharp Coulomb friction of the plant, step by step, against its closed form."""

import numpy as np
import pytest

from robotmodels.kernel.compiling import entry
from robotmodels.simulation import plant_loop
from robotmodels.simulation.plant_loop import Drives, MujocoState

_STEP = 1e-3


@entry
def apply_coulomb_friction(state, drives, before, impulses, step):
    plant_loop.apply_coulomb_friction(state, drives, before, impulses, step)


def _followed(
    speed: float, push: float, friction: float, steps: int, damping: float = 0.0
) -> tuple[float, float]:
    """Return angle and speed of a unit inertia after so many steps of a constant push.

    Between corrections of friction it moves by the exact solution.
    """
    one, none = np.ones(1), np.zeros(1)
    state = MujocoState(
        0, 0, np.zeros(1), np.array([speed]), none, none, none, none, False, np.zeros((0, 1))
    )
    drives = Drives(
        np.array([0]), one, one, np.array([np.inf]), np.array([friction]), none, none,
        np.ones((1, 1)), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    impulses = np.zeros(1)
    for _ in range(steps):
        before = state.qvel.copy()
        acting = push + impulses / _STEP
        decay, fallen = _STEP, 0.5 * _STEP**2
        if damping > 0:
            decay = -np.expm1(-damping * _STEP) / damping
            fallen = (_STEP - decay) / damping
        state.qpos[:] += decay * state.qvel + acting * fallen
        state.qvel[:] += (acting - damping * state.qvel) * decay
        apply_coulomb_friction(state, drives, before, impulses, _STEP)
    return float(state.qpos[0]), float(state.qvel[0])


def test_friction_is_damped_within_its_step() -> None:
    """Taken off after each step, it would seem larger by half of step times rate of damping."""
    speed, friction, damping, steps = 1.0, 2.0, 20.0, 15
    _, velocity = _followed(speed, 0.0, friction, steps, damping)
    steady = -friction / damping
    right = steady + (speed - steady) * np.exp(-damping * _STEP * steps)
    first = 0.5 * damping * _STEP * friction * _STEP  # before friction of any step is there
    assert velocity == pytest.approx(right, abs=1.1 * first)
    assert abs(velocity - right) < 0.1 * first * steps


def _closed_form(speed: float, push: float, friction: float, time: float) -> tuple[float, float]:
    sign = np.sign(speed)
    slowed = push - sign * friction
    stop = -speed / slowed if sign * slowed < 0 else np.inf
    if time <= stop:
        return speed * time + slowed * time**2 / 2, speed + slowed * time
    at_stop = speed * stop + slowed * stop**2 / 2
    on = np.sign(push) * max(abs(push) - friction, 0.0)
    return at_stop + on * (time - stop) ** 2 / 2, on * (time - stop)


@pytest.mark.parametrize("seed", range(20))
def test_speeds_after_a_reversal_are_exact(seed: int) -> None:
    """Friction of a whole step in the last direction would come half a step early."""
    rng = np.random.default_rng(seed)
    speed, friction = rng.uniform(0.05, 0.2), rng.uniform(1, 5)
    push = -friction * rng.uniform(0.3, 3)  # sticks, or turns around
    if seed % 2:
        speed, push = -speed, -push
    angle, velocity = _followed(speed, push, friction, steps=200)
    right_angle, right_velocity = _closed_form(speed, push, friction, 200 * _STEP)
    assert velocity == pytest.approx(right_velocity, abs=1e-12)
    assert angle == pytest.approx(right_angle, abs=3 * friction * _STEP**2)
