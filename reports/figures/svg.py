"""Matplotlib figures as small inline SVGs that take the page's colours and typeface."""

import base64
import io
import re
import warnings
from collections import Counter
from dataclasses import fields
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from markupsafe import Markup

from reports.figures.palette import LIGHT, Drawing, Palette

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STAND_IN = Palette(*(f"#01020{i}" for i in range(3, 8)))
"""Colours that matplotlib draws with and the page replaces by light or dark ones."""

_OFTEN = 4
"""Times that a style occurs from which a class is shorter."""

LARGEST_SVG = 300_000
"""Bytes above which a figure is embedded as a picture of points instead."""


def inline(draw: Drawing, name: str, alt: str) -> Markup:
    """Return a figure as inline SVG, or as PNG where the SVG would be large.

    Parameters
    ----------
    draw : callable
        Draws the figure in the colours of a palette.
    name : str
        Prefixes every identifier inside, so that figures can share a page.
    alt : str
        Says what is to be seen.
    """
    with warnings.catch_warnings(), mpl.rc_context(_style(STAND_IN)):
        # Of a name in another script: the page has fonts for it, matplotlib only measures.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        # Of names longer than the figure, which is drawn without that layout.
        warnings.filterwarnings("ignore", "constrained_layout not applied")
        buffer = io.StringIO()
        figure = draw(STAND_IN)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        svg = _compact(buffer.getvalue(), name, alt)
        if len(svg.encode()) > LARGEST_SVG:
            return _picture(draw, alt)
    for field in fields(Palette):
        svg = svg.replace(getattr(STAND_IN, field.name), f"var(--{field.name})")
    return Markup(svg)


def in_light(draw: Drawing) -> "Figure":
    """Return a figure in the page's light colours, for notebooks and papers."""
    with mpl.rc_context(_style(LIGHT)):
        return draw(LIGHT)


def _picture(draw: Drawing, alt: str) -> Markup:
    """Return a figure as PNG on a light card, readable on a dark page too."""
    with mpl.rc_context(_style(LIGHT)):
        buffer = io.BytesIO()
        draw(LIGHT).savefig(
            buffer, format="png", dpi=150, facecolor="white", metadata={"Software": None}
        )
    data = base64.b64encode(buffer.getvalue()).decode()
    return Markup(f'<img class="card" alt="{escape(alt)}" src="data:image/png;base64,{data}">')


def _style(palette: Palette) -> Any:
    style: dict[str, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": "oed",
        "text.parse_math": False,
        "axes.formatter.use_mathtext": False,
        "font.size": 9,
        "legend.fontsize": 8.5,
        "legend.frameon": False,
        "axes.titlesize": 9,
        "axes.labelsize": 9,
        "axes.linewidth": 0.6,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlecolor": palette.ink,
        "axes.edgecolor": palette.muted,
        "axes.labelcolor": palette.muted,
        "text.color": palette.ink,
        "grid.color": palette.rule,
        "grid.linewidth": 0.5,
    }
    for axis in ("xtick", "ytick"):
        style |= {f"{axis}.color": palette.muted, f"{axis}.labelsize": 8}
        style |= {f"{axis}.major.width": 0.6, f"{axis}.major.size": 3}
        style |= {f"{axis}.minor.width": 0.4, f"{axis}.minor.size": 1.6}
    return style | dict.fromkeys(
        ("figure.facecolor", "axes.facecolor", "savefig.facecolor"), "none"
    )


def _compact(svg: str, name: str, alt: str) -> str:
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", svg, flags=re.S)
    svg = re.sub(
        r"<defs>\s*<style[^>]*>\*.*?</style>\s*</defs>", "", svg, flags=re.S
    )  # of all the page
    svg = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", svg)
    svg = re.sub(r" ?font-family: [^;\"]*;?", "", svg)  # the page's
    svg = re.sub(r' transform="rotate\(-?0 [^"]*\)"', "", svg)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)
    svg = re.sub(r'xlink:href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    # Names that matplotlib gives and nothing refers to; the figure's own may begin alike.
    unused = "figure|axes|patch|line2d|text|x?y?tick|matplotlib|FillBetween|LineColl|PathColl"
    svg = re.sub(rf' id="{re.escape(name)}-(?:{unused})[^"]*"', "", svg)
    svg = re.sub(r'( d="|points=")([^"]*)"', lambda m: f'{m[1]}{_short_path(m[2])}"', svg)
    svg = re.sub(r'\b(x|y|x1|x2|y1|y2)="(-?\d+\.\d+)"', _round_attribute, svg)
    svg = re.sub(r"\s*\n\s*", "\n", svg)
    svg, rules = _shared_styles(svg, name)
    width, height = re.findall(r'(?:width|height)="([\d.]+)pt"', svg)[:2]
    head = (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(alt)}" '
        'stroke-linejoin="round" '
        f'style="--width: {float(width):.0f}; max-width: {float(width) * 4 / 3:.0f}px">'
    )
    return head + rules + svg[svg.index(">") + 1 :]


def _shared_styles(svg: str, name: str) -> tuple[str, str]:
    """Give styles that occur often a class; return the drawing and its style sheet."""
    counts = Counter(re.findall(r' style="([^"]+)"', svg))
    rules = []
    for number, (style, count) in enumerate(counts.most_common()):
        if count < _OFTEN:
            break
        svg = svg.replace(f' style="{style}"', f' class="{name}-{number}"')
        rules.append(f".{name}-{number}{{{style.replace(': ', ':').replace('; ', ';')}}}")
    return svg, f"<style>{''.join(rules)}</style>" if rules else ""


def _short_path(d: str) -> str:
    """Return path data with one decimal; straight runs as steps from point to point."""
    out: list[str] = []
    x, y, last = 0, 0, ""
    for command, arguments in re.findall(r"([MLCQz])([^MLCQz]*)", d):
        numbers = [round(10 * float(a)) for a in arguments.split()]
        straight = command == "L"
        shown = [numbers[0] - x, numbers[1] - y] if straight else numbers
        if not (straight and last == "L"):
            out.append("l" if straight else command)
        for number in shown:
            word = _tenth(number)
            # A minus or a second point parts numbers as well as a space does.
            glued = word[0] == "-" or (word[0] == "." and "." in out[-1])
            out.append(word if glued or out[-1].isalpha() else f" {word}")
        if len(numbers) >= 2:
            x, y = numbers[-2:]
        last = command
        # After z the next command is M in matplotlib's output, so the point needs no reset.
    return "".join(out)


@cache
def _tenth(number: int) -> str:
    """Return a number of tenths as short as SVG allows, without a leading zero."""
    return re.sub(r"^(-?)0\.", r"\1.", f"{number / 10:g}")


def _round_attribute(match: re.Match[str]) -> str:
    return f'{match[1]}="{float(match[2]):.2f}"'
