"""Start values from physics: rigid bodies, and springs from where each axis stands still."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimators.fitting.anti_resonances import AGREE, agreed, dip_values, end_inertias, gear_springs
from estimators.fitting.coarse_search import ParameterGroup, coarse_search
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, check_above_zero, read_only
from robotmodels.common.errors import IdentificationError, InvalidInput, check_word, nearest
from robotmodels.common.printing import ReprHtml
from robotmodels.linear.response import Elastic
from robotmodels.linear.spring_network import SpringNetwork

# Torsions of the structure are stiffer than gears: [WM] section 6 and the published robots of the
# library have them at one to two times the frequency.
TORSIONS = 1.5
DAMPING_RATIO = 0.03
# Standard deviations of ln theta: rms errors on the built-in robots, rounded up.
ROUGH_GEAR, ROUGH_TORSION, ROUGH_DAMPER = 0.2, 0.7, 0.8
# Of stiffnesses that are given.
ROUGH_DRIVE = 0.1
STARTS = ("physics", "chains")


@dataclass(frozen=True, eq=False)
class StartValues(ReprHtml):
    """Start values of parameters, with their uncertainty.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    values : ndarray, (p,)
        Values [SI].
    std : ndarray, (p,)
        Standard deviations of their logarithms.
    """

    names: tuple[str, ...]
    values: Array
    std: Array

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return n starts (n, p) for `multistart`: the values themselves, and others as rough."""
        if n < 1:
            raise InvalidInput(f"start: {n} starts requested; at least 1 is needed")
        spread = rng.standard_normal((n - 1, len(self.values))) * self.std
        return np.asarray(np.vstack([self.values, self.values * np.exp(spread)]))

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = ["start values, each right within the factor given, two times of three"]
        lines += [
            f"  {name:<{width}}  {value:12.6g}  x/ {np.exp(std):.2g}"
            for name, value, std in zip(self.names, self.values, self.std, strict=True)
        ]
        return "\n".join(lines)


def physics_start(
    model: Elastic, estimate: FrfEstimate, drives: Mapping[int, float] | None = None
) -> StartValues:
    """Return rough springs and dampers from measured FRFs and the rigid robot alone.

    Where motor i stands still, at an anti-resonance w_a of G_ii, the arm swings on its gear:
    k_i = J w_a^2 with J the arm's rigid inertia about that axis; without one, at a resonance w_r,
    k_i = w_r^2 J J_m/(J + J_m). Another axis' anti-resonances show as well, but J changes with the
    position otherwise: first that stiffness counts on which most positions agree. A gear on which
    no two agree lies above the band, as a rule: it gets J w w_F, w the geometric mean of the other
    axes' frequencies and w_F the band's end. Torsions get J (1.5 w)^2, dampers a damping ratio of
    3 %; what is neither spring nor damper keeps the model's nominal value. Tied parameters get the
    mean. Then the other stiffnesses that dips allow, and multiples, are tried gear by gear, for
    torsions and for dampers, where these bring |G| nearer to the measured.

    `std` is what errors came to on the built-in robots in six random positions, see the constants
    of this module. Largest were factors of 1.8 (gears), 4 (torsions) and 10 (dampers).

    Parameters
    ----------
    drives : mapping of int to float, N m/rad, optional
        Arm-side stiffnesses of gears that were measured otherwise, by motor counted from 0, such
        as those of the inverse eigenvalue problem.

    Raises
    ------
    InvalidInput
        If no axis shows an anti-resonance or a resonance, the FRFs lack a motor, or `drives` has a
        motor without elastic drive or a stiffness that is not positive.
    """
    network = model.network(estimate.positions)
    if min(estimate.response.shape[2:]) < network.selector.shape[1]:
        raise InvalidInput(
            f"start: FRFs of shape {estimate.response.shape[2:]} do not show all "
            f"{network.selector.shape[1]} motors"
        )
    gears = gear_springs(network)
    drive_stiffness = _checked_drives(drives or {}, gears)
    inertias = end_inertias(network)
    dips = {
        motor: dip_values(network, inertias[s], estimate, motor, s) for motor, s in gears.items()
    }
    stiffness = {motor: agreed(motor_dips) for motor, motor_dips in dips.items()} | drive_stiffness
    gear_stiffness = {
        gears[motor]: value for motor, value in stiffness.items() if np.isfinite(value)
    }
    if not gear_stiffness:
        low, high = estimate.omega[[0, -1]] / (2 * np.pi)
        raise InvalidInput(
            f"start: no motor's FRF has an anti-resonance or a resonance from {low:.3g} to "
            f"{high:.3g} Hz; give start values, or measure further up"
        )
    unseen = set(gears.values()) - set(gear_stiffness)
    guess = _springs(network, inertias, gear_stiffness, unseen, estimate.omega[-1])
    open_dips = {
        gears[motor]: motor_dips
        for motor, motor_dips in dips.items()
        if motor not in drive_stiffness
    }
    groups = _groups(network, open_dips, set(gears.values()))
    first = _as_parameters(network, *guess)
    values = coarse_search(_about(model, network, estimate, first), estimate, first, groups)
    std = _roughness(network, set(gears.values()), {gears[motor] for motor in drive_stiffness})
    return StartValues(network.parameters.names, read_only(values), read_only(std))


