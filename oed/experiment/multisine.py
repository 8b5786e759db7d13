"""Orthogonal random-phase multisines: periodic signals that separate n inputs in n runs.

In run l of a block, input i is r_i(t) = sum_k A_ki cos(w_k t + phi_ki + 2 pi i l / n),
i, l = 0..n-1, so that the DFTs of a block form R = diag(R_i) T with T_il = e^{2 pi j i l / n} and
T T^H = n I ([WM] section 4; Dobrowiecki and Schoukens 2007).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    IntArray,
    check_above_zero,
    check_count,
    read_only,
)
from robotmodels.common.errors import InvalidInput, check_word

Spacing = Literal["linear", "quasi_log"]


@dataclass(frozen=True, eq=False)
class Multisine:
    """The lines and amplitudes of a multisine for n inputs; phases make it a signal.

    Attributes
    ----------
    samples : int
        N of a period.
    sample_time : float, s
        Sample time.
    lines : ndarray of int, (F,)
        Excited DFT lines, rising; line k is the frequency k / (N sample_time) [Hz].
    amplitudes : ndarray, (F, n)
        Peak value of each line in each input; a number or an array that broadcasts to it, one
        number per line, or one column.
    inputs : int
        n.
    detection : ndarray of int
        Lines that are not excited, so that motion at them is distortion.
    odd : bool
        Whether all of these lines are odd, so that even distortion falls between them.

    Raises
    ------
    InvalidInput
        Naming a line that is no whole number, given twice, even where only odd ones are allowed, or
        not below the Nyquist frequency; or amplitudes of the wrong shape or sign.
    """

    samples: int
    sample_time: float
    lines: IntArray
    inputs: int
    amplitudes: Array = field(default_factory=lambda: np.ones((1, 1)))
    detection: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    odd: bool = True

    def __post_init__(self) -> None:
        for name, least in (("samples", 3), ("inputs", 1)):
            object.__setattr__(self, name, check_count(getattr(self, name), name, least))
        check_above_zero(self.sample_time, "sample_time [s]")
        lines = _checked_lines("lines", self.lines, self)
        detection = _checked_lines("detection", self.detection, self)
        if not len(lines):
            raise InvalidInput("lines: none given; at least one line must be excited")
        both = np.intersect1d(lines, detection)
        if len(both):
            raise InvalidInput(f"detection: line {both[0]} is among the excited lines too")
        amplitudes = _checked_amplitudes(self.amplitudes, len(lines), self.inputs)
        object.__setattr__(self, "lines", read_only(lines))
        object.__setattr__(self, "detection", read_only(detection))
        object.__setattr__(self, "amplitudes", read_only(amplitudes))

    @property
    def period(self) -> float:
        """Length of a period [s]."""
        return self.samples * self.sample_time

    @property
    def omega(self) -> Array:
        """Excited frequencies, (F,) [rad/s]."""
        return np.asarray(2 * np.pi * self.lines / self.period)

    def with_amplitudes(self, amplitudes: ArrayLike) -> "Multisine":
        """Return the same lines with other amplitudes, as the constructor takes them."""
        return replace(self, amplitudes=np.asarray(amplitudes, dtype=float))

    def spectrum(self, phases: Array) -> ComplexArray:
        """Return R = diag(R_i) T, (..., F, n, n): DFTs of the inputs (rows) in n runs.

        Parameters
        ----------
        phases : ndarray, (..., F, n), rad
            Phases.
        """
        diagonal = 0.5 * self.samples * self.amplitudes * np.exp(1j * self._phases(phases))
        return np.asarray(diagonal[..., None] * fourier_matrix(self.inputs))

    def reference(self, phases: Array) -> Array:
        """Return one period of the signals, (..., n runs, N, n inputs).

        Parameters
        ----------
        phases : ndarray, (..., F, n), rad
            Phases.
        """
        return self.period_of(self.spectrum(phases))

    def period_of(self, spectrum: ComplexArray, samples: int | None = None) -> Array:
        """Return the period whose DFT at the lines is `spectrum` (..., F, k, n), (..., n, N, k).

        `samples` points per period, N by default; more of them sample the same signal.
        """
        points = self.samples if samples is None else samples
        swapped = np.moveaxis(spectrum, -1, -3)  # (..., runs, F, k)
        full = np.zeros((*swapped.shape[:-2], points // 2 + 1, swapped.shape[-1]), dtype=complex)
        full[..., self.lines, :] = swapped * (points / self.samples)
        return np.asarray(np.fft.irfft(full, points, axis=-2))

    def _phases(self, phases: Array) -> Array:
        phases = np.asarray(phases, dtype=float)
        shape = (len(self.lines), self.inputs)
        if phases.shape[-2:] != shape:
            raise InvalidInput(
                f"phases: shape {phases.shape} given; (..., {shape[0]}, {shape[1]}), lines by "
                "inputs, is needed"
            )
        return phases


def band_multisine(
    samples: int,
    sample_time: float,
    band: tuple[float, float],
    *,
    inputs: int,
    count: int | None = None,
    spacing: Spacing = "linear",
    odd: bool = True,
    detection_group: int | None = None,
    amplitude: ArrayLike | Callable[[Array], ArrayLike] = 1.0,
    rng: np.random.Generator | None = None,
) -> Multisine:
    """Choose lines in a band.

    Parameters
    ----------
    samples : int
        Samples per period, as of the `Multisine`.
    sample_time : float, s
        Sample time.
    inputs : int
        Number of inputs.
    band : tuple of (float, float), rad/s
        Lowest and highest frequency, included.
    count : int, optional
        Lines to spread over the band; every line by default. Quasi-logarithmic lines that fall on
        one another are taken once, so that there may be fewer.
    spacing : Spacing
        Linear or quasi-logarithmic (logarithmic, then moved to the nearest line).
    odd : bool
        Whether to take odd lines only.
    detection_group : int, optional
        Detection group of each group of so many consecutive lines, one at random becomes a
        detection line; a last group that is not full stays whole.
    amplitude : array_like or callable
        Peak value per line: as the amplitudes of a `Multisine`, or a function of omega (F,) [rad/s]
        that returns them.
    rng : Generator, optional
        Draws the detection lines.

    Raises
    ------
    InvalidInput
        If the band holds too few lines or reaches the Nyquist frequency, or if an argument is
        missing or out of range.
    """
    grid = Multisine(samples, sample_time, np.array([1]), inputs)  # checks what is common
    lines = _band_lines(grid, band, odd)
    lines = _spread(lines, count, spacing)
    detection = np.zeros(0, dtype=np.int64)
    if detection_group is not None:
        lines, detection = _left_out(lines, detection_group, rng)
    omega: Array = np.asarray(2 * np.pi * lines / grid.period, dtype=float)
    amplitudes = amplitude(omega) if callable(amplitude) else amplitude
    return replace(
        grid,
        lines=lines,
        detection=detection,
        odd=odd,
        amplitudes=np.asarray(amplitudes, dtype=float),
    )


def fourier_matrix(n: int) -> ComplexArray:
    """Return $T_il = e^(2 pi j i l / n)$, (n, n); $T T^H = n I$."""
    # Reduced modulo n first: e^{2 pi j} is 1 but for rounding.
    index = np.arange(n)
    return np.asarray(np.exp(2j * np.pi * (np.outer(index, index) % n) / n))


def random_phases(grid: Multisine, n_blocks: int, *, rng: np.random.Generator) -> Array:
    """Return phases for blocks, (B, F, n), independent and uniform on [0, 2 pi).

    Raises
    ------
    InvalidInput
        If there is no block.
    """
    check_count(n_blocks, "blocks")
    return rng.uniform(0.0, 2 * np.pi, (n_blocks, len(grid.lines), grid.inputs))


def _band_lines(grid: Multisine, band: tuple[float, float], odd: bool) -> IntArray:
    """Return every allowed line of the band."""
    low, high = band
    if not (np.isfinite([low, high]).all() and 0 < low <= high):
        raise InvalidInput(f"band: ({low:g}, {high:g}) rad/s; 0 < low <= high is needed")
    nyquist = np.pi / grid.sample_time
    if high >= nyquist:
        raise InvalidInput(
            f"band: its upper end {high:g} rad/s is not below the Nyquist frequency "
            f"{nyquist:g} rad/s of {grid.sample_time:g} s samples"
        )
    # A band's end that is meant to be a line is one, in spite of rounding.
    first = int(np.ceil(low * grid.period / (2 * np.pi) - 1e-9))
    last = int(np.floor(high * grid.period / (2 * np.pi) + 1e-9))
    lines = np.arange(max(first, 1), min(last, (grid.samples - 1) // 2) + 1, dtype=np.int64)
    lines = lines[lines % 2 == 1] if odd else lines
    if not len(lines):
        kind = "odd line" if odd else "line"
        raise InvalidInput(
            f"band: no {kind} lies between {low:g} and {high:g} rad/s; lines are "
            f"{2 * np.pi / grid.period:g} rad/s apart, a longer period brings them closer"
        )
    return lines


def _spread(lines: IntArray, count: int | None, spacing: Spacing) -> IntArray:
    """Return `count` of the lines, evenly or logarithmically spaced."""
    check_word("spacing:", spacing, ("linear", "quasi_log"))
    if count is None:
        if spacing == "quasi_log":
            raise InvalidInput("count: quasi-logarithmic spacing needs a number of lines")
        return lines
    if not 1 <= count <= len(lines):
        raise InvalidInput(f"count: {count} lines; the band holds {len(lines)} that are allowed")
    space = np.geomspace if spacing == "quasi_log" else np.linspace
    targets = space(float(lines[0]), float(lines[-1]), count)
    nearest = np.abs(lines[None, :] - targets[:, None]).argmin(axis=1)
    return np.asarray(lines[np.unique(nearest)])


def _left_out(
    lines: IntArray, group: int, rng: np.random.Generator | None
) -> tuple[IntArray, IntArray]:
    """Return the lines that stay excited, and one at random of each full group."""
    if rng is None:
        raise InvalidInput("rng: a numpy.random.Generator is needed to draw detection lines")
    if not 2 <= group <= len(lines):
        raise InvalidInput(
            f"detection_group: {group}; a number from 2 to the {len(lines)} lines is needed"
        )
    full = len(lines) // group
    omitted = group * np.arange(full) + rng.integers(0, group, full)
    return np.delete(lines, omitted), lines[omitted]


def _checked_lines(name: str, lines: ArrayLike, grid: Multisine) -> IntArray:
    array = np.asarray(lines)
    if array.ndim != 1 or (len(array) and not np.array_equal(array, np.round(array))):
        raise InvalidInput(f"{name}: an array (F,) of whole numbers is needed")
    lines = array.astype(np.int64)
    if (np.diff(lines) <= 0).any():
        i = int(np.argmax(np.diff(lines) <= 0))
        raise InvalidInput(f"{name}: {lines[i + 1]} follows {lines[i]}; lines must rise")
    for line in lines:
        if not 0 < 2 * line < grid.samples:
            raise InvalidInput(
                f"{name}: line {line} is not between 1 and the last below the Nyquist frequency, "
                f"{(grid.samples - 1) // 2}, of {grid.samples} samples"
            )
        if grid.odd and line % 2 == 0:
            raise InvalidInput(
                f"{name}: line {line} is even; leave it out or give odd=False for all lines"
            )
    return lines


def crest_factor(signal: Array, axis: int = -2) -> Array:
    """Return peak over root mean square along the axis of time; a sine has sqrt 2."""
    signal = np.asarray(signal, dtype=float)
    return np.asarray(np.abs(signal).max(axis=axis) / np.sqrt(np.mean(signal**2, axis=axis)))


def _checked_amplitudes(amplitudes: ArrayLike, n_lines: int, inputs: int) -> Array:
    array = np.asarray(amplitudes, dtype=float)
    column = array[:, None] if array.ndim == 1 else array
    try:
        amplitudes = np.array(np.broadcast_to(column, (n_lines, inputs)))
    except ValueError:
        raise InvalidInput(
            f"amplitudes: shape {array.shape} given; ({n_lines},), one per line, or "
            f"({n_lines}, {inputs}), lines by inputs, is needed"
        ) from None
    wrong = ~(np.isfinite(amplitudes) & (amplitudes > 0))
    if wrong.any():
        line, motor = np.argwhere(wrong)[0]
        raise InvalidInput(
            f"amplitudes[{line}, {motor}]: {amplitudes[line, motor]:g} is not positive; leave a "
            "line out that is not to be excited"
        )
    return amplitudes
