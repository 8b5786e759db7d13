"""FRFs from records, with their covariance: [WM] section 4."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimators.frf.averaging import (
    SUMMING,
    covariance_of,
    effective_runs,
    find_method,
    jackknife,
    needed_rank,
    noise_deviations,
)
from estimators.frf.block_checks import (
    check_blocks,
    check_copied_periods,
    check_excited,
    check_samples,
)
from estimators.frf.frf_estimate import FrfEstimate, unvec
from estimators.frf.record_checks import (
    check_condition,
    check_periods,
    settling,
    warn,
)
from estimators.frf.spectra import Spectra, spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray, whole_numbers
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.records.records import Records

Transient = int | Literal["auto"]


def estimate_frf(
    records: Records | Iterable[Records],
    method: str = "ari",
    *,
    covariance: str = "total",
    structure: str = "full",
    hold: bool = True,
    delay: float = 0.0,
    transient: Transient = "auto",
    lines: IntArray | None = None,
) -> FrfEstimate:
    """Estimate motor torque to motor acceleration FRFs, and the covariance of the estimate.

    Periods are averaged first, then blocks by `method`. Blocks with a missing run
    are dropped with a warning, except where the method sums over runs (h1, jio) and uses the
    other runs; blocks that are missing altogether are skipped, and `repetitions` counts the
    blocks used.

    Parameters
    ----------
    records : Records or iterable of Records
        Runs, or any iterable of them, e.g. `robotmodels.records.records.iterate_records`; one
        position at a time is in memory.
    method : str
        "ari", "har", "log", "h1" or "jio"; `estimators.compare_methods` helps to choose.
    covariance : str
        "total", over blocks, or "noise", from what does not repeat from period to period, which
        misses the distortions by nonlinearities and is all that one block can give.
    structure : str
        "full" matrices of vec(G), of rank B - 1 at most for the total one, or their "diagonal".
    hold : bool
        Whether the torque is held over a sample.
    delay : float, s
        Delay of the measured angle after the torque.
    transient : Transient
        Periods to drop at the start of each run; "auto" drops those that differ from later ones,
        see `estimators.settling`, and warns when it does.
    lines : ndarray of int, optional
        DFT lines, some of those that are excited; all by default. `estimators.excitation` tells
        which are usable.

    Raises
    ------
    InvalidInput
        Naming position, block, line and condition number where torques are dependent or within
        their noise, and whatever else keeps the records from being used.
    """
    find_method(method)
    check_word("covariance", covariance, ("total", "noise"))
    check_word("structure", structure, ("full", "diagonal"))

    def estimated(part: Records, who: str) -> PositionFrf:
        measured = usable_spectra(
            part, who, method, hold=hold, delay=delay, transient=transient, lines=lines
        )
        response, draws, freedom = with_deviations(measured, method, covariance, who)
        error = structured(covariance_of(draws), structure, response.shape[1])
        count = len(measured.present)
        return PositionFrf(measured.omega, response, error, count, freedom, draws.swapaxes(0, 1))

    return over_positions(records, estimated)


class PositionFrf(NamedTuple):
    """What one position gives: an `FrfEstimate` without the axis of positions."""

    omega: Array
    response: ComplexArray
    covariance: NDArray[Any]
    repetitions: int
    degrees_of_freedom: float
    deviations: ComplexArray | None = None
    line_correlation: Array = np.empty(0)


def over_positions(
    records: Records | Iterable[Records], estimated: Callable[[Records, str], PositionFrf]
) -> FrfEstimate:
    """Return the estimates of one position after the other as one.

    Parameters
    ----------
    estimated : callable
        Gives a position's, from its records and what messages are to call it.

    Raises
    ------
    InvalidInput
        If there are no records, or frequencies, outputs or motors of positions differ.
    """
    positions, estimates = of_positions(records, estimated)
    m, n = estimates[0].response.shape[1:]
    for count, one in enumerate(estimates):
        if (shape := one.response.shape[1:]) != (m, n):
            raise InvalidInput(
                f"position {count + 1}: {shape[0]} x {shape[1]} FRFs (outputs x motors); "
                f"those of position 1 are {m} x {n}"
            )
    return FrfEstimate(
        positions,
        estimates[0].omega,
        np.array([one.response for one in estimates]),
        np.array([one.covariance for one in estimates]),
        np.array([one.repetitions for one in estimates], dtype=np.int64),
        np.array([one.degrees_of_freedom for one in estimates]),
        stacked_deviations([one.deviations for one in estimates]),
        mean_correlation([one.line_correlation for one in estimates]),
    )


class HasOmega(Protocol):
    """What belongs to angular frequencies."""

    @property
    def omega(self) -> Array:
        """Angular frequencies, (F,) [rad/s]."""


_Part = TypeVar("_Part", bound=HasOmega)


def of_positions(
    records: Records | Iterable[Records], part_of: Callable[[Records, str], _Part]
) -> tuple[Array, list[_Part]]:
    """Return positions (Q, n) [rad], and what is computed from the records of each.

    Parameters
    ----------
    part_of : callable
        Gives a position's, from its records and what messages are to call it.

    Raises
    ------
    InvalidInput
        If there are no records, or frequencies of positions differ.
    """
    positions, parts = [], list[_Part]()
    for count, part in enumerate(each_position(records)):
        who = f"position {count + 1}"
        positions.append(part.positions[0])
        parts.append(part_of(part, who))
        if not np.array_equal(parts[0].omega, parts[-1].omega):
            raise InvalidInput(f"{who}: its frequencies differ from those of position 1")
    if not parts:
        raise InvalidInput("records: none given; at least one position is needed")
    return np.array(positions), parts


def stacked_deviations(draws: Sequence[ComplexArray | None]) -> ComplexArray | None:
    """Return the draws (R, F, m, n) of positions as one (Q, R, F, m, n), zeros filled in."""
    available = [one for one in draws if one is not None]
    if len(available) < len(draws):
        return None
    most = max(len(one) for one in available)
    return np.stack(
        [np.pad(one, [(0, most - len(one)), (0, 0), (0, 0), (0, 0)]) for one in available]
    )


def mean_correlation(correlations: Sequence[Array]) -> Array:
    """Return the mean over positions of correlations at lags 1 to L, zero beyond each one's."""
    most = max(len(one) for one in correlations)
    padded = [np.pad(one, (0, most - len(one))) for one in correlations]
    return np.asarray(np.mean(padded, axis=0))


