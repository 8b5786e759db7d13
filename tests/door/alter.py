"""The alterations of `alterations.txt`, as functions of good records or of good FRFs."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from good_data import SAMPLE_TIME, GoodData

from estimators import FrfEstimate, check_rigid_limit, estimate_frf, fit
from robotmodels import IdentificationError, IdentificationWarning, Records

TURN = 2 * np.pi
LIST = Path(__file__).with_name("alterations.txt")


def listed() -> dict[str, str]:
    """Return how each alteration may be met, by its name."""
    lines = [x.split("; ") for x in LIST.read_text().splitlines() if not x.startswith("#")]
    return {name: how for name, _, how in lines}


def estimated(
    data: GoodData, records: Records, covariance: str = "total"
) -> tuple[FrfEstimate, list[str]]:
    """Return FRFs and the warnings about their records."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", IdentificationWarning)
        estimate = estimate_frf(records, structure="diagonal", covariance=covariance)
    return estimate, [str(w.message) for w in caught]


def questions(data: GoodData, name: str, good: FrfEstimate | None = None) -> list[str]:
    """Return what is said of data that an alteration spoiled, or the refusal; "" spoils nothing."""
    try:
        if name in FRFS:
            estimate, said = FRFS[name](good or estimated(data, data.records)[0], data), []
        else:
            records = RECORDS[name](data.records, data) if name else data.records
            # Copies of periods do no harm to a covariance over blocks.
            covariance = "noise" if name == "periods_copied" else "total"
            estimate, said = estimated(data, records, covariance)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", IdentificationWarning)
            check_rigid_limit(estimate, data.robot)
            fit(data.robot, estimate, "nls", "optimal_diagonal", max_evaluations=1)
    except IdentificationError as error:
        return [f"refused: {error}"]
    return said + [str(w.message) for w in caught]


def changed(e: FrfEstimate, change: Callable[[Any], Any], **entries: Any) -> FrfEstimate:
    """Return FRFs with changed response, and noise that went through the same change."""
    variance = np.abs(change(np.sqrt(e.variance) + 0j)) ** 2
    return replace(
        e,
        **({"response": change(e.response), "covariance": variance, "deviations": None} | entries),
    )


def scaled(rows: Any = 1.0, columns: Any = 1.0) -> Callable[..., FrfEstimate]:
    """Return an alteration that scales outputs (m,) and inputs (n,)."""

    def alter(e: FrfEstimate, data: GoodData) -> FrfEstimate:
        r, c = (one(data) if callable(one) else np.asarray(one) for one in (rows, columns))
        return changed(e, lambda G: np.atleast_1d(r)[:, None] * G * c)

    return alter


def first(factor: Any) -> Callable[[GoodData], np.ndarray]:
    def factors(data: GoodData) -> np.ndarray:
        values = np.ones(len(data.robot.motor_names))
        values[0] = factor(data)[0] if callable(factor) else factor
        return values

    return factors


def gears(data: GoodData) -> np.ndarray:
    return np.abs(data.robot.network(data.records.positions).selector).max(axis=0)


def of_first(change: Callable[[Any], Any]) -> Callable[..., FrfEstimate]:
    def alter(e: FrfEstimate, data: GoodData) -> FrfEstimate:
        def only(G: np.ndarray) -> np.ndarray:
            return np.concatenate([change(G[:1]), G[1:]])

        return changed(e, only)

    return alter


def ordered(rows: bool, columns: bool, order: Callable[[int], Any]) -> Callable[..., FrfEstimate]:
    def alter(e: FrfEstimate, data: GoodData) -> FrfEstimate:
        k = order(e.response.shape[-1])
        return changed(e, lambda G: (G[:, :, k] if rows else G)[..., k if columns else slice(None)])

    return alter


def swap(n: int) -> list[int]:
    return [1, 0, *range(2, n)] if n > 1 else [0]


def lines(order: Callable[[np.ndarray], np.ndarray], data_too: bool) -> Callable[..., FrfEstimate]:
    def alter(e: FrfEstimate, data: GoodData) -> FrfEstimate:
        k = order(np.arange(len(e.omega)))
        if not data_too:
            return replace(e, omega=e.omega[k])
        return changed(e, lambda G: G[:, k], omega=e.omega[k], line_correlation=())

    return alter


def jw(power: int) -> Callable[..., FrfEstimate]:
    return lambda e, data: changed(e, lambda G: G * (1j * e.omega[:, None, None]) ** power)


