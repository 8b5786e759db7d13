"""Errors that say what is wrong, where, and what would be right."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches


class IdentificationError(Exception):
    """Root of every error this package raises for a reason a user can mend."""


class IdentificationWarning(UserWarning):
    """Something in the data that a user should know of, though an answer can be given."""


class InvalidInput(IdentificationError):
    """A file, key, name or number that cannot be used."""


class NoEquilibrium(IdentificationError):
    """The springs cannot carry the robot's weight in a position."""


class NotIdentifiable(IdentificationError):
    """The experiments carry no information on some parameters.

    Attributes
    ----------
    names : parameters at fault.
    """

    def __init__(self, names: Sequence[str], remedy: str) -> None:
        self.names = tuple(names)
        self.remedy = remedy
        super().__init__(f"not identifiable: {', '.join(self.names)}; {remedy}")


class SolverFailed(IdentificationError):
    """A numerical solver ended without a usable answer."""


def nearest(word: str, known: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the known word nearest to `word`, or nothing."""
    matches = get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" (did you mean {matches[0]!r}?)" if matches else ""
