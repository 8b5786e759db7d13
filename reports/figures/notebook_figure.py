"""Figures that notebooks show by themselves, without pyplot."""

import io

from matplotlib.figure import Figure

_DPI = 110


class NotebookFigure(Figure):
    """A matplotlib figure that IPython and Jupyter show where a cell ends with it."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=_DPI)
        return buffer.getvalue()
