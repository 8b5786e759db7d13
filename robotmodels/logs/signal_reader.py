"""Signals in SI on the samples of one clock: as they are, or interpolated."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.binding import BoundSignal
from robotmodels.logs.clocks import Clock
from robotmodels.logs.log import Table
from robotmodels.logs.resampling import band_edge_share, interpolate
from robotmodels.logs.survey import Survey, signal_key, unwraps

_SAME = 1e-3  # of a sample, by which clocks may differ and still be one
_MOST_ERROR = 0.02  # of a signal, that interpolation may get wrong
_JUDGED = 1 << 16  # samples


@dataclass(frozen=True, eq=False)
class SignalReader:
    """Reads signals in pieces.

    Attributes
    ----------
    where : str
        Names of the files, for errors.
    base : Table
        Table whose samples count.
    clocks : mapping of str to Clock
        Clocks by the names of tables.
    surveys : mapping of str to Survey
        Passes through the channels, which say where they jump.
    """

    where: str
    base: Table
    clocks: Mapping[str, Clock]
    surveys: Mapping[str, Survey]

    def values(self, signal: BoundSignal, low: int, high: int) -> Array:
        """Return a signal in SI for samples `low` to `high` of the base clock, (high - low,)."""
        clock, base = self.clocks[signal.table.name], self.clocks[self.base.name]
        if self.aligned(signal):
            return signal.factor * self._by_tick(signal, clock, low, high)
        times = base.sample_times(low, high)
        where = np.asarray((times + signal.entry.delay - clock.start) / clock.sample_time)
        step = base.sample_time / clock.sample_time

        def read(start: int, stop: int) -> Array:
            return self._by_tick(signal, clock, start, stop)

        return signal.factor * interpolate(read, len(clock), where, step)

    def aligned(self, signal: BoundSignal) -> bool:
        """Return whether a signal is taken row by row."""
        if signal.entry.delay:
            return False
        if signal.table is self.base:
            return True
        clock, base = self.clocks[signal.table.name], self.clocks[self.base.name]
        alike = np.array_equal(clock.ticks, base.ticks), np.array_equal(clock.counts, base.counts)
        if not all(alike):
            return False
        shift = abs(clock.start - base.start)
        drift = abs(clock.sample_time - base.sample_time) * float(base.ticks[-1] + base.counts[-1])
        return shift + drift < _SAME * base.sample_time

    def interpolation_error(self, signal: BoundSignal) -> float | None:
        """Return the error of interpolating a signal over what its role moves, None without.

        Raises
        ------
        InvalidInput
            If it is too large, or samples are missing.
        """
        if self.aligned(signal):
            return None
        clock, base = self.clocks[signal.table.name], self.clocks[self.base.name]
        head = self._by_tick(signal, clock, 0, min(len(clock), _JUDGED))
        error = band_edge_share(head, base.sample_time / clock.sample_time) * self._share(signal)
        if error > _MOST_ERROR:
            raise InvalidInput(
                f"{self.where}: {signal.channel}: interpolation to other samples would err by "
                f"{error:.1%} of {signal.role}, it has that much near the Nyquist frequency; put "
                "its own table first in the mapping, or record faster"
            )
        if clock.gaps:
            row, missing = clock.gaps[0]
            raise InvalidInput(
                f"{self.where}: {signal.channel}: {missing} samples are missing before row {row}; "
                "a channel with gaps is not interpolated, cut the file there"
            )
        return error

    def _share(self, signal: BoundSignal) -> float:
        """Return the range of a signal over the largest of its role: noise of rest counts little.

        Channels of one role are mostly in one unit.
        """
        ranges = {
            key: seen.high - seen.low
            for key, seen in self.surveys.items()
            if key.startswith(f"{signal.role}:")
        }
        largest = np.nanmax(list(ranges.values()))
        return float(ranges[signal_key(signal)] / largest) if largest > 0 else 1.0

    def _by_tick(self, signal: BoundSignal, clock: Clock, low: int, high: int) -> Array:
        """Return values in the unit of the channel, by samples of its own clock."""
        rows = clock.sample_rows(low, high)
        first, stop = int(rows[0]), int(rows[-1]) + 1
        raw = np.asarray(signal.table.channels[signal.channel].read(first, stop), dtype=float)
        seen = self.surveys[signal_key(signal)]
        if unwraps(signal, seen):
            raw = seen.unwrapped(raw, first, signal.turn)
        return raw if len(raw) == len(rows) else raw[rows - first]
