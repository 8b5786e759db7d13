"""Tables on the page of ``oed chains``."""

import numpy as np

from estimators.chain_dampers.chains_from_records import MeasuredChains
from estimators.chains.parameter_maps import ChainLayout
from estimators.trust.intervals import Interval
from reports import text
from reports.page_elements import Cell, Column, Number, Table, numbers, percent_cell, table
from reports.summaries.chains_summary import in_hertz, method_of, refused, unit


def parameter_table(shown: MeasuredChains) -> Table:
    """Return the recommended masses, springs and couplings, beside those of the inverse problem."""
    inverse = shown.identification.inverse
    rows: list[tuple[Cell, ...]] = []
    for k, i in enumerate(shown.recommended.intervals):
        cells: list[Cell] = ["not quoted"] * 5
        if not refused(i):
            other, std = float(inverse.values[k]), float(inverse.relative_std[k])
            spread = 0.0 if i.method == "given" else i.std / abs(i.value)
            cells = [significant(i.value), _percent(spread), *_ends(i), significant(other)]
            cells.append(_percent(std))
        else:
            cells.append("")
        rows.append((i.name, *cells, unit(i.name)))
    columns = [
        Column("parameter", code=True),
        *numbers("value", "std [%]", "95 % from", "to", "inverse problem", "its std [%]"),
        Column("unit", "u"),
    ]
    caption = f"Recommended: {method_of(shown)}. For comparison: the inverse eigenvalue problem."
    layout = shown.recommended.layout
    return Table("parameter-table", caption, tuple(columns), by_chain(layout, rows))


def _ends(interval: Interval) -> tuple[Cell, Cell]:
    if interval.method == "given":
        return "given", "given"
    low, high = (
        "none" if v is None else Number(text.significant(v, 6), v)
        for v in (interval.low, interval.high)
    )
    return low, high


def by_chain(
    layout: ChainLayout, rows: list[tuple[Cell, ...]]
) -> tuple[tuple[str, tuple[tuple[Cell, ...], ...]], ...]:
    """Return the rows of each chain's masses and springs, then those of the couplings."""
    m, n = layout.chains, layout.masses
    groups = []
    for i in range(m):
        masses = rows[i * n : (i + 1) * n]
        springs = rows[m * n + i * (n - 1) : m * n + (i + 1) * (n - 1)]
        groups.append((f"Chain {i + 1}", tuple(masses + springs)))
    if m > 1:
        groups.append(("Couplings", tuple(rows[layout.positive :])))
    return tuple(groups)


def mode_table(shown: MeasuredChains) -> Table:
    """Return resonances, damping and each chain's anti-resonances."""
    modes = shown.identification.modes
    rows: list[list[Cell]] = []
    for r in range(len(modes.omega)):
        row: list[Cell] = [
            Number(str(r + 1), r + 1),
            _hertz(float(modes.omega[r]), float(modes.omega_std[r])),
            _percent(float(modes.damping[r])),
        ]
        row += [
            _hertz(float(modes.zeros[i, r]), float(modes.zeros_std[i, r]))
            for i in range(len(modes.zeros))
        ]
        rows.append(row)
    chains = [f"zero, chain {i + 1} [Hz]" for i in range(len(modes.zeros))]
    columns = numbers("mode", "pole [Hz]", "damping [%]", *chains)
    caption = "Undamped frequencies of poles and zeros, with one standard deviation."
    return table("mode-table", caption, columns, rows)


def damper_table(shown: MeasuredChains) -> Table:
    """Return dampers, motor friction and the delay."""
    d = shown.dampers
    rows: list[list[Cell]] = []
    if d is not None:
        entries = [
            *zip(
                (f"c{i + 1}" for i in range(d.dampers.size)),
                d.dampers.ravel(),
                d.dampers_std.ravel(),
                ["N m s/rad or N s/m"] * d.dampers.size,
                strict=True,
            ),
            *zip(
                (f"friction{i + 1}" for i in range(len(d.model.friction))),
                d.model.friction,
                d.friction_std,
                ["N m s/rad or N s/m"] * len(d.model.friction),
                strict=True,
            ),
            ("delay", d.model.delay, d.delay_std, "s"),
        ]
        rows = [
            [name, significant(float(value)), significant(float(std)), words]
            for name, value, std, words in entries
        ]
    columns = [Column("parameter", code=True), *numbers("value", "std"), Column("unit", "u")]
    caption = (
        "Dampers parallel to the springs, viscous friction of the motors, delay of the angles."
    )
    return table("damper-table", caption, columns, rows)


def other_table(shown: MeasuredChains) -> Table:
    """Return the same parameters under both models of damping, each with its verdict."""
    identification, d = shown.identification, shown.dampers
    estimates = (
        [identification.structured] if d is None else [identification.structured, d.estimate]
    )
    rows: list[list[Cell]] = []
    for k, name in enumerate(identification.names):
        row: list[Cell] = [name]
        for e in estimates:
            hidden = bool(e.intervals) and refused(e.intervals[k])
            row += [
                "not quoted" if hidden else significant(float(e.values[k])),
                "" if hidden else _percent(float(e.relative_std[k])),
            ]
        rows.append(row)
    heads = (
        *("damping free by modes", "its std [%]"),
        *("dampers at springs", "std with dampers [%]"),
    )
    columns = [Column("parameter", code=True), *numbers(*heads[: 2 * len(estimates)])]
    caption = "; ".join(f"{e.method}: {e.verdict}" for e in estimates) + "."
    return table("damped-table", caption, columns, rows)


def order_table(shown: MeasuredChains) -> Table:
    """Return the numbers of masses that were tried."""
    order = shown.identification.order
    rows: list[list[Cell]] = []
    if order is not None:
        for n_masses, cost, score in zip(order.tried, order.costs, order.scores, strict=True):
            shown_score: Cell = "not all modes clear"
            if np.isfinite(score):
                shown_score = significant(float(score))
            row: list[Cell] = [Number(str(n_masses), n_masses), significant(float(cost))]
            rows.append([*row, shown_score])
    columns = numbers("masses", "cost", "score")
    caption = "Sum of squared residuals and score (BIC, its noise enlarged to the best misfit)."
    return table("order-table", caption, columns, rows)


def _hertz(omega: float, std: float) -> Number:
    hertz, spread = (float(v) for v in in_hertz(np.array([omega, std])))
    decimals = min(text.decimals_for(spread), 5)
    return Number(f"{text.fixed(hertz, decimals)} ± {text.significant(spread, 2)}", hertz)


def _percent(value: float) -> Cell:
    return "given" if value == 0 else percent_cell(value)


def significant(value: float) -> Number:
    """Return a number of four significant digits."""
    return Number(text.significant(value, 4), value)
