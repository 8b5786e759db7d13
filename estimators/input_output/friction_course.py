"""The course of one motor's Coulomb friction, where it moves, turns around and sticks.

Over a step of the controller a motor of inertia J moves by J a = F + d - c sign(v) until it stops,
with torques less reactions F and a disturbance d that nobody measures; there it sticks as long as
|F + d| <= c. Where it clearly moves friction is full, and what is left over tells the level c and
the size of d. Elsewhere friction is what all d make of the speed at the beginning of the step,
which they cannot have changed. What is left over there holds d, on which it depends whether a motor
stops: levels by it are 1 % too small, where disturbances are 0.6 of a level and a quarter of the
samples is near stops.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.linalg import solveh_banded

from robotmodels.common.arrays import Array, BoolArray

_SLOW = 35.0
"""Frequency up to which errors of reactions are made up for [Hz]."""

_NOISE = 3.0
"""Standard deviations of its noise by which an angle must move, or the motor may be at rest."""

_FULL = 4.0
"""Widths of tanh at which it is full, to 7e-4."""

_LARGEST = 1.5
"""Share that noise may make of what is left over."""

_NODES = 7
"""Of the Gauss-Hermite quadrature over disturbances."""

_WIDEST = 4.0
"""Standard deviations that its nodes reach."""


@dataclass(frozen=True, eq=False)
class MotorCourse:
    """Motion and torques of a motor at M samples.

    Attributes
    ----------
    angle : ndarray, (M,), rad
        Angle.
    torque : ndarray, (M,), N m
        Torque less reactions of gear and arm, means with triangular weights about the samples.
    steps : ndarray, (M - 1,), N m
        The same, means from each sample to the next.
    inertia : float, kg m^2
        At high frequencies.
    sample_time : float, s
        Sampling time.
    predicted : bool
        Whether sharp friction is predicted near stops, or what is left over there as well.
    width : float, rad/s
        Of the tanh of smooth friction; zero of sharp friction, which sticks.
    """

    angle: Array
    torque: Array
    steps: Array
    inertia: float
    sample_time: float
    predicted: bool = True
    width: float = 0.0

    def shares(self) -> tuple[Array, BoolArray]:
        """Return the shares of friction, -1 to 1, and where it clearly was full, (M,) each."""
        signs = self._signs()
        clear = signs != 0
        if not clear.any():
            return signs, clear
        surplus = self.torque.copy()
        surplus[1:-1] -= self.inertia * np.diff(self.angle, 2) / self.sample_time**2
        columns = np.stack([clear, signs], axis=1)
        level = float(np.linalg.lstsq(columns[clear], surplus[clear])[0][1])
        if level <= 0:  # no friction
            return signs, clear
        slow = _interpolated(
            clear * (surplus - level * signs), clear.astype(float), self._smoothing
        )
        surplus -= slow
        if self.width or not self.predicted:
            between = np.clip(surplus / level, -_LARGEST, _LARGEST)
        else:
            disturbance = self._disturbance((surplus - level * signs)[clear])
            between = self._expected(level, self.steps - (slow[1:] + slow[:-1]) / 2, disturbance)
        between[[0, 1, -2, -1]] = 0.0
        return np.where(clear, signs, between), clear

    @cached_property
    def _noise(self) -> float:
        """Standard deviation of the noise of angles; by sixth differences."""
        return float(np.median(np.abs(np.diff(self.angle, 6))) / (0.6745 * np.sqrt(924)))

    @property
    def _smoothing(self) -> float:
        """Weight of squared third differences that keeps what is slower than `_SLOW`."""
        return float((2 * np.pi * _SLOW * self.sample_time) ** -6)

    def _signs(self) -> Array:
        """Return the signs of the speeds where the motor clearly moves about a sample, else 0."""
        steps = np.diff(self.angle)
        least = _FULL * self.width * self.sample_time + _NOISE * np.sqrt(2) * self._noise
        moved = np.sign(steps) * (np.abs(steps) > least)
        signs = np.zeros(self.angle.shape)
        # A motor that stops within a step has moved in it: the steps beside must be clear too.
        four = np.lib.stride_tricks.sliding_window_view(moved, 4)
        signs[2:-2] = np.where((four == four[:, :1]).all(axis=1), four[:, 0], 0.0)
        return signs

    def _disturbance(self, errors: Array) -> float:
        """Return the standard deviation of disturbances in steps by errors of triangular means."""
        of_angles = 6 * (self.inertia * self._noise / self.sample_time**2) ** 2
        return float(np.sqrt(2 * max(errors.var() - of_angles, 0.0)))

    def _expected(self, level: float, force: Array, disturbance: float) -> Array:
        """Return the shares that speeds and forces make expect, (M,).

        Of each step friction has a mean weighted towards the end and one towards the beginning.
        """
        pace = self.sample_time / self.inertia
        speed = self._speeds(level, force)
        unsure = np.hypot(np.sqrt(2) * self._noise / self.sample_time, pace * disturbance / 2)
        end, begin = np.sign(speed), np.sign(speed)
        reach = pace * (np.abs(force) + level + _WIDEST * disturbance) + _WIDEST * unsure
        near = np.abs(speed) < reach
        x, weights = hermegauss(_NODES)
        weights = np.outer(weights, weights).ravel() / weights.sum() ** 2
        total = force[near, None] + disturbance * np.tile(x, _NODES)
        v = speed[near, None] + unsure * np.repeat(x, _NODES) * (speed[near, None] != 0)
        way = np.sign(v)
        slowing = np.maximum(pace * (level - way * total), 1e-300)
        moving = np.minimum(np.abs(v) / slowing, 1.0)  # part before it stops
        stuck = np.clip(total / level, -1.0, 1.0)
        end[near] = (stuck + moving**2 * (way - stuck)) @ weights
        begin[near] = (way + (1 - moving) ** 2 * (stuck - way)) @ weights
        shares = np.zeros(len(self.angle))
        shares[1:-1] = (end[:-1] + begin[1:]) / 2
        return shares

    def _speeds(self, level: float, force: Array) -> Array:
        """Return the speeds at the beginning of steps, (M - 1,); zero where it seems at rest.

        By the mean speed of the step before and half of its change.
        """
        mean = np.diff(self.angle) / self.sample_time
        way = np.sign(mean)
        behind = mean + (force - level * way) * self.sample_time / (2 * self.inertia)
        return np.append(0.0, np.where(behind * way > 0, behind, 0.0)[:-1])


def _interpolated(values: Array, weights: Array, smoothing: float) -> Array:
    """Return the smooth course (M,) of least weighted squares and squared third differences."""
    third = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((4, len(values)))
    bands[0] = weights + 1e-9
    for i in range(4):
        for j in range(i, 4):
            bands[j - i, i : len(values) - 3 + i] += smoothing * third[i] * third[j]
    return np.asarray(solveh_banded(bands, values, lower=True))
