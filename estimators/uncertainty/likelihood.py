"""From weighted squares to a log likelihood: noise that is known, of unknown scale, or estimated.

V is a fit's cost with weights that are inverse noise covariances, and n the number of real data. Q
is the part of V of one element, or of one line where the elements of its FRF matrix are correlated;
d is the number of elements that Q is made of, and 3/2 for a single real residual.
"""

from dataclasses import dataclass

import numpy as np

from estimators.frf.estimate import is_full, vec
from robotmodels.arrays import Array, ComplexArray
from robotmodels.errors import InvalidInput, nearest

NOISES = ("known", "unknown", "estimated")


@dataclass(frozen=True)
class Noise:
    """What is known of the noise.

    Attributes
    ----------
    kind : "known", the weights are inverse covariances: log p = -scale V.
        "unknown", they are inverse covariances but for one common factor s^2 with the prior 1/s,
        marginalised analytically: log p = -(n/2) ln V.
        "estimated", they are inverses of sample covariances over `blocks` blocks, each with a flat
        prior, marginalised analytically: log p = -sum (blocks - d) ln(1 + Q/(blocks - 1)), a
        Student t for each Q. With this exponent alone the gradient of log p has the covariance
        that its curvature promises, so that a parameter of many lines has the interval of right
        coverage; one of a single line has one a little too wide. Jeffreys' prior |covariance|^-d
        has the exponent `blocks` and intervals that are too narrow.
    scale : factor of V where the noise is known, for weights that are not inverse covariances.
    blocks : independent FRF estimates that each sample covariance was made from.
    """

    kind: str = "known"
    scale: float = 1.0
    blocks: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in NOISES:
            raise InvalidInput(
                f"noise: {self.kind!r} is none of {', '.join(NOISES)}{nearest(self.kind, NOISES)}"
            )
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise InvalidInput(f"scale: {self.scale:g} is not a positive number")
        if self.kind == "estimated" and (self.blocks is None or self.blocks < 2):
            raise InvalidInput(
                f"blocks: {self.blocks}; estimated noise needs the number of blocks (at least 2) "
                "that its covariance was made from"
            )
        if self.kind != "estimated" and self.blocks is not None:
            raise InvalidInput(
                f"blocks: {self.blocks} given, but the noise is {self.kind}; only estimated noise "
                "uses them"
            )

    def of_cost(self, cost: Array, data: int) -> Array:
        """Return log p (W,) from V (W,) and n = `data`; not for estimated noise."""
        if self.kind == "known":
            return np.asarray(-self.scale * cost)
        return np.asarray(-data / 2 * np.log(cost))

    def power(self, elements: float) -> float:
        """Return the exponent blocks - d of estimated noise.

        Raises
        ------
        InvalidInput : if there are too few blocks for so many elements.
        """
        assert self.blocks is not None
        if self.blocks <= elements:
            raise InvalidInput(
                f"blocks: {self.blocks} give no covariance of {elements:g} elements; more blocks, "
                "or variances of single elements, are needed"
            )
        return self.blocks - elements

    def of_squares(self, squares: Array, elements: float) -> Array:
        """Return log p (W,) of estimated noise from Q (W, ...) and d = `elements`."""
        assert self.blocks is not None
        terms = np.log1p(squares / (self.blocks - 1)).reshape(len(squares), -1)
        return np.asarray(-self.power(elements) * terms.sum(axis=1))

    def influence(self, squares: Array, elements: float) -> Array:
        """Return -d log p / dQ of estimated noise at Q."""
        assert self.blocks is not None
        return np.asarray(self.power(elements) / (self.blocks - 1 + squares))

    def curvature(self, cost: float, data: int, elements: float) -> float:
        """Return the factor of the Hessian of V that log p has near the fit, whose cost is V.

        Exact for known noise and an unknown scale, an average over data for estimated noise.
        """
        if self.kind == "known":
            return self.scale
        if self.kind == "unknown":
            return data / (2 * cost)
        assert self.blocks is not None
        # (blocks - 1)/(blocks - 1 + Q) is beta distributed with blocks - d and d degrees.
        mean = (self.blocks - elements) / self.blocks
        bent = self.blocks / (self.blocks + 1)
        return self.power(elements) / (self.blocks - 1) * mean * bent


def line_squares(root: Array | ComplexArray, error: Array | ComplexArray) -> Array:
    """Return |S error|^2 of residuals (..., Q, F, m, n): parts of the cost V.

    One per element, (..., Q, F, m, n), or per line, (..., Q, F), where S couples the elements.
    """
    if is_full(root, error.shape[-4:]):
        white = (root @ vec(error)[..., None])[..., 0]
        return np.asarray(np.sum(white.real**2 + white.imag**2, axis=-1))
    white = root * error
    return np.asarray(white.real**2 + white.imag**2)
