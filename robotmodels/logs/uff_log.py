"""Universal files, dataset 58: time histories, and functions over frequency, as tables."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.universal_file import read_functions
from robotmodels.logs.log import Channel, Log, Table, array_channel, unique_names

_FREQUENCY = 18


def read_uff_log(path: Path, stack: ExitStack) -> Log:
    """Read the functions of a universal file; those with one abscissa make a table.

    Raises
    ------
    InvalidInput
        If there is no function in it.
    """
    functions, _ = read_functions(path)
    if not functions:
        raise InvalidInput(f"{path}: no function (dataset 58) in it")
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for function in functions:
        x = function["x"]
        kind = function["abscissa_spec_data_type"]
        groups.setdefault((kind, len(x), float(x[0]), float(x[-1])), []).append(function)
    tables = []
    for number, ((kind, *_), members) in enumerate(groups.items()):
        name = f"functions_{number + 1}" if len(groups) > 1 else ""
        tables.append(_table(name, members, kind == _FREQUENCY))
    return Log((path,), tuple(tables))


def _table(name: str, members: list[dict[str, Any]], spectral: bool) -> Table:
    abscissa, otherwise = ("frequency", "Hz") if spectral else ("time", "s")
    first = members[0]
    unit = _unit(first["abscissa_axis_units_lab"], otherwise)
    channels: dict[str, Channel] = {abscissa: array_channel(first["x"], unit)}
    for label, function in zip(unique_names([_name(f) for f in members]), members, strict=True):
        unit = _unit(function["ordinate_axis_units_lab"], "")
        channels[label] = array_channel(function["data"], unit)
    even = first["abscissa_spacing"] == 1 and not spectral
    step = float(first["abscissa_inc"]) if even else None
    return Table(name, len(first["x"]), channels, step, abscissa, abscissa)


def _name(function: dict[str, Any]) -> str:
    texts = (function["id1"], function["ordinate_axis_lab"])
    text = next((t.strip() for t in texts if t.strip() not in ("", "NONE")), "function")
    return f"{text} {function['rsp_node']}:{function['rsp_dir']}".removesuffix(" 0:0")


def _unit(label: str, otherwise: str) -> str:
    text = label.strip()
    return otherwise if text in ("", "NONE") else text
