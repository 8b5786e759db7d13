"""Figures of docs/reliability.md, each kind between markers of its own."""

from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
PAGE = REPOSITORY / "docs" / "reliability.md"


def write_figures(name: str, lines: Sequence[str], page: Path = PAGE) -> None:
    """Put `lines` where the page has the figures called `name`.

    Raises
    ------
    ValueError : if the page has no place for them.
    """
    begin, end = f"<!-- figures: {name} -->\n", "<!-- end -->\n"
    before, marker, after = page.read_text(encoding="utf-8").partition(begin)
    _, stop, after = after.partition(end)
    if not (marker and stop):
        raise ValueError(f"{page}: no place for the figures {name!r}")
    text = "".join((before, begin, *(f"{line}\n" for line in lines), end, after))
    page.write_text(text, encoding="utf-8")


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return [
        "| " + " | ".join(str(cell) for cell in row) + " |"
        for row in (header, ["---"] * len(header), *rows)
    ]
