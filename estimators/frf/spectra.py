"""From samples to spectra: DFT lines of torque, outputs (motor accelerations) and reference."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

# Neighbours on either side of a line that show its noise, at most.
_REACH = 4


@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier coefficients of one position's runs, period by period.

    Columns of the matrices are the runs of a block. Runs that are missing are zero
    in every signal, so that they vanish from sums over runs.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    reference : ndarray of complex, (B, P, F, n, E), rad/s
        Speed reference.
    input : ndarray of complex, (B, P, F, n, E), N m
        Torque as the motors saw it, the hold included.
    output : ndarray of complex, (B, P, F, m, E), rad/s^2
        Motor acceleration, or other outputs in their units.
    noise_input, noise_output : ndarray of complex, (B, J, F, ., E)
        At J frequencies around each line where no periodic signal is: bins of the whole record
        between those of its period; J = 0 for one period. They are scaled as averages over the
        periods are, so that their power is the averages' noise.
    noise_bins : float
        How many of the J bins a line has for itself: neighbouring lines may share some.
    present : ndarray, (B, E)
        Whether a run was measured.
    """

    omega: Array
    reference: ComplexArray
    input: ComplexArray
    output: ComplexArray
    noise_input: ComplexArray
    noise_output: ComplexArray
    noise_bins: float
    present: NDArray[np.bool_]

    @property
    def periods(self) -> int:
        """Number P of periods."""
        return int(self.input.shape[1])

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which blocks (B,) have all of their runs."""
        return np.asarray(self.present.all(axis=1))

    def averaged(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return output, input and reference averaged over the periods, (B, F, ., E)."""
        return self.output.mean(axis=1), self.input.mean(axis=1), self.reference.mean(axis=1)

    def blocks(self, which: NDArray[Any]) -> "Spectra":
        """Return the spectra of some blocks."""
        return Spectra(
            self.omega,
            self.reference[which],
            self.input[which],
            self.output[which],
            self.noise_input[which],
            self.noise_output[which],
            self.noise_bins,
            self.present[which],
        )


def spectra(
    records: Records,
    index: int = 0,
    lines: IntArray | None = None,
    hold: bool = True,
    delay: float = 0.0,
    first: int = 0,
) -> Spectra:
    """Return the spectra in position `index` at `lines` (the excited ones by default).

    A torque held over a sample T has the continuous-time coefficient sinc(omega T/2)
    e^{-j omega T/2} times its DFT. An angle, sampled at instants, is differentiated twice by
    (j omega)^2, exact for a periodic signal; other outputs as often as the records say.

    Parameters
    ----------
    hold : bool
        Whether the torque was held over each sample; otherwise it is taken as sampled, as measured
        torques always are, see `Records.commanded`.
    delay : float, s
        Time by which the measured angle lags the torque, e.g. a filter's or a bus's.
    first : int
        Periods before this one are dropped.
    """
    if not np.isfinite(delay):
        raise InvalidInput(f"delay: {delay!r} s is not a number")
    periods = records.torque.shape[3]
    if not 0 <= first < periods:
        raise InvalidInput(
            f"transient: {first} of {periods} periods cannot be dropped; give 0 to {periods - 1}"
        )
    P, T = periods - first, records.sample_time
    k = records.lines if lines is None else np.asarray(lines, dtype=np.int64)
    unit = float(2 * np.pi / (records.samples * T))
    present = ~records.missing[index]
    torque, angle = (
        np.where(present[:, :, None, None, None], signal[index][:, :, first:], 0.0)
        for signal in (records.torque, records.angle)
    )
    reference = np.where(present[:, :, None, None, None], records.reference[index], 0.0)
    reference = reference[:, :, first:] if reference.shape[2] > 1 else reference
    omega = np.asarray(unit * k, dtype=float)
    hold = hold and records.commanded
    at = _transfer(omega, T, hold, delay, records.derivatives)
    u, y, r = (_lines(signal, k) for signal in (torque, angle, reference))
    noise_u, noise_y = (_between(signal, k) for signal in (torque, angle))
    bins = _neighbours(k, P)
    near = _transfer(unit * bins / P, T, hold, delay, records.derivatives)
    return Spectra(
        omega=omega,
        reference=np.broadcast_to(r, u.shape),
        input=u * at[0][:, None, None],
        output=y * at[1][..., None],
        noise_input=noise_u * near[0][..., None, None],
        noise_output=noise_y * near[1][..., None],
        noise_bins=len(np.unique(bins)) / max(len(k), 1),
        present=present,
    )


def _transfer(
    omega: Array, sample_time: float, hold: bool, delay: float, derivatives: IntArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return what turns coefficients of torques (...) and of outputs (..., m) into U and Y."""
    half = omega * sample_time / 2
    hold_factor = (
        np.sinc(half / np.pi) * np.exp(-1j * half) if hold else np.ones(omega.shape, complex)
    )
    jw = 1j * omega[..., None]
    return np.asarray(hold_factor), np.asarray(jw**derivatives * np.exp(jw * delay))


def _neighbours(lines: IntArray, periods: int) -> IntArray:
    """Return the bins (J, F) of the whole record nearest to the lines' own on either side."""
    reach = min(max(1, (periods - 1) // 2), _REACH) if periods > 1 else 0
    away = np.array([j for i in range(1, reach + 1) for j in (-i, i)], dtype=np.int64)
    return np.asarray(periods * lines + away[:, None])


def _lines(signal: Array, lines: IntArray) -> ComplexArray:
    """Return the coefficients (B, P, F, c, E) of samples (B, E, P, N, c), period by period."""
    transform = np.fft.rfft(signal, axis=3)[:, :, :, lines] / signal.shape[3]
    return np.asarray(transform.transpose(0, 2, 3, 4, 1))


def _between(signal: Array, lines: IntArray) -> ComplexArray:
    """Return the coefficients (B, J, F, c, E) of all periods in one, at the lines' neighbours.

    Noise that lasts from one period into the next makes their errors dependent, so the scatter
    over periods would mistake the uncertainty of their mean, most of all for free motors, whose
    angles random torques set adrift. One transform of all periods keeps no such error.
    """
    B, E, P, N, c = signal.shape
    whole = signal.reshape(B, E, P * N, c)
    bins = _neighbours(lines, P)
    transform = np.fft.rfft(whole, axis=2)[:, :, bins] / (P * N)
    return np.asarray(transform.transpose(0, 2, 3, 4, 1))
