"""Spring networks of many structures, at random values."""

from dataclasses import replace

import numpy as np

from robotmodels.description.parameters import Parameters
from robotmodels.linear.linear_model import Channels, Measurement
from robotmodels.linear.spring_network import Inertances, SpringNetwork


def _parameters(stiffness, damping):
    values = np.concatenate([stiffness, damping])
    names = [f"k{i}" for i in range(len(stiffness))] + [f"c{i}" for i in range(len(damping))]
    return Parameters(tuple(names), values, ("",) * len(values))


def _exponents(n_positions, n_springs, free):
    rows = [*free, *(n_springs + np.asarray(free))]
    one = np.zeros((2 * n_springs, len(rows)))
    one[rows, range(len(rows))] = 1.0
    return np.tile(one, (n_positions, 1, 1))


def robot(rng, n_positions=3, n=6, n_torsions=12, n_free_torsions=7, damping=1.5e-3, scale=1.0):
    """Return a network like an arm's: random inertia, gears with motors, torsions to ground."""
    arm = n + n_torsions
    d = arm + n
    drives = np.sort(rng.choice(arm, n, replace=False))
    torsions = np.setdiff1d(np.arange(arm), drives)
    size = np.exp(rng.normal(0, 0.7, arm))
    mass, friction, gravity = (np.zeros((n_positions, d, d)) for _ in range(3))
    A, B = rng.normal(size=(2, n_positions, arm, arm)) / np.sqrt(arm)
    mass[:, :arm, :arm] = (A @ A.swapaxes(1, 2) + 0.3 * np.eye(arm)) * np.outer(size, size)
    gravity[:, :arm, :arm] = 100 * (B + B.swapaxes(1, 2)) * np.outer(size, size)
    motor = np.arange(arm, d)
    mass[:, motor, motor] = rng.uniform(0.3, 4, n)
    friction[:, motor, motor] = rng.uniform(2, 20, n)
    selector = np.zeros((d, n))
    selector[motor, range(n)] = rng.uniform(30, 120, n)
    ends = [(a, m) for a, m in zip(drives, motor, strict=True)] + [(t, -1) for t in torsions]
    k = 1e4 * size[[*drives, *torsions]] ** 2 * rng.uniform(0.5, 4, arm) * scale
    c = damping * k
    free = range(n + n_free_torsions)
    return SpringNetwork(
        mass,
        friction,
        gravity,
        selector,
        np.array(ends),
        np.tile(k, (n_positions, 1)),
        np.tile(c, (n_positions, 1)),
        _exponents(n_positions, len(ends), free),
        _parameters(k[free], c[free]),
    )


def chain(rng, driven=(0, 3)):
    """Return two coupled chains of masses, springs between coordinates, some driven directly."""
    mass = np.diag(rng.uniform(1, 3, 6))
    mass[2, 5] = mass[5, 2] = 0.3
    ends = np.array([(0, 1), (1, 2), (3, 4), (4, 5)])
    k, c = rng.uniform(1e3, 5e3, 4), rng.uniform(1, 3, 4)
    selector = np.zeros((6, len(driven)))
    selector[driven, range(len(driven))] = 1.0
    friction = np.diag([0.5, 0, 0, 0.5, 0, 0])
    return SpringNetwork(
        np.stack([mass, 1.5 * mass]),
        np.stack([friction] * 2),
        np.zeros((2, 6, 6)),
        selector,
        ends,
        np.tile(k, (2, 1)),
        np.tile(c, (2, 1)),
        _exponents(2, 4, range(4)),
        _parameters(k, c),
    )


def nonlinear(rng):
    """Return a robot whose first spring depends on two parameters, differently per position."""
    network = robot(rng, n=3, n_torsions=4, n_free_torsions=2)
    exponents = network.exponents.copy()
    exponents[:, 0, 1] = rng.uniform(0, 1, 3)
    exponents[:, 0, 0] = 1 - exponents[:, 0, 1]
    return replace(network, exponents=exponents)


def unusual(rng):
    """Return a chain with one motor acting on two masses at once."""
    network = chain(rng)
    selector = network.selector.copy()
    selector[1, 0] = 0.5
    return replace(network, selector=selector)


