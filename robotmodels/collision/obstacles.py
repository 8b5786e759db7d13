"""What stands around a robot: planes, boxes and spheres in the frame of its root link."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.arrays import Array, real_numbers
from robotmodels.errors import InvalidInput

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Plane:
    """A wall or floor; everything with normal . x < offset is solid.

    Attributes
    ----------
    name : what reports call it.
    normal : points to where the robot is; any length but zero.
    offset : distance from the origin along the unit normal [m].

    Raises
    ------
    InvalidInput : naming the obstacle, if a number is missing or not finite, or the normal is zero.
    """

    name: str
    normal: Vector
    offset: float

    def __post_init__(self) -> None:
        normal = _vector(self.normal, f"obstacle {self.name!r}: normal")
        if not normal.any():
            raise InvalidInput(f"obstacle {self.name!r}: normal is zero; a direction is needed")
        _number(self.offset, f"obstacle {self.name!r}: offset")

    @property
    def direction(self) -> Array:
        """The unit normal, (3,)."""
        return np.asarray(np.array(self.normal, dtype=float) / np.linalg.norm(self.normal))


@dataclass(frozen=True)
class Box:
    """A box with its middle at `center` and edges of the lengths `size` [m].

    Attributes
    ----------
    name : what reports call it.
    center, size : (3,) [m].
    rpy : its roll, pitch and yaw about the fixed axes x, y, z, in this order [rad].

    Raises
    ------
    InvalidInput : naming the obstacle, if a number is missing or not finite, or an edge is not
        positive.
    """

    name: str
    center: Vector
    size: Vector
    rpy: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for key in ("center", "size", "rpy"):
            _vector(getattr(self, key), f"obstacle {self.name!r}: {key}")
        if min(self.size) <= 0:
            raise InvalidInput(
                f"obstacle {self.name!r}: size {list(self.size)} m; three positive lengths are "
                "needed"
            )


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Attributes
    ----------
    name : what reports call it.
    center : (3,) [m].
    radius : [m].

    Raises
    ------
    InvalidInput : naming the obstacle, if a number is missing or not finite, or the radius is not
        positive.
    """

    name: str
    center: Vector
    radius: float

    def __post_init__(self) -> None:
        _vector(self.center, f"obstacle {self.name!r}: center")
        _number(self.radius, f"obstacle {self.name!r}: radius")
        if self.radius <= 0:
            raise InvalidInput(
                f"obstacle {self.name!r}: radius {self.radius:g} m; a positive one is needed"
            )


Obstacle = Plane | Box | Sphere


def floor(height: float, gravity: Vector | Array) -> Plane:
    """Return the floor at `height` [m] above the root link's origin, against `gravity` (3,).

    Raises
    ------
    InvalidInput : if the height is not finite, or gravity is zero, so that nothing is up.
    """
    _number(height, "floor")
    down = np.asarray(gravity, dtype=float)
    if not down.any():
        raise InvalidInput(
            "floor: the robot file's gravity is zero, so that nothing is up; give a plane with "
            "its normal instead"
        )
    x, y, z = (float(u) + 0.0 for u in -down / np.linalg.norm(down))
    return Plane("floor", (x, y, z), float(height))


def _vector(value: ArrayLike, what: str) -> Array:
    array = real_numbers(value, what)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InvalidInput(f"{what} is {value!r}; three finite numbers are needed")
    return array


def _number(value: ArrayLike, what: str) -> None:
    array = real_numbers(value, what)
    if array.shape != () or not np.isfinite(array):
        raise InvalidInput(f"{what} is {value!r}; a finite number is needed")
