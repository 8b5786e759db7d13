"""The course of Coulomb friction at the motors of runs, by their equations of motion.

Where a motor clearly moves, friction has its full level c, against the speed. Where it turns around
or sticks, friction is what torque and motion leave over,

    c s = u - J a - g,

with the inertia J that motors have at high frequencies, and the reaction g of gears and arm, which
a model predicts from the motion. What the model misses of g is slow against a turn and interpolated
from both sides. Commanded torques pass the gain, delay and lag of the motors' torque loops before.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import IdentificationWarning, InvalidInput
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.linear_model import Channels
from robotmodels.linear.response import Elastic, frequency_response
from robotmodels.records.records import Records

_BAND = 0.15
"""Of the sampling frequency: up to there motion tells the reaction of the gears."""

_SLOW = 35.0
"""Frequency up to which its errors are made up for [Hz]."""

_NOISE = 3.0
"""Standard deviations of its noise by which an angle must move, or the motor may be at rest."""

_FULL = 4.0
"""Widths of tanh at which it is full, to 7e-4."""

_LARGEST = 1.5
"""Share that noise may make of it."""

_RESTING = 0.5
"""Part of the samples without full friction that is warned of."""

_FAST = 1e7
"""Angular frequency at which nothing but inertia is seen [rad/s]."""


def friction_shares(
    records: Records,
    model: Elastic,
    values: Array | None = None,
    delay: float = 0.0,
    *,
    hold: bool = True,
) -> Records:
    """Return the records with the shares s of friction, -1 to 1, in place of torques.

    A share is the mean about its sample with triangular weights: so the second difference of an
    angle tells the acceleration.

    Parameters
    ----------
    records : Records
        Runs whose first outputs are the motors' angles.
    model : Elastic
        Robot.
    values : ndarray, (p,), SI, optional
        Its parameters; by default its own.
    delay : float, s
        By which angles are late; shares are then late as well.
    hold : bool
        Whether commanded torques were held over each sample.

    Raises
    ------
    InvalidInput
        If the first outputs are not the motors' angles; and as `check_motors`.
    """
    n = records.torque.shape[-1]
    if records.angle.shape[-1] < n or not (records.derivatives[:n] == 2).all():
        raise InvalidInput(
            f"friction: the first {n} outputs must be the motors' angles, which tell its course"
        )
    least = _least_speeds(model, n) * records.sample_time
    shares, resting = np.full(records.torque.shape, np.nan), []
    for q in range(len(records)):
        motion = _Motion.of(records, model, records.positions[q], values)
        channels = torque_channels(model, records.positions[q], values, delay)
        for block, run in np.argwhere(~records.missing[q]):
            angle = records.angle[q, block, run][..., :n]
            torque = _mean_torque(
                records, (q, block, run), channels, steady=hold and records.commanded
            )
            surplus = torque - motion.torque(angle).reshape(-1, n)
            signs = _signs(angle.reshape(-1, n), least)
            resting.append((signs == 0).mean(axis=0))
            pairs = zip(surplus.T, signs.T, strict=True)
            filled = np.stack([_filled(r, one, motion.smoothing) for r, one in pairs], axis=1)
            shares[q, block, run] = filled.reshape(angle.shape)
    if resting:
        _warn_of_rest(np.mean(resting, axis=0))
    return replace(records, torque=shares, command=None)


@dataclass(frozen=True, eq=False)
class _Motion:
    """What torques the motors' motion takes.

    Attributes
    ----------
    inertia : ndarray, (n, n)
        Of motors at high frequencies.
    reaction : ndarray of complex, (K, n, n)
        Of gears and arm, by angles, at the first lines of a period.
    sample_time : float, s
        Sampling time.
    """

    inertia: Array
    reaction: ComplexArray
    sample_time: float

    @classmethod
    def of(
        cls, records: Records, model: Elastic, position: Array, values: Array | None
    ) -> "_Motion":
        n, count, step = records.torque.shape[-1], records.samples, records.sample_time
        lines = np.arange(1, max(2, int(_BAND * count)))
        omega = np.append(2 * np.pi * lines / (count * step), _FAST)
        loops = torque_channels(model, position, values).response(omega)
        G = frequency_response(model, position[None], omega, values)[0, :, :n] / loops[:, None]
        stiff = np.linalg.inv(G)
        inertia = stiff[-1].real
        mean = np.sinc(omega[:-1] * step / (2 * np.pi)) ** 2  # with triangular weights
        reaction = -(mean * omega[:-1] ** 2)[:, None, None] * (stiff[:-1] - inertia)
        return cls(inertia, reaction, step)

    @property
    def smoothing(self) -> float:
        """Weight of squared third differences that keeps what is slower than `_SLOW`."""
        return float((2 * np.pi * _SLOW * self.sample_time) ** -6)

    def torque(self, angle: Array) -> Array:
        """Return the torques J a + g of angles (P, N, n), means about their samples."""
        periods, count, _ = angle.shape
        flat = angle.reshape(periods * count, -1)
        second = np.zeros_like(flat)
        second[1:-1] = np.diff(flat, 2, axis=0) / self.sample_time**2
        spectrum = np.fft.rfft(angle.mean(axis=0), axis=0)
        reaction = np.zeros_like(spectrum)
        inside = slice(1, 1 + len(self.reaction))
        reaction[inside] = np.einsum("kij,kj->ki", self.reaction, spectrum[inside])
        slow = np.fft.irfft(reaction, count, axis=0)
        return np.asarray((second @ self.inertia.T).reshape(angle.shape) + slow)


def check_motors(robot: ElasticRobot) -> None:
    """Refuse robots whose motors do not tell their friction.

    Raises
    ------
    InvalidInput
        If the first outputs are not the encoders of all motors, if these have gains, delays or lags
        of their own, or friction counts as dampers.
    """
    for i, motor in enumerate(robot.file.motors):
        output = robot.outputs[i] if i < len(robot.outputs) else None
        if output is None or (output.motor, output.quantity) != (motor.name, "acceleration"):
            raise InvalidInput(
                f"friction: output {i + 1} of the robot is not the encoder of motor "
                f"{motor.name!r}; the first outputs must be those of all motors, in their order"
            )
        if motor.coulomb_speed is not None:
            raise InvalidInput(
                f"friction: motor {motor.name!r} counts it as a damper at its coulomb_speed; leave "
                "that out of the robot file, or do not estimate its level"
            )
        if not output.ideal:
            raise InvalidInput(
                f"friction: delay, gain and lag of the encoder of motor {motor.name!r} hide its "
                "course; leave them out, and correct records for them"
            )


def torque_channels(
    model: Elastic, position: Array, values: Array | None = None, delay: float = 0.0
) -> Channels:
    """Return what changes commanded torques on the way to the motors, as late as angles are.

    Parameters
    ----------
    position : ndarray, (n,), rad
        Any of the robot.
    values : ndarray, (p,), SI, optional
        Parameters of the model.
    delay : float, s
        By which angles are late beside the model's delay.
    """
    at = model.parameters.values if values is None else values
    measured = model.network(position[None], at).linear_model().measured
    return replace(measured.torque, delay=measured.torque.delay + measured.delay + delay)


def _least_speeds(model: Elastic, motors: int) -> Array:
    """Return speeds from which friction is full, (n,) [rad/s]; beside noise."""
    if not isinstance(model, ElasticRobot):
        return np.zeros(motors)
    if len(model.file.motors) != motors:
        raise InvalidInput(
            f"friction: {motors} motors were recorded; {model.name} has {len(model.file.motors)}"
        )
    check_motors(model)
    return _FULL * np.array([motor.coulomb_width for motor in model.file.motors])


def _mean_torque(
    records: Records, run: tuple[int, int, int], channels: Channels, *, steady: bool
) -> Array:
    """Return torques at the motors, means about the samples of angles, (P N, n) [N m]."""
    torque, step = records.torque[run].reshape(-1, records.torque.shape[-1]), records.sample_time
    ways = zip(torque.T, channels.delay / step, channels.lag / step, strict=True)
    passed = [_late_mean(column, late, lag, steady) for column, late, lag in ways]
    return np.stack(passed, axis=1) * channels.gain


def _late_mean(torque: Array, late: float, lag: float, steady: bool) -> Array:
    """Return triangular means (M,) of a torque behind a delay and a lag [samples].

    `steady` from a sample to the next, or else straight between them, without a lag.
    """
    whole = int(late)
    x = late - whole
    if steady:
        weights = np.array([0, (1 - x) ** 2 / 2, 1 / 2 + x - x**2, x**2 / 2])
    else:
        weights = (np.array([1, 10, 1, 0]) * (1 - x) + np.array([0, 1, 10, 1]) * x) / 12
    padded = np.pad(torque, (whole + 2, 1), mode="edge")
    means = np.convolve(padded, weights, "valid")[: len(torque)]
    return means - lag * _lag_slopes(padded, x, lag)[: len(torque)] if lag else means


def _lag_slopes(torque: Array, late: float, lag: float) -> Array:
    """Return triangular means of the slope of y = u - lag y', of a steady torque u.

    That is the difference of two means over a sample, each by the same equation.
    """
    from scipy.signal import lfilter, lfilter_zi  # takes a second to load

    pole = np.exp(-1 / lag)
    b, a = [0.0, 1 - pole], [1.0, -pole]
    begun = lfilter(b, a, torque, zi=lfilter_zi(b, a) * torque[0])[0]  # where a sample begins
    y = torque + (begun - torque) * np.exp((late - 1) / lag)
    return np.diff(late * torque[:-1] + (1 - late) * torque[1:] - lag * np.diff(y))


def _signs(angle: Array, least: Array) -> Array:
    """Return the signs of the speeds where motors clearly move about a sample, (M, n), else 0.

    `least` are steps of the angles (n,) that they must exceed beside noise.
    """
    steps = np.diff(angle, axis=0)
    noise = np.median(np.abs(np.diff(angle, 6, axis=0)), axis=0) / (0.6745 * np.sqrt(924))
    moved = np.sign(steps) * (np.abs(steps) > least + _NOISE * np.sqrt(2) * noise)
    signs = np.zeros(angle.shape)
    # A motor that stops within a step has moved in it: the steps beside must be clear too.
    alike = (moved[:-3] == moved[1:-2]) & (moved[1:-2] == moved[2:-1]) & (moved[2:-1] == moved[3:])
    signs[2:-2] = np.where(alike, moved[1:-2], 0.0)
    return signs


def _filled(surplus: Array, signs: Array, smoothing: float) -> Array:
    """Return shares (M,): signs where there are, else what `surplus` (M,) [N m] tells of them."""
    clear = signs != 0
    if not clear.any():
        return np.zeros(len(surplus))
    columns = np.stack([clear, signs], axis=1)
    level = float(np.linalg.lstsq(columns[clear], surplus[clear])[0][1])
    if level <= 0:  # no friction
        return signs
    slow = _interpolated(clear * (surplus - level * signs), clear.astype(float), smoothing)
    between = np.clip((surplus - slow) / level, -_LARGEST, _LARGEST)
    between[[0, 1, -2, -1]] = 0.0
    return np.where(clear, signs, between)


def _interpolated(values: Array, weights: Array, smoothing: float) -> Array:
    """Return the smooth course (M,) of least weighted squares and squared third differences."""
    third = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((4, len(values)))
    bands[0] = weights + 1e-9
    for i in range(4):
        for j in range(i, 4):
            bands[j - i, i : len(values) - 3 + i] += smoothing * third[i] * third[j]
    return np.asarray(solveh_banded(bands, values, lower=True))


def _warn_of_rest(share: Array) -> None:
    """Warn of motors that rest or turn around most of the time."""
    for motor in np.flatnonzero(share > _RESTING):
        warnings.warn(
            f"friction: motor {motor + 1} rests or turns around in {100 * share[motor]:.0f} % of "
            "the samples, where its friction is not the full one; shake it more, or add a carrier",
            IdentificationWarning,
            stacklevel=2,
        )
