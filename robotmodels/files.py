"""YAML files read against a schema; every mistake becomes one line that names file and key."""

import errno
import os
import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from robotmodels.errors import InvalidInput, nearest
from robotmodels.file_kinds import misplaced, needed


class Strict(BaseModel):
    """A section of a file: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _truth_is_no_number(cls, value: object, info: ValidationInfo) -> object:
        annotation = cls.model_fields[str(info.field_name)].annotation
        known = _allows(annotation, bool) or (_model_of(annotation) and not isinstance(value, bool))
        if _has_truth(value) and not known:
            raise PydanticCustomError("truth", "a number is needed")
        return value


_Section = TypeVar("_Section", bound=Strict)


class _UniqueKeys(yaml.SafeLoader):
    """YAML in which a key given twice is an error instead of a silent override."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"key {key!r} is given twice", problem_mark=key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path, schema: type[_Section]) -> _Section:
    """Read the YAML file `path` as a `schema`.

    Raises
    ------
    InvalidInput : if the file is absent, is not YAML, or does not fit the schema.
    """
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_UniqueKeys)
    except FileNotFoundError:
        raise InvalidInput(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        wanted = f"; {needed(schema)} is needed" if isinstance(error, UnicodeDecodeError) else ""
        raise InvalidInput(f"{path}: cannot be read: {reason(error)}{wanted}") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}: " if mark else ""
        wrong = f"{line}not valid YAML: {error.problem}"
        raise InvalidInput(f"{path}: {wrong}; {needed(schema)} is needed") from None
    except yaml.YAMLError as error:
        wrong = f"not valid YAML: {' '.join(str(error).split())}"
        raise InvalidInput(f"{path}: {wrong}; {needed(schema)} is needed") from None
    return parse(content, schema, str(path))


def reason(error: Exception) -> str:
    """Return in a few words why a file cannot be read or written."""
    if isinstance(error, IsADirectoryError):
        return "it is a folder, a file is needed"
    if isinstance(error, UnicodeDecodeError):
        return "it is not UTF-8 text"
    words = getattr(error, "strerror", None) or str(error)
    inside = re.search(r"error message = '([^']+)'", words)  # of HDF5, amid its own variables
    return " ".join((inside[1] if inside else words).split())


def disk_full(error: BaseException | None) -> bool:
    """Whether an error, or one that led to it, says that a disk or a quota is full."""
    while error is not None:
        full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
        if full or os.strerror(errno.ENOSPC) in str(error):  # HDF5 tells in words only
            return True
        error = error.__cause__ or error.__context__
    return False


def parse(content: object, schema: type[_Section], source: str) -> _Section:
    """Return `content` as a `schema`; `source` names it in errors.

    Raises
    ------
    InvalidInput : naming the key at fault, what was found and what would be right.
    """
    if isinstance(content, str) and content.startswith("<"):
        raise InvalidInput(
            f"{source}: this is XML, such as a URDF, of which `oed init` makes a robot file and a "
            f"study; {needed(schema)} is needed here"
        )
    if not isinstance(content, dict):
        found = "nothing" if content is None else type(content).__name__
        raise InvalidInput(f"{source}: a mapping of keys to values is needed, found {found}")
    if other := misplaced(content, schema):
        raise InvalidInput(f"{source}: {other}")
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        details = error.errors(include_url=False)
        # An unknown key usually explains a missing one (a typing error): say it first.
        first = min(_meant(details), key=lambda e: e["type"] != "extra_forbidden")
        raise InvalidInput(f"{source}: {_one_line(first, schema, content)}") from None


def _meant(details: list[Any]) -> list[Any]:
    """Drop what is said about "a number" where a mapping was given instead, as it may be."""
    mappings = {e["loc"][:-1] for e in details if isinstance(e["input"], dict) and _branch(e)}
    kept = [e for e in details if not (_branch(e) and e["loc"][:-1] in mappings)]
    # Likewise what is said about a mapping where a number was given.
    numbers = {e["loc"][:-1] for e in kept if _branch(e)}
    return [e for e in kept if _branch(e) or e["loc"][:-1] not in numbers] or details


