"""A carrier: a slow sine of every motor under the excitation, so that friction seldom sticks.

Where a motor hardly moves, Coulomb friction holds it; where the carrier moves it faster than the
excitation does, friction is a constant torque but for two moments of each period, when the speed
changes its sign. In an even line of the period these reversals have lines of even number
only, so that an odd multisine's lines stay free of them.
"""

from dataclasses import dataclass, replace

import numpy as np

from oed.experiment.multisine import Multisine
from robotmodels.common.arrays import Array, ComplexArray, check_count, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.response import Elastic
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.loop_noise import closed_loop


@dataclass(frozen=True, eq=False)
class Carrier:
    """Speed references r_i(t) = a_i cos(w t + phi_i) that are added to every run in a position.

    Attributes
    ----------
    line : int
        Periods of it in one of the multisine.
    amplitudes : ndarray, (Q, n), rad/s
        Of the references, motor shaft.
    phases : ndarray, (Q, n), rad
        Of the references.

    Raises
    ------
    InvalidInput
        If line or amplitudes cannot be.
    """

    line: int
    amplitudes: Array
    phases: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "line", check_count(self.line, "carrier: line"))
        for name in ("amplitudes", "phases"):
            array = np.array(getattr(self, name), dtype=float)
            if not np.isfinite(array).all() or (name == "amplitudes" and (array < 0).any()):
                raise InvalidInput(f"carrier: {name} must be finite, amplitudes not negative")
            object.__setattr__(self, name, read_only(array))

    def grid(self, excitation: Multisine) -> Multisine:
        """Return its line as the only one of a multisine of the same period."""
        line = np.array([self.line])
        return Multisine(
            excitation.samples, excitation.sample_time, line, excitation.inputs, odd=False
        )

    def spectrum(self, position: int, samples: int) -> ComplexArray:
        """Return the DFT of a position's references at its line, (1, n, 1)."""
        vector = self.amplitudes[position] * np.exp(1j * self.phases[position])
        return np.asarray(0.5 * samples * vector[None, :, None])

    def reference(self, position: int, excitation: Multisine) -> Array:
        """Return one period in a position, (N, n) [rad/s, motor shaft]."""
        spectrum = self.spectrum(position, excitation.samples)
        return np.asarray(self.grid(excitation).period_of(spectrum)[0])

    def scaled(self, factor: float) -> "Carrier":
        """Return it with all amplitudes times a factor."""
        return replace(self, amplitudes=factor * self.amplitudes)


def carrier_line(frequency: float | None, excitation: Multisine) -> int:
    """Return the line of a frequency [Hz], by default the second, below all of the excitation.

    Raises
    ------
    InvalidInput
        If it is not a line, or not below those of the excitation.
    """
    line = 2.0 if frequency is None else frequency * excitation.period
    lowest = min([*excitation.lines, *excitation.detection])
    if abs(line - round(line)) > 1e-6 or not 1 <= round(line) < lowest:
        raise InvalidInput(
            f"carrier.frequency: {line / excitation.period:.6g} Hz; a multiple of 1 / period = "
            f"{1 / excitation.period:.6g} Hz below the lowest line, "
            f"{lowest / excitation.period:.6g} Hz, is needed; a longer period has more of them"
        )
    return round(line)


def carrier_in(
    robot: Elastic,
    positions: Array,
    controller: Controller,
    speed: Array,
    frequency: float | None,
    excitation: Multisine,
) -> Carrier:
    """Return the carrier whose motors move by sines of stated speeds, as the model predicts.

    Phases of the speeds are spread over half a period: no two motors reverse at once.

    Parameters
    ----------
    robot : Elastic
        Robot that will run it.
    positions : ndarray, (Q, n), rad
        Where.
    controller : Controller
        Controller of its motors.
    speed : ndarray, (n,), rad/s
        Amplitudes of the motors' speeds.
    frequency : float or None, Hz
        A whole multiple of the lines' distance, below all lines; by default twice that distance.
    excitation : Multisine
        What it carries.

    Raises
    ------
    InvalidInput
        As `carrier_line`.
    """
    line = carrier_line(frequency, excitation)
    omega = 2 * np.pi * line / excitation.period
    per_reference = (
        1j * omega * closed_loop(robot.network(positions), np.array([omega]), controller).angle
    )
    sines = speed * np.exp(1j * np.pi * np.arange(len(speed)) / len(speed))
    reference = np.linalg.solve(per_reference[:, 0], sines[:, None])[..., 0]
    return Carrier(line, np.abs(reference), np.angle(reference))
