"""YAML files written, and read against a schema; a mistake is one line with file, line and key."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import AliasChoices, BaseModel, ConfigDict, ValidationError

from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.file_paths import check_file, reason
from robotmodels.common.yaml_reader import Node, YamlError, read_document, reads_as_text

MOST_CHARACTERS = 4_000_000
"""Size of a YAML file [bytes]; longer lists of positions fit into CSV or NumPy's files."""


class _Dumper(yaml.SafeDumper):
    """Quotes also text that only YAML 1.2 takes for a number, such as ``1e5``."""


def _text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    style = None if reads_as_text(text) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _text)


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return YAML with keys in their order and the innermost lists in one line."""
    return yaml.dump(
        content,
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        width=100,
        allow_unicode=True,
    )


class FileSection(BaseModel):
    """A section of a file: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_Section = TypeVar("_Section", bound=FileSection)


def read_yaml(path: Path, schema: type[_Section]) -> _Section:
    """Read the YAML file `path` as a `schema`.

    Raises
    ------
    InvalidInput
        If the file is absent, is not YAML, or does not fit the schema.
    """
    return parse_yaml(read_text(path, MOST_CHARACTERS, needed(schema)), schema, str(path))


def parse_yaml(text: str, schema: type[_Section], source: str) -> _Section:
    """Return YAML as a `schema`; `source` names it in errors.

    Raises
    ------
    InvalidInput
        Naming line and key at fault, the value read and the value needed.
    """
    document = yaml_document(text, source, needed(schema))
    return parse(document, schema, source)


def yaml_document(text: str, source: str, contents: str) -> Node:
    """Return what a YAML file holds; `contents` is what it is to hold.

    Raises
    ------
    InvalidInput
        Naming the line that is not YAML.
    """
    try:
        return read_document(text)
    except YamlError as error:
        wrong = f"{source}:{error.line}: not valid YAML: {error}"
        raise InvalidInput(f"{wrong}; {contents} is needed") from None


def read_text(path: Path, most: int, contents: str) -> str:
    """Return the text of a file.

    Parameters
    ----------
    path : Path
        Path of a file, no device and no pipe.
    most : int, bytes
        Largest size of the file.
    contents : str
        What the file is to hold, for errors.

    Raises
    ------
    InvalidInput
        If there is no such file, or it cannot be read.
    """
    check_file(path, most)
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {reason(error)}") from None
    except UnicodeDecodeError as error:
        wrong = f"{path}: cannot be read: {reason(error)}"
        raise InvalidInput(f"{wrong}; {contents} is needed") from None


def parse(document: Node, schema: type[_Section], source: str) -> _Section:
    """Return what a YAML file holds as a `schema`; `source` names it in errors.

    Raises
    ------
    InvalidInput
        Naming line and key at fault, the value read and the value needed.
    """
    content = document.content
    if isinstance(content, str) and content.startswith("<"):
        raise InvalidInput(
            f"{source}: this is XML, such as a URDF, of which `oed init` makes a robot file and a "
            f"study; {needed(schema)} is needed here"
        )
    if not isinstance(content, dict):
        kind = "nothing" if content is None else type(content).__name__
        raise InvalidInput(f"{source}: a mapping of keys to values is needed, found {kind}")
    if other := misplaced(content, schema):
        raise InvalidInput(f"{source}: {other}")
    try:
        # Strictly, where no text is a number and 1 is not true; as JSON, whose lists are tuples.
        return schema.model_validate_json(json.dumps(content), strict=True)
    except ValidationError as error:
        details = error.errors(include_url=False)
        # An unknown key usually explains a missing one (a typing error): say it first.
        first = min(_meant(details), key=lambda e: e["type"] != "extra_forbidden")
        line = document.line_of(first["loc"])
        where = source if line is None else f"{source}:{line}"
        raise InvalidInput(f"{where}: {_one_line(first, schema, content)}") from None


def _meant(details: list[Any]) -> list[Any]:
    """Drop errors about a number where the file has a mapping that the schema allows."""
    mappings = {e["loc"][:-1] for e in details if isinstance(e["input"], dict) and _branch(e)}
    unambiguous = [e for e in details if not (_branch(e) and e["loc"][:-1] in mappings)]
    # Likewise what is said about a mapping where a number was given.
    numbers = {e["loc"][:-1] for e in unambiguous if _branch(e)}
    return [e for e in unambiguous if _branch(e) or e["loc"][:-1] not in numbers] or details


def _branch(error: Any) -> bool:
    """Whether an error is about the number of "a number or a mapping"."""
    return error["loc"][-1:] in (("float",), ("constrained-float",))


