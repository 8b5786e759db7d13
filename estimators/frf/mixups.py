"""Mix-ups of units, signs, sides, motors and positions, as corrections of measured FRFs.

Each one is undone in turn; the cause is named whose undoing makes the data fit the robot.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray

# A factor between units is recognised within this, in ln; and is one at all from 1.3 on.
_NEAR = 0.12
LEAST_FACTOR = 1.3
_MOST_PAIRS = 12  # of motors, or positions, that are exchanged two by two

_ANGLES = {
    180 / np.pi: "angles look like degrees",
    np.pi / 180: "angles look converted from degrees, though they were radians",
    1 / (2 * np.pi): "angles look like revolutions",
    2 * np.pi: "angles look converted from revolutions, though they were radians",
    1e3: "angles look like milliradians, or torques like kN m",
}
_TIMES = {
    1e-6: "sample times look like ms",
    1e6: "sample times look converted from ms, though they were s",
    4 * np.pi**2: "frequencies look multiplied by 2 pi twice",
    1 / (4 * np.pi**2): "frequencies look like Hz",
}
_TORQUES = {
    1e-3: "torques look like mN m",
    1e3: "torques look like kN m",
    0.7375621: "torques look like foot pounds",
    0.5: "torques look like peak to peak values",
    np.sqrt(2): "torques look like root mean squares",
}


@dataclass(frozen=True, eq=False)
class MixUp:
    """One possible cause, and the FRFs as they would be without it.

    Attributes
    ----------
    cause : str
        The cause in words, with the factor as evidence where there is one.
    response : ndarray of complex, (Q, F, m, n)
        FRFs with the mix-up undone.
    """

    cause: str
    response: ComplexArray


def mix_ups(
    response: ComplexArray,
    expected: ComplexArray,
    weight: Array,
    omega: Array,
    gears: Array,
) -> Iterator[MixUp]:
    """Yield possible mix-ups, the simplest first.

    Parameters
    ----------
    response, expected : ndarray of complex, (Q, F, m, n)
        FRFs that were measured, and those of the rigid robot.
    weight : ndarray, (Q, F, m, n)
        Weights of the elements by how certain they are; zero of those that tell nothing.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    gears : ndarray, (n,)
        Gear ratios.
    """
    ratio = np.abs(response / np.where(weight > 0, expected, 1.0))
    yield from _gears(response, gears)
    yield from _common(response, ratio, weight)
    s = 1j * omega[:, None, None]
    yield MixUp("outputs look like speeds in place of accelerations", response * s)
    yield MixUp("outputs look like angles in place of accelerations", response * s**2)
    yield from _of_one_motor(response, ratio, weight)
    yield from _exchanged_motors(response)
    yield from _positions(response, ratio, weight)


def _common(response: ComplexArray, ratio: Array, weight: Array) -> Iterator[MixUp]:
    yield MixUp("all signs are wrong; turn the torques' or the angles'", -response)
    factor = _median(ratio, weight)
    if _is_factor(factor):
        words = _units(factor, _TIMES | _TORQUES | _ANGLES) or "torques or angles have another unit"
        yield MixUp(f"{words}: gain {factor:.3g} everywhere", response / factor)


def _gears(response: ComplexArray, gears: Array) -> Iterator[MixUp]:
    """Yield angles and torques of the other side of the gears."""
    motors, outputs = len(gears), response.shape[2]
    if (np.abs(np.log(gears)) < np.log(LEAST_FACTOR)).all():
        return
    rows = np.append(gears, np.ones(outputs - motors))[:, None]
    size = f"{gears.min():.4g}" + (f" to {gears.max():.4g}" if np.ptp(gears) else "")
    for what, factors in (
        ("angles", rows),
        ("torques", gears),
        ("angles and torques", rows * gears),
    ):
        for words, corrected in (
            ("the arm side in place of the motors'", response * factors),
            ("the motors' side in place of the arm's", response / factors),
        ):
            yield MixUp(f"{what} look like those of {words}: gear ratios {size}", corrected)


def _of_one_motor(response: ComplexArray, ratio: Array, weight: Array) -> Iterator[MixUp]:
    outputs, motors = response.shape[2:]
    if motors == 1:
        return
    for i in range(max(outputs, motors)):
        sides = [("angle" if i < motors else "acceleration", 2)] * (i < outputs)
        sides += [("torque", 3)] * (i < motors)
        for what, axis in sides:
            name = f"{what} of motor {i + 1}" if i < motors else f"output {i + 1}"
            yield MixUp(f"{name}: wrong sign", _scaled(response, axis, i, -1.0))
            factor = _median(np.take(ratio, i, axis), np.take(weight, i, axis))
            if _is_factor(factor):
                words = _units(factor, _TORQUES if what == "torque" else _ANGLES)
                words = words or "another unit, or side of the gear"
                yield MixUp(
                    f"{name}: {words}: gain {factor:.3g}", _scaled(response, axis, i, 1 / factor)
                )
        if len(sides) == 2:
            both = _scaled(_scaled(response, 2, i, -1.0), 3, i, -1.0)
            cause = f"motor {i + 1}: torque and angle are both turned round, couplings change sign"
            yield MixUp(cause, both)


def _exchanged_motors(response: ComplexArray) -> Iterator[MixUp]:
    outputs, motors = response.shape[2:]
    same = np.arange(outputs), np.arange(motors)
    orders = []
    if motors <= _MOST_PAIRS:
        for a, b in combinations(range(motors), 2):
            order = np.arange(motors)
            order[[a, b]] = b, a
            orders.append((f"motors {a + 1} and {b + 1} look exchanged", order))
    if motors > 2:
        for step in (1, -1):
            orders.append(
                (f"motors look numbered from another one on (by {step})", np.roll(same[1], step))
            )
    for words, order in orders:
        rows = np.append(order, same[0][motors:])
        yield MixUp(f"angles: {words}", response[:, :, rows])
        yield MixUp(f"torques: {words}", response[..., order])
        yield MixUp(f"torques and angles: {words}", response[:, :, rows][..., order])


def _positions(response: ComplexArray, ratio: Array, weight: Array) -> Iterator[MixUp]:
    count = len(response)
    if not 1 < count <= _MOST_PAIRS:
        return
    for q in range(count):
        factor = _median(ratio[q], weight[q])
        if _is_factor(factor):
            words = _units(factor, _TORQUES | _ANGLES) or "another unit"
            cause = f"position {q + 1}: {words}: gain {factor:.3g} there alone"
            yield MixUp(cause, _scaled(response, 0, q, 1 / factor))
        yield MixUp(f"position {q + 1}: all signs are wrong", _scaled(response, 0, q, -1.0))
    for a, b in combinations(range(count), 2):
        order = np.arange(count)
        order[[a, b]] = b, a
        yield MixUp(f"positions {a + 1} and {b + 1} look exchanged", response[order])


def _scaled(response: ComplexArray, axis: int, index: int, factor: float) -> ComplexArray:
    corrected = np.array(np.moveaxis(response, axis, 0))
    corrected[index] *= factor
    return np.moveaxis(corrected, 0, axis)


def _units(factor: float, units: dict[float, str]) -> str:
    """Return which units explain a factor in G, or nothing."""
    for size, words in units.items():
        if abs(np.log(factor / size)) < _NEAR:
            return words
    return ""


def _is_factor(factor: float) -> bool:
    return bool(np.isfinite(factor) and abs(np.log(factor)) > np.log(LEAST_FACTOR))


def _median(values: Array, weight: Array) -> float:
    """Return the weighted median of positive values; not a number without weight."""
    order = np.argsort(values, axis=None)
    share = np.cumsum(weight.ravel()[order])
    if share[-1] == 0:
        return float("nan")
    return float(values.ravel()[order][np.searchsorted(share, share[-1] / 2)])