def named_start(name: str, model: Elastic, estimate: FrfEstimate) -> Array:
    """Return the start values (p,) called "physics" or "chains".

    "chains" are those of `estimators.chain_start_values`, the inverse eigenvalue problem of each
    axis, in the first position.

    Raises
    ------
    InvalidInput
        For another name, or chains of a model that is no robot, or as those functions.
    NotIdentifiable
        As `chain_start_values`.
    """
    check_word("start:", name, STARTS, "is neither parameter values nor the name of a start")
    if name == "physics":
        return physics_start(model, estimate).values
    from estimators.chains.start_values_from_chains import chain_start_values
    from robotmodels.elastic.robot import ElasticRobot

    if not isinstance(model, ElasticRobot):
        raise InvalidInput("start: 'chains' needs a robot; 'physics' serves any model")
    return chain_start_values(model, estimate)


def _about(
    model: Elastic, network: SpringNetwork, estimate: FrfEstimate, values: Array
) -> SpringNetwork:
    """Return the network about the equilibria of `values` (p,), or `network` if they are none."""
    try:
        return model.network(estimate.positions, values)
    except IdentificationError:
        return network


def _checked_drives(drives: Mapping[int, float], gears: dict[int, int]) -> dict[int, float]:
    for motor, value in drives.items():
        if motor not in gears:
            raise InvalidInput(
                f"start: motor {motor} (counted from 0) has no elastic drive"
                f"{nearest(str(motor), map(str, gears))}"
            )
        check_above_zero(value, f"start: stiffness of motor {motor}")
    return {motor: float(value) for motor, value in drives.items()}


def _springs(
    network: SpringNetwork,
    inertias: Array,
    gear_stiffness: dict[int, float],
    unseen: set[int],
    top: float,
) -> tuple[Array, Array]:
    """Return stiffnesses and dampings (s,) of all springs from those of some gears.

    Parameters
    ----------
    inertias : ndarray, (s, 2, Q)
        Inertias at their ends.
    gear_stiffness : dict of int to float
        Stiffnesses of gears.
    unseen : set of int
        The other gears.
    top : float, rad/s
        End of the band.
    """
    reduced = np.exp(-np.mean(np.log((1 / inertias).sum(axis=1)), axis=1))
    arm = np.array([np.exp(np.mean(np.log(max(inertias[s], key=np.sum)))) for s in gear_stiffness])
    frequency = float(np.exp(np.mean(np.log(np.array(list(gear_stiffness.values())) / arm)) / 2))
    torsion = network.nodes.min(axis=1) < 0
    stiffness = reduced * np.where(torsion, TORSIONS * frequency, frequency) ** 2
    for s in unseen:
        stiffness[s] = reduced[s] * frequency * max(frequency, top)
    for s, value in gear_stiffness.items():
        stiffness[s] = value
    natural = np.sqrt(stiffness / reduced)
    return stiffness, 2 * DAMPING_RATIO * stiffness / natural


def _groups(
    network: SpringNetwork, dips: dict[int, list[tuple[Array, Array]]], gears: set[int]
) -> list[ParameterGroup]:
    """Return the groups to search: each gear that has dips, all torsions, all dampers.

    A gear's damper keeps its ratio to the spring.
    """
    count = len(network.nodes)
    groups = []
    for s, gear_dips in dips.items():
        values = np.sort(np.concatenate([x for x, _ in gear_dips]))
        gaps = np.flatnonzero(np.diff(values) > AGREE) + 1
        candidates = tuple(float(np.median(part)) for part in np.split(values, gaps) if part.size)
        groups.append(ParameterGroup((s, count + s), candidates))
    torsions = [s for s in range(count) if s not in gears]
    if torsions:
        groups.append(ParameterGroup((*torsions, *(count + s for s in torsions))))
    return [*groups, ParameterGroup(tuple(range(count, 2 * count)))]


def _roughness(network: SpringNetwork, gears: set[int], measured_gears: set[int]) -> Array:
    """Return standard deviations of ln theta (p,), the largest where a parameter acts on several.

    Other parameters than springs and dampers get zero: their start is the nominal value.
    """
    count = len(network.nodes)
    rows = np.array(
        [
            ROUGH_DRIVE if s in measured_gears else ROUGH_GEAR if s in gears else ROUGH_TORSION
            for s in range(count)
        ]
        + [ROUGH_DAMPER] * count
    )
    exponents = np.abs(network.exponents.mean(axis=0))
    acting = exponents > 0.5 * exponents.max(axis=0, initial=1e-12)
    return np.asarray(np.max(np.where(acting, rows[:, None], 0.0), axis=0))


def _as_parameters(network: SpringNetwork, stiffness: Array, damping: Array) -> Array:
    """Return the parameters (p,) that come nearest to springs and dampers (s,)."""
    theta = network.parameters.values
    exponents = network.exponents.mean(axis=0)
    now = np.concatenate([network.spring_stiffness, network.spring_damping], axis=1)
    coefficients = np.concatenate([stiffness, damping])
    with np.errstate(divide="ignore"):
        change = np.log(coefficients) - np.mean(np.log(now), axis=0)
    acting = exponents.any(axis=1) & np.isfinite(change)
    step = np.linalg.lstsq(exponents[acting], change[acting], rcond=None)[0]
    return np.asarray(theta * np.exp(step))
