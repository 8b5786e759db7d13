"""From samples to spectra: DFT lines of torque, motor acceleration and reference."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.arrays import Array, ComplexArray, IntArray
from robotmodels.errors import InvalidInput
from robotmodels.records import Records


@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier coefficients of one position's experiments, period by period.

    Columns of the matrices are the experiments of a block. Experiments that are missing are zero
    in every signal, so that they vanish from sums over experiments.

    Attributes
    ----------
    omega : (F,) [rad/s].
    reference : (B, P, F, n, E) speed reference [rad/s].
    input : (B, P, F, n, E) torque as the motors saw it, the hold included [N m].
    output : (B, P, F, m, E) motor acceleration [rad/s^2].
    present : (B, E) whether an experiment was measured.
    """

    omega: Array
    reference: ComplexArray
    input: ComplexArray
    output: ComplexArray
    present: NDArray[np.bool_]

    @property
    def periods(self) -> int:
        """Number P of periods."""
        return int(self.input.shape[1])

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which blocks (B,) have all of their experiments."""
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
            self.present[which],
        )

    def from_period(self, first: int) -> "Spectra":
        """Return the spectra without the periods before `first`."""
        if not 0 <= first < self.periods:
            raise InvalidInput(
                f"transient: {first} of {self.periods} periods cannot be dropped; give 0 to "
                f"{self.periods - 1}"
            )
        return Spectra(
            self.omega,
            self.reference[:, first:],
            self.input[:, first:],
            self.output[:, first:],
            self.present,
        )


def spectra(
    records: Records,
    index: int = 0,
    lines: IntArray | None = None,
    hold: bool = True,
    delay: float = 0.0,
) -> Spectra:
    """Return the spectra in position `index` at `lines` (the excited ones by default).

    A torque held over a sample T has the continuous-time coefficient sinc(omega T/2)
    e^{-j omega T/2} times its DFT. The angle, sampled at instants, is differentiated twice by
    (j omega)^2, exact for a periodic signal.

    Parameters
    ----------
    hold : whether the torque was held over each sample; otherwise it is taken as sampled.
    delay : time by which the measured angle lags the torque, e.g. a filter's or a bus's [s].
    """
    if not np.isfinite(delay):
        raise InvalidInput(f"delay: {delay!r} s is not a number")
    k = records.lines if lines is None else np.asarray(lines, dtype=np.int64)
    omega = np.asarray(2 * np.pi * k / (records.samples * records.sample_time), dtype=float)
    half = omega * records.sample_time / 2
    held = np.sinc(half / np.pi) * np.exp(-1j * half) if hold else np.ones(len(k))
    present = ~records.missing[index]
    torque = _lines(records.torque[index], k, present) * held[:, None, None]
    twice = -(omega**2) * np.exp(1j * omega * delay)
    angle = _lines(records.angle[index], k, present) * twice[:, None, None]
    reference = _lines(records.reference[index], k, present)
    reference = np.broadcast_to(reference, torque.shape)
    return Spectra(omega, reference, torque, angle, present)


def _lines(signal: Array, lines: IntArray, present: NDArray[np.bool_]) -> ComplexArray:
    """Return the coefficients (B, P, F, n, E) of samples (B, E, P, N, n), zero where missing."""
    samples = np.where(present[:, :, None, None, None], signal, 0.0)
    transform = np.fft.rfft(samples, axis=3)[:, :, :, lines] / signal.shape[3]
    return np.asarray(transform.transpose(0, 2, 3, 4, 1))
