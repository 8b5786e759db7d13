"""Prior knowledge of some parameters: independent normal distributions of ln theta."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, read_only, real_numbers
from robotmodels.common.errors import InvalidInput, nearest


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent normal priors of ln theta.

    A fit minimises V + z^2/2 with z = ln(theta/value)/std: what was measured before counts as k
    more data. That is the posterior's mode if the weights are the inverse noise covariance.

    Attributes
    ----------
    names : tuple of str
        Names of the k parameters.
    values : ndarray, (k,)
        Medians [SI].
    std : ndarray, (k,)
        Standard deviations of ln theta, so relative ones.
    """

    names: tuple[str, ...]
    values: Array
    std: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        k = len(self.names)
        if len(set(self.names)) < k or not k:
            raise InvalidInput(f"prior: names {self.names}; one or more different ones are needed")
        for field in ("values", "std"):
            array = real_numbers(getattr(self, field), f"prior.{field}")
            if array.shape != (k,):
                raise InvalidInput(f"prior.{field}: shape {array.shape} given; ({k},) is needed")
            wrong = ~(np.isfinite(array) & (array > 0))
            if wrong.any():
                i = int(np.argmax(wrong))
                raise InvalidInput(
                    f"prior.{field}: {array[i]:g} for {self.names[i]} is not a positive number"
                )
            object.__setattr__(self, field, read_only(array))

    def columns(self, names: tuple[str, ...]) -> list[int]:
        """Return the indices of the prior's parameters among `names`.

        Raises
        ------
        InvalidInput
            If one is not among them.
        """
        for name in self.names:
            if name not in names:
                raise InvalidInput(f"prior: {name!r} is not a free parameter{nearest(name, names)}")
        return [names.index(name) for name in self.names]

    def standardised(self, names: tuple[str, ...], values: Array) -> Array:
        """Return z = ln(theta/value)/std, (..., k), at `values` (..., p) of `names`."""
        selected = np.asarray(values)[..., self.columns(names)]
        return np.asarray(np.log(selected / self.values) / self.std)

    def cost(self, names: tuple[str, ...], values: Array) -> Array:
        """Return sum z^2/2, (...), minus the log density but for a constant."""
        return np.asarray(np.sum(self.standardised(names, values) ** 2, axis=-1) / 2)

    def slope(self, names: tuple[str, ...]) -> Array:
        """Return dz/d ln theta, (k, p)."""
        result = np.zeros((len(self.names), len(names)))
        result[np.arange(len(self.names)), self.columns(names)] = 1 / self.std
        return result

    def information(self, names: tuple[str, ...]) -> Array:
        """Return what the prior adds to the information on ln theta, (p, p)."""
        slope = self.slope(names)
        return np.asarray(slope.T @ slope)
