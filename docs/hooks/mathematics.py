"""MkDocs hook: formulas become MathML, which browsers set by themselves, without any script."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Set every formula that pymdownx.arithmatex has marked."""
    return _FORMULA.sub(_set, content)


def _set(formula: re.Match[str]) -> str:
    block = formula[1] == "div"
    mathml = convert(html.unescape(formula[2]).strip(), display="block" if block else "inline")
    return f'<div class="formula">{mathml}</div>' if block else mathml
