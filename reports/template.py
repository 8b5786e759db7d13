"""Pages and files from templates."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from importlib.resources import files

import jinja2
from markupsafe import Markup

from reports import text
from reports.drawing.svg import LIGHT
from reports.parts import Section


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
            script=Markup(_file("report.js") + _file("robots.js")),
            light=Markup(json.dumps(asdict(LIGHT))),
        )
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
    return jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not html,
    )
