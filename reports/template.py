"""Pages from templates: one file, its style inside."""

from importlib.resources import files

import jinja2
from markupsafe import Markup

from reports import text


def filled(template: str, **contents: object) -> str:
    """Return a template of this package filled in, as HTML.

    It finds `text`, the formatting functions, and `style`, the style sheet, beside the contents.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = files("reports.templates").joinpath("report.css").read_text(encoding="utf-8")
    return environment.get_template(template).render(text=text, style=Markup(style), **contents)
