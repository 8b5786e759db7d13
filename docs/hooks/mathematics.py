r"""MkDocs hook: formulas become MathML, which browsers set by themselves, without any script.

Pages have LaTeX, ``\(...\)``. Docstrings have plain formulas that are read as they stand,
``$P = H^-1 J H^-1$``; `latex` makes LaTeX of them.
"""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_GREEK = "alpha beta gamma delta epsilon eta theta kappa lambda mu pi rho sigma tau phi psi omega"
_SYMBOLS = {
    **{name: rf"\{name} " for name in _GREEK.split()},
    **{name.capitalize(): rf"\{name.capitalize()} " for name in ("lambda", "phi", "psi", "omega")},
    **{name: rf"\{name} " for name in ("sum", "log", "ln", "det", "max", "min", "exp", "ldots")},
    **{name: rf"\operatorname{{{name}}}" for name in ("tr", "Re", "var", "diag", "vec")},
}
_TOKEN = re.compile(
    r"(?P<over>sqrt|conj)\((?P<under>[^()]*)\)|(?P<mark>[_^])(?:\((?P<group>[^()]*)\)|(?P<one>-?\w+|\*))"
    r"|(?P<word>[A-Za-z]+)|(?P<relation><=|>=)"
)


def on_page_content(content: str, **_: Any) -> str:
    """Set every formula that pymdownx.arithmatex has marked."""
    return _FORMULA.sub(_set, content)


def _set(formula: re.Match[str]) -> str:
    block, text = formula[1] == "div", html.unescape(formula[2]).strip()
    mathml = convert(text if "\\" in text else latex(text), display="block" if block else "inline")
    return f'<div class="formula">{mathml}</div>' if block else mathml


def latex(plain: str) -> str:
    """Return LaTeX of a plain formula: its indices, powers, roots, Greek letters and functions."""
    return _TOKEN.sub(_token, plain)


def _token(token: re.Match[str]) -> str:
    if token["over"]:
        over = {"sqrt": r"\sqrt", "conj": r"\overline"}[token["over"]]
        return f"{over}{{{latex(token['under'])}}}"
    if token["relation"]:
        return {"<=": r"\le ", ">=": r"\ge "}[token["relation"]]
    if token["mark"]:
        inside = token["group"] or token["one"]
        index = inside if inside.isalpha() and inside not in _SYMBOLS else latex(inside)
        return f"{token['mark']}{{{index}}}"
    word = token["word"]
    return _SYMBOLS.get(word, word if len(word) < 3 else rf"\mathrm{{{word}}}")
