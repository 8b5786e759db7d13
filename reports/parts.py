"""What a page is made of: sections, figures, tables."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup
from matplotlib.figure import Figure as MatplotlibFigure

from reports.drawing.svg import Palette, inline

Drawing = Callable[[Palette], MatplotlibFigure]


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading of its own and a place in the contents."""

    id: str
    title: str
    body: Markup


@dataclass(frozen=True)
class Figure:
    """A drawing on a page.

    Attributes
    ----------
    id : str
        Id on the page, and name of the file when it is downloaded.
    drawing : Markup
        Inline SVG, or a picture.
    caption : str
        Below it; a template may say more.
    label : str
        Label of one of several figures to choose from.
    wide : bool
        Whether it may be wider than text.
    """

    id: str
    drawing: Markup
    caption: str = ""
    label: str = ""
    wide: bool = False

    @property
    def format(self) -> str:
        """What a download gives."""
        return "PNG" if self.drawing.startswith("<img") else "SVG"


def figure(
    id: str, draw: Drawing, alt: str, *, caption: str = "", label: str = "", wide: bool = False
) -> Figure:
    """Return a drawing for a page; `alt` says what is to be seen."""
    return Figure(id, inline(draw, f"in-{id}", alt), caption, label, wide)


@dataclass(frozen=True)
class Number:
    """A number as it is shown, and as it sorts and is downloaded.

    Attributes
    ----------
    struck : str
        Why it must not be quoted: it is struck out then, here and in downloads.
    """

    text: str
    value: float
    struck: str = ""

    @property
    def exact(self) -> str:
        """The value to eight digits."""
        return f"{self.value:.8g}"


Cell = str | Number
Row = Sequence[Cell]


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    title : str
        Its heading.
    kind : {"n", "u", "words", ""}
        n for numbers, u for units, words for text that wraps, nothing for names.
    code : bool
        Whether its entries are names in a file.
    """

    title: str
    kind: Literal["n", "u", "words", ""] = ""
    code: bool = False

    @property
    def heading(self) -> str:
        """The title, its unit on one line."""
        return re.sub(r"\[.*?\]", lambda unit: unit[0].replace(" ", "\u00a0"), self.title)


@dataclass(frozen=True)
class Table:
    """A table that sorts and can be downloaded; rows come in groups, one without a name or more."""

    id: str
    caption: str
    columns: tuple[Column, ...]
    groups: tuple[tuple[str, tuple[tuple[Cell, ...], ...]], ...]


def table(
    id: str, caption: str, columns: Sequence[Column], rows: Iterable[Sequence[Cell]]
) -> Table:
    """Return a table of one group."""
    return Table(id, caption, tuple(columns), (("", tuple(tuple(row) for row in rows)),))


def numbers(*titles: str) -> list[Column]:
    """Return columns of numbers."""
    return [Column(title, "n") for title in titles]
