"""Options of ``oed init`` for model files: xacro's arguments and packages, joints that are held."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from robotmodels.checks.sub_chain import SubChain
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import decimal


@dataclass(frozen=True)
class ModelOptions:
    """How a model file is read, and which part of it moves.

    Attributes
    ----------
    arguments : tuple of (str, str)
        Names and values of xacro arguments.
    packages : tuple of Path
        Folders in which packages are sought.
    chain : SubChain
        Which joints are held.
    """

    arguments: tuple[tuple[str, str], ...] = ()
    packages: tuple[Path, ...] = ()
    chain: SubChain = field(default_factory=SubChain)


def model_options(
    arguments: Sequence[str] | None = None,
    packages: Sequence[Path] | None = None,
    lock: Sequence[str] | None = None,
    base: str | None = None,
    tip: str | None = None,
) -> ModelOptions:
    """Return options from words such as ``prefix=left_`` and ``wrist=0.5``.

    Raises
    ------
    InvalidInput
        If a word is of another form.
    """
    pairs = []
    for word in arguments or ():
        pair = re.fullmatch(r"(?s)([^=:]+):?=(.*)", word)
        if not pair:
            raise InvalidInput(f"--argument: {word!r} is not of the form NAME=VALUE")
        pairs.append((pair[1], pair[2]))
    locked: dict[str, float | None] = {}
    for word in lock or ():
        name, separator, value = word.partition("=")
        locked[name] = decimal(value) if separator else None
        if separator and not math.isfinite(decimal(value)):
            raise InvalidInput(
                f"--lock: {word!r}: {value!r} is no number; an angle [rad] or a distance [m] is "
                "needed"
            )
    return ModelOptions(tuple(pairs), tuple(packages or ()), SubChain(base, tip, locked))