def _branch(error: Any) -> bool:
    """Whether an error is about the number of "a number or a mapping"."""
    return error["loc"][-1:] in (("float",), ("constrained-float",))


def _one_line(error: Any, schema: type[BaseModel], content: dict[str, Any]) -> str:
    key = _dotted(error["loc"])
    found, kind = error["input"], error["type"]
    if kind == "extra_forbidden":
        known = _known_keys(schema, error["loc"][:-1])
        right = nearest(str(error["loc"][-1]), known) or f"; known are {', '.join(known)}"
        return f"unknown key {key!r}{_owner(error, content)}{right}"
    if kind == "missing" and isinstance(error["loc"][-1], int):
        return f"{_dotted(error['loc'][:-1])}: too few numbers, found {list(found)}"
    if kind == "missing":
        return f"missing key {key!r}{_owner(error, content)}"
    if kind == "value_error":
        message = error["msg"].removeprefix("Value error, ")
        return f"{key}: {message}" if key else str(message)
    if kind in _PLAIN:
        message = _PLAIN[kind].format(**error.get("ctx", {}))
    else:
        message = error["msg"][0].lower() + error["msg"][1:]
    return f"{key}{_owner(error, content)}: {message}, found {_brief(found)}"


# Python's words for what a YAML file holds, put plainly.
_PLAIN = {
    "too_short": "at least {min_length} is needed",
    "too_long": "at most {max_length} are allowed",
    "tuple_type": "a list is needed",
    "list_type": "a list is needed",
    "dict_type": "a mapping of keys to values is needed",
    "model_type": "a mapping of keys to values is needed",
    "float_type": "a number is needed",
    "float_parsing": "a number is needed",
    "int_type": "a whole number is needed",
    "int_parsing": "a whole number is needed",
    "int_from_float": "a whole number is needed",
    "string_type": "text is needed",
    "finite_number": "a finite number is needed",
    "greater_than": "a number greater than {gt:g} is needed",
    "greater_than_equal": "a number of at least {ge:g} is needed",
    "less_than": "a number less than {lt:g} is needed",
    "less_than_equal": "a number of at most {le:g} is needed",
}


def _brief(found: object) -> str:
    text = repr(list(found) if isinstance(found, tuple) else found)
    text = re.sub(r"\b(True|False)\b", lambda word: word[0].lower(), text)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _owner(error: Any, content: Any) -> str:
    """Return `` of 'g1'`` for the innermost item with a name around the key at fault."""
    owner = ""
    for part in error["loc"][:-1]:
        try:
            content = content[part]
        except (KeyError, IndexError, TypeError):
            break
        if isinstance(part, int) and isinstance(content, dict) and "name" in content:
            owner = f" of {content['name']!r}"
    return owner


def _dotted(location: tuple[str | int, ...]) -> str:
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif not part[:1].isupper() and not part.startswith(_TYPES):
            text += f".{part}" if text else part
    return text


# What pydantic adds to the place of an error to tell the members of a union apart.
_TYPES = ("float", "constrained-float", "list[", "tuple[")


def _known_keys(schema: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Return the keys that `schema` knows at `location`."""
    current: Any = schema
    for part in location:
        if isinstance(part, str) and isinstance(current, type) and issubclass(current, BaseModel):
            field = next(
                (f for name, f in current.model_fields.items() if part in (name, f.alias)), None
            )
            if field is not None:
                current = _model_of(field.annotation) or current
    return [f.alias or name for name, f in current.model_fields.items()]


def _has_truth(value: object) -> bool:
    """Whether a value of a YAML file is true or false, or a list or mapping with one in it."""
    if isinstance(value, dict):
        value = list(value.values())
    return isinstance(value, bool) or (isinstance(value, list) and any(map(_has_truth, value)))


def _allows(annotation: Any, kind: type) -> bool:
    """Whether an annotation such as ``list[float] | bool`` names a type."""
    return annotation is kind or any(_allows(a, kind) for a in getattr(annotation, "__args__", ()))


def _model_of(annotation: Any) -> type[BaseModel] | None:
    """Return the section class inside an annotation such as ``list[Spring]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (_model_of(a) for a in getattr(annotation, "__args__", ()))
    return next((m for m in inner if m is not None), None)
