"""Probabilities that intervals and tests are asked for."""

from robotmodels.errors import InvalidInput

IMPROBABLE = 1e-3
"""Chance explains costs, residuals or misses with less than this probability no more."""


def check_level(level: float, where: str) -> None:
    """Refuse a level that is no probability.

    Raises
    ------
    InvalidInput
        Naming `where` it was given.
    """
    if not 0 < level < 1:
        raise InvalidInput(f"{where}: level {level} does not lie between 0 and 1")
