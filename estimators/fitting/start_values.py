"""Start values from physics: rigid bodies, and springs from where each axis stands still."""

from collections.abc import Mapping

import numpy as np

from estimators.fitting.weights import MINIMUM_SNR
from estimators.frf.estimate import FrfEstimate
from robotmodels.arrays import Array
from robotmodels.elastic.spring_network import SpringNetwork
from robotmodels.errors import InvalidInput, nearest
from robotmodels.response import Elastic

# ln |G| that a dip must lie below its surroundings to be no noise.
PROMINENCE = 0.7
# Torsions of the structure are stiffer than gears: [WM] section 6 and the published robots of the
# library have them at one to two times the frequency.
TORSIONS = 1.5
DAMPING_RATIO = 0.03
# Stiffnesses from two positions agree if their logarithms differ by about this: links that bend
# shift anti-resonances by as much.
AGREE = 0.3
# No dip is worth more than this in ln |G|: how deep it is depends on the grid of frequencies.
DEEP = 3.0
STARTS = ("physics", "chains")


def physics_start(
    model: Elastic, estimate: FrfEstimate, drives: Mapping[int, float] | None = None
) -> Array:
    """Return rough values (p,) of springs and dampers from measured FRFs and the rigid robot alone.

    Where motor i stands still, at an anti-resonance w_a of G_ii, the arm swings on its gear:
    k_i = J w_a^2 with J the arm's rigid inertia about that axis; without one, at a resonance w_r,
    k_i = w_r^2 J J_m/(J + J_m). Another axis' anti-resonances show as well, but J changes with the
    position otherwise: the stiffness counts on which most positions agree. A gear on which no two
    agree lies above the band, as a rule: it gets J w w_F, w the geometric mean of the other axes'
    frequencies and w_F the band's end. Torsions get J (1.5 w)^2, dampers a damping ratio of 3 %;
    what is neither spring nor damper keeps the model's own value. Tied parameters get the mean.

    On six built-in robots in six random positions half of the gears are right within a factor of
    1.3, and all within 7; positions that move the arm's inertia little tell axes apart badly.

    Parameters
    ----------
    drives : arm-side stiffnesses of gears that are known better, by motor counted from 0
        [N m/rad], such as the inverse eigenvalue problem's.

    Raises
    ------
    InvalidInput : if no axis shows an anti-resonance or a resonance, the FRFs lack a motor, or
        `drives` has a motor without elastic drive or a stiffness that is not positive.
    """
    network = model.network(estimate.positions)
    gears, inertias = _gears(network), _inertias(network)
    if min(estimate.response.shape[2:]) < network.selector.shape[1]:
        raise InvalidInput(
            f"start: FRFs of shape {estimate.response.shape[2:]} do not show all "
            f"{network.selector.shape[1]} motors"
        )
    stiffness = {
        motor: _gear_stiffness(network, inertias[s], estimate, motor, s)
        for motor, s in gears.items()
    }
    for motor, value in (drives or {}).items():
        if motor not in gears:
            raise InvalidInput(
                f"start: motor {motor} (counted from 0) has no elastic drive"
                f"{nearest(str(motor), map(str, gears))}"
            )
        if not (np.isfinite(value) and value > 0):
            raise InvalidInput(f"start: stiffness {value:g} of motor {motor} is not positive")
        stiffness[motor] = float(value)
    known = {gears[motor]: value for motor, value in stiffness.items() if np.isfinite(value)}
    if not known:
        low, high = estimate.omega[[0, -1]] / (2 * np.pi)
        raise InvalidInput(
            f"start: no motor's FRF has an anti-resonance or a resonance from {low:.3g} to "
            f"{high:.3g} Hz; give start values, or measure further up"
        )
    unseen = set(gears.values()) - set(known)
    springs = _springs(network, inertias, known, unseen, estimate.omega[-1])
    return _as_parameters(network, *springs)


def named_start(name: str, model: Elastic, estimate: FrfEstimate) -> Array:
    """Return the start values (p,) called "physics" or "chains".

    "chains" are those of `estimators.chain_start_values`, the inverse eigenvalue problem of each
    axis, in the first position.

    Raises
    ------
    InvalidInput : for another name, or chains of a model that is no robot, or as those functions.
    NotIdentifiable : as `chain_start_values`.
    """
    if name not in STARTS:
        raise InvalidInput(
            f"start: {name!r} is neither parameter values nor one of {', '.join(STARTS)}"
            f"{nearest(name, STARTS)}"
        )
    if name == "physics":
        return physics_start(model, estimate)
    from estimators.fitting.chain_start import chain_start_values
    from robotmodels.elastic.robot import ElasticRobot

    if not isinstance(model, ElasticRobot):
        raise InvalidInput("start: 'chains' needs a robot; 'physics' serves any model")
    return chain_start_values(model, estimate)


