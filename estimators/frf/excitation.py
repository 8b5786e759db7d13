"""Which lines tell the motors apart: rank and conditioning of the torques, line by line."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.frf.averaging import SUMMING, find_method, needed_rank
from estimators.frf.block_checks import line_words
from estimators.frf.estimate_frf import Transient, first_period, of_positions
from estimators.frf.input_rank import (
    condition_numbers,
    excited_rank,
    input_noise,
    side_by_side,
)
from estimators.frf.local_rational_model import window_excitation
from estimators.frf.record_checks import check_records
from estimators.frf.repeated_visits import visits_of
from estimators.frf.spectra import Spectra, spectra
from robotmodels.common.arrays import Array, IntArray, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

LOCAL = "local"
"""In place of a method: the local rational model."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """Rank and conditioning of the torques of records at each line.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    lines : ndarray of int, (F,)
        Excited DFT lines of the band.
    omega : ndarray, (F,), rad/s
        Their angular frequencies.
    rank : ndarray of int, (Q, F)
        Independent torques at the line above their noise, over all runs of a position.
    condition : ndarray, (Q, F), dimensionless
        Condition number of what the estimate inverts: the torques of the worst block, or those of
        all blocks together, motors scaled alike; the regressors of the window of a local model.
    determined : ndarray of bool, (Q, F)
        Whether the FRF can be estimated.
    """

    positions: Array
    lines: IntArray
    omega: Array
    rank: IntArray
    condition: Array
    determined: NDArray[np.bool_]

    @property
    def usable(self) -> IntArray:
        """Lines at which the FRFs of all positions can be estimated."""
        return np.asarray(self.lines[self.determined.all(axis=0)])

    def at_usable_lines(self) -> "Excitation":
        """Return the same of the usable lines, one position for all visits to it."""
        at, visits = self.determined.all(axis=0), visits_of(self.positions)
        return replace(
            self,
            positions=self.positions[[v[0] for v in visits]],
            lines=self.lines[at],
            omega=self.omega[at],
            rank=np.array([self.rank[v].min(axis=0)[at] for v in visits]),
            condition=np.array([self.condition[v].max(axis=0)[at] for v in visits]),
            determined=np.ones((len(visits), at.sum()), dtype=bool),
        )

    def left_out(self, records: Records) -> list[str]:
        """Return in words why lines are not usable."""
        n, words = self.positions.shape[1], []
        for rank in range(n + 1):
            at = ~self.determined.all(axis=0) & (self.rank.min(axis=0) == rank)
            if at.any():
                words.append(
                    f"{line_words(self.lines[at], records)} left out: {rank} of {n} torques are "
                    "independent above their noise in some position"
                )
        return words


def excitation(
    records: Records | Iterable[Records],
    method: str = "ari",
    *,
    band: tuple[float, float] | None = None,
    transient: Transient = "auto",
    **local: Any,
) -> Excitation:
    """Return rank and conditioning of the torques at each excited line.

    Parameters
    ----------
    records : Records or iterable of Records
        As in `estimators.estimate_frf`.
    method : str
        As in `estimators.estimate_frf`, or "local" for `estimators.local_frf`, to which a line
        is usable where the torques of its window are independent.
    band : tuple of float, optional
        Lowest and highest angular frequency [rad/s]; all lines by default.
    transient : Transient
        As in `estimators.estimate_frf`.
    **local
        Order, denominator and half_width of the local model.

    Raises
    ------
    InvalidInput
        If no line lies in the band, positions differ in their lines, or a method does not exist.
    """
    if method != LOCAL:
        find_method(method)
    positions, parts = of_positions(
        records, partial(_of_position, method=method, band=band, transient=transient, local=local)
    )
    return Excitation(
        positions,
        parts[0].lines,
        parts[0].omega,
        np.array([one.rank for one in parts]),
        np.array([one.condition for one in parts]),
        np.array([one.determined for one in parts]),
    )


class _Part(NamedTuple):
    """One position's part of an `Excitation`."""

    lines: IntArray
    omega: Array
    rank: IntArray
    condition: Array
    determined: NDArray[np.bool_]


def _of_position(
    part: Records,
    who: str,
    method: str,
    band: tuple[float, float] | None,
    transient: Transient,
    local: dict[str, Any],
) -> _Part:
    check_records(part, 0, who)
    lines = lines_in(part, band)
    measured = spectra(part, 0, lines)
    if first := first_period(measured, transient, who):
        measured = spectra(part, 0, lines, first=first)
    noise = input_noise(part, measured, lines)
    rank = excited_rank(measured, noise)
    if method == LOCAL:
        condition, determined = window_excitation(measured, noise, who, **local)
    else:
        condition = _by_line(measured, method)
        determined = rank >= needed_rank(method, part.positions.shape[1])
    return _Part(lines, measured.omega, rank, condition, determined & (rank > 0))


def lines_in(records: Records, band: tuple[float, float] | None) -> IntArray:
    """Return the excited lines within a band [rad/s], 0 Hz never one of them.

    Raises
    ------
    InvalidInput
        If the band is none, or holds no line.
    """
    if band is None:
        return records.lines
    ends, omega = real_numbers(band, "band"), records.omega
    if ends.shape != (2,):
        raise InvalidInput(f"band: {ends.tolist()}; a low and a high angular frequency are needed")
    low, high = ends
    inside = (omega >= low * (1 - 1e-9)) & (omega <= high * (1 + 1e-9))
    if not 0 <= low < high or not inside.any():
        hertz = np.array([low, high, omega[0], omega[-1]]) / (2 * np.pi)
        raise InvalidInput(
            f"band: {hertz[0]:.6g} to {hertz[1]:.6g} Hz holds none of the excited lines, which "
            f"lie from {hertz[2]:.6g} to {hertz[3]:.6g} Hz; give the lower end first, 0 or more"
        )
    return np.asarray(records.lines[inside])


def _by_line(measured: Spectra, method: str) -> Array:
    """Return the condition numbers (F,) of what a method inverts at a line."""
    if method in SUMMING or not measured.complete.any():
        return condition_numbers(side_by_side(measured.input, measured))
    blocks = measured.averaged()[1][measured.complete]  # (B, F, n, E)
    return np.asarray(condition_numbers(blocks).max(axis=0))
