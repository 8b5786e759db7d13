"""Figures of a run: torque, speed and angle in time against limits, and the spectra of motors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from oed.experiment.multisine import crest_factor
from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing, plain_logarithm
from reports.figures.svg import Palette
from reports.text import fixed
from robotmodels import Records
from robotmodels.common.arrays import Array, IntArray

_BINS = 120  # of a signal in time, at most, each drawn from its least to its largest value
_ABOVE = 2.0  # highest line, times this, up to which angles are differentiated


@dataclass(frozen=True, eq=False)
class Run:
    """One period of one run.

    Attributes
    ----------
    torque, speed, angle : ndarray, (N, n)
        On the motor shafts [N m, rad/s, rad]; angles without their mean.
    sample_time : float, s
        Sample time.
    lines : ndarray of int, (F,)
        Excited lines of the period's discrete Fourier transform.
    """

    torque: Array
    speed: Array
    angle: Array
    sample_time: float
    lines: IntArray


def run_of(records: Records, position: int = 0, block: int = 0, run: int = 0) -> Run:
    """Return the first measured period of a run; speeds are differentiated angles of the motors."""
    torque, angle = (s[position, block, run, 0] for s in (records.torque, records.angle))
    angle = angle[:, : torque.shape[1]]
    spectrum = np.fft.rfft(angle - angle.mean(axis=0), axis=0)
    line = np.arange(len(spectrum))[:, None]
    omega = 2 * np.pi * line / (len(angle) * records.sample_time)
    passed = np.where(line <= _ABOVE * records.lines.max(), 1j * omega * spectrum, 0)
    speed = np.fft.irfft(passed, n=len(angle), axis=0)
    return Run(torque, speed, angle - angle.mean(axis=0), records.sample_time, records.lines)


def excitation(run: Run, motors: Sequence[str], limits: Mapping[str, Array]) -> Drawing:
    """Return a row for each motor: torque, speed, angle in time and the spectrum of the torque.

    Parameters
    ----------
    limits : mapping of str to ndarray, (n,)
        Largest "torque" [N m], "speed" [rad/s] and "swing" [rad], where there are any.
    """

    def draw(palette: Palette) -> Figure:
        figure = NotebookFigure(figsize=(8.2, 0.7 + 1.05 * len(motors)), layout="constrained")
        grid = figure.subplots(len(motors), 4, squeeze=False, sharex="col")
        signals = {"torque": run.torque, "speed": run.speed, "swing": run.angle}
        for i, motor in enumerate(motors):
            for axes, (name, signal) in zip(grid[i], signals.items(), strict=False):
                bound = float(limits[name][i]) if name in limits else None
                _in_time(axes, signal[:, i], run.sample_time, bound, palette)
            _spectrum(grid[i, 3], run, i, palette)
            crest = float(crest_factor(run.torque[:, i] - run.torque[:, i].mean(), axis=0))
            grid[i, 0].set_ylabel(f"{motor}\ncrest {fixed(crest, 1)}")
        titles = ("torque [N m]", "speed [rad/s]", "angle [rad]", "torque spectrum [N m]")
        for j, title in enumerate(titles):
            grid[0, j].set_title(title)
            grid[-1, j].set_xlabel("time [s]" if j < 3 else "frequency [Hz]")
        return figure

    return draw


def _in_time(
    axes: Axes, signal: Array, sample_time: float, bound: float | None, palette: Palette
) -> None:
    """Draw a signal between the least and the largest value of short stretches, and its limit."""
    starts = np.unique(np.linspace(0, len(signal), min(len(signal), _BINS) + 1).astype(int))[:-1]
    low, high = (extreme.reduceat(signal, starts) for extreme in (np.minimum, np.maximum))
    time = sample_time * starts
    axes.fill_between(time, low, high, color=palette.accent, lw=0.5)
    if bound is not None:
        for side in (-bound, bound):
            axes.axhline(side, color=palette.second, lw=0.9, dashes=(4, 3))
    axes.set_xlim(0, sample_time * len(signal))


def _spectrum(axes: Axes, run: Run, motor: int, palette: Palette) -> None:
    amplitude = 2 * np.abs(np.fft.rfft(run.torque[:, motor]))[run.lines] / len(run.torque)
    hertz = run.lines / (len(run.torque) * run.sample_time)
    axes.plot(hertz, amplitude, ".", color=palette.accent, ms=2.5)
    axes.set(xscale="log", yscale="log")
    plain_logarithm(axes.xaxis)
    plain_logarithm(axes.yaxis)
