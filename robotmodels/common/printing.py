"""Text as terminals, files and notebooks show it."""

import math
import re
from html import escape

# They end or reorder a line, make a terminal obey, or are halves of others.
_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


_DECIMAL = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def decimal(text: str) -> float:
    """Return a number, or NaN for what is none: digits of other scripts and ``1_0`` are none."""
    return float(text) if _DECIMAL.fullmatch(text) else math.nan


def unprintable(text: str) -> str:
    """Return the first character that does not belong into a text, escaped; or nothing."""
    character = _UNPRINTABLE.search(text)
    return _escaped(character) if character else ""


def printable(text: str) -> str:
    r"""Return a text with such characters escaped, as in ``\u001b``, which JSON reads too."""
    return _UNPRINTABLE.sub(_escaped, text)


def _escaped(character: re.Match[str]) -> str:
    return f"\\u{ord(character[0]):04x}"


class ReprHtml:
    """A result that a notebook shows as `print` does."""

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"
