"""Counterbalances in robot files: springs, cylinders or tables that carry part of the weight.

Each acts on one joint, with a torque that depends on the joint's angle alone.
"""

from typing import Annotated, Self

from pydantic import Field, model_validator

from robotmodels.common.yaml_files import FileSection
from robotmodels.description.names import Name
from robotmodels.description.ranges import Coordinate, Length, Positive, Stiffness, Vector

Torque = Annotated[float, Field(ge=-1e9, le=1e9)]
"""[N m] or [N]."""


class Sinusoid(FileSection):
    """Torque amplitude sin(angle + phase) on the joint."""

    amplitude: Positive
    phase: Coordinate


class Point(FileSection):
    """A point on a link, in its frame [m]."""

    link: str
    at: Vector


class TensionSpring(FileSection):
    """A spring between two points that pulls with preload + stiffness (length - rest_length)."""

    points: tuple[Point, Point]
    stiffness: Stiffness
    rest_length: Annotated[float, Field(ge=0, le=1e4)]
    preload: Torque = 0.0

    @property
    def unloaded_length(self) -> float:
        """Where it pulls with nothing [m]; below zero where no spring has such a length."""
        return self.rest_length - self.preload / self.stiffness


class GasSpring(FileSection):
    """A gas spring between two points.

    It pulls with `force` (pushes, where that is negative) at `length`, where its gas column is
    `column` long; the force goes with the column to the power of -`exponent`, and the column gets
    shorter as the spring gives way to its load.
    """

    points: tuple[Point, Point]
    force: Torque
    length: Length
    column: Length
    exponent: Annotated[float, Field(ge=0.5, le=2.0)] = 1.2


class Table(FileSection):
    """Torques at angles of the joint, a smooth curve between them (a cubic spline)."""

    angles: list[Coordinate] = Field(min_length=4, max_length=10_000)
    torques: list[Torque] = Field(min_length=4, max_length=10_000)

    @model_validator(mode="after")
    def _angles_rise(self) -> Self:
        if len(self.angles) != len(self.torques):
            raise ValueError(f"{len(self.angles)} angles and {len(self.torques)} torques")
        if any(a >= b for a, b in zip(self.angles, self.angles[1:], strict=False)):
            raise ValueError("angles: each must be larger than the one before it")
        return self


class Counterbalance(FileSection):
    """What adds a torque to a joint, link side, over the joint's angle: one of four laws."""

    name: Name
    joint: str
    sinusoid: Sinusoid | None = None
    spring: TensionSpring | None = None
    gas: GasSpring | None = None
    table: Table | None = None

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        if sum(law is not None for law in (self.sinusoid, self.spring, self.gas, self.table)) != 1:
            raise ValueError(
                f"counterbalance {self.name!r}: exactly one of sinusoid, spring, gas and table "
                "is needed"
            )
        return self

    @property
    def points(self) -> tuple[Point, Point] | None:
        """Where a spring or gas spring is fastened."""
        law = self.spring or self.gas
        return None if law is None else law.points

    @property
    def in_mujoco(self) -> bool:
        """Whether a spring of MuJoCo's, between two points, has exactly this torque."""
        if self.spring is None:
            return self.sinusoid is not None
        return self.spring.unloaded_length >= 0
