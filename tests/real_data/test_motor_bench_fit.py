"""The real two-inertia bench fitted from its motor side: FACTS of the published fits, and beyond.

Torques are currents, so everything is in units of the unknown torque constant.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from motor_bench import LINES, PERIODS, RATE, SAMPLES, bench_data
from test_motor_bench_frf import bench, estimate  # noqa: F401

from estimators import Prior, covariance, estimate_frf, fit, identifiability, residual_analysis
from estimators.chain_dampers.damped_chains import DampedChains
from estimators.chains.parameter_maps import ChainLayout
from robotmodels import CoupledChains, NotIdentifiable, Parameters

PUBLISHED = {"K1": 552.5, "m1": 0.004796, "m2": 0.004804}


@dataclass(frozen=True, eq=False)
class Bench:
    """Two inertias, a spring with damper, friction of motor and load, and a delay, all free."""

    chains: DampedChains
    load_friction: float

    @property
    def parameters(self):
        own = self.chains.parameters
        return Parameters(
            (*own.names, "load_friction"),
            np.append(own.values, self.load_friction),
            (*own.units, "N s/m"),
        )

    def network(self, positions, parameters=None):
        theta = self.parameters.check(parameters)
        bare = self.chains.network(positions, theta[:-1])
        p, q = len(theta), len(positions)
        exponents = np.zeros((q, 4, p))
        exponents[:, 0, 0] = exponents[:, 2, 1] = exponents[:, 3, -1] = 1.0
        return replace(
            bare,
            nodes=np.array([*bare.nodes.tolist(), [1, -1]]),
            spring_stiffness=np.append(bare.spring_stiffness, np.zeros((q, 1)), axis=1),
            spring_damping=np.append(bare.spring_damping, np.full((q, 1), theta[-1]), axis=1),
            exponents=exponents,
            parameters=Parameters(self.parameters.names, theta, self.parameters.units),
        )

    def tangents(self, positions, parameters=None, *, equilibrium_shift=True):
        theta = self.parameters.check(parameters)
        found = self.chains.tangents(positions, theta[:-1], equilibrium_shift=equilibrium_shift)
        wider = {
            name: np.concatenate([array, np.zeros_like(array[:, :1])], axis=1)
            for name, array in vars(found).items()
            if array is not None and name != "delay"
        }
        return replace(found, **wider, delay=np.append(found.delay, 0.0))

    def linearization(self, positions, parameters=None, *, equilibrium_shift=True):
        return self.network(positions, parameters), self.tangents(
            positions, parameters, equilibrium_shift=equilibrium_shift
        )


def model(delay=1e-4):
    chains = DampedChains(
        layout=ChainLayout(1, 2),
        theta=np.array([5e-3, 5e-3, 500.0]),
        dampers=np.array([0.02]),
        friction=np.array([0.02]),
        delay=delay,
        offsets=np.array([-1.0, -1e-2]),
    )
    return Bench(chains, 0.02)


@pytest.fixture(scope="module")
def found(estimate):  # noqa: F811
    return fit(model(), estimate, "lls", "user")


def named(one):
    return dict(zip(one.parameters.names, one.parameters.values, strict=True))


def test_spring_and_inertias_within_one_percent(found):
    assert found.converged
    values = named(found)
    for name, published in PUBLISHED.items():
        assert values[name] == pytest.approx(published, rel=0.01)


def test_the_damper_is_called_unidentifiable(found):
    # The noise alone would promise more than the model can keep: residuals are 15 times larger.
    assert residual_analysis(found).ratio > 100
    honest = covariance(found, "empirical")
    weak = identifiability(np.linalg.inv(honest.covariance), honest.names).weak()
    assert len(weak) == 1
    assert weak[0].startswith("c1")
    others = np.delete(honest.std, honest.names.index("c1"))
    assert others.max() < 0.15
    assert honest.std[honest.names.index("K1")] < 0.01
    assert "at a bound: c1" in found.message


def test_a_free_delay_helps(estimate, found):  # noqa: F811
    known = Prior(("delay.above",), np.array([1e-2]), np.array([1e-9]))  # no delay
    without = fit(model(delay=1e-12), estimate, "lls", "user", prior=known)
    assert without.data_cost > 4 * found.cost
    delay = named(found)["delay.above"] - 1e-2
    assert 0.1 < delay * RATE < 0.5  # samples
    std = covariance(found, "empirical").std[-2] * 1e-2
    assert delay > 10 * std


@pytest.mark.parametrize("change", [-1e-13, 0.0, 1e-13])
def test_magnitudes_alone_do_not_tell_the_delay(estimate, change):  # noqa: F811
    rounded = estimate.response * (1 + change * np.cos(estimate.omega))[:, None, None]
    found = fit(model(), replace(estimate, response=rounded), "lls_magnitude", "user")
    assert named(found)["delay.above"] == pytest.approx(named(model())["delay.above"], rel=1e-12)
    with pytest.raises(NotIdentifiable, match=r"delay\.above"):
        covariance(found)


def test_chains_without_friction_and_delay_come_near(estimate):  # noqa: F811
    """`CoupledChains` alone: nls, which resonances rule, still tells springs and inertias."""
    chains = CoupledChains(
        np.array([[5e-3, 5e-3]]),
        np.array([[500.0]]),
        np.zeros((1, 1)),
        np.array([[0.05]]),
        extra=("m1", "m2"),
    )
    values = named(fit(chains, estimate, "nls", "optimal"))
    for name, published in PUBLISHED.items():
        assert values[name] == pytest.approx(published, rel=0.01)


def test_the_load_side_is_predicted(bench, estimate, found):  # noqa: F811
    """The load's own encoder, never fitted: its angle over the motor's."""
    data = bench_data()
    shape = (1, 1, 1, PERIODS, SAMPLES, 1)
    load = -np.asarray(data["theta_my"], dtype=float).reshape(shape)  # its sign is reversed
    measured = estimate_frf(replace(bench, angle=load), covariance="noise", hold=False, transient=1)
    ratio = (measured.response / estimate.response)[0, :, 0, 0]
    assert len(ratio) == len(LINES)
    now = named(found)
    s = 1j * estimate.omega
    spring = now["K1"] + now["c1"] * s
    predicted = spring / (now["m2"] * s**2 + now["load_friction"] * s + spring)
    error = np.abs(np.log(np.abs(ratio / predicted)))
    assert np.median(error) < 0.05
    assert np.quantile(error, 0.9) < 0.2
    # Without the spring, as one rigid body, it would be far off.
    assert np.median(np.abs(np.log(np.abs(ratio)))) > 10 * np.median(error)
