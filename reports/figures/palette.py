"""Colours of figures."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Palette:
    """The colours a figure may use."""

    ink: str
    muted: str
    rule: str
    accent: str
    second: str


LIGHT = Palette(ink="#1c2126", muted="#5d666f", rule="#d9dde1", accent="#1d5c92", second="#b3541e")
"""The page's colours in the light, for pictures of points."""

Drawing = Callable[[Palette], "Figure"]
"""Draws a figure of matplotlib in the colours of a palette."""
