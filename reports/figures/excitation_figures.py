"""Figures of a run: torque, speed and angle in time against limits, and the spectra of motors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.experiment.multisine import crest_factor
from reports.figures.panels import DASHES, Area, Axis, Curve, Mark, Panel, Panels, Rule
from reports.text import fixed, significant
from robotmodels import Records
from robotmodels.common.arrays import Array, IntArray

_BINS = 120  # of a signal in time, at most, each drawn from its least to its largest value
_TITLES = ("torque [N m]", "speed [rad/s]", "angle [rad]", "spectrum [N m]")
_FAR = 5.0  # limits over what is reached, above which they would flatten the signal
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


def excitation(run: Run, motors: Sequence[str], limits: Mapping[str, Array]) -> Panels:
    """Return a row for each motor: torque, speed, angle in time and the spectrum of the torque.

    Parameters
    ----------
    limits : mapping of str to ndarray, (n,)
        Largest "torque" [N m], "speed" [rad/s] and "swing" [rad], where there are any.
    """
    rows = [
        _row(run, i, motor, limits, last=i == len(motors) - 1) for i, motor in enumerate(motors)
    ]
    return Panels((8.2, 0.7 + 1.05 * len(motors)), rows)


def halves(id: str, panels: Panels) -> list[tuple[str, Panels, str]]:
    """Return ids, panels and titles of the left and the right half, two rows on narrow screens."""
    width, height = panels.size
    left = [row[:2] for row in panels.rows]
    right = [[*row[2:]] for row in panels.rows]
    for row, beside in zip(panels.rows, right, strict=True):
        if row[0] and beside[0]:
            motor = row[0].y.label.split("\n")[0]
            beside[0] = replace(beside[0], y=replace(beside[0].y, label=motor))
    half = width / 2, height
    return [
        (id, Panels(half, left), "Torque and speed of each motor in time"),
        (
            f"{id}-angles",
            Panels(half, right),
            "Angle of each motor in time, and spectrum of its torque",
        ),
    ]


def _row(run: Run, i: int, motor: str, limits: Mapping[str, Array], *, last: bool) -> list[Panel]:
    """Return the panels of one motor, with titles above the first and words below the last."""
    crest = float(crest_factor(run.torque[:, i] - run.torque[:, i].mean(), axis=0))
    y = [Axis(f"{motor}\ncrest {fixed(crest, 1)}", count=4, grid=False)]
    y += [Axis(count=4, grid=False)] * 2
    ends = (0.0, run.sample_time * len(run.torque))
    time = Axis("time [s]" if last else "", ends, count=4, numbered=last, grid=False)
    signals = (("torque", run.torque), ("speed", run.speed), ("swing", run.angle))
    titles = [""] * 4 if i else [*_TITLES]
    row = []
    for axis, title, (name, signal) in zip(y, titles, signals, strict=False):
        bound = float(limits[name][i]) if name in limits else None
        if bound is not None and bound > _FAR * np.abs(signal[:, i]).max():
            title, bound = ", ".join([*filter(None, [title]), f"limit ±{significant(bound)}"]), None
        row.append(Panel(_in_time(signal[:, i], run.sample_time, bound), time, axis, title))
    hertz = Axis("frequency [Hz]" if last else "", log=True, numbered=last, grid=False)
    amplitude = Axis(log=True, count=4, grid=False)
    return [*row, Panel([_spectrum(run, i)], hertz, amplitude, titles[3])]


def _in_time(signal: Array, sample_time: float, bound: float | None) -> list[Mark]:
    """Return a signal between the least and the largest value of short stretches, and its limit."""
    starts = np.unique(np.linspace(0, len(signal), min(len(signal), _BINS) + 1).astype(int))[:-1]
    low, high = (extreme.reduceat(signal, starts) for extreme in (np.minimum, np.maximum))
    time = sample_time * starts
    shape = Area(np.concatenate([time, time[::-1]]), np.concatenate([low, high[::-1]]), "accent")
    # A signal without noise has no height in a stretch of one sample.
    marks: list[Mark] = [shape, Curve(time, (low + high) / 2, "accent", 0.5)]
    limits = () if bound is None else (-bound, bound)
    return [*marks, *(Rule(side, "second", 0.9, DASHES) for side in limits)]


def _spectrum(run: Run, motor: int) -> Curve:
    amplitude = 2 * np.abs(np.fft.rfft(run.torque[:, motor]))[run.lines] / len(run.torque)
    hertz = run.lines / (len(run.torque) * run.sample_time)
    return Curve(hertz, amplitude, "accent", 0.0, 2.0)
