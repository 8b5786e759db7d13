import warnings
from dataclasses import replace

import numpy as np
import pytest
from mass_springs import MassSprings

from estimators import FrfEstimate, check_rigid_limit, simulate_frf
from estimators.frf.rigid_body_check import rigid_response
from robotmodels import (
    IdentificationWarning,
    InvalidInput,
    RelativeNoise,
    frequency_response,
    load_robot,
)

OMEGA = 2 * np.pi * np.linspace(2, 60, 30)


@pytest.fixture(scope="module", params=["ur10", "manutec_r3"])
def case(request):
    robot = load_robot(request.param)
    rng = np.random.default_rng(0)
    positions = rng.uniform(-1, 1, (4, len(robot.motor_names)))
    return robot, simulate_frf(robot, positions, OMEGA, RelativeNoise(0.1, 0.02), rng)


def with_response(estimate, response):
    return FrfEstimate(
        estimate.positions, estimate.omega, response, estimate.covariance, estimate.repetitions
    )


def messages(case, change):
    robot, estimate = case
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        changed = with_response(estimate, change(estimate.response))
        std = np.abs(change(np.sqrt(estimate.variance) + 0j))
        found = check_rigid_limit(replace(changed, covariance=std**2), robot)
    said = [str(w.message) for w in caught if w.category is IdentificationWarning]
    assert tuple(said) == found.messages
    return said


def turned(motor):
    sign = np.ones(6)
    sign[motor] = -1
    return sign


def test_right_data_pass_in_silence(case):
    assert messages(case, lambda G: G) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda G: -G, "all signs are wrong; turn the torques' or the angles'"),
        (lambda G: turned(1)[:, None] * G, "angle of motor 2: wrong sign"),
        (lambda G: turned(1) * G, "torque of motor 2: wrong sign"),
        (lambda G: turned(1)[:, None] * G * turned(1), "motor 2: torque and angle are both"),
        (lambda G: G * 180 / np.pi, r"angles look like degrees: gain 57.*lowest 3 lines"),
        (lambda G: G * np.pi / 180, "angles look converted from degrees"),
        (lambda G: G / (2 * np.pi), "angles look like revolutions"),
        (lambda G: G * 1e3, "angles look like milliradians, or torques like kN m: gain"),
        (lambda G: G * 652, r"torques or angles have another unit: gain 65\d everywhere"),
        (lambda G: G / (1j * OMEGA[:, None, None]), "speeds in place of accelerations"),
        (lambda G: G / (1j * OMEGA[:, None, None]) ** 2, "angles in place of accelerations"),
        (lambda G: G[:, :, [1, 0, 2, 3, 4, 5]], "angles: motors 1 and 2 look exchanged"),
        (lambda G: G[..., [0, 2, 1, 3, 4, 5]], "torques: motors 2 and 3 look exchanged"),
        (np.conj, "position 1: motors give power.*conjugated"),
        (lambda G: G * np.exp(-4e-3j * OMEGA[:, None, None]), r"position 1: .* at least \d.* late"),
    ],
)
def test_mistakes_are_named(case, change, expected):
    import re

    assert any(re.search(expected, text) for text in messages(case, change))


def test_a_gear_ratio_is_recognised(case):
    gears = np.abs(case[0].network(case[1].positions).selector).max(axis=0)
    (text,) = messages(case, lambda G: G / gears[:, None])
    alike = np.ptp(gears) == 0
    assert text.startswith("angles look like those of the arm side" if not alike else "")


def test_motors_that_are_coupled_to_nothing_prove_nothing():
    model = MassSprings()
    positions = np.array([[0.0], [1.0]])
    omega = 2 * np.pi * np.linspace(0.5, 3, 6)
    noise = RelativeNoise(0.02, 0.01)
    estimate = simulate_frf(model, positions, omega, noise, np.random.default_rng(1))
    diagonal = with_response(estimate, estimate.response * np.eye(2))
    assert check_rigid_limit(diagonal, model).messages == ()
    swapped = with_response(estimate, turned(1)[:2, None] * estimate.response * turned(1)[:2])
    with pytest.warns(IdentificationWarning, match="motor 1: torque and angle are both"):
        check_rigid_limit(swapped, model)


def test_the_rigid_response_is_the_limit_of_stiff_springs():
    model = MassSprings()
    positions = np.array([[0.0], [1.0]])
    stiff = model.parameters.values.copy()
    stiff[:3] *= 1e9
    omega = np.array([1.0, 10.0])
    rigid = rigid_response(model.network(positions), omega)
    assert np.allclose(rigid, model.network(positions, stiff).frequency_response(omega), rtol=1e-4)


def test_another_robot_is_refused():
    _, estimate = (
        None,
        simulate_frf(
            MassSprings(), np.array([[0.0]]), OMEGA, RelativeNoise(), np.random.default_rng(1)
        ),
    )
    wide = FrfEstimate(
        estimate.positions,
        estimate.omega,
        estimate.response[:, :, :, :1],
        estimate.covariance[:, :, :, :1],
        estimate.repetitions,
    )
    with pytest.raises(
        InvalidInput, match="FRFs of 2 outputs and 1 motors against a model of 2 and 2"
    ):
        check_rigid_limit(wide, MassSprings())


def test_a_band_that_starts_above_the_anti_resonance_is_not_judged():
    robot = load_robot("moberg_axis1")
    positions = np.zeros((1, 1))
    omega = 2 * np.pi * np.arange(6.0, 30.0, 2.0)
    G = frequency_response(robot, positions, omega)
    estimate = FrfEstimate(positions, omega, G, np.abs(G) ** 2 * 1e-6, np.ones(1, dtype=int))
    limit = check_rigid_limit(estimate, robot)
    assert limit.messages == ()
    assert np.isnan(limit.ratio).all()
