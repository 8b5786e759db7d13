"""Noise and nonlinear distortion separated, by repetition and by unexcited lines.

Periods of one run differ by noise, blocks with new phases by noise and by the stochastic
part of nonlinear distortions (Pintelon and Schoukens 2001, ch. 3). An odd multisine that leaves
out some odd lines shows odd distortions there and even ones at the even lines.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from estimators.frf.estimate_frf import (
    Transient,
    lines_of,
    of_positions,
    usable_spectra,
    variances,
    with_deviations,
)
from estimators.frf.local_rational_model import interpolated
from estimators.frf.spectra import Spectra, spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records


@dataclass(frozen=True, eq=False)
class Distortion:
    """Levels of noise and distortion of FRFs, and of the motors' motion between excited lines.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Excited lines.
    noise : ndarray, (Q, F, m, n)
        Variances of the FRF by noise, from what periods do not repeat.
    total : ndarray, (Q, F, m, n)
        Variances by noise and distortion, from blocks; NaN where there is one block.
    blocks : ndarray of int, (Q,)
        Blocks averaged.
    output : ndarray, (Q, F, m)
        rms acceleration at the excited lines, over blocks and runs.
    odd_omega, even_omega : ndarray, (O,) and (V,), rad/s
        Detection lines within the excited band.
    odd, even : ndarray, (Q, O, m) and (Q, V, m), rad/s^2
        rms of Y - G U there: what the linear response to the torque at these lines does not
        explain.
    odd_noise, even_noise : ndarray
        The rms that noise alone would have there.
    odd_raw, even_raw : ndarray
        rms of Y there, the response to the torque included.
    """

    positions: Array
    omega: Array
    noise: Array
    total: Array
    blocks: IntArray
    output: Array
    odd_omega: Array
    even_omega: Array
    odd: Array
    even: Array
    odd_noise: Array
    even_noise: Array
    odd_raw: Array
    even_raw: Array

    @property
    def level(self) -> Array:
        """Standard deviation (Q, F, m, n) of one block's FRF by distortion: total less noise."""
        excess = np.maximum(self.total - self.noise, 0.0)
        return np.asarray(np.sqrt(excess * self.blocks[:, None, None, None]))

    @property
    def odd_level(self) -> Array:
        """Odd distortion (Q, O, m) with the noise's part taken off [rad/s^2]."""
        return np.asarray(np.sqrt(np.maximum(self.odd**2 - self.odd_noise**2, 0.0)))

    @property
    def even_level(self) -> Array:
        """Even distortion (Q, V, m) with the noise's part taken off [rad/s^2]."""
        return np.asarray(np.sqrt(np.maximum(self.even**2 - self.even_noise**2, 0.0)))


def distortion(
    records: Records | Iterable[Records],
    method: str = "ari",
    *,
    hold: bool = True,
    delay: float = 0.0,
    transient: Transient = "auto",
    lines: IntArray | None = None,
) -> Distortion:
    """Return noise and distortion levels of the FRFs that `estimate_frf` estimates.

    Between excited lines the FRF is interpolated, see
    `estimators.frf.local_rational_model.interpolated`; as the torque is small there, so is the
    error that this makes.

    Parameters
    ----------
    records : Records or iterable of Records
        As in `estimators.estimate_frf`.
    method : str
        As in `estimators.estimate_frf`.
    hold : bool
        As in `estimators.estimate_frf`.
    delay : float
        As in `estimators.estimate_frf`.
    transient : Transient
        As in `estimators.estimate_frf`.
    lines : ndarray of int, optional
        As in `estimators.estimate_frf`.

    Raises
    ------
    InvalidInput
        If there are less than two periods, or as `estimate_frf` does.
    """
    estimated = partial(
        _of_position, method=method, hold=hold, delay=delay, transient=transient, lines=lines
    )
    positions, estimates = of_positions(records, estimated)
    last = estimates[-1]
    stacked = {name: np.array([one.levels[name] for one in estimates]) for name in last.levels}
    return Distortion(
        positions=positions,
        omega=last.omega,
        odd_omega=last.odd_omega,
        even_omega=last.even_omega,
        blocks=np.array([one.blocks for one in estimates], dtype=np.int64),
        **stacked,
    )


class _Position(NamedTuple):
    """One position's part of a `Distortion`; `levels` holds what has an axis of positions."""

    omega: Array
    odd_omega: Array
    even_omega: Array
    blocks: int
    levels: dict[str, Array]


def _of_position(
    part: Records,
    who: str,
    *,
    method: str,
    hold: bool,
    delay: float,
    transient: Transient,
    lines: IntArray | None,
) -> _Position:
    """Return the levels in one position.

    Raises
    ------
    InvalidInput
        As `distortion`.
    """
    measured = usable_spectra(
        part, who, method, hold=hold, delay=delay, transient=transient, lines=lines
    )
    if measured.periods < 2:
        raise InvalidInput(f"{who}: one period; distortion needs at least 2, to see the noise")
    response, noise, _ = with_deviations(measured, method, "noise", who)
    total = np.full(response.shape, np.nan)
    if len(measured.present) > 1:
        total = variances(with_deviations(measured, method, "total", who)[1])
    levels = {"noise": variances(noise), "total": total, "output": _rms(measured)}
    unexcited = detection_lines(part, lines)
    first = part.torque.shape[3] - measured.periods
    for name, k in zip(("odd", "even"), unexcited, strict=True):
        between = spectra(part, 0, k, hold, delay, first)
        levels |= _between(name, between, measured.omega, response)
    unit = 2 * np.pi / (part.samples * part.sample_time)
    odd, even = (np.asarray(unit * k, dtype=float) for k in unexcited)
    return _Position(measured.omega, odd, even, len(measured.present), levels)


def detection_lines(records: Records, lines: IntArray | None = None) -> tuple[IntArray, IntArray]:
    """Return the odd and the even detection lines within the excited band, or that of `lines`.

    Odd ones are declared; every even line that is not excited is one where all excited are odd.
    """
    band = lines_of(records, lines)
    first, last = int(band[0]), int(band[-1])
    inside = records.detection[(records.detection >= first) & (records.detection <= last)]
    even = np.arange(first + first % 2, last + 1, 2)
    if (records.lines % 2 == 0).any():
        even = even[:0]
    return inside[inside % 2 == 1], even


def _rms(measured: Spectra) -> Array:
    """Return the rms (F, m) of period-averaged outputs over the runs that are present."""
    power = np.abs(measured.output.mean(axis=1)) ** 2
    return np.asarray(np.sqrt(power.sum(axis=(0, 3)) / measured.present.sum()))


def _between(
    name: str, measured: Spectra, omega: Array, response: ComplexArray
) -> dict[str, Array]:
    count = int(measured.present.sum())
    G = interpolated(measured.omega, omega, response)
    error = (measured.output - G @ measured.input).mean(axis=1)
    power = (np.abs(error) ** 2).sum(axis=(0, 3)) / count
    alone = measured.noise_output - G @ measured.noise_input
    noise = (np.abs(alone) ** 2).mean(axis=1).sum(axis=(0, 3)) / count
    return {
        name: np.sqrt(power),
        f"{name}_noise": np.sqrt(noise),
        f"{name}_raw": _rms(measured),
    }
