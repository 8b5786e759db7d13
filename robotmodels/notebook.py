"""How results look in a notebook: as they print."""

from html import escape


class Printed:
    """A result that a notebook shows as `print` does."""

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"
