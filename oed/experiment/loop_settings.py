"""What experiments, studies and campaigns have in common: lines, limits, moves and controller.

`oed.experiment.experiment_file` shows all keys.
"""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Count, Hertz, NonNegative, Positive, Seconds

PositiveEach = Positive | Annotated[list[Positive], Field(min_length=1)]
NonNegativeEach = NonNegative | Annotated[list[NonNegative], Field(min_length=1)]


Format = Literal["csv", "mat", "trajectory"]
"""Of files for controllers."""


class MultisineChoice(FileSection):
    """Lines of the speed reference: band [Hz], sampling [s], what is left out."""

    band: tuple[Hertz, Hertz]
    sample_time: Seconds
    period: Seconds
    count: Count | None = None
    spacing: Literal["linear", "quasi_log"] = "linear"
    odd: bool = True
    detection: Annotated[int, Field(ge=2, le=1000)] | None = None
    slope: Annotated[float, Field(ge=-10, le=10)] = 0.0
    crest_iterations: Annotated[int, Field(ge=0, le=100_000)] = 0

    @model_validator(mode="after")
    def _fits(self) -> Self:
        low, high = self.band
        if high <= low:
            raise ValueError(f"band [{low:g}, {high:g}] Hz; the lower frequency comes first")
        if high >= 0.5 / self.sample_time:
            raise ValueError(
                f"band up to {high:g} Hz; it must stay below half the sampling frequency, "
                f"{0.5 / self.sample_time:g} Hz"
            )
        samples = self.period / self.sample_time
        if abs(samples - round(samples)) > 1e-6 * samples:
            raise ValueError(
                f"period {self.period:g} s is {samples:.6g} samples of {self.sample_time:g} s; "
                "a whole number is needed"
            )
        if self.spacing == "quasi_log" and self.count is None:
            raise ValueError("spacing quasi_log needs a count of lines")
        return self

    @property
    def samples(self) -> int:
        """Samples per period."""
        return round(self.period / self.sample_time)


class LimitChoice(FileSection):
    """What the linear model may predict, and commands be, at most; per motor, one at least."""

    torque: PositiveEach | None = None
    rms_torque: PositiveEach | None = None
    speed: PositiveEach | None = None
    swing: PositiveEach | None = None
    command_speed: PositiveEach | None = None
    command_acceleration: PositiveEach | None = None
    margin: Annotated[float, Field(ge=0, lt=1)] = 0.0
    balance: bool = True

    @model_validator(mode="after")
    def _some(self) -> Self:
        if all(getattr(self, name) is None for name in LIMITS):
            raise ValueError(f"none of {', '.join(LIMITS)} is given; any amplitude would do")
        return self


LIMITS = ("torque", "rms_torque", "speed", "swing", "command_speed", "command_acceleration")
"""Keys of `LimitChoice` that are limits."""


class MoveChoice(FileSection):
    """Largest speed and acceleration between positions, arm side, per motor."""

    speed: PositiveEach = 1.0
    acceleration: PositiveEach = 2.0


class ControllerChoice(FileSection):
    """Gains of the cascaded controller, per motor; see `robotmodels.Controller`."""

    speed_gain: PositiveEach
    integral_time: PositiveEach
    position_gain: NonNegativeEach
    filter_time: NonNegativeEach = 0.0


class ImperfectionChoice(FileSection):
    """What the simulated robot has that its linear model has not; see `Imperfections`."""

    friction: NonNegative = 1.0
    backlash: NonNegativeEach = 0.0
    quantisation: NonNegative = 0.0
    angle_noise: NonNegativeEach = 0.0
    output_noise: NonNegativeEach = 0.0
    torque_disturbance: NonNegativeEach = 0.0
    torque_limit: PositiveEach | None = None
    nonlinear_gears: bool = True


class CarrierChoice(FileSection):
    """Slow sines under the excitation, see `oed.experiment.carrier`."""

    speed: NonNegativeEach
    frequency: Hertz | None = None


class LoopSettings(FileSection):
    """Lines, limits and moves of a robot under its controller; of a simulated one what it lacks."""

    multisine: MultisineChoice
    limits: LimitChoice
    moves: MoveChoice = MoveChoice()
    settle: NonNegative = 0.0
    carrier: CarrierChoice | None = None
    controller: ControllerChoice | None = None
    imperfections: ImperfectionChoice = ImperfectionChoice()

    @property
    def friction_factor(self) -> float:
        """Times the robot file's Coulomb friction, which torques overcome within their limits."""
        return self.imperfections.friction


def per_motor(
    key: str, value: float | list[float], motors: tuple[str, ...], each: str = "motor"
) -> Array:
    """Return an entry as one value per motor, (n,), or for each of other names.

    Raises
    ------
    InvalidInput
        If a list has another length.
    """
    if isinstance(value, list) and len(value) != len(motors):
        raise InvalidInput(
            f"{key}: {len(value)} given; one number, or {len(motors)}, one per {each} "
            f"({', '.join(motors)}), is needed"
        )
    return np.array(np.broadcast_to(np.asarray(value, dtype=float), (len(motors),)))
