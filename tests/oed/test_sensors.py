from functools import cache
from itertools import combinations

import numpy as np
import pytest
from random_candidates import information_set, random_set
from robots import SENSED, built

from oed import (
    Constraints,
    Sensor,
    information,
    optimal_design,
    optimal_sensors,
    sensor_information,
)
from robotmodels import InvalidInput, NotIdentifiable, RelativeNoise

Q, P = 30, 4
BASE = random_set(0, Q, P, 2)


def shop(count, seed=1):
    rng = np.random.default_rng(seed)
    return {
        f"s{i}": Sensor(
            information_set(np.exp(rng.normal()) * random_set(100 * seed + i, Q, P, 1).matrices),
            1.0 + rng.random(),
        )
        for i in range(count)
    }


def best_of_all(sensors, budget, base=BASE, **options):
    """Try every subset."""
    found = {}
    for k in range(len(sensors) + 1):
        for choice in combinations(sensors, k):
            if sum(sensors[name].cost for name in choice) <= budget:
                H = base.matrices + sum(sensors[name].information.matrices for name in choice)
                found[choice] = optimal_design(information_set(H), **options).value
    return max(found, key=found.get), found


@cache
def values_of_four():
    return best_of_all(shop(4), np.inf, solver="newton")[1]


@pytest.mark.parametrize("budget", [0.5, 2.0, 3.5, 20.0])
def test_choice_is_the_best_of_all(budget):
    sensors = shop(4)
    design = optimal_sensors(BASE, sensors, budget)
    values = values_of_four()
    choice = max((c for c in values if sum(sensors[n].cost for n in c) <= budget), key=values.get)
    assert design.sensors == choice
    assert design.design.value == pytest.approx(values[choice], abs=1e-5)
    assert design.cost == pytest.approx(sum(sensors[n].cost for n in choice))
    assert design.efficiency >= 1 - 1e-6
    assert design.relaxed_efficiency <= 1.0


def test_choice_for_the_worst_combination_after_experiments_there_are():
    sensors, prior = shop(3), np.diag([3.0, 1.0, 0.3, 0.0])
    design = optimal_sensors(BASE, sensors, 3.5, "E", prior=prior)
    choice, values = best_of_all(sensors, 3.5, criterion="E", prior=prior)
    assert design.sensors == choice
    assert design.design.value == pytest.approx(values[choice], rel=1e-5)
    # No choice reaches the relaxation's bound, and this one is the best.
    assert 0.8 < design.relaxed_efficiency <= 1.0
    assert f"{choice[0]:<12} without it " in str(design)


@pytest.mark.parametrize("prior", [None, np.eye(P)])
def test_the_relaxation_is_a_linear_problem_of_all_columns(prior):
    """Every set of sensors in every position is a column; cvxpy states them all."""
    sensors = shop(3)
    base = information_set(BASE.matrices[:6])
    some = {
        name: Sensor(information_set(one.information.matrices[:6]), one.cost)
        for name, one in sensors.items()
    }
    design = optimal_sensors(base, some, 2.0, prior=prior)
    columns, costs = [], []
    for k in range(4):
        for choice in combinations(some, k):
            columns.append(base.matrices + sum(some[n].information.matrices for n in choice))
            costs += [sum(some[n].cost for n in choice)] * len(base)
    matrices, costs = np.concatenate(columns), np.array(costs)
    rules = Constraints(experiments=1, linear={"cost": (costs, 2.0)})
    best = optimal_design(information_set(matrices), constraints=rules, prior=prior)
    reached = np.exp((design.design.value - best.value) / P)
    assert design.relaxed_efficiency == pytest.approx(reached, rel=2e-4)


def test_many_sensors_are_exchanged_and_bounded(monkeypatch):
    """More choices than are tried; the bound of the relaxation holds for the best of all."""
    monkeypatch.setattr("oed.design.sensors._MOST_TRIED", 2)
    sensors = shop(6, seed=2)
    design = optimal_sensors(BASE, sensors, 4.5)
    assert design.efficiency == design.relaxed_efficiency < 1.0  # not all were tried
    choice, values = best_of_all(sensors, 4.5, solver="newton")
    true = np.exp((design.design.value - values[choice]) / P)
    assert true > 0.98
    assert design.relaxed_efficiency <= true + 1e-6
    assert sum(design.usage[n] * sensors[n].cost for n in sensors) <= 4.5 * (1 + 1e-6)