def each_position(records: Records | Iterable[Records]) -> Iterator[Records]:
    """Return the records of one position after the other, Q = 1 each."""
    for part in [records] if isinstance(records, Records) else records:
        for index in range(len(part)):
            yield part.at(index)


def usable_spectra(
    records: Records,
    who: str,
    method: str,
    *,
    hold: bool = True,
    delay: float = 0.0,
    transient: Transient = "auto",
    lines: IntArray | None = None,
) -> Spectra:
    """Return the checked spectra of one position, without transients and missing blocks.

    Raises
    ------
    InvalidInput
        As `estimate_frf` does.
    """
    check_samples(records, who)
    k = lines_of(records, lines)
    measured = spectra(records, 0, k, hold, delay)
    check_periods(measured, who)
    n, E = measured.input.shape[-2:]
    if n > E:
        raise InvalidInput(
            f"{who}: {E} of {n} runs a block, one for each motor; they are needed, or "
            "estimators.local_frf (oed frf --local), which uses neighbouring lines too, or a "
            "fit to the runs themselves (oed identify)"
        )
    if n < E and method not in SUMMING:
        raise InvalidInput(
            f"{who}: {E} runs a block for {n} motors; {method} needs {n}, "
            f"{' and '.join(SUMMING)} take any number"
        )
    check_excited(measured, records, k, who, needed_rank(method, n))
    if method == "jio" and not measured.reference.any():
        raise InvalidInput(f"{who}: jio needs the reference, which is zero; use another method")
    first = first_period(measured, transient, who)
    measured = spectra(records, 0, k, hold, delay, first) if first else measured
    measured = _without_missing(measured, method, who)
    check_blocks(measured, who)
    _check_inputs(measured, method, k.astype(float), who)
    return measured


def lines_of(records: Records, lines: IntArray | None) -> IntArray:
    """Return the excited lines, or some of them.

    Raises
    ------
    InvalidInput
        Naming those that are not excited.
    """
    if lines is None:
        return records.lines
    subset = whole_numbers(lines, "lines")
    silent = np.setdiff1d(subset, records.lines)
    if len(silent) or not len(subset) or (np.diff(subset) <= 0).any():
        what = f"{', '.join(map(str, silent[:8]))} are not excited" if len(silent) else "none rise"
        raise InvalidInput(
            f"lines: {what}; rising ones among the excited {records.lines[0]} to "
            f"{records.lines[-1]} are needed"
        )
    return subset


