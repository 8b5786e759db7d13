"""Reading of numbers and single children of XML elements, refused in words that name the owner."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import decimal
from robotmodels.description.ranges import MOST_LENGTH
from robotmodels.description.xml_reader import XmlElement


def elements(parent: XmlElement, tag: str) -> list[XmlElement]:
    """Return the children with a tag."""
    return [child for child in parent.findall(tag) if isinstance(child, XmlElement)]


def add_origin(checked: ET.Element, element: ET.Element, who: str) -> None:
    """Add the ``<origin>`` of `element`, its numbers written anew."""
    origin = only_child(element, "origin", who)
    if origin is not None:
        entries = {key: number_text(read_numbers(origin, key, 3, who)) for key in ("xyz", "rpy")}
        ET.SubElement(checked, "origin", entries)


def only_child(element: ET.Element, tag: str, who: str) -> ET.Element | None:
    """Return the child with a tag; parsers take the first of several, silently."""
    children = element.findall(tag)
    if len(children) > 1:
        raise InvalidInput(f"{who} has {len(children)} <{tag}>; one at most")
    return children[0] if children else None


def read_number(
    element: ET.Element, key: str, who: str, default: str = "", most: float = MOST_LENGTH
) -> float:
    """Return the number in attribute `key`; `default` where it is absent."""
    (value,) = read_numbers(element, key, 1, who, default, most)
    return value


def read_numbers(
    element: ET.Element,
    key: str,
    count: int,
    who: str,
    default: str = "0 0 0",
    most: float = MOST_LENGTH,
) -> list[float]:
    """Return the `count` numbers, of size `most` at most, in attribute `key`.

    Raises
    ------
    InvalidInput
        Naming `who` has something else.
    """
    text = element.get(key, default)
    parts = re.split("[ \t\r\n]+", text.strip(" \t\r\n"))
    values = [decimal(part) for part in parts]
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InvalidInput(
            f"{who}: <{element.tag}> has {key}={text!r}; "
            f"{'a number is' if count == 1 else f'{count} numbers are'} needed"
        )
    if max(map(abs, values)) > most:
        raise InvalidInput(
            f"{who}: <{element.tag}> has {key}={text!r}; numbers of at most {most:g} are needed"
        )
    return values


def number_text(numbers: Iterable[float]) -> str:
    """Return numbers as an attribute, at full precision."""
    return " ".join(repr(float(number)) for number in numbers)
