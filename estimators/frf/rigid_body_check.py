"""Signs, units and order of measured FRFs, judged by what no spring can change.

At low frequencies springs do not yield and the FRF is that of the rigid robot, which is known far
better than the springs. At any frequency motors take up power and do not give it, so the real part
of speed over torque is not negative, and torque i moves motor j as torque j moves motor i.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.mixups import MixUp, mix_ups
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import IdentificationError, IdentificationWarning, InvalidInput
from robotmodels.linear.response import Elastic
from robotmodels.linear.spring_network import SpringNetwork

# Friction and a payload not modelled change the low end, but rarely by more.
PLAUSIBLE = 2.5
_STIFF = 1e5  # times the springs: rigid to 1e-3 up to the robot's resonances
_LINES = 3
_MOST_LINES = 30  # that frequencies are compared at
# Elements count if they are this large against the others of their row and column.
_CLEAR = 0.03
_MOST_ERROR = 3.0  # of one element, in ln and rad
_MODEL_ERROR = 0.2  # of the rigid robot's elements
_MOST_LEFT = 0.5  # beside noise, by what is the cause
# The undone mix-up must leave less than this part of the misfit, and take away so much of it.
_EXPLAINS, _LEAST_GAIN = 0.5, 0.15
_SIMPLEST = 0.95  # of the most that is explained will do for a simpler cause
_SIGMAS = 5.0
_ACTIVE = 0.05  # sine of the angle by which FRFs may lie on the active side
_WINDOWS = 6  # of lines, over which these are averaged
_ASYMMETRY = np.log(1.5)


@dataclass(frozen=True, eq=False)
class RigidLimit:
    """Measured FRFs against the rigid-body limit at low frequencies.

    Attributes
    ----------
    ratio : ndarray of complex, (n,)
        Measured over rigid diagonal elements, median over positions and lowest lines; not a number
        for motors that are not judged.
    messages : tuple of str
        One line for each thing that looks wrong.
    """

    ratio: ComplexArray
    messages: tuple[str, ...]


def check_rigid_limit(estimate: FrfEstimate, model: Elastic) -> RigidLimit:
    """Warn of signs, units and numberings that the robot contradicts; see `rigid_limit`.

    Raises
    ------
    InvalidInput
        If the model has other motors or outputs than the estimate.
    """
    limit = rigid_limit(estimate, model)
    for message in limit.messages:
        warnings.warn(message, IdentificationWarning, stacklevel=2)
    return limit


def rigid_limit(estimate: FrfEstimate, model: Elastic) -> RigidLimit:
    """Compare measured FRFs with the rigid robot, and with passive and reciprocal ones.

    For the rigid robot only the lowest lines count, and only elements for which the model's
    own springs do not yet yield. Robots of which some motor's encoder is not among the outputs
    are looked at for copies only.

    Parameters
    ----------
    model : Elastic
        Robot, or anything with its ``parameters`` and ``network``.

    Raises
    ------
    InvalidInput
        If the model has other motors or outputs than the estimate.
    """
    network = model.network(estimate.positions)
    omega = estimate.omega[:_LINES]
    elastic = network.frequency_response(omega)
    if elastic.shape[2:] != estimate.response.shape[2:]:
        m, n = estimate.response.shape[2:]
        raise InvalidInput(
            f"rigid limit: FRFs of {m} outputs and {n} motors against a model of "
            f"{elastic.shape[2]} and {elastic.shape[3]}; they must be the same"
        )
    rows = _motors_first(network)
    if rows is None:
        return RigidLimit(np.full(elastic.shape[3], np.nan + 0j), tuple(_copies(estimate)))
    turned = _turned_positions(estimate, model, omega)
    return _compared(
        estimate.of_outputs(rows),
        network.of_outputs(rows),
        elastic[:, :, rows],
        None if turned is None else turned[:, :, rows],
    )


def _compared(
    estimate: FrfEstimate,
    network: SpringNetwork,
    elastic: ComplexArray,
    turned: ComplexArray | None,
) -> RigidLimit:
    """Return the comparison where the motors are the first outputs."""
    omega = estimate.omega[:_LINES]
    rigid = rigid_response(network, omega)
    measured = estimate.response[:, :_LINES]
    weight = _weights(measured, estimate.variance[:, :_LINES], rigid, elastic)
    mask = weight > 0
    diagonal = _diagonal(np.where(mask, measured / np.where(mask, rigid, 1.0), np.nan))
    ratio = np.array([_median(diagonal[..., i]) for i in range(diagonal.shape[-1])])
    cause = _rigid(measured, rigid, weight, omega, network, turned)
    cause = cause or _frequencies(estimate, network)
    messages = [cause] if cause else _sizes(ratio)
    messages += [] if messages else _passivity(estimate, network)
    messages += [] if messages else _reciprocity(estimate, network)
    messages += _copies(estimate)
    return RigidLimit(ratio, tuple(messages))


def _motors_first(network: SpringNetwork) -> IntArray | None:
    """Return all outputs, the motors' first; None where a motor's is not measured."""
    motors = network.motor_rows
    if (motors < 0).any():
        return None
    count = len(motors) if network.measurement is None else network.measurement.position.shape[-2]
    return np.concatenate([motors, np.setdiff1d(np.arange(count), motors)])


def _copies(estimate: FrfEstimate) -> list[str]:
    """Look for positions with the same numbers, noise included."""
    first: dict[bytes, int] = {}
    messages = []
    for q, response in enumerate(estimate.response):
        original = first.setdefault(response.tobytes(), q)
        if original != q:
            messages.append(
                f"positions {original + 1} and {q + 1} have the same FRFs to the last digit; a "
                "copy counts as new data, leave it out"
            )
    return messages


def rigid_response(network: SpringNetwork, omega: Array) -> ComplexArray:
    """Return the FRFs (Q, F, m, n) with all springs all but rigid, with gravity and friction."""
    stiff = replace(network, spring_stiffness=_STIFF * network.spring_stiffness)
    return np.asarray(stiff.frequency_response(omega))


def _weights(
    measured: ComplexArray, variance: Array, rigid: ComplexArray, elastic: ComplexArray
) -> Array:
    """Return weights of the elements by their noise; zero where springs yield or noise hides."""
    near = np.abs(np.log(_size(elastic) / _size(rigid))) < np.log(PLAUSIBLE) / 2
    clear = _size(rigid) / _scale(rigid)
    # Relative to row and column, whose units may be mixed up.
    noise = np.sqrt(variance) / _scale(measured) / clear
    precision = np.where(near & (clear > _CLEAR), noise**-2.0, 0.0)
    return np.where(precision.sum(axis=1, keepdims=True) > 1, precision, 0.0)


def _size(matrices: ComplexArray) -> Array:
    return np.maximum(np.abs(matrices), 1e-300)


def _scale(matrices: ComplexArray) -> Array:
    """Return the geometric mean of the largest elements in each one's row and column."""
    size = _size(matrices)
    squares = size.max(axis=-1, keepdims=True) * size.max(axis=-2, keepdims=True)
    return np.asarray(np.sqrt(squares))