def times(factor: float) -> Callable[..., FrfEstimate]:
    return lambda e, data: replace(e, omega=factor * e.omega)


def placed(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., FrfEstimate]:
    return lambda e, data: replace(e, positions=change(e.positions))


FRFS: dict[str, Callable[[FrfEstimate, GoodData], FrfEstimate]] = {
    "degrees": scaled(360 / TURN),
    "revolutions": scaled(1 / TURN),
    "milliradians": scaled(1e3),
    "counts": scaled(4096 / TURN),
    "degrees_of_one": scaled(first(360 / TURN)),
    "milli_torque": scaled(1e-3),
    "current": scaled(0.1),
    "foot_pounds": scaled(1 / 0.7375621),
    "arm_angle": scaled(lambda d: 1 / gears(d)),
    "arm_torque": scaled(1.0, lambda d: 1 / gears(d)),
    "arm_both": scaled(lambda d: 1 / gears(d), lambda d: 1 / gears(d)),
    "arm_angle_of_one": scaled(first(lambda d: 1 / gears(d))),
    "torque_of_one_position": of_first(lambda G: G / 2),
    "peak_to_peak": scaled(0.5),
    "root_mean_square": scaled(np.sqrt(2)),
    "hertz": times(1 / TURN),
    "twice_converted": times(TURN),
    "speed": jw(-1),
    "angle_response": jw(-2),
    "torque_sign": scaled(-1.0),
    "torque_sign_of_one": scaled(1.0, first(-1.0)),
    "angle_sign_of_one": scaled(first(-1.0)),
    "both_signs_of_one": scaled(first(-1.0), first(-1.0)),
    "conjugate": lambda e, d: changed(e, np.conj),
    "conjugate_of_one_position": of_first(np.conj),
    "angles_swapped": ordered(True, False, swap),
    "torques_swapped": ordered(False, True, swap),
    "motors_swapped": ordered(True, True, swap),
    "motors_rolled": ordered(True, True, lambda n: np.roll(np.arange(n), 1)),
    "rows_rolled": ordered(True, False, lambda n: np.roll(np.arange(n), -1)),
    "transposed": lambda e, d: changed(e, lambda G: np.swapaxes(G, -1, -2)),
    "positions_swapped": placed(lambda q: q[[1, 0, *range(2, len(q))]]),
    "position_degrees": placed(lambda q: q * 360 / TURN),
    "position_signs": placed(lambda q: -q),
    "frequencies_reversed": lines(lambda k: k[::-1], False),
    "lines_unsorted": lines(lambda k: np.roll(k, 3), True),
    "line_twice": lines(lambda k: np.sort(np.append(k, 5)), True),
    "lines_off_by_one": lambda e, d: replace(e, omega=e.omega + TURN / (400 * SAMPLE_TIME)),
    "magnitudes": lambda e, d: replace(e, response=np.abs(e.response), deviations=None),
    "positions_copied": lambda e, d: e.subset([0, 0, *range(1, len(e.positions))]),
}


def angles(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Records]:
    def alter(r: Records, data: GoodData) -> Records:
        return replace(r, angle=change(np.array(r.angle)))

    return alter


def slipped(where: tuple[Any, ...], samples: int) -> Callable[..., Records]:
    """Shift angles [Q, B, E, P, N, n] along whole records."""

    def alter(angle: np.ndarray) -> np.ndarray:
        part = angle[where]
        flat = part.reshape(*part.shape[:-3], -1, part.shape[-1])
        angle[where] = np.roll(flat, samples, axis=-2).reshape(part.shape)
        return angle

    return angles(alter)


def later_periods(angle: np.ndarray) -> np.ndarray:
    angle[:, :, :, 1:] = np.roll(angle[:, :, :, 1:], 3, axis=4)
    return angle


def drift(angle: np.ndarray) -> np.ndarray:
    ramp = np.arange(angle.shape[4]) / angle.shape[4]
    return angle + 3 * np.std(angle, axis=4, keepdims=True) * ramp[:, None]


def random_drift(angle: np.ndarray) -> np.ndarray:
    Q, B, E, P, N, n = angle.shape
    steps = np.random.default_rng(5).standard_normal((Q, B, E, P * N, n)).cumsum(axis=3)
    return angle + 0.2 * np.std(angle, axis=4, keepdims=True) * steps.reshape(angle.shape)


