"""Whether what is in files for controllers stays inside all limits, sample by sample."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from oed.experiment.limits import UNITS, Limits
from oed.experiment.moves import MoveLimits
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.discrete_loop import SampledLoop

_COMMAND, _MODEL = 1e-6, 1e-3
"""Parts of a limit that are let pass: for digits in files; for transients that plans neglect."""

_DIGITS = 1e-12
"""Largest rounding error of a position in a file [rad; m]."""


class BeyondLimit(InvalidInput):
    """Runs of a plan that exceed a limit in what the model predicts.

    Attributes
    ----------
    ratio : float
        Largest value over its limit.
    """

    def __init__(self, message: str, ratio: float) -> None:
        super().__init__(message)
        self.ratio = ratio


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A move or a run, as files tell it, from rest to rest.

    Attributes
    ----------
    pieces : tuple of tuple of (str, int)
        Files in the order in which they are played, and the samples of each.
    visit : int
        Which visit of the plan, from 0.
    is_move : bool
        Whether it leads to the visit's position (also rest there), instead of being a run in it.
    positions : ndarray, (K, n), rad
        Arm side.
    speeds : ndarray, (K, n), rad/s
        Motor shaft.
    """

    pieces: tuple[tuple[str, int], ...]
    visit: int
    is_move: bool
    positions: Array
    speeds: Array

    def where(self, sample: int) -> tuple[str, int]:
        """Return file and sample in it."""
        before = 0
        for file, count in self.pieces:
            if sample < before + count:
                return file, sample - before
            before += count
        return self.pieces[-1][0], self.pieces[-1][1] - 1


@dataclass(frozen=True, eq=False)
class TrajectoryCheck:
    """What trajectories of a visit must respect.

    Attributes
    ----------
    limits : Limits
        Of what the model predicts, and of commands.
    moves : MoveLimits
        Of moves.
    position : ndarray, (n,), rad
        Where the visit is.
    ratios : ndarray, (n,)
        Motor angle per arm angle.
    controller : Controller
        What follows the commands.
    loop : SampledLoop
        The linear model at the position under the controller.
    hold, friction : ndarray, (n,), N m
        What torques overcome beside.
    """

    limits: Limits
    moves: MoveLimits
    position: Array
    ratios: Array
    controller: Controller
    loop: SampledLoop
    hold: Array
    friction: Array

    def check(self, trajectory: Trajectory) -> dict[str, Array]:
        """Refuse a trajectory that exceeds a limit; return largest magnitudes by quantity, (n,).

        Raises
        ------
        InvalidInput
            Naming file, motor, time, value and limit of the first sample that does; `BeyondLimit`
            in a run.
        """
        checks = self._move if trajectory.is_move else self._run
        motors, T = self.moves.motors, self.controller.sample_time
        largest = {}
        for quantity, unit, values, bounds, slack in checks(trajectory):
            low, high = bounds.T
            outside = ~((values >= low - slack) & (values <= high + slack))  # NaN is outside
            if outside.any():
                k, motor = (int(i) for i in np.argwhere(outside)[0])
                file, sample = trajectory.where(k)
                limit = bounds[motor, int(not values[k, motor] < low[motor])]
                message = (
                    f"{file}: motor {motors[motor]!r} at {sample * T:.6g} s: {quantity} "
                    f"{values[k, motor]:.6g} {unit} is beyond its limit {limit:.6g} {unit}; "
                    "the visit is not offered"
                )
                if trajectory.is_move:
                    raise InvalidInput(message)
                raise BeyondLimit(
                    message, float((values / np.where(values < low, low, high)).max())
                )
            largest[quantity] = np.abs(values).max(axis=0)
        return largest

    def _move(self, move: Trajectory) -> Iterator[tuple[str, str, Array, Array, Array]]:
        """Yield quantity, unit, values (K, n), bounds (n, 2) and slack (n,) of a move."""
        T, limits = self.controller.sample_time, self.moves
        ends = np.vstack([move.positions[:1], move.positions, self.position])
        yield "position", "rad", move.positions, limits.positions, self._slack(_DIGITS)
        by_speed = move.speeds / self.ratios
        rested = np.pad(by_speed, [(1, 1), (0, 0)])
        for speeds, among in ((np.diff(ends, axis=0) / T,) * 2, (by_speed, rested)):
            bounds = _both(limits.speed)
            yield "speed of the move", "rad/s", speeds, bounds, self._slack(_DIGITS / T, bounds)
            steps, bounds = np.diff(among, axis=0) / T, _both(limits.acceleration)
            slack = self._slack(4 * _DIGITS / T**2, bounds)
            yield "acceleration of the move", "rad/s^2", steps, bounds, slack

    def _run(self, run: Trajectory) -> Iterator[tuple[str, str, Array, Array, Array]]:
        """Yield the same of a run: of its commands, then of what they lead to."""
        T, n = self.controller.sample_time, len(self.ratios)
        away = (run.positions - self.position) * self.ratios
        followed = run.speeds + self.controller.position_gain * away
        response = self.loop.run(
            followed[:, :, None], np.zeros(n), np.random.default_rng(0), transient=0, periods=1
        )[..., 0]
        torque, shift = response[:, :n], response[:, n:] / self.ratios
        sign = np.where(torque + self.hold < 0, -1.0, 1.0)
        mean = np.sqrt((torque**2).mean(axis=0)) + self.friction
        yield "commanded position", "rad", run.positions, self.moves.positions, self._slack(_DIGITS)
        values = {
            "command_speed": run.speeds,
            "command_acceleration": np.diff(np.pad(run.speeds, [(1, 1), (0, 0)]), axis=0) / T,
            "torque": torque + self.hold + sign * self.friction,
            "speed": np.diff(response[:, n:], axis=0) / T,
            "position": self.position + shift,
            "swing": shift,
            "rms_torque": np.hypot(mean, self.hold)[None],
        }
        limits = dict(zip(UNITS, self.limits.bounds(self.moves.motors), strict=True))
        for name, each in values.items():
            bounds = limits[name]
            part = _COMMAND if name.startswith("command") else _MODEL
            slack = part * np.where(np.isfinite(bounds), np.abs(bounds), 0.0).max(axis=1)
            yield name, UNITS[name], each, bounds, slack

    def _slack(self, rounding: float, bounds: Array | None = None) -> Array:
        limit = np.zeros(len(self.ratios)) if bounds is None else bounds[:, 1]
        return rounding + _COMMAND * limit


def _both(limit: Array) -> Array:
    """Return the bounds (n, 2) of magnitudes."""
    return np.stack([-limit, limit], axis=-1)