def _errors(response: ComplexArray, expected: ComplexArray, mask: NDArray[np.bool_]) -> Array:
    """Return the sizes of ln(response / expected) where there is a mask, large ones cut off."""
    ratio = np.where(mask & (response != 0), response, 1.0) / np.where(mask, expected, 1.0)
    return np.asarray(np.minimum(np.abs(np.log(ratio)), _MOST_ERROR))


def _mean_errors(response: ComplexArray, expected: ComplexArray, weight: Array) -> Array:
    """Return the errors (Q, m, n) of weighted means over the lines of response / expected."""
    mask = weight > 0
    ratio = np.where(mask, response, 1.0) / np.where(mask, expected, 1.0)
    total = weight.sum(axis=1)
    mean = (weight * ratio).sum(axis=1) / np.where(total > 0, total, 1.0)
    return _errors(mean, np.ones_like(mean), total > 0)


def _explains(error: float, before: float) -> bool:
    return error < _EXPLAINS * before and before - error > _LEAST_GAIN


def _rigid(
    measured: ComplexArray,
    rigid: ComplexArray,
    weight: Array,
    omega: Array,
    network: SpringNetwork,
    turned: ComplexArray | None,
) -> str:
    """Return the mix-up that explains the low end best, if any is needed.

    A mix-up is judged by the elements that it changes.
    """
    gears = np.abs(network.selector).max(axis=0)
    tried = [(one, rigid) for one in mix_ups(measured, rigid, weight, omega, gears)]
    if turned is not None:
        tried.append((MixUp("positions look turned round, all signs of them", measured), turned))
    before = _mean_errors(measured, rigid, weight)
    total = weight.sum(axis=1)
    noise = np.where(total > 0, np.maximum(total, 1e-300) ** -0.5, 0.0)
    trust = np.where(total > 0, 1 / (noise**2 + _MODEL_ERROR**2), 0.0)
    gains: list[tuple[float, str]] = []
    for one, expected in tried:
        after = _mean_errors(one.response, expected, weight)
        changed = ((one.response != measured) | (expected != rigid)).any(axis=1) * trust
        if not changed.any():
            continue
        sizes = [float(np.average(each, weights=changed)) for each in (before, after, noise)]
        if _explains(sizes[1], sizes[0]) and sizes[1] < _MOST_LEFT + sizes[2]:
            cause = (
                f"{one.cause} (lowest {len(omega)} lines, {int((changed > 0).sum())} elements "
                f"against the rigid robot: mean error {sizes[0]:.2g}, {sizes[1]:.2g} without it)"
            )
            gains.append((changed.sum() * (sizes[0] - sizes[1]), cause))
    most = max((gain for gain, _ in gains), default=0.0)
    return next((cause for gain, cause in gains if gain >= _SIMPLEST * most), "")