def with_deviations(
    measured: Spectra, method: str, covariance: str, who: str
) -> tuple[ComplexArray, ComplexArray, float]:
    """Return the FRF (F, m, n), draws (F, R, m, n) of its error, and their degrees of freedom.

    Draws are of the "total" error, by leaving out blocks, or of "noise", by bins without signal.

    Raises
    ------
    InvalidInput
        If there are too few blocks, or periods, for a covariance.
    """
    B, P = measured.input.shape[:2]
    Y, U, R = (a.swapaxes(0, 1) for a in measured.averaged())
    if covariance == "total":
        if B < 2:
            raise InvalidInput(
                f"{who}: one block; a total covariance needs at least 2 with new phases, a noise "
                "covariance two periods; otherwise fit the runs themselves (oed identify)"
            )
        response, draws = jackknife(find_method(method), Y, U, R)
        freedom = float(B - 1)
    else:
        if P < 2:
            raise InvalidInput(f"{who}: one period; a noise covariance needs at least 2")
        check_copied_periods(measured, who)
        response = find_method(method)(Y, U, R)
        noise = [np.moveaxis(a, 2, 0) for a in (measured.noise_output, measured.noise_input)]
        draws = noise_deviations(method, response, noise[0], noise[1], U, R)
        freedom = measured.noise_bins * effective_runs(method, U, R)
    return response, above_rounding(draws, response), freedom


def above_rounding(draws: ComplexArray, response: ComplexArray) -> ComplexArray:
    """Raise draws (F, R, m, n) of the error to the size of rounding errors."""
    size = np.abs(response).max(axis=(-2, -1))[:, None, None]
    least = 4 * np.finfo(float).eps * size
    std = np.sqrt((np.abs(draws) ** 2).sum(axis=1))
    poor = (std < least)[:, None]
    return np.asarray(np.where(poor, (least / np.sqrt(draws.shape[1]))[:, None], draws))


def structured(covariance: ComplexArray, structure: str, outputs: int) -> Array | ComplexArray:
    """Return covariances "full", (F, m n, m n), as they are, or their "diagonal", (F, m, n)."""
    covariance = (covariance + np.conj(np.swapaxes(covariance, -1, -2))) / 2
    single = covariance.shape[-1] == 1  # a matrix of one element is a variance
    return covariance if structure == "full" and not single else diagonal(covariance, outputs)


def diagonal(covariance: ComplexArray, outputs: int) -> Array:
    """Return the variances (F, m, n) of (F, m n, m n) covariances."""
    return np.asarray(unvec(np.diagonal(covariance, axis1=-2, axis2=-1).real, outputs))


def variances(draws: ComplexArray) -> Array:
    """Return the variances (F, m, n) of the elements from draws (F, R, m, n) of their errors."""
    return np.asarray((np.abs(draws) ** 2).sum(axis=1))


def first_period(measured: Spectra, transient: Transient, who: str) -> int:
    """Return how many periods to drop: so many, or those not settled ("auto"), with a warning."""
    if transient != "auto":
        return transient
    settled = settling(measured)
    if settled.first:
        warn(
            f"{who}: the first {settled.first} of {measured.periods} periods dropped: they differ "
            f"from later ones by {settled.deviations[0]:.2g} of the signal, more than chance allows"
        )
    if not settled.settled:
        warn(f"{who}: no period agrees with the later ones; the runs never settled")
    return settled.first


def _without_missing(measured: Spectra, method: str, who: str) -> Spectra:
    some, every = np.asarray(measured.present.any(axis=1)), measured.complete
    partial = some & ~every
    if method in SUMMING or not partial.any():
        return measured.blocks(some)
    warn(
        f"{who}: blocks {_numbers(partial)} lack runs and are left out; "
        f"{' and '.join(SUMMING)} would use what they have"
    )
    if not every.any():
        raise InvalidInput(f"{who}: no block is complete, as {method} needs")
    return measured.blocks(every)


def _numbers(which: NDArray[np.bool_]) -> str:
    """Return which are true, counted from 1."""
    return ", ".join(str(i + 1) for i in np.flatnonzero(which))


def _check_inputs(measured: Spectra, method: str, lines: Array, who: str) -> None:
    averaged = measured.input.mean(axis=1)  # (B, F, n, E)
    if method in SUMMING:
        together = np.concatenate(list(averaged), axis=-1)
        check_condition(together, measured.omega, lines, who)
        if method == "jio":
            references = np.concatenate(list(measured.reference[:, 0]), axis=-1)
            check_condition(references, measured.omega, lines, who, "references")
        return
    for b, block in enumerate(averaged):
        check_condition(block, measured.omega, lines, f"{who}, block {b + 1}")