def test_keep_says_what_each_sensor_is_worth():
    sensors = shop(3, seed=3)
    design = optimal_sensors(BASE, sensors, 3.0)
    _, values = best_of_all(sensors, 100.0, solver="newton")
    own = values[design.sensors]
    for name, kept in design.relative_efficiency.items():
        changed = tuple(n for n in sensors if (n in design.sensors) != (n == name))
        assert kept == pytest.approx(np.exp((values[changed] - own) / P), abs=1e-5)
        assert (kept < 1) == (name in design.sensors)


def test_a_useless_sensor_does_not_earn_its_keep():
    sensors = {"dead": Sensor(information_set(np.zeros((Q, P, P))), 1.0), **shop(1)}
    design = optimal_sensors(BASE, sensors, 2.0)
    assert design.sensors == ("s0",)
    both = optimal_sensors(BASE, sensors, 10.0)
    assert both.relative_efficiency["dead"] == pytest.approx(1.0, abs=1e-6)


def test_sensors_that_make_parameters_identifiable():
    blind = BASE.matrices.copy()
    blind[:, 1] = blind[:, :, 1] = 0.0
    base, sensors = information_set(blind), shop(3)
    design = optimal_sensors(base, sensors, 2.0)
    assert len(design.sensors) == 1
    assert design.relative_efficiency[design.sensors[0]] == 0.0
    with pytest.raises(
        NotIdentifiable, match=r"not identifiable: k1; budget: no set of sensors within 0\.5"
    ):
        optimal_sensors(base, sensors, 0.5)


@pytest.mark.parametrize(
    ("sensors", "budget", "criterion", "message"),
    [
        ({}, 1.0, "D", "sensors: none given"),
        (shop(1), -1.0, "D", "budget: -1.0 is not a number >= 0"),
        ({"a": Sensor(random_set(0, 5, P, 2))}, 1.0, "D", "sensors: a: 5 candidates"),
        ({"a": Sensor(BASE, np.nan)}, 1.0, "D", "sensors: a: cost: nan is not a number >= 0"),
        (shop(1), 2.0, "F", "criterion 'F' is not known"),
    ],
)
def test_sensors_that_do_not_fit(sensors, budget, criterion, message):
    with pytest.raises(InvalidInput, match=message):
        optimal_sensors(BASE, sensors, budget, criterion)


def test_accelerometers_of_a_robot_file():
    """What the motors tell does not know of accelerometers, and rows add up to the whole."""
    robot = built(SENSED)
    bare = built({key: value for key, value in SENSED.items() if key != "accelerometers"})
    positions = np.array([[0.2, -1.0, 0.7, 0.3, -0.4, 0.1]] * 66) * np.linspace(0.2, 1, 66)[:, None]
    omega, noise = 2 * np.pi * np.array([4.0, 9.0, 23.0]), RelativeNoise(0.03, 0.01)
    base, added = sensor_information(robot, positions, omega, noise)
    assert tuple(added) == ("tip", "elbow", "foot")
    alone = information(bare, positions, omega, noise)
    scale = np.abs(alone.matrices).max()
    np.testing.assert_allclose(base.matrices, alone.matrices, atol=1e-9 * scale)
    # Without a floor the errors of all rows are as independent here as there.
    relative = RelativeNoise(0.03, 0.0)
    base, added = sensor_information(robot, positions[:3], omega, relative)
    whole = information(robot, positions[:3], omega, relative).matrices
    parts = base.matrices + sum(one.matrices for one in added.values())
    np.testing.assert_allclose(parts, whole, atol=1e-9 * np.abs(whole).max())
    bought = optimal_sensors(base, {name: Sensor(one) for name, one in added.items()}, 1.0)
    assert len(bought.sensors) == 1
    with pytest.raises(InvalidInput, match="has no outputs beside motors' encoders"):
        sensor_information(bare, positions, omega, noise)
    with pytest.raises(InvalidInput, match="positions: none given"):
        sensor_information(robot, np.empty((0, 6)), omega, noise)