def _one_line(error: Any, schema: type[BaseModel], content: dict[str, Any]) -> str:
    key = _dotted(error["loc"])
    value, kind = error["input"], error["type"]
    if kind == "extra_forbidden":
        keys = _schema_keys(schema, error["loc"][:-1])
        if twin := _twin(schema, key):
            return f"the keys {key!r} and {twin!r} mean the same; one of them is needed"
        right = nearest(str(error["loc"][-1]), keys) or f"; known are {', '.join(keys)}"
        return f"unknown key {key!r}{_owner(error, content)}{right}"
    if kind == "missing" and isinstance(error["loc"][-1], int):
        return f"{_dotted(error['loc'][:-1])}: too few numbers, found {list(value)}"
    if kind == "missing":
        return f"missing key {key!r}{_owner(error, content)}"
    if kind == "value_error":
        message = error["msg"].removeprefix("Value error, ")
        return f"{key}: {message}" if key else str(message)
    if kind in _PLAIN:
        message = _PLAIN[kind].format(**error.get("ctx", {}))
    else:
        message = error["msg"][0].lower() + error["msg"][1:]
    return f"{key}{_owner(error, content)}: {message}, found {_brief(value)}"


# Python's words for what a YAML file holds, put plainly.
_PLAIN = {
    "too_short": "at least {min_length} is needed",
    "too_long": "at most {max_length} are allowed",
    "tuple_type": "a list is needed",
    "list_type": "a list is needed",
    "dict_type": "a mapping of keys to values is needed",
    "model_type": "a mapping of keys to values is needed",
    "float_type": "a number is needed",
    "int_type": "a whole number is needed",
    "bool_type": "true or false is needed",
    "string_type": "text is needed",
    "finite_number": "a finite number is needed",
    "greater_than": "a number greater than {gt:g} is needed",
    "greater_than_equal": "a number of at least {ge:g} is needed",
    "less_than": "a number less than {lt:g} is needed",
    "less_than_equal": "a number of at most {le:g} is needed",
}


def _brief(value: object) -> str:
    text = repr(list(value) if isinstance(value, tuple) else value)
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
_TYPES = ("literal[", "float", "constrained-float", "list[", "tuple[", "function-")


def _schema_keys(schema: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
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


def _twin(schema: type[BaseModel], key: str) -> str:
    """Return the other name of a key of a file; nothing where it has none."""
    for field in schema.model_fields.values():
        names = field.validation_alias
        if isinstance(names, AliasChoices) and key in names.choices:
            return next(str(name) for name in names.choices if name != key)
    return ""


def _model_of(annotation: Any) -> type[BaseModel] | None:
    """Return the section class inside an annotation such as ``list[Spring]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (_model_of(a) for a in getattr(annotation, "__args__", ()))
    return next((m for m in inner if m is not None), None)


_KINDS = {
    "robot": ("a robot file", "oed check"),
    "study": ("a study", "oed run"),
    "experiment": ("an experiment", "oed simulate"),
    "import": ("a mapping of a log", "oed import"),
    "controller": ("a controller", "oed margins"),
}


def needed(schema: type[BaseModel]) -> str:
    """Return ``a study (YAML, schema: study/1)`` for what `schema` reads; "YAML" for a section."""
    name = _schema_name(schema)
    return f"{_name(name)} (YAML, schema: {name})" if name else "YAML"


def misplaced(content: dict[str, Any], schema: type[BaseModel]) -> str:
    """Return what a file is if it is of another kind than `schema`, and who takes it; or nothing.

    Parameters
    ----------
    content : dict of str to Any
        Content of the file.
    """
    expected, actual = _schema_name(schema), content.get("schema")
    if not expected or not isinstance(actual, str) or _kind(actual) == _kind(expected):
        return ""
    if _kind(actual) not in _KINDS:
        return ""
    command = _KINDS[_kind(actual)][1]
    return (
        f"this is {_name(actual)} (schema: {actual}), which `{command}` takes; "
        f"{needed(schema)} is needed here"
    )


def _schema_name(schema: type[BaseModel]) -> str:
    """Return the ``schema`` that a file must state, nothing for a section of a file."""
    field = schema.model_fields.get("schema_")
    return str(get_args(field.annotation)[0]) if field else ""


def _kind(schema: str) -> str:
    return schema.partition("/")[0]


def _name(schema: str) -> str:
    return _KINDS.get(_kind(schema), (f"a {_kind(schema)}", ""))[0]
