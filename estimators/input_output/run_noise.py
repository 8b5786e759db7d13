"""Noise of runs: between the bins of periods, over blocks, at silent lines, or as stated."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimators.frf.record_checks import check_condition
from estimators.frf.spectra import Spectra
from estimators.input_output.silent_lines import SilentLines
from robotmodels.common.arrays import ComplexArray, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

NEAREST = 6
"""Lines without excitation that show the noise of an excited one."""

FEWEST = 3
"""Degrees of freedom of a covariance at least, see `estimators.fit`."""

_BLOCKS = 4
"""From so many on their scatter is preferred to that of periods."""


def possible_noise(measured: Spectra) -> str:
    """Return the best way to the noise that a position's records allow."""
    blocks, periods, _, n, runs = measured.reference.shape
    if runs == n and blocks >= _BLOCKS and measured.reference.any():
        return "blocks"
    enough = periods > 1 and measured.noise_bins * measured.present.sum() >= FEWEST
    return "periods" if enough else "detection"


@dataclass(frozen=True, eq=False)
class RunNoise:
    """Spectra of one position with their noise; n inputs, or 2 n with the shares of friction.

    Attributes
    ----------
    outputs : ndarray of complex, (E, F, m)
        Outputs of each run.
    inputs : ndarray of complex, (E, F, n)
        Inputs.
    covariance : ndarray of complex, (F, m + n, m + n)
        Of the errors of both.
    degrees_of_freedom : float
        Of the covariance.
    silent : SilentLines or None
        Lines that tell it.
    """

    outputs: ComplexArray
    inputs: ComplexArray
    covariance: ComplexArray
    degrees_of_freedom: float
    silent: SilentLines | None = None


def _from_blocks(
    measured: Spectra, records: Records, read: Callable[..., Spectra], who: str
) -> RunNoise:
    output, torque, reference = measured.averaged()
    blocks, _, n, runs = reference.shape
    if runs != n or blocks < 2 or not reference.any():
        raise InvalidInput(
            f"{who}: noise 'blocks' needs {n} runs a block, two blocks and references; here are "
            f"runs a block: {runs}, blocks: {blocks}; take 'periods' or 'detection'"
        )
    check_condition(reference[0], measured.omega, measured.omega, who, "references")
    inverse = np.linalg.inv(reference)
    # K K^H = (mean of (R R^H)^-1)^-1: the errors of the mean's columns are alike and independent
    spread = (np.conj(np.swapaxes(inverse, -1, -2)) @ inverse).mean(axis=0)  # (F, n, n)
    K = np.linalg.inv(np.conj(np.swapaxes(np.linalg.cholesky(spread), -1, -2)))
    turned = np.concatenate([output, torque], axis=2) @ inverse @ K  # (B, F, m + n, E)
    mean = turned.mean(axis=0)
    errors = turned - mean
    freedom = float((blocks - 1) * runs)
    covariance = np.einsum("bfie,bfje->fij", errors, np.conj(errors)) / (freedom * blocks)
    m = output.shape[2]
    return RunNoise(_by_run(mean[None, :, :m]), _by_run(mean[None, :, m:]), covariance, freedom)


def _from_periods(
    measured: Spectra, records: Records, read: Callable[..., Spectra], who: str
) -> RunNoise:
    if measured.periods < 2:
        raise InvalidInput(f"{who}: noise 'periods' needs two periods; take 'detection'")
    noise = np.concatenate([measured.noise_output, measured.noise_input], axis=3)
    covariance = np.einsum("bjfie,bjfke->fik", noise, np.conj(noise))
    draws = noise.shape[0] * noise.shape[1] * noise.shape[4]
    output, torque, _ = measured.averaged()
    freedom = float(measured.noise_bins * measured.present.sum())
    return RunNoise(_by_run(output), _by_run(torque), covariance / draws, freedom)


def _from_detection(
    measured: Spectra, records: Records, read: Callable[..., Spectra], who: str
) -> RunNoise:
    """Return the noise of the nearest lines of their own; odd ones, where any were left out."""
    lines, count = records.lines, records.samples // 2
    others = records.detection
    if len(others) < NEAREST:
        others = np.setdiff1d(np.arange(1, count), lines)
    if len(others) < NEAREST:
        raise InvalidInput(
            f"{who}: {len(others)} lines are not excited; noise 'detection' needs {NEAREST}"
        )
    first = records.torque.shape[3] - measured.periods
    beside = read(records, lines=others, first=first)
    output, torque, _ = beside.averaged()
    nearest = np.argsort(np.abs(others - lines[:, None]), axis=1)[:, :NEAREST]
    noise = _by_run(output), _by_run(torque)
    silent = SilentLines(beside.omega, *noise, records.derivatives, nearest)
    output, torque, _ = measured.averaged()
    covariance, freedom = silent.covariance(measured.omega), silent.degrees_of_freedom
    return RunNoise(_by_run(output), _by_run(torque), covariance, freedom, silent)


def declared(
    noise: tuple[ArrayLike, ArrayLike],
    hold: bool,
    measured: Spectra,
    records: Records,
    read: Callable[..., Spectra],
    who: str,
) -> RunNoise:
    """Return spectra with the noise of samples whose standard deviations are stated."""
    output, torque, reference = measured.averaged()
    (m, n), samples = (output.shape[2], reference.shape[2]), measured.periods * records.samples
    stds = []
    for name, value, count in zip(("torques", "angles"), noise, (n, m), strict=True):
        std = np.broadcast_to(real_numbers(value, f"noise of {name}"), (count,))
        if not (std >= 0).all():
            raise InvalidInput(f"noise of {name}: {std.min():g}; standard deviations are >= 0")
        stds.append(std)
    torques, angles = stds
    readings = measured.omega[:, None] ** records.derivatives * angles
    hold_gain = np.sinc(measured.omega * records.sample_time / (2 * np.pi))
    hold_gain = hold_gain if hold and records.commanded else np.ones_like(hold_gain)
    shares = np.zeros((len(hold_gain), torque.shape[2] - n))  # without errors
    white = np.concatenate([readings, np.multiply.outer(hold_gain, torques), shares], 1)
    unit = np.eye(white.shape[1])
    covariance = np.asarray(white[:, :, None] ** 2 * unit / samples, dtype=complex)
    return RunNoise(_by_run(output), _by_run(torque), covariance, np.inf)


NoiseOf = Callable[[Spectra, Records, Callable[..., Spectra], str], RunNoise]

NOISES: dict[str, NoiseOf] = {
    "blocks": _from_blocks,
    "periods": _from_periods,
    "detection": _from_detection,
}


def _by_run(signals: ComplexArray) -> ComplexArray:
    """Return spectra (B, F, c, E / B) run by run, (E, F, c)."""
    by_run = np.moveaxis(signals, 3, 1)
    return by_run.reshape(-1, *by_run.shape[2:])
