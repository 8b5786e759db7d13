"""Libraries that only some formats need."""

from importlib import import_module
from typing import Any

from robotmodels.common.errors import InvalidInput
from robotmodels.common.extras import install


def optional_library(module: str, purpose: str) -> Any:
    """Return a module of a library of the extra ``records``.

    Parameters
    ----------
    purpose : str
        What needs it, for the error.

    Raises
    ------
    InvalidInput
        With the command that installs it, where it is missing.
    """
    try:
        return import_module(module)
    except ImportError:
        name = module.partition(".")[0]
        raise InvalidInput(
            f"{purpose}: the library {name} is needed; {install('records')}"
        ) from None
