"""A cascaded position and speed controller per motor, sampled, its torque held over a sample."""

import math
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, check_above_zero, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.dynamics import mass_matrices
from robotmodels.elastic.robot import ElasticRobot

# ks [N m s/rad], Ts [s], kp [1/s] of every axis (Modelica Standard Library, MultiBody RobotR3).
_PUBLISHED = {"manutec_r3": (0.5, 0.05, 5.0)}
_BANDWIDTH = 30.0  # of the default speed loop around the rigid arm [rad/s]
# At high frequency a loop is gain/(inertia s) with a delay of one sample, unstable from 1.57 on.
_LARGEST_STEP = 0.5


@dataclass(frozen=True, eq=False)
class Controller:
    """A proportional position loop around a proportional-integral speed loop, motor by motor.

    At the sample k, with the measured motor angle y and the speed reference r,

        w_k = a w_{k-1} + (1 - a) (y_k - y_{k-1}) / T,        a = exp(-T / filter_time)
        e_k = r_k + position_gain (y_0 - y_k) - w_k
        i_k = i_{k-1} + T e_k / integral_time
        u_k = speed_gain (e_k + i_k) + the torque that holds the arm against gravity

    acts from kT to (k+1)T. While a torque is limited, its integral i stands still.

    Attributes
    ----------
    speed_gain : ndarray, (n,), N m s/rad
        Proportional gain, positive, on the motor shaft as everything here.
    integral_time : ndarray, (n,), s
        Integral time, positive, infinite for no integral part.
    position_gain : ndarray, (n,), 1/s
        Not negative.
    sample_time : float, s
        T.
    filter_time : ndarray or None, (n,), s
        Not negative, of the speed's low-pass filter; zeros by default.

    Raises
    ------
    InvalidInput
        Naming the entry and motor out of range, or arrays of different lengths.
    """

    speed_gain: Array
    integral_time: Array
    position_gain: Array
    sample_time: float
    filter_time: Array | None = None

    def __post_init__(self) -> None:
        gain = np.atleast_1d(np.asarray(self.speed_gain, dtype=float))
        filter_time = np.zeros(len(gain)) if self.filter_time is None else self.filter_time
        entries = {
            "speed_gain": (gain, True),
            "integral_time": (self.integral_time, True),
            "position_gain": (self.position_gain, False),
            "filter_time": (filter_time, False),
        }
        for name, (value, positive) in entries.items():
            array = np.atleast_1d(np.asarray(value, dtype=float))
            if array.shape != (len(gain),):
                raise InvalidInput(
                    f"controller: {name} has shape {array.shape}, speed_gain ({len(gain)},)"
                )
            endless = name == "integral_time"
            wrong = ~((array > 0) if positive else (array >= 0)) | (np.isinf(array) & (not endless))
            if wrong.any():
                i = int(np.argmax(wrong))
                what = "positive" if positive else "a finite number >= 0"
                raise InvalidInput(f"controller: {name} of motor {i} is {array[i]:g}, not {what}")
            object.__setattr__(self, name, read_only(array))
        check_above_zero(self.sample_time, "controller: sample_time")

    @property
    def filter_pole(self) -> Array:
        """The pole a of the speed filter, (n,); 0 where nothing is filtered."""
        tau = np.asarray(self.filter_time)
        filtered = tau > 0
        return np.where(filtered, np.exp(-self.sample_time / np.where(filtered, tau, 1.0)), 0.0)

    def prefilter(self, omega: Array) -> ComplexArray:
        """Return torque per speed reference, F_r (F, n), of the sampled controller."""
        z = np.exp(1j * np.asarray(omega, dtype=float) * self.sample_time)[:, None]
        integral = self.sample_time / self.integral_time * z / (z - 1)
        return np.asarray(self.speed_gain * (1 + integral))

    def feedback(self, omega: Array) -> ComplexArray:
        """Return torque per motor angle with opposite sign, F_y (F, n): u = F_r r - F_y y."""
        z = np.exp(1j * np.asarray(omega, dtype=float) * self.sample_time)[:, None]
        a = self.filter_pole
        speed = (1 - a) / (1 - a / z) * (1 - 1 / z) / self.sample_time
        return np.asarray(self.prefilter(omega) * (self.position_gain + speed))


def default_controller(robot: ElasticRobot, sample_time: float) -> Controller:
    """Return gains that keep `robot` stable: the published ones if there are, else a rule.

    The rule gives the speed loop a bandwidth of 30 rad/s around the largest rigid inertia that a
    motor meets, and both the position loop and the integral part a fifth of that. Rule or
    published, a speed gain is limited to what sampling allows: half the inertia that the motor
    feels at high frequency (its own behind a gear spring) per sample time.

    Raises
    ------
    InvalidInput
        If the sample time is not positive.
    """
    check_above_zero(sample_time, "controller: sample_time")
    slow, fast = _inertias(robot)
    limit = _LARGEST_STEP * fast / sample_time
    ones = np.ones(len(slow))
    if robot.name in _PUBLISHED:
        gain, integral_time, position_gain = _PUBLISHED[robot.name]
        return Controller(
            np.minimum(gain, limit), integral_time * ones, position_gain * ones, sample_time
        )
    gains = np.minimum(_BANDWIDTH * slow, limit)
    fifth = gains / slow / 5
    return Controller(gains, 1 / fifth, fifth, sample_time)


def _inertias(robot: ElasticRobot) -> tuple[Array, Array]:
    """Return the inertias that motors feel, (n,) on the motor shaft [kg m^2].

    The first is the largest with all springs rigid, the second the least at high frequency, when
    nothing but inertia resists.
    """
    layout = robot.layout
    # A few positions all over the joints' ranges; no two angles of an arm are alike in them.
    spread = np.sin(np.outer(np.arange(16), 1 + np.arange(len(layout.motors)) / math.e))
    low, high = robot.position_limits.T
    coordinates = np.zeros((len(spread), layout.arm_size))
    coordinates[:, layout.drives] = low + (high - low) * (1 + spread) / 2
    arm = mass_matrices(robot.arm, coordinates)
    square = np.array([m.gear_ratio**2 for m in robot.file.motors])
    rotors = np.array([m.inertia for m in robot.file.motors])
    slow = rotors + arm[:, layout.drives, layout.drives].max(axis=0) / square
    mass = np.zeros((len(arm), layout.size, layout.size))
    mass[:, : layout.arm_size, : layout.arm_size] = arm
    mass[:, layout.motors, layout.motors] += rotors * square
    mobility = np.linalg.inv(mass)[:, layout.motors, layout.motors].max(axis=0)
    return slow, 1 / (mobility * square)
