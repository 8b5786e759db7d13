"""Start values for robots from chains: drive springs without a start."""

import numpy as np
import pytest

from estimators import simulate_frf
from estimators.chains.start_values_from_chains import chain_start_values
from robotmodels import RelativeNoise, load_robot
from robotmodels.common.errors import InvalidInput, NotIdentifiable

OMEGA = 2 * np.pi * np.linspace(2.0, 80.0, 120)


def measured(robot, omega=OMEGA, positions=1):
    low, high = robot.position_limits.T
    middle = (low + high) / 2 + 0.2 * (high - low) * np.sin(np.arange(len(low)) + 1)
    law = RelativeNoise(0.01, 0.003)
    return simulate_frf(
        robot, np.tile(middle, (positions, 1)), omega, law, np.random.default_rng(0)
    )


def test_drives_of_a_robot_without_passive_torsions():
    robot = load_robot("manutec_r3")
    found = chain_start_values(robot, measured(robot, positions=2), 1)
    names = robot.parameters.names
    ratio = dict(zip(names, found / robot.parameters.values, strict=True))
    for i in (1, 2, 3):
        assert ratio[f"g{i}.stiffness"] == pytest.approx(1.0, abs=0.03)
        assert ratio[f"g{i}.damping"] == pytest.approx(1.0, abs=0.3)


def test_bad_input():
    robot = load_robot("manutec_r3")
    estimate = measured(robot)
    with pytest.raises(InvalidInput, match="position 1: the estimate has positions 0 to 0"):
        chain_start_values(robot, estimate, 1)
    stiff = measured(robot, 2 * np.pi * np.linspace(0.1, 2.0, 120))
    with pytest.raises(NotIdentifiable, match="no clear resonance"):
        chain_start_values(robot, stiff)
