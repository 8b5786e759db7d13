"""Sections, figures and tables of a page, and the templates that make one file of them."""

import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Literal, Protocol, runtime_checkable

import jinja2
from markupsafe import Markup, escape

from reports import text
from reports.figures.palette import LIGHT, Drawing
from reports.figures.svg import inline

_SCRIPTS = ("report.js", "packed.js", "robots.js", "plotting.js", "responses.js", "map.js")


@runtime_checkable
class VectorDrawing(Protocol):
    """A drawing that is written as SVG, without matplotlib."""

    def svg(self, name: str, alt: str) -> Markup:
        """Return the SVG; `name` prefixes its identifiers, `alt` says what is to be seen."""


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading and an entry in the contents."""

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
    id: str,
    draw: Drawing | VectorDrawing,
    alt: str,
    *,
    caption: str = "",
    label: str = "",
    wide: bool = False,
) -> Figure:
    """Return a drawing for a page; `alt` says what is to be seen."""
    name = f"in-{id}"
    drawing = draw.svg(name, alt) if isinstance(draw, VectorDrawing) else inline(draw, name, alt)
    return Figure(id, drawing, caption, label, wide)


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

    @property
    def compound(self) -> bool:
        """Whether the text says more than the value: a range, a deviation, a count of several."""
        return any(mark in self.text for mark in (" to ", " ± ", " of ", " → "))


def number_cell(value: float, words: Callable[..., str], *options: int, struck: str = "") -> Number:
    """Return a number in words; a dash where there is none."""
    return Number(words(value, *options) if math.isfinite(value) else "–", value, struck)


def percent_cell(fraction: float, struck: str = "", unbounded: str = "–") -> Number:
    """Return a fraction in per cent, the unit being in the heading; `unbounded` if infinite."""
    if math.isinf(fraction):
        return Number(unbounded, fraction, struck)
    return number_cell(100 * fraction, text.significant, 2, struck=struck)


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
    def explanation(self) -> str:
        """What the glossary says of the title without its unit; nothing if it has no entry."""
        return glossary().get(re.sub(r" *\[.*\]$", "", self.title).lower(), "")

    @property
    def heading(self) -> str:
        """The title, its unit on one line."""
        return re.sub(r"\[.*?\]", lambda unit: unit[0].replace(" ", "\u00a0"), self.title)


_LONG, _WRAPPED = 110, 30
"""Characters of a table's longest cells with the space between, of one whose text wraps."""


@dataclass(frozen=True)
class Table:
    """A table that sorts and can be downloaded; rows come in groups, one without a name or more."""

    id: str
    caption: str
    columns: tuple[Column, ...]
    groups: tuple[tuple[str, tuple[tuple[Cell, ...], ...]], ...]

    @property
    def dense(self) -> bool:
        """Whether its cells are so long together that they are set closer."""
        rows = [row for _, group in self.groups for row in group]
        words = [[one if isinstance(one, str) else one.text for one in row] for row in rows]
        longest = (max(map(len, column)) + 2 for column in zip(*words, strict=True))
        return (
            sum(
                min(count, _WRAPPED) if column.kind == "words" else count
                for column, count in zip(self.columns, longest, strict=bool(rows))
            )
            > _LONG
        )


def table(
    id: str, caption: str, columns: Sequence[Column], rows: Iterable[Sequence[Cell]]
) -> Table:
    """Return a table of one group."""
    return Table(id, caption, tuple(columns), (("", tuple(tuple(row) for row in rows)),))


def in_shared_unit(one: Table, *more: str) -> Table:
    """Return a table without its column of units where all rows share one: headings have it then.

    Those of numbers before that column, and those in `more`.
    """
    at = next(k for k, column in enumerate(one.columns) if column.kind == "u")
    units = {str(row[at]) for _, rows in one.groups for row in rows}
    if len(units) != 1:
        return one
    titles = [c.title for c in one.columns[:at] if c.kind == "n" and "[" not in c.title]
    columns = [
        replace(c, title=f"{c.title} [{min(units)}]") if c.title in (*titles, *more) else c
        for c in one.columns
    ]
    groups = tuple(
        (name, tuple((*row[:at], *row[at + 1 :]) for row in rows)) for name, rows in one.groups
    )
    return Table(one.id, one.caption, (*columns[:at], *columns[at + 1 :]), groups)


