"""Records of periodic runs made of imported movements."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.file_guard import PathLike
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.excitation import Excitation, find_excitation, group_runs, run_positions
from robotmodels.logs.importer import Import
from robotmodels.logs.importing import opened_import
from robotmodels.logs.mapping_file import Mapping
from robotmodels.records.movement import Movement
from robotmodels.records.records import Records

_MOST_NUMBERS = 8_000_000
"""Samples times joints in which periods are looked for: all of them are in memory then."""


def import_records(
    paths: PathLike | Sequence[PathLike],
    mapping: PathLike | Mapping,
    robot: ElasticRobot | None = None,
) -> Records:
    """Return the periodic runs of a log as records, on the motor shafts.

    Parameters
    ----------
    paths : path or sequence of paths
        Files of one recording.
    mapping : path or Mapping
        What their channels mean, or a file that says it; motor angles and torques at least.
        Reference torques beside them become `Records.command`.
    robot : ElasticRobot, optional
        By default the robot that the mapping names.

    Raises
    ------
    InvalidInput
        If the log is not periodic; `import_movements` reads it then.
    """
    with opened_import(paths, mapping, robot) as source:
        return periodic_records(source)[0]


def found_records(source: Import) -> tuple[Records | None, tuple[str, ...]]:
    """Return the records of an import, None where it is not periodic, and the reason in words."""
    needed = ("motor_angle", "motor_torque")
    if any(role not in source.roles for role in needed):
        return None, ("no records: motor angles and motor torques are needed for them",)
    most = _MOST_NUMBERS // len(source.binding.joints)
    if sum(map(len, source.runs)) > most:
        return None, (f"no records: more than {most} samples; cut the log",)
    try:
        return periodic_records(source)
    except InvalidInput as error:
        return None, (f"no records: {str(error).removeprefix(f'{source.log.where}: ')}",)


def periodic_records(source: Import) -> tuple[Records, tuple[str, ...]]:
    """Return the periodic runs of an import, and what was seen of the excitation.

    Raises
    ------
    InvalidInput
        If there are none, ratios are unknown, or experiments differ in their numbers of runs.
    """
    mapping, where = source.mapping, source.log.where
    if mapping.period == 0:
        raise InvalidInput(f"{where}: period: 0 says that it is not periodic")
    if not np.isfinite(source.binding.ratios).all():
        raise InvalidInput(f"{where}: records are on the motor shafts: ratios or a robot is needed")
    parts: list[Records] = []
    notes: list[str] = []
    try:
        for run in source.runs:
            movement = run.read()
            excitation = find_excitation(movement, mapping.period, mapping.transient)
            parts.append(_shaped(movement, excitation, source))
            notes += excitation.notes
        return Records.join(parts), tuple(notes)
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None


def _shaped(movement: Movement, excitation: Excitation, source: Import) -> Records:
    """Return runs in the axes of records: positions, blocks, runs, periods, samples, motors."""
    positions = run_positions(movement, excitation)
    size = np.nan_to_num(np.ptp(movement.motor_angle, axis=0))
    visits = group_runs(positions, int((size > 0).sum()))
    shapes = {(len(blocks), len(blocks[0])) for blocks in visits}
    if len(shapes) > 1:
        told = ", ".join(f"{blocks} blocks of {runs} runs" for blocks, runs in sorted(shapes))
        raise InvalidInput(f"experiments differ: {told}; cut the log or record what is missing")
    periods = int(excitation.periods.min())
    order = np.array(visits, dtype=int)
    signals: dict[str, Any] = {
        name: _cut(values, excitation, order, periods)
        for name, values in _on_shafts(movement, source).items()
    }
    (blocks, runs), motors = next(iter(shapes)), len(movement.joints)
    return Records(
        positions=positions[order].mean(axis=(1, 2)),
        sample_time=movement.sample_time,
        lines=excitation.lines,
        detection=np.zeros(0, dtype=int),
        saturated=np.zeros((len(visits), blocks, runs, periods, motors), dtype=bool),
        **signals,
    )


def _on_shafts(movement: Movement, source: Import) -> dict[str, Array]:
    ratios, mixing = source.binding.ratios, source.binding.mixing
    unmixed = np.linalg.inv(mixing)
    angle = movement.motor_angle @ unmixed.T * ratios
    torque = movement.motor_torque @ mixing / ratios
    speed = movement.signals.get("reference_velocity")
    reference = np.zeros_like(angle) if speed is None else speed * ratios
    signals = {"angle": angle, "torque": torque, "reference": reference}
    command = movement.signals.get("reference_torque")
    if command is not None and np.isfinite(command).all():
        signals["command"] = command / ratios
    return signals


def _cut(values: Array, excitation: Excitation, order: IntArray, periods: int) -> Array:
    """Return (positions, blocks, runs, periods, samples, motors)."""
    length = periods * excitation.samples
    runs = np.stack([values[excitation.starts[i] :][:length] for i in order.ravel()])
    return runs.reshape(*order.shape, periods, excitation.samples, values.shape[1])
