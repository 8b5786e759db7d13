"""YAML files read against a schema; every mistake becomes one line that names file and key."""

from collections.abc import Hashable
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from robotmodels.errors import InvalidInput, nearest


class Strict(BaseModel):
    """A section of a file: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


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
        raise InvalidInput(f"{path}: cannot be read ({error})") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}: " if mark else ""
        raise InvalidInput(f"{path}: {line}not valid YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise InvalidInput(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    return parse(content, schema, str(path))


def parse(content: object, schema: type[_Section], source: str) -> _Section:
    """Return `content` as a `schema`; `source` names it in errors.

    Raises
    ------
    InvalidInput : naming the key at fault, what was found and what would be right.
    """
    if not isinstance(content, dict):
        found = "nothing" if content is None else type(content).__name__
        raise InvalidInput(f"{source}: a mapping of keys to values is needed, found {found}")
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        details = error.errors(include_url=False)
        # An unknown key usually explains a missing one (a typing error): say it first.
        first = min(details, key=lambda e: e["type"] != "extra_forbidden")
        raise InvalidInput(f"{source}: {_one_line(first, schema)}") from None


def _one_line(error: Any, schema: type[BaseModel]) -> str:
    key = _dotted(error["loc"])
    if error["type"] == "extra_forbidden":
        known = _known_keys(schema, error["loc"][:-1])
        return f"unknown key {key!r}{nearest(str(error['loc'][-1]), known)}"
    if error["type"] == "missing":
        return f"missing key {key!r}"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "value_error" or isinstance(error["input"], dict | list):
        return f"{key}: {message}" if key else message
    return f"{key}: {message[0].lower()}{message[1:]}, found {error['input']!r}"


def _dotted(location: tuple[str | int, ...]) -> str:
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif not part[:1].isupper() and not part.startswith(("float", "list[", "tuple[")):
            text += f".{part}" if text else part
    return text


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


def _model_of(annotation: Any) -> type[BaseModel] | None:
    """Return the section class inside an annotation such as ``list[Spring]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (_model_of(a) for a in getattr(annotation, "__args__", ()))
    return next((m for m in inner if m is not None), None)
