"""Errors that say what is wrong, where, and what would be right."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches

_MOST_COMBINATIONS = 3  # that an error spells out


class IdentificationError(Exception):
    """Base class of all errors that a user can correct."""


class IdentificationWarning(UserWarning):
    """Base class of warnings about data and results that are computed nevertheless."""


class InvalidInput(IdentificationError):
    """A file, key, name or number that cannot be used."""


class NoEquilibrium(IdentificationError):
    """The springs cannot carry the robot's weight in a position."""


class NotIdentifiable(IdentificationError):
    """The experiments carry no information on some parameters.

    Attributes
    ----------
    names : tuple of str
        Parameters at fault.
    combinations : tuple of str
        What of them is open, as far as more is known than names: "a - 0.5 b" may grow, a by one and
        b by minus a half, and no experiment would tell.
    """

    def __init__(self, names: Sequence[str], remedy: str, combinations: Sequence[str] = ()) -> None:
        self.names = tuple(names)
        self.remedy = remedy
        self.combinations = tuple(combinations)
        more = len(self.combinations) - _MOST_COMBINATIONS
        directions = ", ".join(self.combinations[:_MOST_COMBINATIONS])
        directions += f" and {more} more" if more > 0 else ""
        # Single names would only be said twice.
        opened = f" (open: {directions})" if set(self.combinations) - set(self.names) else ""
        super().__init__(f"not identifiable: {', '.join(self.names)}{opened}; {remedy}")

    def __reduce__(self) -> tuple[type["NotIdentifiable"], tuple[object, ...]]:
        """Return what makes it anew in another process."""
        return type(self), (self.names, self.remedy, self.combinations)


class SolverFailed(IdentificationError):
    """A numerical solver ended without a usable answer."""


@contextmanager
def naming(what: object) -> Iterator[None]:
    """Begin the message of an `InvalidInput` with what it is about, such as a file.

    Raises
    ------
    InvalidInput
        In place of one raised within.
    """
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(f"{what}: {error}") from error


def check_word(what: str, word: object, words: Collection[str], wrong: str = "is unknown") -> None:
    """Refuse a word that is none of `words`, naming `what` it was given for and those there are."""
    if word not in words:
        name, there = str(word)[:60], ", ".join(words) or "none"
        raise InvalidInput(f"{what} {name!r} {wrong}{nearest(name, words)}; there are {there}")


def nearest(word: str, words: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the one of `words` nearest to `word`, or nothing."""
    matches = get_close_matches(word, list(words), n=1, cutoff=0.5)
    return f" (did you mean {matches[0]!r}?)" if matches else ""
