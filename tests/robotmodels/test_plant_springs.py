"""Springs and dampers of the plant's loop against MuJoCo's passive forces."""

import mujoco
import numpy as np
import pytest

import robotmodels
from robotmodels.kernel.compiling import entry
from robotmodels.simulation import plant_loop
from robotmodels.simulation.plant_model import build_plant
from robotmodels.simulation.simulate_block import open_gears, springs_of, static_state


@entry
def spring_forces(springs, q, v, forces):
    plant_loop.add_spring_forces(springs, q, v, forces, 1.0)


@pytest.mark.parametrize("gap", [0.0, 0.02])
@pytest.mark.parametrize("hardens", [True, False])
def test_forces_are_mujocos(hardens: bool, gap: float) -> None:
    robot = robotmodels.load_robot("manutec_r3_26")
    plant = build_plant(robot.file, robot.model_file)
    state, _ = static_state(plant, robot, np.array([0.3, -0.5, 0.8, 0.5, 0.7, 0.2]), "")
    if hardens:
        plant.model.tendon_stiffnesspoly[:, 1] = 10 * plant.model.tendon_stiffness
    state = open_gears(plant, state, np.full(6, gap))
    springs, rng = springs_of(plant), np.random.default_rng(0)
    within = 0
    for size in (0.003, 0.03, 0.3):
        plant.data.qpos[:] = state + size * rng.normal(size=len(state))
        plant.data.qvel[:] = rng.normal(size=len(state))
        mujoco.mj_forward(plant.model, plant.data)
        forces = np.zeros(len(state))
        spring_forces(springs, plant.data.qpos.copy(), plant.data.qvel.copy(), forces)
        expected = plant.data.qfrc_passive
        assert np.abs(forces - expected).max() < 1e-12 * np.abs(expected).max()
        low, high = plant.model.tendon_lengthspring.T
        within += int(((low < plant.data.ten_length) & (plant.data.ten_length < high)).sum())
    assert (within > 0) == (gap > 0)  # some gears were in their gaps
