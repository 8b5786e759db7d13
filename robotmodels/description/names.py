"""Names in files: what motors, springs and other parts may be called."""

from typing import Annotated

from pydantic import AfterValidator

_RESERVED = ("payload", "universe")  # the latter is Pinocchio's word for the ground


def _plain_name(name: str) -> str:
    formula = name.startswith(("=", "+", "-", "@"))  # to a spreadsheet
    if not name.strip() or formula or "." in name or "\n" in name or name in _RESERVED:
        # A parameter is called by a name, a point and an entry.
        raise ValueError(
            f"{name!r} cannot be a name: one line that has no point and begins with none of "
            f"= + - @ is needed, other than {' and '.join(map(repr, _RESERVED))}"
        )
    return name


Name = Annotated[str, AfterValidator(_plain_name)]
