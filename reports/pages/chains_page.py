"""The page of ``oed chains``: one HTML file."""

from pathlib import Path

import numpy as np

from estimators.chain_dampers.chains_from_records import MeasuredChains
from estimators.chains.model_order import WrongModeCount
from estimators.chains.parameter_maps import ChainLayout
from estimators.trust.intervals import Interval
from reports import text
from reports.figures.chains_figures import found_panels, pole_zero_panels
from reports.figures.response_panels import lines_drawn, response_panels
from reports.page_elements import (
    Cell,
    Column,
    Figure,
    Number,
    Section,
    Table,
    figure,
    filled,
    numbers,
    page,
    table,
)
from reports.summaries.chains_summary import in_hertz, method_of, refused, unit, verdict_of
from robotmodels.common.atomic_files import write_text

_CLEARLY_WORSE = 1.5  # misfit of the fit with dampers over that of the modes


def write_chains_page(shown: MeasuredChains, source: Path, path: Path) -> None:
    """Write identified chains as one HTML file that needs nothing else."""
    count, length = shown.found.masses.shape
    title = f"{text.plural(count, 'chain')} of {length} masses"
    write_text(
        path,
        page(
            title=title,
            kind="identified chains",
            kicker="Inverse eigenvalue identification of coupled chains",
            lead=(
                "Masses, springs and couplings behind each motor, from motor torques and angles "
                "alone, and how certain they are."
            ),
            sections=chains_sections(shown, source),
        ),
    )


def write_modes_page(error: WrongModeCount, source: Path, path: Path) -> None:
    """Write the picture of FRFs that show another number of modes than was asked for."""
    drawing = figure(
        "modes",
        found_panels(error.omega, error.response, error.found),
        f"Magnitudes of the motors' own FRFs and {len(error.found)} resonances that were found",
    )
    body = filled("chains_modes.html.j2", error=error, source=source, drawing=drawing)
    write_text(
        path,
        page(
            title=f"{len(error.found)} resonances found, {error.expected} expected",
            kind="identified chains",
            kicker="Inverse eigenvalue identification of coupled chains",
            lead="The frequency responses do not show what was asked for.",
            sections=[Section("modes", "Resonances found", body)],
        ),
    )


def chains_sections(shown: MeasuredChains, source: Path) -> list[Section]:
    """Return the sections of the page."""
    found = shown.found
    parts: list[tuple[str, str, dict[str, object]]] = [
        ("summary", "Summary", {"facts": _facts(shown), "source": source}),
        ("parameters", "Parameters", {"estimates": parameter_table(shown)}),
        ("modes", "Poles and zeros", {"panels": _poles(shown), "modes": mode_table(shown)}),
        (
            "responses",
            "Frequency responses",
            {"panels": _responses(shown), "words": _fitted_words(shown)},
        ),
    ]
    if shown.dampers is not None:
        ratio = worse_with_dampers(shown)
        damped = {
            "dampers": damper_table(shown),
            "estimates": other_table(shown),
            "worse": text.significant(ratio, 2) if ratio else "",
        }
        parts.insert(2, ("dampers", "Dampers", dict(damped)))
    if found.order is not None:
        parts.append(("order", "Number of masses", {"orders": order_table(shown)}))
    return [
        Section(name, title, filled(f"chains_{name}.html.j2", shown=shown, **contents))
        for name, title, contents in parts
    ]


def _facts(shown: MeasuredChains) -> dict[str, str]:
    found = shown.found
    e, verdict = shown.recommended, verdict_of(shown)
    hidden = any(map(refused, e.intervals))
    return {
        "verdict": str(verdict),
        "reason": verdict.reason,
        "chains": text.plural(len(found.masses), "chain"),
        "lines": text.plural(len(found.modes.data.omega), "line"),
        "low": text.hertz(found.modes.data.omega[0]),
        "high": text.hertz(found.modes.data.omega[-1]),
        "std": "none" if hidden else text.percent(float(np.median(e.relative_std))),
        "condition": text.significant(found.inverse.condition, 2),
        "misfit": text.significant(found.misfit, 2),
        "p_value": text.significant(found.structure_p_value, 2),
        "delay": text.significant(1e6 * found.modes.delay, 3),
    }


def worse_with_dampers(shown: MeasuredChains) -> float:
    """Return the misfit with dampers over that of the modes if it is clearly more, or 0."""
    if shown.dampers is None or shown.found.modes.data.scaled:
        return 0.0
    ratio = shown.dampers.misfit / max(shown.found.modes.misfit, 1e-300)
    return ratio if ratio > _CLEARLY_WORSE else 0.0


