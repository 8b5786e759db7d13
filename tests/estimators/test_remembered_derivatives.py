"""What a problem computed last is not computed again, nor kept for ever, changed or sent along."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from weakref import ref

import numpy as np
import pytest

import estimators
import robotmodels


@pytest.fixture(scope="module")
def fit():
    robot = robotmodels.load_robot("moberg_axis1")
    omega = 2 * np.pi * np.geomspace(2, 60, 30)
    noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
    positions = np.zeros((2, len(robot.motor_joints)))
    data = estimators.simulate_frf(robot, positions, omega, noise, np.random.default_rng(4))
    return estimators.fit(robot, data, residual="nls", weights="optimal")


def test_the_latest_fits_only_hold_derivatives(fit):
    fits = [replace(fit) for _ in range(4)]
    linear = [ref(one.linearise()) for one in fits]
    assert [one() is None for one in linear] == [True, True, False, False]
    assert fits[3].linearise() is linear[3]()
    assert np.array_equal(fits[0].linearise().jacobian, fits[3].linearise().jacobian)


def test_results_that_are_shared_cannot_be_changed(fit):
    linear, at = fit.linearise(), fit.problem.derived(fit.parameters.values)
    for array in (linear.residuals, linear.jacobian, linear.covariance, *at):
        with pytest.raises(ValueError, match="read-only"):
            array += 1.0


def test_derivatives_do_not_travel(fit):
    without = len(pickle.dumps(replace(fit)))
    asked = replace(fit)
    linear = asked.linearise()
    assert len(pickle.dumps(asked)) == without
    assert len(pickle.dumps(asked.problem)) == len(pickle.dumps(replace(fit).problem))
    assert np.array_equal(pickle.loads(pickle.dumps(asked)).linearise().rows, linear.rows)


def test_threads_get_the_derivatives_that_they_ask_for(fit):
    values = [fit.parameters.values * factor for factor in (1.0, 1.1, 1.2)]
    expected = [replace(fit).problem.derived(x)[0].copy() for x in values]

    def asked(k):
        return np.array_equal(fit.problem.derived(values[k % 3])[0], expected[k % 3])

    with ThreadPoolExecutor(6) as threads:
        assert all(threads.map(asked, range(300)))