def wrapped(angle: np.ndarray) -> np.ndarray:
    half = np.abs(angle).max(axis=4, keepdims=True) / 2
    return (angle + half) % (2 * half) - half


def wrapped_block(angle: np.ndarray) -> np.ndarray:
    angle[:, 1] = wrapped(angle)[:, 1]
    return angle


def quantised(angle: np.ndarray) -> np.ndarray:
    step = np.ptp(angle, axis=4, keepdims=True) / 20
    return np.round(angle / step) * step


def dropout(angle: np.ndarray) -> np.ndarray:
    angle[:, 1, 0, :, 100:120] = angle[:, 1, 0, :, 100:101]
    return angle


def gap(angle: np.ndarray) -> np.ndarray:
    angle[0, 1, 0, 1, 100:120] = np.nan
    return angle


def clipped(r: Records, data: GoodData) -> Records:
    limit = 0.6 * np.abs(r.torque).max(axis=(3, 4), keepdims=True)
    cut = np.clip(r.torque, -limit, limit)
    # What the angle lacks, by the rigid inertia alone: twice integrated.
    omega = TURN * np.fft.rfftfreq(r.samples, r.sample_time)
    lost = np.fft.rfft(cut - r.torque, axis=4)
    G = data.robot.network(r.positions).frequency_response(omega[1:])
    moved = np.zeros_like(lost)
    G = G[:, None, None, None] @ lost[:, :, :, :, 1:, :, None]
    moved[:, :, :, :, 1:] = -G[..., 0] / omega[1:, None] ** 2
    return replace(r, angle=r.angle + np.fft.irfft(moved, axis=4, n=r.samples))


def blocks(order: Callable[[int], list[int]], *, reference: bool) -> Callable[..., Records]:
    def alter(r: Records, data: GoodData) -> Records:
        k = order(r.torque.shape[1])
        new = {x: getattr(r, x)[:, k] for x in ("reference", "torque", "angle", "saturated")}
        return replace(r, **new)

    return alter


def same_phases(r: Records, data: GoodData) -> Records:
    rng = np.random.default_rng(6)
    noise = {
        x: getattr(r, x) - getattr(r, x).mean(axis=3, keepdims=True) for x in ("torque", "angle")
    }
    mean = {x: getattr(r, x)[:, :1].mean(axis=3, keepdims=True) for x in noise}
    order = rng.permutation(r.torque.shape[1])
    return replace(
        r,
        reference=np.repeat(r.reference[:, :1], r.reference.shape[1], axis=1),
        **{x: mean[x] + noise[x][:, order] for x in noise},
    )


def periods_copied(r: Records, data: GoodData) -> Records:
    P = r.torque.shape[3]
    return replace(
        r, **{x: np.repeat(getattr(r, x)[:, :, :, :1], P, axis=3) for x in ("torque", "angle")}
    )


def truncated(r: Records, data: GoodData) -> Records:
    N = r.samples - 3
    new = {x: getattr(r, x)[:, :, :, :, :N] for x in ("reference", "torque", "angle")}
    return replace(r, **new)


def not_excited(r: Records, data: GoodData) -> Records:
    return replace(r, lines=np.sort(np.append(r.lines, [7, 23])))


def sampled(factor: float) -> Callable[..., Records]:
    return lambda r, data: replace(r, sample_time=factor * r.sample_time)


RECORDS: dict[str, Callable[[Records, GoodData], Records]] = {
    "milliseconds": sampled(1e3),
    "delay_of_one": slipped((...,), 1),
    "delay_of_five": slipped((...,), 5),
    "advance": slipped((...,), -1),
    "slipped_run": slipped((slice(None), 1, 0), 3),
    "slipped_block": slipped((slice(None), 1), 3),
    "slipped_period": angles(later_periods),
    "drift": angles(drift),
    "random_drift": angles(random_drift),
    "wrapped": angles(wrapped),
    "wrapped_block": angles(wrapped_block),
    "quantised": angles(quantised),
    "clipped": clipped,
    "dropout": angles(dropout),
    "gap": angles(gap),
    "blocks_copied": blocks(lambda n: [0] * n, reference=True),
    "one_block_copied": blocks(lambda n: [0, 0, *range(2, n)], reference=True),
    "same_phases": same_phases,
    "periods_copied": periods_copied,
    "truncated": truncated,
    "not_excited": not_excited,
    "resampled": sampled(1.01),
}
