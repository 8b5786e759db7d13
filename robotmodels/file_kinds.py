"""The kinds of YAML file, told by their ``schema`` key, and the command that takes each."""

from typing import Any, get_args

from pydantic import BaseModel

_KINDS = {
    "robot": ("a robot file", "oed check"),
    "study": ("a study", "oed run"),
    "experiment": ("an experiment", "oed simulate"),
}


def needed(schema: type[BaseModel]) -> str:
    """Return ``a study (YAML, schema: study/1)`` for what `schema` reads; "YAML" for a section."""
    wanted = _wanted(schema)
    return f"{_name(wanted)} (YAML, schema: {wanted})" if wanted else "YAML"


def misplaced(content: dict[str, Any], schema: type[BaseModel]) -> str:
    """Return what a file is if it is of another kind than `schema`, and who takes it; or nothing.

    Parameters
    ----------
    content : dict of str to Any
        Content of the file.
    """
    wanted, found = _wanted(schema), content.get("schema")
    if not wanted or not isinstance(found, str) or _kind(found) == _kind(wanted):
        return ""
    if _kind(found) not in _KINDS:
        return ""
    command = _KINDS[_kind(found)][1]
    return (
        f"this is {_name(found)} (schema: {found}), which `{command}` takes; "
        f"{needed(schema)} is needed here"
    )


def _wanted(schema: type[BaseModel]) -> str:
    """Return the ``schema`` that a file must state, nothing for a section of a file."""
    field = schema.model_fields.get("schema_")
    return str(get_args(field.annotation)[0]) if field else ""


def _kind(schema: str) -> str:
    return schema.partition("/")[0]


def _name(schema: str) -> str:
    return _KINDS.get(_kind(schema), (f"a {_kind(schema)}", ""))[0]
