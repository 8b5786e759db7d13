"""From weighted squares to a log likelihood: noise of known or unknown scale.

V is a fit's cost with weights that are inverse noise covariances, and n the number of real data.
"""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, check_above_zero
from robotmodels.common.errors import check_word

NOISES = ("known", "unknown")


@dataclass(frozen=True)
class Noise:
    """Knowledge of the noise.

    Attributes
    ----------
    kind : {"known", "unknown"}
        "known", the weights are inverse covariances: log p = -scale V. Covariances that were
        estimated count as known: weights come from neighbouring lines, which makes them nearly so.
        "unknown", they are inverse covariances but for one common factor s^2 with the prior 1/s,
        marginalised analytically: log p = -(n/2) ln V.
    scale : float
        Factor of V where the noise is known, for weights that are not inverse covariances.
    """

    kind: str = "known"
    scale: float = 1.0

    def __post_init__(self) -> None:
        check_word("noise:", self.kind, NOISES)
        check_above_zero(self.scale, "scale")

    def of_cost(self, cost: Array, data: int) -> Array:
        """Return log p (W,) from V (W,) and n = `data`."""
        if self.kind == "known":
            return np.asarray(-self.scale * cost)
        return np.asarray(-data / 2 * np.log(cost))

    def curvature(self, cost: float, data: int) -> float:
        """Return the factor of the Hessian of V that log p has near the fit, whose cost is V."""
        return self.scale if self.kind == "known" else data / (2 * cost)
