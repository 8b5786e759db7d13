"""Ranges of the numbers in files: wider than any robot, narrow enough to be squared and inverted.

What is beyond is a slip of the pen or of units; products of such numbers leave double precision.
"""

from typing import Annotated

from pydantic import Field

MOST_LENGTH, MOST_MASS, MOST_INERTIA, MOST_LIMIT = 1e4, 1e9, 1e12, 1e16
"""Largest coordinate [m], mass [kg], moment of inertia [kg m^2] and limit of a joint [rad or m]."""

LEAST_DIRECTION = 1e-6
"""Length of the shortest vector that is a direction."""

MOST_COUNT = 100_000
"""Of what is counted and has no other limit."""

Coordinate = Annotated[float, Field(ge=-MOST_LENGTH, le=MOST_LENGTH)]
"""[m], of a direction [-], or an angle [rad]."""
Length = Annotated[float, Field(ge=1e-9, le=MOST_LENGTH)]
"""[m]."""
JointLimit = Annotated[float, Field(ge=-MOST_LIMIT, le=MOST_LIMIT)]
"""[rad or m]."""
Mass = Annotated[float, Field(ge=0, le=MOST_MASS)]
"""[kg]."""
Moment = Annotated[float, Field(ge=-MOST_INERTIA, le=MOST_INERTIA)]
"""Entry of a tensor of inertia [kg m^2]."""
RotorInertia = Annotated[float, Field(ge=1e-12, le=1e6)]
"""[kg m^2]."""
GearRatio = Annotated[float, Field(ge=-1e6, le=1e6)]
"""[-, or rad/m]; 1e-6 at least, of either sign."""
Friction = Annotated[float, Field(ge=0, le=1e9)]
"""[N m s/rad or N m]."""
Stiffness = Annotated[float, Field(ge=1e-6, le=1e15)]
"""[N m/rad or N/m]."""
Damping = Annotated[float, Field(ge=1e-9, le=1e12)]
"""[N m s/rad or N s/m]."""
Positive = Annotated[float, Field(ge=1e-12, le=1e12)]
"""Of any unit."""
NonNegative = Annotated[float, Field(ge=0, le=1e12)]
"""Of any unit."""
Seconds = Annotated[float, Field(ge=1e-9, le=1e9)]
"""[s]."""
Hertz = Annotated[float, Field(ge=1e-6, le=1e6)]
"""[Hz]."""
Count = Annotated[int, Field(ge=1, le=MOST_COUNT)]
Index = Annotated[int, Field(ge=0, le=MOST_COUNT)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
