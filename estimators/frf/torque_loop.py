"""The loop between commanded and measured torques of motors, where records hold both."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimators.frf.estimate_frf import each_position, first_period, lines_of
from estimators.frf.input_rank import side_by_side
from estimators.frf.local_rational_model import one_line
from estimators.frf.spectra import spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

if TYPE_CHECKING:
    from robotmodels import ElasticRobot

_ORDER = 2
_WINDOW = 7
"""Lines over which a loop is a polynomial of that order, for its noise."""
_LEAST = 3  # equations in excess of a window's unknowns


@dataclass(frozen=True, eq=False)
class TorqueLoop:
    """Measured over commanded torques of n motors, $gain e^(-j omega delay) / (1 + j omega lag)$.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    response : ndarray of complex, (F, n), dimensionless
        Measured over commanded torque.
    variance : ndarray, (F, n)
        Of its circular complex errors, independent from line to line.
    gain, delay, lag : ndarray, (n,)
        Of the loop [-, s, s].
    std : ndarray, (n, 3)
        Standard deviations of gain, delay and lag, enlarged where the loop is another.
    misfit : ndarray, (n,), dimensionless
        Cost over what noise makes of it; well above one where the loop is another.
    """

    omega: Array
    response: ComplexArray
    variance: Array
    gain: Array
    delay: Array
    lag: Array
    std: Array
    misfit: Array

    @property
    def bandwidth(self) -> Array:
        """Frequency (n,) at which the lag takes 3 dB, infinite without [rad/s]."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.lag)


def torque_loop(
    records: Records | Iterable[Records], *, lines: IntArray | None = None
) -> TorqueLoop:
    """Return the loops between the commands and the measured torques of records.

    Commands are exact and held over a sample; noise is that of measured torques, seen by what a
    polynomial of the frequency leaves in windows of lines, all runs of all positions together.

    Parameters
    ----------
    records : Records or iterable of Records
        With `Records.command`.
    lines : ndarray of int, optional
        As in `estimators.estimate_frf`.

    Raises
    ------
    InvalidInput
        If there are no commands beside the measured torques, or too few runs and lines.
    """
    signals, omega = [], np.empty(0)
    for count, part in enumerate(each_position(records)):
        who = f"position {count + 1}"
        signals.append(_both(part, lines, who))
        omega = part.omega[np.isin(part.lines, lines_of(part, lines))]
        if signals[-1].shape[:3] != signals[0].shape[:3]:
            raise InvalidInput(f"{who}: its frequencies differ from those of position 1")
    if not signals:
        raise InvalidInput("records: none given; at least one position is needed")
    together = np.concatenate(signals, axis=-1)  # (2, F, n, r)
    measured, command = np.moveaxis(together, 2, 1)
    loops = [_of_motor(measured[i], command[i], omega, i) for i in range(len(measured))]
    response, variance, values, std, misfit = (np.array(a) for a in zip(*loops, strict=True))
    gain, delay, lag = values.T
    return TorqueLoop(omega, response.T, variance.T, gain, delay, lag, std, misfit)


def check_torque_loop(robot: "ElasticRobot", records: Records) -> None:
    """Refuse robots whose motors turn commands into torques, where torques were measured.

    Raises
    ------
    InvalidInput
        Naming the motors.
    """
    late = [
        motor.name
        for motor in robot.file.motors
        if (motor.torque_gain, motor.torque_delay, motor.torque_lag) != (1.0, 0.0, 0.0)
    ]
    if late and not records.commanded:
        raise InvalidInput(
            f"motor {', '.join(late)}: torque_gain, torque_delay and torque_lag act on commanded "
            "torques, the records hold measured ones; leave them out of the robot file"
        )


def _both(part: Records, lines: IntArray | None, who: str) -> ComplexArray:
    """Return the spectra of measured and commanded torques, (2, F, n, runs)."""
    if part.command is None:
        raise InvalidInput(
            f"{who}: no commands beside measured torques; records with both have `command`"
        )
    measured = spectra(part, 0, lines_of(part, lines))
    first = first_period(measured, "auto", who)
    commanded = replace(part, torque=part.command, command=None)
    both = [spectra(one, 0, lines_of(part, lines), first=first) for one in (part, commanded)]
    return np.stack([side_by_side(one.input, one) for one in both])


_Loop = tuple[ComplexArray, Array, Array, Array, float]
"""Response and variance (F,), gain, delay and lag (3,), their standard deviations, misfit."""


def _of_motor(measured: ComplexArray, command: ComplexArray, omega: Array, motor: int) -> _Loop:
    """Return the loop of one motor from spectra (F, r)."""
    power = (np.abs(command) ** 2).sum(axis=1)
    if not (power > 0).all():
        raise InvalidInput(f"command: that of motor {motor + 1} is zero at a line")
    response = (measured * np.conj(command)).sum(axis=1) / power
    variance = _noise(measured, command, omega, motor) / power
    std = np.sqrt(np.maximum(variance, (1e-14 * np.abs(response)) ** 2))

    def errors(values: Array) -> Array:
        error = (response - _loop(values, omega)) / std
        return np.concatenate([error.real, error.imag])

    late = -float(np.polyfit(omega, np.unwrap(np.angle(response)), 1)[0])
    start = [response[0].real, late / 2, max(late / 2, 1e-9)]
    scale = [1.0, 1 / omega[-1], 1 / omega[-1]]
    bounds = ([-np.inf, -np.inf, 0.0], np.inf)
    from scipy.optimize import least_squares  # takes a tenth of a second to load

    fit = least_squares(errors, start, bounds=bounds, x_scale=scale, xtol=1e-12, ftol=1e-12)
    freedom = max(2 * len(omega) - len(start), 1)
    misfit = float(2 * fit.cost / (freedom / 2))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) / 2
    return response, std**2, fit.x, np.sqrt(np.diag(covariance) * max(misfit, 1.0)), misfit


def _loop(values: Array, omega: Array) -> ComplexArray:
    gain, delay, lag = values
    return np.asarray(gain * np.exp(-1j * omega * delay) / (1 + 1j * omega * lag))


def _noise(measured: ComplexArray, command: ComplexArray, omega: Array, motor: int) -> Array:
    """Return the variances (F,) of measured torques of one run."""
    lines, runs = command.shape
    width, variances = min(_WINDOW, lines), np.empty(lines)
    if width * runs < _ORDER + 1 + _LEAST:
        raise InvalidInput(
            f"command: {lines} lines of {runs} runs do not show the noise of motor {motor + 1}'s "
            f"torque; {_ORDER + 1 + _LEAST} are needed together"
        )
    for k in range(lines):
        start = int(np.clip(k - width // 2, 0, lines - width))
        window = slice(start, start + width)
        step = (omega[window] - omega[k]) / max(np.ptp(omega[window]), 1e-300)
        order = min(_ORDER, width - 1)
        sides = measured[window, None], command[window, None]
        _, covariance, weights = one_line(*sides, step, order, 0)
        variances[k] = covariance[0, 0].real / np.sum(np.abs(weights) ** 2)
    return variances
