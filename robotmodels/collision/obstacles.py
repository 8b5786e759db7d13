"""What stands around a robot: planes, boxes and spheres in the frame of its root link."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput

Vector = tuple[float, float, float]

_LEAST_NORMAL = 1e-6


@dataclass(frozen=True)
class Plane:
    """A wall or floor; everything with normal . x < offset is solid.

    Attributes
    ----------
    name : str
        What reports call it.
    normal : Vector
        Points to where the robot is; any length but zero.
    offset : float, m
        Distance from the origin along the unit normal.

    Raises
    ------
    InvalidInput
        Naming the obstacle, if a number is missing or not finite, or the normal is zero.
    """

    name: str
    normal: Vector
    offset: float

    def __post_init__(self) -> None:
        normal = _vector(self, "normal")
        if np.linalg.norm(normal) < _LEAST_NORMAL:
            raise InvalidInput(f"obstacle {self.name!r}: normal is zero; a direction is needed")
        _number(self, "offset")

    @property
    def direction(self) -> Array:
        """The unit normal, (3,)."""
        return np.asarray(np.array(self.normal, dtype=float) / np.linalg.norm(self.normal))


@dataclass(frozen=True)
class Box:
    """A box with its middle at `center` and edges of the lengths `size` [m].

    Attributes
    ----------
    name : str
        What reports call it.
    center, size : Vector, (3,), m
        Center and size.
    rpy : Vector, rad
        Its roll, pitch and yaw about the fixed axes x, y, z, in this order.

    Raises
    ------
    InvalidInput
        Naming the obstacle, if a number is missing or not finite, or an edge is not positive.
    """

    name: str
    center: Vector
    size: Vector
    rpy: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for key in ("center", "size", "rpy"):
            _vector(self, key)
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
    name : str
        What reports call it.
    center : Vector, (3,), m
        Center.
    radius : float, m
        Radius.

    Raises
    ------
    InvalidInput
        Naming the obstacle, if a number is missing or not finite, or the radius is not positive.
    """

    name: str
    center: Vector
    radius: float

    def __post_init__(self) -> None:
        _vector(self, "center")
        _number(self, "radius")
        if self.radius <= 0:
            raise InvalidInput(
                f"obstacle {self.name!r}: radius {self.radius:g} m; a positive one is needed"
            )


Obstacle = Plane | Box | Sphere


def floor(height: float, gravity: Vector | Array) -> Plane:
    """Return the floor at `height` [m] above the root link's origin, against `gravity` (3,).

    Raises
    ------
    InvalidInput
        If the height is not finite, or gravity is zero, so that nothing is up.
    """
    height = _finite(height, "floor")
    down = np.asarray(gravity, dtype=float)
    if not down.any():
        raise InvalidInput(
            "floor: the robot file's gravity is zero, so that nothing is up; give a plane with "
            "its normal instead"
        )
    x, y, z = (float(u) + 0.0 for u in -down / np.linalg.norm(down))
    return Plane("floor", (x, y, z), height)


def _vector(obstacle: Obstacle, key: str) -> Array:
    """Return a vector of an obstacle, which then holds the numbers that were checked."""
    value, what = getattr(obstacle, key), f"obstacle {obstacle.name!r}: {key}"
    array = real_numbers(value, what)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InvalidInput(f"{what} is {value!r}; three finite numbers are needed")
    object.__setattr__(obstacle, key, tuple(array.tolist()))
    return array


def _number(obstacle: Obstacle, key: str) -> None:
    """Check a number of an obstacle, which then holds it."""
    value = _finite(getattr(obstacle, key), f"obstacle {obstacle.name!r}: {key}")
    object.__setattr__(obstacle, key, value)


def _finite(value: ArrayLike, what: str) -> float:
    array = real_numbers(value, what)
    if array.shape != () or not np.isfinite(array):
        raise InvalidInput(f"{what} is {value!r}; a finite number is needed")
    return float(array)
