import numpy as np
import pytest
from two_chains import OMEGA, POSITIONS, drawn, truth, two_chains

from estimators import FrfEstimate, StartValues, fit, physics_start, simulate_frf
from estimators.fitting.anti_resonances import agreed
from robotmodels import CoupledChains, InvalidInput, RelativeNoise, load_robot

HERTZ = 2 * np.pi


def measured(robot, seed=0, frequencies=40):
    rng = np.random.default_rng(seed)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (6, len(low)))
    omega = HERTZ * np.geomspace(2.0, 100.0, frequencies)
    return simulate_frf(robot, positions, omega, RelativeNoise(0.02, 0.002), rng)


@pytest.fixture(scope="module")
def kr240():
    robot = load_robot("kr240_class")
    estimate = measured(robot)
    return robot, estimate, physics_start(robot, estimate)


def test_one_axis_by_its_closed_form():
    """Motor locked, mass 2 swings on K at sqrt(K/m2)."""
    chain = CoupledChains(np.array([[1.0, 2.0]]), np.array([[300.0]]), np.zeros((1, 1)))
    damped = CoupledChains(chain.masses, chain.springs, chain.couplings, np.array([[1.0]]))
    omega = np.linspace(5.0, 30.0, 400)
    estimate = drawn(truth(damped, omega), np.random.default_rng(0), RelativeNoise(0.01, 0), omega)
    wrong = CoupledChains(chain.masses, np.array([[5.0]]), chain.couplings, np.array([[1.0]]))
    stiffness, damping = physics_start(wrong, estimate).values
    assert np.isclose(stiffness, 300.0, rtol=0.05)
    assert 0.7 < damping < 1.4  # the truth is 1
    # Above the anti-resonance only the resonance sqrt(K (1/m1 + 1/m2)) is left.
    high = omega > 15.0
    estimate = FrfEstimate(
        POSITIONS, omega[high], estimate.response[:, high], estimate.covariance[:, high], [1]
    )
    assert np.isclose(physics_start(wrong, estimate).values[0], 300.0, rtol=0.05)


@pytest.mark.parametrize(
    "name", [pytest.param("ur10", marks=pytest.mark.slow), "kr240_class", "manutec_r3_26"]
)
def test_gears_are_found_within_a_factor(name, kr240):
    if name == "kr240_class":
        robot, _, start = kr240
    else:
        robot = load_robot(name)
        start = physics_start(robot, measured(robot))
    gears = [s.axis == "drive" for s in robot.file.springs]
    error = np.abs(np.log(start.values / robot.parameters.values)).round(9)
    assert error[: len(gears)][gears].max() < np.log(1.8)
    # As rough as stated: one in twenty beyond two standard deviations, none beyond four.
    assert np.mean(error > 2 * start.std) <= 0.1
    assert (error <= 4 * start.std).all()
    assert not (error < start.std / 2).all()


def test_the_stiffness_counts_on_which_positions_agree():
    own = np.log([2.0e4, 2.2e4, 1.9e4, 2.1e4])
    others = np.log([2.0e3, 5.0e2, 7.0e3, 9.0e5])  # deeper, but nowhere alike
    found = [(np.array(pair), np.array([1.0, 2.5])) for pair in zip(own, others, strict=True)]
    assert np.isclose(agreed(found), 2.05e4, rtol=0.02)
    assert np.isnan(agreed([(others[:1], np.ones(1)), (others[1:2], np.ones(1))]))
    assert np.isclose(agreed([(own[:1], np.ones(1))]), 2.0e4)
    assert np.isnan(agreed([(own[:0], own[:0])]))


def test_the_models_own_values_do_not_matter(kr240):
    robot, estimate, expected = kr240

    class Softer:
        parameters = robot.parameters

        def network(self, positions, parameters=None):
            given = robot.parameters.values if parameters is None else parameters
            return robot.network(positions, 5.0 * given)

    found = physics_start(Softer(), estimate)
    # One step of the search where two values serve alike.
    assert np.abs(np.log(found.values / expected.values)).max() < np.log(1.5)


@pytest.mark.parametrize("start", ["physics", "chains"])
def test_fits_from_the_data_alone_find_the_truth(start, kr240):
    robot, estimate, _ = kr240
    found = fit(robot, estimate, start=start)
    assert found.converged
    assert np.abs(np.log(found.parameters.values / robot.parameters.values)).max() < 0.2
    assert not np.allclose(found.start, robot.parameters.values, rtol=1e-3)


def test_stiffnesses_known_better_take_their_place():
    model = two_chains()
    estimate = drawn(truth(model), np.random.default_rng(0))
    start = physics_start(model, estimate, drives={1: 151.0})
    assert np.isclose(start.values[1], 151.0)
    assert np.isclose(start.values[0], physics_start(model, estimate).values[0])
    assert start.std[1] < start.std[0]


def test_starts_are_drawn_as_rough_as_stated():
    start = StartValues(("k", "c"), np.array([100.0, 2.0]), np.array([0.2, 0.8]))
    drawn_starts = start.draw(2000, np.random.default_rng(0))
    assert np.array_equal(drawn_starts[0], start.values)
    assert np.allclose(np.log(drawn_starts / start.values).std(axis=0), start.std, rtol=0.06)
    assert "k           100  x/ 1.2" in str(start)
    with pytest.raises(InvalidInput, match="0 starts requested"):
        start.draw(0, np.random.default_rng(0))


def test_where_physics_says_nothing():
    model = two_chains()
    low = OMEGA[:3] / 10
    estimate = drawn(truth(model, low), np.random.default_rng(0), omega=low)
    with pytest.raises(InvalidInput, match="no motor's FRF has an anti-resonance"):
        physics_start(model, estimate)
    with pytest.raises(InvalidInput, match=r"motor 2 \(counted from 0\) has no elastic drive"):
        physics_start(model, estimate, drives={2: 1.0})
    with pytest.raises(InvalidInput, match=r"stiffness of motor 0: -1.* is not a number > 0"):
        physics_start(model, estimate, drives={0: -1.0})
    with pytest.raises(InvalidInput, match=r"'phisics' is neither .* \(did you mean 'physics'\?\)"):
        fit(model, estimate, start="phisics")
    with pytest.raises(InvalidInput, match="'chains' needs a robot"):
        fit(model, estimate, start="chains")
    for part in (np.s_[:, :, :1], np.s_[:, :, :, :1]):
        one = FrfEstimate(POSITIONS, low, estimate.response[part], estimate.variance[part], [1])
        with pytest.raises(InvalidInput, match="do not show all 2 motors"):
            physics_start(model, one)
