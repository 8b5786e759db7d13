"""Pages and files from templates."""

from importlib.resources import files

import jinja2
from markupsafe import Markup

from reports import text


def filled(template: str, **contents: object) -> str:
    """Return a template of this package filled in, as HTML: one file, its style inside.

    It finds `text`, the formatting functions, and `style`, the style sheet, beside the contents.
    """
    style = files("reports.templates").joinpath("report.css").read_text(encoding="utf-8")
    page = _environment(html=True).get_template(template)
    return page.render(text=text, style=Markup(style), **contents)


def filled_text(template: str, **contents: object) -> str:
    """Return a template of this package filled in, as plain text."""
    return _environment(html=False).get_template(template).render(**contents)


def _environment(html: bool) -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