def shared_damping(rng):
    """Return a robot whose bearing friction is given once for all positions."""
    network = robot(rng, n=3, n_torsions=4, n_free_torsions=2)
    return replace(network, damping=network.damping[0])


def other_outputs(rng):
    """Return a chain of which motor speeds and a mass's acceleration are measured."""
    network = chain(rng)
    still = np.zeros((2, 3, 6))
    speed, acceleration = still.copy(), still.copy()
    speed[:, :2] = network.selector.T
    acceleration[:, 2, 4] = 1.0
    return replace(
        network,
        measurement=Measurement(
            still, speed, acceleration, Channels.plain(np.array([1.0, 1.1])), 1e-3
        ),
    )


def motor_speeds(rng):
    """Return a robot whose motors' speeds are measured, late and with differing torque gains."""
    network = robot(rng, n=3, n_torsions=4, n_free_torsions=2)
    still = np.zeros((len(network.mass), *network.selector.T.shape))
    gain = np.array([1.0, 1.1, 0.9])
    return replace(
        network,
        measurement=Measurement(
            still, still + network.selector.T, still, Channels.plain(gain), 2e-3
        ),
    )


def motor_angles(rng):
    """Return a robot whose motors' angles are measured, with one torque gain for all."""
    network = robot(rng, n=3, n_torsions=4, n_free_torsions=2)
    still = np.zeros((len(network.mass), *network.selector.T.shape))
    gain = np.full(3, 1.2)
    return replace(
        network,
        measurement=Measurement(
            still + network.selector.T, still, still, Channels.plain(gain), 0.0
        ),
    )


def free_inertias(network, coordinates, rng):
    """Return `network` with more inertia, free, at `coordinates`; one friction is not free."""
    r, p = len(coordinates), len(network.parameters)
    friction, inertia = rng.uniform(1, 5, r), rng.uniform(0.3, 4, r)
    old = network.parameters
    names = [*(f"d{c}" for c in coordinates[1:]), *(f"J{c}" for c in coordinates)]
    inertances = Inertances(
        coordinates=np.array(coordinates),
        friction=friction,
        inertia=inertia,
        exponents=np.eye(2 * r, p + 2 * r - 1, p - 1),
    )
    return replace(
        network,
        exponents=np.pad(network.exponents, ((0, 0), (0, 0), (0, 2 * r - 1))),
        parameters=Parameters(
            (*old.names, *names),
            np.concatenate([old.values, friction[1:], inertia]),
            ("",) * (p + 2 * r - 1),
        ),
        inertances=inertances,
    )


NETWORKS = {
    "ur10-like": robot,
    "rigid drives": lambda rng: chain(rng, driven=(1, 4)),
    "chains": chain,
    "chains, one motor in the middle": lambda rng: chain(rng, driven=(1,)),
    "neighbouring motors": lambda rng: chain(rng, driven=(0, 1)),
    "one motor, no torsion": lambda rng: robot(rng, n=1, n_torsions=0, n_free_torsions=0),
    "all torsions free": lambda rng: robot(rng, n=2, n_torsions=5, n_free_torsions=5),
    "nonlinear spring": nonlinear,
    "friction shared by positions": shared_damping,
    "motor speeds": motor_speeds,
    "motor angles": motor_angles,
    "other outputs": other_outputs,
    "motor on two coordinates": unusual,
    "free motor inertias": lambda rng: free_inertias(robot(rng), [23, 19], rng),
    "free masses": lambda rng: free_inertias(chain(rng), [0, 1, 3, 5], rng),
    "free inertia of a rigid drive": lambda rng: free_inertias(chain(rng, (1, 4)), [4, 2], rng),
    "free inertia, other outputs": lambda rng: free_inertias(other_outputs(rng), [0, 2], rng),
}


def error(found, expected):
    """Return the largest error beside the diagonal, (.., p, p), or the largest element."""
    if np.iscomplexobj(expected):
        return np.max(np.abs(found - expected) / np.abs(expected).max((-2, -1), keepdims=True))
    size = np.sqrt(np.einsum("qii->qi", expected))
    return np.max(np.abs(found - expected) / size[:, :, None] / size[:, None, :])