def _turned_positions(estimate: FrfEstimate, model: Elastic, omega: Array) -> ComplexArray | None:
    """Return the rigid robot's FRFs with positions turned round; None where it cannot be there."""
    try:
        return rigid_response(model.network(-estimate.positions), omega)
    except IdentificationError:
        return None


def _frequencies(estimate: FrfEstimate, network: SpringNetwork) -> str:
    """Compare all lines with the nominal springs at other frequencies: resonances tell."""
    step = -(-len(estimate.omega) // _MOST_LINES)
    omega, response = estimate.omega[::step], estimate.response[:, ::step]
    clear = np.abs(response) > _SIGMAS * np.sqrt(estimate.variance[:, ::step])
    if not clear.any():
        return ""

    def error(factor: float) -> float:
        return float(
            _errors(response, network.frequency_response(factor * omega), clear)[clear].mean()
        )

    causes = {
        2 * np.pi: "look like Hz",
        1 / (2 * np.pi): "look multiplied by 2 pi twice",
        1e3: "look like kHz (a sample time in ms?)",
        1e-3: "are a thousand times too large (a sample time in us?)",
    }
    before = error(1.0)
    best, factor = min((error(f), f) for f in causes)
    if not _explains(best, before):
        return ""
    return (
        f"frequencies {causes[factor]}: resonances lie {factor:.4g} times higher in the robot "
        f"(mean error {before:.2g}, {best:.2g} without it)"
    )


def _sizes(ratio: ComplexArray) -> list[str]:
    """Say which diagonal elements differ from the rigid robot's without a known cause."""
    messages = []
    for i, value in enumerate(ratio):
        angle = abs(float(np.angle(value, deg=True)))
        if not np.isfinite(value):
            continue
        if not 1 / PLAUSIBLE < abs(value) < PLAUSIBLE:
            why = "check the units" if abs(value) > 1 else "friction holds it, or units are wrong"
            messages.append(
                f"low frequencies, motor {i + 1}: the FRF is {abs(value):.3g} times the rigid "
                f"robot's; {why}"
            )
        elif angle > 60:
            messages.append(
                f"low frequencies, motor {i + 1}: the phase is {angle:.0f} degrees off the rigid "
                "robot's; angle, speed or acceleration mixed up, a delay, or friction"
            )
    return messages


def _passivity(estimate: FrfEstimate, network: SpringNetwork) -> list[str]:
    """Look for motors that give power: conjugated FRFs, delays; each position by itself."""
    omega, n = estimate.omega, network.selector.shape[1]
    factors = _motor_factors(network, omega)
    factors = _diagonal(factors)
    driving = _diagonal(estimate.response)[..., :n] / factors
    deviation = np.sqrt(_diagonal(estimate.weight_variance).real)[..., :n] / np.abs(factors)
    messages = []
    for q, (G, std) in enumerate(zip(driving, deviation, strict=True)):
        active = _activity(G, std)
        if active.max() < _ACTIVE:
            continue
        cause = _active_cause(G, std, omega)
        messages.append(
            f"position {q + 1}: motors give power, which no spring or damper lets them: {cause}; "
            f"sine up to {active.max():.2g} on the active side"
        )
    return messages


def _active_cause(response: ComplexArray, std: Array, omega: Array) -> str:
    """Return what makes FRFs (F, n) passive: their conjugates, or the least delay, undone."""
    before, reach = _activity(response, std).mean(), np.pi / omega[-1]
    delays = np.linspace(-reach, reach, 81)
    shifts = np.exp(1j * omega * delays[:, None])
    after = np.array([_activity(response * shift[:, None], std).mean() for shift in shifts])
    allowed = np.flatnonzero(after <= after.min() + 0.02 * before)
    best = allowed[np.argmin(np.abs(delays[allowed]))]
    if _activity(np.conj(response), std).mean() < after[best]:
        return "FRFs look conjugated (another sign of the Fourier transform?)"
    if after[best] < before / 3:
        late = "late" if delays[best] > 0 else "early"
        return f"angles look at least {abs(delays[best]) * 1e3:.2g} ms {late} (a delay?)"
    return "signs, units or timing are wrong"


def _motor_factors(network: SpringNetwork, omega: Array) -> ComplexArray:
    """Return what FRFs of motors, the first outputs, are per FRF of accelerations, (F, n, n)."""
    measurement, n = network.measurement, network.selector.shape[1]
    if measurement is None:
        return np.ones((len(omega), n, n), dtype=complex)
    parts = measurement.position, measurement.velocity, measurement.acceleration
    orders = np.argmax([np.any(part[..., :n, :], axis=(0, -1)) for part in parts], axis=0)
    outputs = measurement.sensors(omega)[:, :n] * (1j * omega[:, None]) ** (orders - 2)
    return np.asarray(outputs[:, :, None] * measurement.torque.response(omega)[:, None])


def _activity(response: ComplexArray, std: Array) -> Array:
    """Return how far FRFs (F, n) lie on the active side, beyond noise: mean sines of windows."""
    size = np.maximum(np.abs(response), 1e-300)
    sine, variance = response.imag / size, (std / size) ** 2 / 2
    weight = 1 / (variance + _ACTIVE**2)
    active = []
    for width in {1, max(1, len(response) // _WINDOWS)}:
        whole, total, square = (
            _summed(values, width) for values in (weight, weight * sine, weight**2 * variance)
        )
        active.append(np.maximum(-total / whole - _SIGMAS * np.sqrt(square) / whole, 0.0))
    return np.concatenate(active)


def _summed(values: Array, width: int) -> Array:
    """Return the sums of `width` rows that follow each other."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    return np.asarray(total[width:] - total[:-width])


def _reciprocity(estimate: FrfEstimate, network: SpringNetwork) -> list[str]:
    """Look for pairs of motors that do not move each other alike."""
    n = network.selector.shape[1]
    G, std = estimate.response[:, :, :n], np.sqrt(estimate.variance[:, :, :n])
    gain = _motor_factors(network, estimate.omega)
    G = G / gain
    clear = np.abs(G) > 2 * _SIGMAS * std / np.abs(gain)
    with np.errstate(all="ignore"):
        ratio = np.log(G / np.swapaxes(G, -1, -2))
    both = clear & np.swapaxes(clear, -1, -2)
    worst, pair = 0.0, (0, 0)
    for i, j in np.ndindex(n, n):
        values = ratio[..., i, j][both[..., i, j]]
        if i < j and len(values) > max(_LINES, both[..., 0, 0].size // 10):
            size = float(np.median(np.abs(values)))
            worst, pair = max((worst, pair), (size, (i, j)))
    if worst < _ASYMMETRY:
        return []
    return [
        f"motors {pair[0] + 1} and {pair[1] + 1} do not move each other alike: elements "
        f"({pair[0] + 1}, {pair[1] + 1}) and ({pair[1] + 1}, {pair[0] + 1}) differ by a factor of "
        f"{np.exp(worst):.3g} (median); an angle or a torque is scaled, turned or exchanged"
    ]


def _diagonal(matrices: NDArray[np.inexact]) -> ComplexArray:
    return np.asarray(np.diagonal(matrices, axis1=-2, axis2=-1))


def _median(values: ComplexArray) -> complex:
    finite = values[np.isfinite(values)]
    return (
        complex(np.median(finite.real), np.median(finite.imag)) if finite.size else complex(np.nan)
    )
