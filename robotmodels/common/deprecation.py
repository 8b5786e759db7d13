"""Old names of keywords, functions and classes, which work with a warning for a while."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")


def renamed_keywords(since: str, **renamed: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take keywords by their old names.

    Parameters
    ----------
    since : str
        Version that renamed them, such as "0.2"; the next one drops the old names.
    **renamed : str
        New name of each old keyword.

    Returns
    -------
    callable
        Decorator; a call with an old keyword warns, with old and new one it raises TypeError.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        name = function.__qualname__.removesuffix(".__init__")

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            for old in renamed.keys() & kwargs.keys():
                new = renamed[old]
                if new in kwargs:
                    raise TypeError(f"{name}: {old!r} is the old name of {new!r}")
                _warn(f"{name}: keyword {old!r}", new, since)
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call

    return decorate


def renamed_attributes(since: str, **renamed: str) -> Callable[[type[T]], type[T]]:
    """Let a dataclass take and show fields by their old names.

    Parameters
    ----------
    since : str
        Version that renamed them.
    **renamed : str
        New name of each old field or property.
    """

    def decorate(cls: type[T]) -> type[T]:
        start = renamed_keywords(since, **renamed)(cls.__init__)
        setattr(cls, "__init__", start)  # noqa: B010 (mypy takes no assignment to a method)
        for old, new in renamed.items():
            setattr(cls, old, property(_reader(f"{cls.__name__}.{old}", new, since)))
        return cls

    return decorate


def _reader(old: str, new: str, since: str) -> Callable[[object], Any]:
    def read(self: object) -> Any:
        _warn(old, new, since)
        return getattr(self, new)

    return read


def renamed_names(
    module: str, load: Callable[[str], Any], since: str, **renamed: str
) -> Callable[[str], Any]:
    """Return a module's `__getattr__` that knows old names too.

    Parameters
    ----------
    module : str
        Name of the module.
    load : callable
        Its `__getattr__` for the new names, such as lazy_loader's.
    since : str
        Version that renamed them.
    **renamed : str
        New name of each old one.
    """

    def get(name: str) -> Any:
        if name not in renamed:
            return load(name)
        _warn(f"{module}.{name}", f"{module}.{renamed[name]}", since)
        return load(renamed[name])

    return get


def current_key(key: str, where: str, since: str, **renamed: str) -> str:
    """Return the present name of a key or column of a file, with a warning for an old one.

    Parameters
    ----------
    key : str
        As the file has it.
    where : str
        File, and what in it has the key.
    since : str
        Version that renamed it.
    **renamed : str
        New name of each old key.
    """
    if key not in renamed:
        return key
    _warn(f"{where}: {key!r}", renamed[key], since)
    return renamed[key]


def _warn(old: str, new: str, since: str) -> None:
    major, minor = map(int, since.split("."))
    message = f"{old} is now {new!r}; the old name works until {major}.{minor + 1}"
    warnings.warn(message, DeprecationWarning, stacklevel=3)
