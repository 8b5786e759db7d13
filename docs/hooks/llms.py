"""MkDocs hook: ``llms.txt`` lists all pages with their first sentences, for language models."""

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.nav import Navigation

_PROSE = re.compile(r"^[A-Z*`-](?!``)[^\n]*(?:\n[^\n]*\S[^\n]*)*", re.MULTILINE)
_LINK = re.compile(r"\[([^\]]*)\][(\[][^)\]]*[)\]]")

_navigation: list[Navigation] = []


def on_nav(nav: Navigation, **_: Any) -> None:
    """Remember the order of the pages."""
    _navigation[:] = [nav]


def on_post_build(config: MkDocsConfig) -> None:
    """Write the file beside the pages."""
    lines = [f"# {config.site_name}", "", f"> {config.site_description}", ""]
    for item in _navigation[0].items:
        pages = item.children or []
        lines += ["", f"## {item.title}", "", *map(_line, pages)] if pages else [_line(item)]
    Path(config.site_dir, "llms.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _line(page: Any) -> str:
    return f"- [{page.title}]({page.url}index.html): {first_sentence(page.markdown)}"


def first_sentence(markdown: str) -> str:
    """Return the first sentence of a page's prose, without links."""
    prose = _PROSE.search(markdown)
    words = _LINK.sub(r"\1", " ".join(prose[0].split())) if prose else ""
    return re.split(r"(?<=[.?])\s", words.removeprefix("- ").replace("*", ""))[0]