_DIMENSIONLESS = re.compile(
    r"p-value|share|correlation|ratio|gear ratio|z|dof|R-hat|ESS|BIC|score|cost"
    r"|over best|expected decrease|decrease in cost|held out|misfit per datum|independent|simulated"
    r"|residuals over expected"
    r"|(relative efficiency|inflation|condition|largest singular value).+|[^\[]+ / [^\[]+"
)
"""Titles of numbers without a dimension; counts have what they count in their title."""


def numbers(*titles: str) -> list[Column]:
    """Return columns of numbers; those without a dimension say so."""
    return [
        Column(f"{title} [–]" if _DIMENSIONLESS.fullmatch(title) else title, "n")
        for title in titles
    ]


def in_unit(unit: str, *titles: str) -> list[Column]:
    """Return columns of numbers that have one unit."""
    return numbers(*(f"{title} [{unit}]" for title in titles))


def page(
    title: str,
    kind: str,
    kicker: str,
    lead: str,
    sections: Sequence[Section],
    banner: Markup = Markup(),  # noqa: B008
) -> str:
    """Return an HTML page that needs nothing else: style and controls are inside.

    Parameters
    ----------
    title : str
        Heading, usually a robot's name.
    kind : str
        What the page is about, in the window's title.
    kicker, lead : str
        A line above the heading and one below it.
    sections : sequence of Section
        Sections in the order of the contents.
    banner : Markup
        Below the lead, before the contents.
    """
    entries = dict(re.findall(r"^## (.+)\n(.+)$", _file("glossary.md"), re.M))
    bodies = "".join(one.body for one in sections)
    return (
        _environment(html=True)
        .get_template("base.html.j2")
        .render(
            title=title,
            kind=kind,
            kicker=kicker,
            lead=lead,
            sections=sections,
            banner=banner,
            style=Markup(_file("report.css")),
            script=Markup("".join(map(_file, _SCRIPTS))),
            light=Markup(json.dumps(asdict(LIGHT))),
            glossary=entries,
            used={words for words in entries.values() if f'title="{escape(words)}"' in bodies},
        )
    )


def entry(term: str) -> str:
    """Return the id of a term's entry in the glossary of a page."""
    words = glossary()[term.lower()]
    name = next(name for name, explained in glossary().items() if explained == words)
    return "term-" + re.sub(r"\W+", "-", name.split(", ")[0])


@cache
def glossary() -> dict[str, str]:
    """Return explanations by term, in lower case."""
    entries = re.findall(r"^## (.+)\n(.+)$", _file("glossary.md"), re.M)
    return {term.lower(): words for names, words in entries for term in [names, *names.split(", ")]}


def page_banner(
    verdict: str, kind: str, reason: str, *, quote: str = "", next_step: str = ""
) -> Markup:
    """Return the banner of a page: may the reader trust it, what to quote, what to do next.

    Parameters
    ----------
    kind : {"sound", "doubtful", "refused"}
        Its looks.
    """
    return filled(
        "banner.html.j2", verdict=verdict, kind=kind, reason=reason, quote=quote, step=next_step
    )


def filled(template: str, **contents: object) -> Markup:
    """Return a template of this package filled in, as HTML.

    It finds `text`, the formatting functions, and `parts`, macros for figures and tables.
    """
    environment = _environment(html=True)
    parts = environment.get_template("parts.html.j2").module
    return Markup(environment.get_template(template).render(text=text, parts=parts, **contents))


def filled_text(template: str, **contents: object) -> str:
    """Return a template of this package filled in, as plain text."""
    return _environment(html=False).get_template(template).render(**contents)


def _file(name: str) -> str:
    return files("reports.templates").joinpath(name).read_text(encoding="utf-8")


@cache  # it keeps what it has compiled
def _environment(html: bool) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not html,
    )
    environment.globals["explanation"] = lambda term: glossary()[term.lower()]
    environment.globals["entry"] = entry
    return environment
