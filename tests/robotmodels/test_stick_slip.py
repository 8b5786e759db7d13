"""Sharp Coulomb friction of the plant, step by step, against its closed form."""

import numpy as np
import pytest

from robotmodels.simulation.plant_loop import Drives, MujocoState, apply_coulomb_friction

_STEP = 1e-3


def _followed(speed: float, push: float, friction: float, steps: int) -> tuple[float, float]:
    """Return angle and speed of a unit inertia after so many steps of a constant push."""
    one, none = np.ones(1), np.zeros(1)
    state = MujocoState(0, 0, np.zeros(1), np.array([speed]), none, none, np.zeros((0, 1)))
    drives = Drives(
        np.array([0]), one, one, np.array([np.inf]), np.array([friction]), none, none,
        np.ones((1, 1)), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    impulses = np.zeros(1)
    for _ in range(steps):
        before = state.qvel.copy()
        state.qpos[:] += _STEP * state.qvel + 0.5 * push * _STEP**2
        state.qvel[:] += push * _STEP
        apply_coulomb_friction(state, drives, before, impulses, _STEP)
    return float(state.qpos[0]), float(state.qvel[0])


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
