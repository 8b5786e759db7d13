"""The course of Coulomb friction at the motors of runs, by their equations of motion.

Friction takes what torque and motion leave over,

    c s = u - J a - g,

with the inertia J that motors have at high frequencies, and the reaction g of gears and arm, which
a model predicts from the motion. What the model misses of g is slow against a turn and interpolated
from both sides. Commanded torques pass the gain, delay and lag of the motors' torque loops before.
`MotorCourse` tells the course of each motor.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from estimators.input_output.friction_course import MotorCourse
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import IdentificationWarning, InvalidInput
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.linear_model import Channels
from robotmodels.linear.response import Elastic, frequency_response
from robotmodels.records.records import Records

_BAND = 0.15
"""Of the sampling frequency: up to there motion tells the reaction of the gears."""

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
    near: bool = True,
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
    near : bool
        Whether values are near enough to predict friction where motors stop; else it is what is
        left over there as well, of which errors of the model leave more right.

    Raises
    ------
    InvalidInput
        If the first outputs are not the motors' angles; and as `check_motors`.
    """
    n = records.torque.shape[-1]
    if records.angle.shape[-1] < n or not (records.derivatives[:n] == 2).all():
        raise InvalidInput(
            f"friction: the first {n} outputs must be the motors' angles, which show its course"
        )
    widths = _widths(model, n)
    shares, resting = np.full(records.torque.shape, np.nan), []
    for q in range(len(records)):
        motion = _Motion.of(records, model, records.positions[q], values)
        channels = torque_channels(model, records.positions[q], values, delay)
        for block, run in np.argwhere(~records.missing[q]):
            angle = records.angle[q, block, run][..., :n]
            torque, steps = _mean_torques(
                records, (q, block, run), channels, steady=hold and records.commanded
            )
            courses = [
                replace(motor, predicted=near, width=width).shares()
                for motor, width in zip(motion.courses(angle, torque, steps), widths, strict=True)
            ]
            shares[q, block, run] = np.stack([s for s, _ in courses], axis=1).reshape(angle.shape)
            resting.append([1 - clear.mean() for _, clear in courses])
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
        reaction = -(omega[:-1] ** 2)[:, None, None] * (stiff[:-1] - inertia)
        return cls(inertia, reaction, step)

    def courses(self, angle: Array, torque: Array, steps: Array) -> list[MotorCourse]:
        """Return the motors of angles (P, N, n) under torques (P N, n) and (P N - 1, n)."""
        about, between = self.reactions_to(angle)
        inertias = np.diag(self.inertia)
        columns = angle.reshape(torque.shape).T, (torque - about).T, (steps - between).T
        return [
            MotorCourse(angles, free, of_steps, float(inertia), self.sample_time)
            for angles, free, of_steps, inertia in zip(*columns, inertias, strict=True)
        ]

    def reactions_to(self, angle: Array) -> tuple[Array, Array]:
        """Return what angles (P, N, n) take of torques beside each motor's own inertia [N m].

        Means with triangular weights about samples, (P N, n), and means from each sample to the
        next, (P N - 1, n).
        """
        periods, count, _ = angle.shape
        flat = angle.reshape(periods * count, -1)
        second = np.zeros_like(flat)
        second[1:-1] = np.diff(flat, 2, axis=0) / self.sample_time**2
        coupled = second @ (self.inertia - np.diag(np.diag(self.inertia))).T
        spectrum = np.fft.rfft(angle.mean(axis=0), axis=0)
        inside = slice(1, 1 + len(self.reaction))
        step = np.pi * np.arange(1, 1 + len(self.reaction))[:, None] / count  # omega step / 2
        reaction = np.einsum("kij,kj->ki", self.reaction, spectrum[inside])
        slow = []
        for factor in (np.sinc(step / np.pi) ** 2, np.sinc(step / np.pi) * np.exp(1j * step)):
            spectrum = np.zeros_like(spectrum)
            spectrum[inside] = factor * reaction
            slow.append(np.tile(np.fft.irfft(spectrum, count, axis=0), (periods, 1)))
        return coupled + slow[0], (coupled[1:] + coupled[:-1]) / 2 + slow[1][:-1]


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


def _widths(model: Elastic, motors: int) -> Array:
    """Return the widths of the motors' friction, (n,) [rad/s]."""
    if not isinstance(model, ElasticRobot):
        return np.zeros(motors)
    if len(model.file.motors) != motors:
        raise InvalidInput(
            f"friction: {motors} motors were recorded; {model.name} has {len(model.file.motors)}"
        )
    check_motors(model)
    return np.array([motor.coulomb_width for motor in model.file.motors])


def _mean_torques(
    records: Records, run: tuple[int, int, int], channels: Channels, *, steady: bool
) -> tuple[Array, Array]:
    """Return torques at the motors [N m]: means about the samples of angles, (P N, n), and steps.

    Means about samples have triangular weights; those of steps (P N - 1, n) are from a sample to
    the next.
    """
    torque, step = records.torque[run].reshape(-1, records.torque.shape[-1]), records.sample_time
    ways = zip(torque.T, channels.delay / step, channels.lag / step, strict=True)
    passed = [_late_means(column, late, lag, steady) for column, late, lag in ways]
    about, steps = (np.stack(each, axis=1) * channels.gain for each in zip(*passed, strict=True))
    return about, steps[1:-1]


def _late_means(torque: Array, late: float, lag: float, steady: bool) -> tuple[Array, Array]:
    """Return triangular means (M,) of a torque behind a delay and a lag [samples], and of steps.

    Means of steps (M + 1,) begin with that before the first sample. The torque is `steady` from a
    sample to the next, or else straight between them, without a lag.
    """
    whole = int(late)
    x = late - whole
    if steady:
        weights = np.array([0, (1 - x) ** 2 / 2, 1 / 2 + x - x**2, x**2 / 2])
        of_steps = np.array([1 - x, x])
    else:
        weights = (np.array([1, 10, 1, 0]) * (1 - x) + np.array([0, 1, 10, 1]) * x) / 12
        of_steps = np.array([(1 - x) ** 2 / 2, 1 / 2 + x - x**2, x**2 / 2])
    padded = np.pad(torque, (whole + 2, 1), mode="edge")
    means = np.convolve(padded, weights, "valid")[: len(torque)]
    steps = np.convolve(padded, of_steps, "valid")[: len(torque) + 1]
    if lag:
        steps -= lag * np.diff(_behind_lag(padded, x, lag))[: len(torque) + 1]
        means -= lag * np.diff(steps)
    return means, steps


def _behind_lag(torque: Array, late: float, lag: float) -> Array:
    """Return where y = u - lag y' is, of a steady torque u, `late` behind each sample."""
    from scipy.signal import lfilter, lfilter_zi  # takes a second to load

    pole = np.exp(-1 / lag)
    b, a = [0.0, 1 - pole], [1.0, -pole]
    begun = lfilter(b, a, torque, zi=lfilter_zi(b, a) * torque[0])[0]  # where a sample begins
    return np.asarray(torque + (begun - torque) * np.exp((late - 1) / lag))


def _warn_of_rest(share: Array) -> None:
    """Warn of motors that rest or turn around most of the time."""
    for motor in np.flatnonzero(share > _RESTING):
        warnings.warn(
            f"friction: motor {motor + 1} rests or turns around in {100 * share[motor]:.0f} % of "
            "the samples, where its friction is not the full one; shake it more, or add a carrier",
            IdentificationWarning,
            stacklevel=2,
        )