def parameter_table(shown: MeasuredChains) -> Table:
    """Return the recommended masses, springs and couplings, beside those of the inverse problem."""
    inverse = shown.found.inverse
    rows: list[tuple[Cell, ...]] = []
    for k, i in enumerate(shown.recommended.intervals):
        cells: list[Cell] = ["not quoted"] * 5
        if not refused(i):
            other, std = float(inverse.values[k]), float(inverse.relative_std[k])
            spread = 0.0 if i.method == "given" else i.std / abs(i.value)
            cells = [_significant(i.value), _percent(spread), *_ends(i), _significant(other)]
            cells.append(_percent(std))
        else:
            cells.append("")
        rows.append((i.name, *cells, unit(i.name)))
    columns = [
        Column("parameter", code=True),
        *numbers("value", "std", "95 % from", "to", "inverse problem", "std"),
        Column("unit", "u"),
    ]
    caption = f"Recommended: {method_of(shown)}. Beside it the inverse eigenvalue problem."
    layout = shown.recommended.layout
    return Table("parameter-table", caption, tuple(columns), _by_chain(layout, rows))


def _ends(interval: Interval) -> tuple[Cell, Cell]:
    if interval.method == "given":
        return "given", "given"
    low, high = (
        "none" if v is None else Number(text.significant(v, 6), v)
        for v in (interval.low, interval.high)
    )
    return low, high


def _by_chain(
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
    modes = shown.found.modes
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
    chains = [f"zero, chain {i + 1}" for i in range(len(modes.zeros))]
    columns = numbers("mode", "pole", "damping", *chains)
    caption = "Undamped frequencies of poles and zeros [Hz], with one standard deviation."
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
            [name, _significant(float(value)), _significant(float(std)), words]
            for name, value, std, words in entries
        ]
    columns = [Column("parameter", code=True), *numbers("value", "std"), Column("unit", "u")]
    caption = (
        "Dampers parallel to the springs, viscous friction of the motors, delay of the angles."
    )
    return table("damper-table", caption, columns, rows)


def other_table(shown: MeasuredChains) -> Table:
    """Return the same parameters under both models of damping, each with its verdict."""
    found, d = shown.found, shown.dampers
    estimates = [found.structured] if d is None else [found.structured, d.estimate]
    rows: list[list[Cell]] = []
    for k, name in enumerate(found.names):
        row: list[Cell] = [name]
        for e in estimates:
            hidden = bool(e.intervals) and refused(e.intervals[k])
            row += [
                "not quoted" if hidden else _significant(float(e.values[k])),
                "" if hidden else _percent(float(e.relative_std[k])),
            ]
        rows.append(row)
    heads = ("damping free by modes", "std", "dampers at springs", "std")
    columns = [Column("parameter", code=True), *numbers(*heads[: 2 * len(estimates)])]
    caption = "; ".join(f"{e.method}: {e.verdict}" for e in estimates) + "."
    return table("damped-table", caption, columns, rows)


def order_table(shown: MeasuredChains) -> Table:
    """Return the numbers of masses that were tried."""
    order = shown.found.order
    rows: list[list[Cell]] = []
    if order is not None:
        for n_masses, cost, score in zip(order.tried, order.costs, order.scores, strict=True):
            shown_score: Cell = "not all modes clear"
            if np.isfinite(score):
                shown_score = _significant(float(score))
            row: list[Cell] = [Number(str(n_masses), n_masses), _significant(float(cost))]
            rows.append([*row, shown_score])
    columns = numbers("masses", "cost", "score")
    caption = "Sum of squared residuals and score (BIC, its noise enlarged to the best misfit)."
    return table("order-table", caption, columns, rows)


def _poles(shown: MeasuredChains) -> Figure:
    e, q = shown.frf.estimate, shown.position
    lines = lines_drawn(e.response.shape)
    drawing = pole_zero_panels(shown.found.modes, e.omega[lines], e.response[q, lines])
    alt = "Magnitudes of the motors' own FRFs with their poles and zeros"
    return figure("poles", drawing, alt, wide=len(shown.found.masses) > 1)


def _responses(shown: MeasuredChains) -> Figure:
    e, q, modes = shown.frf.estimate, shown.position, shown.found.modes
    kept = e.omega >= modes.data.omega[0]
    fitted = modes.response
    if shown.dampers is not None and not worse_with_dampers(shown):
        fitted = shown.dampers.response
    drawing = response_panels(
        e.omega[kept],
        e.response[q, kept],
        np.sqrt(e.variance[q, kept]),
        fitted,
        shown.frf.motors,
    )
    alt = "Magnitudes and phases of the measured frequency responses and of the identified chains"
    return figure("responses-figure", drawing, alt, wide=len(shown.found.masses) > 2)


def _fitted_words(shown: MeasuredChains) -> str:
    with_dampers = shown.dampers is not None and not worse_with_dampers(shown)
    return "chains with their dampers" if with_dampers else "modes"


def _hertz(omega: float, std: float) -> Number:
    hertz, spread = (float(v) for v in in_hertz(np.array([omega, std])))
    places = min(text.decimals_for(spread), 5)
    return Number(f"{text.fixed(hertz, places)} ± {text.significant(spread, 2)}", hertz)


def _percent(value: float) -> Cell:
    return "given" if value == 0 else Number(text.percent(value), value)


def _significant(value: float) -> Number:
    return Number(text.significant(value, 4), value)