def _gears(network: SpringNetwork) -> dict[int, int]:
    """Return which spring joins each motor to the arm."""
    motors = {int(np.argmax(np.abs(column))): i for i, column in enumerate(network.selector.T)}
    return {
        motors[end]: s
        for s, ends in enumerate(network.ends.tolist())
        for end in ends
        if end in motors and -1 not in ends
    }


def _inertias(network: SpringNetwork) -> Array:
    """Return the rigid inertias at both ends of springs, (s, 2, Q); infinite at the ground."""
    inertia = np.diagonal(network.linear_model().mass, axis1=1, axis2=2).T
    ground = np.full((1, inertia.shape[1]), np.inf)
    return np.concatenate([inertia, ground])[network.ends]  # the end -1 is the last


def _gear_stiffness(
    network: SpringNetwork, both: Array, estimate: FrfEstimate, motor: int, s: int
) -> float:
    """Return a gear's stiffness; not a number if no two of several positions agree on one.

    both : (2, Q) inertias at its ends.
    """
    ends = network.ends[s].tolist()
    own = int(np.argmax(np.abs(network.selector[:, motor])))
    rotor, arm = both[ends.index(own)], both[1 - ends.index(own)]
    found = []
    # What lies below the noise shows no dips of its own.
    size = np.abs(estimate.response[:, :, motor, motor])
    noise = MINIMUM_SNR * np.sqrt(estimate.variance[:, :, motor, motor])
    for q, level in enumerate(np.log(np.maximum(size, noise))):
        inertia, (omega, depth) = arm[q], _dips(level, estimate.omega)
        if not omega.size:
            inertia = 1 / (1 / arm[q] + 1 / rotor[q])
            omega, depth = _dips(-level, estimate.omega)
        found.append((np.log(inertia * omega**2), np.minimum(depth, DEEP)))
    return agreed(found)


def _dips(level: Array, omega: Array) -> tuple[Array, Array]:
    """Return frequencies and depths of the pronounced minima of (F,) levels."""
    from scipy.signal import find_peaks

    dips, shape = find_peaks(-level, prominence=PROMINENCE)
    return omega[dips], shape["prominences"]


def agreed(found: list[tuple[Array, Array]]) -> float:
    """Return exp of the value that most positions have, or nearly; not a number without two.

    Parameters
    ----------
    found : logarithms of candidates and their weights, for each position.
    """

    def support(value: float) -> Array:
        """Return the best weight for a value in each position, (Q,)."""
        return np.array(
            [np.max(w * np.exp(-(((x - value) / AGREE) ** 2) / 2), initial=0.0) for x, w in found]
        )

    candidates = np.concatenate([x for x, _ in found])
    if not candidates.size:
        return np.nan
    best = max(candidates.tolist(), key=lambda value: float(support(value).sum()))
    near = [x[np.argmin(np.abs(x - best))] for x, _ in found if x.size]
    near = [x for x in near if abs(x - best) < 2 * AGREE]
    return float(np.exp(np.median(near))) if len(near) >= min(2, len(found)) else np.nan


def _springs(
    network: SpringNetwork,
    inertias: Array,
    known: dict[int, float],
    unseen: set[int],
    top: float,
) -> tuple[Array, Array]:
    """Return stiffnesses and dampings (s,) of all springs from those of some gears.

    Parameters
    ----------
    inertias : (s, 2, Q) at their ends.
    known : stiffnesses of gears.
    unseen : the other gears.
    top : end of the band [rad/s].
    """
    reduced = np.exp(-np.mean(np.log((1 / inertias).sum(axis=1)), axis=1))
    arm = np.array([np.exp(np.mean(np.log(max(inertias[s], key=np.sum)))) for s in known])
    frequency = float(np.exp(np.mean(np.log(np.array(list(known.values())) / arm)) / 2))
    torsion = network.ends.min(axis=1) < 0
    stiffness = reduced * np.where(torsion, TORSIONS * frequency, frequency) ** 2
    for s in unseen:
        stiffness[s] = reduced[s] * frequency * max(frequency, top)
    for s, value in known.items():
        stiffness[s] = value
    natural = np.sqrt(stiffness / reduced)
    return stiffness, 2 * DAMPING_RATIO * stiffness / natural


def _as_parameters(network: SpringNetwork, stiffness: Array, damping: Array) -> Array:
    """Return the parameters (p,) that come nearest to springs and dampers (s,)."""
    theta = network.parameters.values
    exponents = network.exponents.mean(axis=0)
    now = np.concatenate([network.spring_stiffness, network.spring_damping], axis=1)
    wanted = np.concatenate([stiffness, damping])
    with np.errstate(divide="ignore"):
        change = np.log(wanted) - np.mean(np.log(now), axis=0)
    acting = exponents.any(axis=1) & np.isfinite(change)
    step = np.linalg.lstsq(exponents[acting], change[acting], rcond=None)[0]
    return np.asarray(theta * np.exp(step))
