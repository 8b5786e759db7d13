"""Free parameters: positive numbers with a name and a unit, estimated as ln theta."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, read_only, real_numbers
from robotmodels.common.errors import InvalidInput, nearest


@dataclass(frozen=True, eq=False)
class Parameters:
    """The free parameters of a model, in the order of every covariance and information matrix.

    Attributes
    ----------
    names : tuple of str
        p names, such as ``g1.stiffness``.
    values : ndarray, (p,)
        Positive values in SI units.
    units : tuple of str
        p units, for people.
    """

    names: tuple[str, ...]
    values: Array
    units: tuple[str, ...]

    def __post_init__(self) -> None:
        values = real_numbers(self.values, "parameters")
        if len({len(self.names), len(self.units), values.size}) != 1:
            raise InvalidInput(
                f"parameters: {len(self.names)} names, {values.size} values and "
                f"{len(self.units)} units; one of each per parameter is needed"
            )
        object.__setattr__(self, "values", read_only(self.check(values)))

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Return the index of parameter `name`.

        Raises
        ------
        InvalidInput
            If there is no free parameter of that name.
        """
        if name not in self.names:
            raise InvalidInput(
                f"parameter {name!r} is not among the free parameters{nearest(name, self.names)}"
            )
        return self.names.index(name)

    def check(self, values: Array | None) -> Array:
        """Return `values` as a (p,) float array, or the parameters' nominal values where None.

        Raises
        ------
        InvalidInput
            If the size is wrong or an entry is not a positive, finite number.
        """
        if values is None:
            return self.values
        values = real_numbers(values, "parameters")
        if values.shape != (len(self.names),):
            raise InvalidInput(
                f"parameters: an array of shape {values.shape} was given, "
                f"({len(self.names)},) is needed, in the order {', '.join(self.names)}"
            )
        wrong = ~(np.isfinite(values) & (values > 0))
        if wrong.any():
            i = int(np.argmax(wrong))
            raise InvalidInput(f"parameter {self.names[i]}: {values[i]:g} is not a positive number")
        return values
