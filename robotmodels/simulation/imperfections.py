"""What a simulated robot does that the linear model knows nothing of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput


@dataclass(frozen=True)
class Imperfections:
    """Differences of a simulated robot from its linear model; values per motor or one for all.

    Attributes
    ----------
    friction : float, dimensionless
        Factor of the robot file's Coulomb friction.
    nonlinear_gears : bool
        Whether hardening springs harden, or keep their slope at each position.
    backlash : array_like
        Gap of the gears, from flank to flank [rad, arm side]; the gear's damper stays.
    quantisation : float
        Resolution of the measured angles [rad, motor shaft]; 0 for none.
    angle_noise : array_like
        Standard deviation of white noise on the angles that the controller sees, and that motors'
        encoders record [rad, motor shaft].
    output_noise : array_like
        Standard deviation of white noise on what all other outputs record, one for each of the
        robot's outputs [in its unit, of encoders rad or m].
    torque_disturbance : array_like, N m
        Standard deviation of white noise on the torques, unseen.
    torque_limit : array_like or None, N m
        Largest torque a motor can give; None for no limit.
    """

    friction: float = 1.0
    nonlinear_gears: bool = True
    backlash: ArrayLike = 0.0
    quantisation: float = 0.0
    angle_noise: ArrayLike = 0.0
    output_noise: ArrayLike = 0.0
    torque_disturbance: ArrayLike = 0.0
    torque_limit: ArrayLike | None = None

    def __post_init__(self) -> None:
        for name in (
            "friction", "backlash", "quantisation", "angle_noise", "output_noise",
            "torque_disturbance",
        ):  # fmt: skip
            value = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(value) & (value >= 0)).all():
                raise InvalidInput(f"imperfections: {name} {value.tolist()} is not a number >= 0")
        limit = np.asarray(1.0 if self.torque_limit is None else self.torque_limit, dtype=float)
        if not (limit > 0).all():
            raise InvalidInput(f"imperfections: torque_limit {limit.tolist()} is not positive")

    def per_motor(self, name: str, n: int, each: str = "motor") -> Array:
        """Return an entry as one value per motor, (n,), or for each of something else.

        Raises
        ------
        InvalidInput
            If it has neither one value nor n.
        """
        value = getattr(self, name)
        value = np.asarray(np.inf if value is None else value, dtype=float)
        if value.shape not in ((), (1,), (n,)):
            raise InvalidInput(
                f"imperfections: {name} has {value.size} values; "
                f"1 or {n}, one per {each}, is needed"
            )
        return np.array(np.broadcast_to(value, (n,)))


IDEAL = Imperfections(friction=0.0, nonlinear_gears=False)
