"""Labels of axes in plain numbers."""

from collections.abc import Callable, Sequence

from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

Words = Callable[[float], str]


def plain_ticks(axis: Axis, words: Words = "{:g}".format) -> None:
    """Label an axis with plain numbers, nothing in between."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: words(value)))
    axis.set_minor_formatter(NullFormatter())


def plain_logarithm(
    axis: Axis, words: Words = "{:g}".format, subs: Sequence[float] = (1.0, 2.0, 5.0)
) -> None:
    """Label a logarithmic axis with plain numbers, at `subs` of each decade."""
    axis.set_major_locator(LogLocator(subs=subs))
    plain_ticks(axis, words)
