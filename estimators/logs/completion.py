"""What a mapping leaves open, taken from what log and robot say."""

from collections.abc import Iterable

from estimators.logs.proposal import propose_mapping
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.binding import SIDED, matches
from robotmodels.logs.log import Log
from robotmodels.logs.mapping_file import Mapping, Signal
from robotmodels.logs.units import stated_unit


def complete_mapping(
    log: Log, mapping: Mapping, robot: ElasticRobot | None
) -> tuple[Mapping, tuple[str, ...]]:
    """Return a mapping with missing units and sides filled in, and what they rest on.

    Parameters
    ----------
    log : Log
        The log, open.
    mapping : Mapping
        As the user wrote it; entries without a unit or a side take those of the proposal for the
        same channels, if the log allows a proposal.
    """
    if not any(_open(log, signal) for signal in mapping.signals):
        return mapping, ()
    try:
        proposal = propose_mapping(log, robot, mapping.time)
    except InvalidInput:
        return mapping, ()  # so that what is open is told by the entry
    told, signals = [], []
    for signal in mapping.signals:
        entry = next(
            (
                entry
                for entry in proposal.entries
                if entry.signal is not None
                and set(entry.family.channels) & set(_channels(log, signal.patterns))
            ),
            None,
        )
        if _open(log, signal) and entry is not None and entry.signal is not None:
            update = {
                key: getattr(entry.signal, key)
                for key in ("unit", "side")
                if not getattr(signal, key) and getattr(entry.signal, key)
            }
            told.append(
                f"{entry.family.pattern}: {', '.join(f'{k} {v}' for k, v in update.items())} "
                f"({entry.evidence})"
            )
            signal = signal.model_copy(update=update)
        signals.append(signal)
    return mapping.model_copy(update={"signals": tuple(signals)}), tuple(told)


def _open(log: Log, signal: Signal) -> bool:
    units = [
        stated_unit(table.channels[channel].unit, signal.role)
        for pattern in signal.patterns
        for table, channel in matches(log, pattern)
    ]
    no_unit = not signal.unit and not all(units) and signal.role != "other"
    return no_unit or (signal.side is None and signal.role in SIDED)


def _channels(log: Log, patterns: Iterable[str]) -> list[str]:
    return [channel for pattern in patterns for _, channel in matches(log, pattern)]
