"""Aligned columns and wrapped lines for a terminal, in characters any font has."""

import csv
import io
import re
import textwrap
from collections.abc import Iterable, Sequence
from itertools import zip_longest
from typing import Any

from reports import text

WIDTH = 80
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def decimals(value: float) -> str:
    """Return three decimals, zero without a sign."""
    return f"{value + 0.0:.3f}".replace("-0.000", "0.000")


def number(value: float, digits: int = 3) -> str:
    """Return so many significant digits."""
    return plain(text.significant(value, digits))


def vector(values: Iterable[float], digits: int | None = None) -> str:
    """Return the values in a row, with so many decimals or as they are."""
    if digits is None:
        return ", ".join(f"{v:g}" for v in values)
    return ", ".join(f"{round(v, digits) + 0.0:.{digits}f}" for v in values)


def plural(count: int, noun: str) -> str:
    """Return ``1 motor`` or ``6 motors``."""
    return plain(text.plural(count, noun))


def plain(words: str) -> str:
    """Return what a terminal shows in any font: plain spaces and hyphens, 1.2e-5 for powers."""
    powers = re.sub(
        f"{text.THIN}×{text.THIN}10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)",
        lambda power: "e" + power[1].translate(_DIGITS),
        words,
    )
    return powers.replace(text.THIN, " ").replace(text.MINUS, "-")


def table(header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int]) -> list[str]:
    """Return aligned lines; the columns `right` end flush.

    Two spaces separate columns, or one if a line would not fit a terminal.
    """
    titles = [*zip_longest(*(title.split("\n") for title in header), fillvalue="")]
    for gap in ("  ", " "):
        lines = [*titles, *((gap + row[0], *row[1:]) for row in rows)]
        widths = [max(len(line[c]) for line in lines) for c in range(len(header))]
        shown = [c for c, width in enumerate(widths) if width]
        aligned = [
            gap.join(f"{line[c]:{'>' if c in right else '<'}{widths[c]}}" for c in shown).rstrip()
            for line in lines
        ]
        if max(map(len, aligned)) <= WIDTH:
            break
    return aligned


def wrapped(words: str) -> list[str]:
    """Return `words` wrapped and indented."""
    return hung("  ", words)


def hung(first: str, words: str, indent: int = 4) -> list[str]:
    """Return `words` after `first`, wrapped, further lines indented."""
    return textwrap.wrap(
        words,
        WIDTH,
        initial_indent=first,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def described(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Return names, aligned, with their words beside them, wrapped."""
    width = max(len(name) for name, _ in rows)
    return [line for name, words in rows for line in hung(f"  {name:<{width}}  ", words, width + 4)]


def csv_text(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table as CSV, numbers to nine digits."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerows(
        [header, *([f"{x:.9g}" if isinstance(x, float) else x for x in r] for r in rows)]
    )
    return lines.getvalue()
