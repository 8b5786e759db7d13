"""Tables of a study of coupled chains, beside the paper's numbers where it repeats the paper."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from oed.chain_study import paper
from oed.chain_study.run_chain_study import ChainStudyResults
from reports import text
from reports.page_elements import Cell, Column, Number, Table, numbers, table
from reports.pages.chains_tables import by_chain, significant
from reports.summaries.chains_summary import refused

Groups = list[tuple[str, tuple[tuple[Cell, ...], ...]]]


def frequency_table(results: ChainStudyResults) -> Table:
    """Return resonances and each chain's anti-resonances, (5) and (6)."""
    modes = results.measured.identification.modes
    spectra = [(modes.omega, modes.omega_std), *zip(modes.zeros, modes.zeros_std, strict=True)]
    names = ["λ", *(f"λ₀, chain {i + 1}" for i in range(len(modes.zeros)))]
    printed = (paper.RESONANCES, *paper.ANTI_RESONANCES)
    rows = []
    for r in range(len(modes.omega)):
        row: list[Cell] = [Number(str(r + 1), r + 1)]
        for k, (values, std) in enumerate(spectra):
            row += _printed(results, printed, k, r, 2)
            row.append(_with_std(float(values[r]), float(std[r])))
        rows.append(row)
    caption = "Square roots of λ and λ₀ [rad/s], fitted, with one standard deviation."
    return table("frequency-table", caption, _columns(results, "mode", names), rows)


def gain_table(results: ChainStudyResults) -> Table:
    """Return the gains A_H, A_L and A_C read off, with what the simulated chains have."""
    responses, truth = results.responses, results.truth
    pairs = list(combinations(range(len(truth.masses)), 2))
    low, high = 1 / truth.masses.sum(axis=1), 1 / truth.masses[:, 0]
    coupled = np.diag(truth.masses.sum(axis=1)) + truth.couplings
    cross = [np.linalg.inv(coupled[np.ix_(pair, pair)])[0, 1] for pair in pairs]
    single = [f"chain {i + 1}" for i in range(len(low))]
    double = [f"chains {i + 1} and {j + 1}" for i, j in pairs]
    parts = (
        (
            "A_H, (3)",
            single,
            paper.HIGH_GAINS,
            responses.high,
            responses.high_std,
            high,
        ),
        ("A_L, (2)", single, paper.LOW_GAINS, responses.low, responses.low_std, low),
        ("|A_C|, (7)", double, paper.CROSS_GAINS, responses.cross_low, responses.cross_std, cross),
    )
    groups: Groups = []
    for title, names, printed, values, deviations, exact in parts:
        cells = [
            (
                name,
                *_printed(results, [printed], 0, k, 3),
                _with_std(abs(float(values[k])), float(deviations[k])),
                significant(abs(float(exact[k]))),
            )
            for k, name in enumerate(names)
        ]
        if cells:
            groups.append((title, tuple(cells)))
    caption = "Gains read off the responses [1/kg], other chains held at low frequency."
    columns = [Column("of"), *numbers(*_paper_column(results), "found", "simulated")]
    return Table("gain-table", caption, tuple(columns), tuple(groups))


def step_table(results: ChainStudyResults) -> Table:
    """Return B11, B12 and B22 of each chain, (14) to (16)."""
    names = [f"chain {i + 1}" for i in range(len(results.steps))]
    rows = []
    for name, printed in (("b11", paper.B11), ("b12", paper.B12), ("b22", paper.B22)):
        row: list[Cell] = [name.upper()]
        for i, one in enumerate(results.steps):
            row += _printed(results, [printed], 0, i, None)
            row.append(_five_digits(getattr(one.step, name)))
        rows.append(row)
    caption = "First step of the Lanczos algorithm [1/s²]."
    return table("step-table", caption, _columns(results, "element", names), rows)


def vector_table(results: ChainStudyResults) -> Table:
    """Return u1, d2 and u2 of each chain, (13) to (15), mode by mode."""
    names = [f"chain {i + 1}" for i in range(len(results.steps))]
    groups: Groups = []
    for title, printed, vectors in (
        ("u₁", paper.FIRST_COMPONENTS, [one.first for one in results.steps]),
        ("d₂ [1/s²]", paper.D2, [one.step.d2 for one in results.steps]),
        ("u₂", paper.SECOND_COMPONENTS, [one.step.u2 for one in results.steps]),
    ):
        rows = []
        for r in range(len(vectors[0])):
            row: list[Cell] = [Number(str(r), r)]
            for i, vector in enumerate(vectors):
                row += _printed(results, printed, i, r, None)
                row.append(significant(float(vector[r])))
            rows.append(tuple(row))
        groups.append((title, tuple(rows)))
    caption = "Vectors of that step; mode 0 is the rigid one."
    columns = tuple(_columns(results, "mode", names))
    return Table("vector-table", caption, columns, tuple(groups))


def parameter_table(results: ChainStudyResults) -> Table:
    """Return masses, springs and couplings: printed, simulated, and estimated in three ways."""
    stepwise, best = results.stepwise, results.measured.recommended
    rows: list[tuple[Cell, ...]] = []
    for k, interval in enumerate(best.intervals):
        hidden = refused(interval)
        low, high = (
            "–" if end is None else _five_digits(end) for end in (interval.low, interval.high)
        )
        value = paper.PARAMETERS[interval.name] if repeats(results) else 0.0
        printed = [Number(f"{value:g}", value)] if repeats(results) else []
        rows.append(
            (
                interval.name,
                *printed,
                significant(float(results.true_values[k])),
                significant(float(results.read_off[k])),
                _with_std(float(stepwise.values[k]), float(stepwise.std[k])),
                "not quoted"
                if hidden
                else Number(text.significant(interval.value, 5), interval.value),
                low,
                high,
                "N/m" if interval.name.startswith("K") else "kg",
            )
        )
    titles = ("simulated", "gains read off", "step by step", "most likely", "95 % from", "to")
    columns = [
        Column("parameter", code=True),
        *numbers(*_paper_column(results), *titles),
        Column("unit", "u"),
    ]
    caption = f"Masses, springs and couplings. Most likely: {best.method}."
    groups = by_chain(best.layout, rows)
    return Table("study-parameters", caption, tuple(columns), groups)


def repeats(results: ChainStudyResults) -> bool:
    """Return whether a study repeats the paper's, so that both numbers stand side by side."""
    return results.study.compare_with is not None


def _columns(results: ChainStudyResults, first: str, names: Sequence[str]) -> list[Column]:
    """Return a first column, and for each name one of what is found, after the printed one."""
    columns = [Column(first)]
    for name in names:
        columns += numbers(*(f"{name}, {part}" for part in (*_paper_column(results), "found")))
    return columns


def _paper_column(results: ChainStudyResults) -> list[str]:
    return ["printed"] if repeats(results) else []


def _printed(
    results: ChainStudyResults,
    values: Sequence[Sequence[float]],
    row: int,
    column: int,
    decimals: int | None,
) -> list[Cell]:
    """Return a printed number as a cell, or no cell where no paper is repeated."""
    if not repeats(results):
        return []
    value = values[row][column]
    if decimals is None:
        return [Number(f"{value:g}".replace("-", text.MINUS), value)]
    return [Number(text.fixed(value, decimals), value)]


def _five_digits(value: float) -> Number:
    return Number(text.significant(value, 5), value)


def _with_std(value: float, std: float) -> Number:
    decimals = min(text.decimals_for(std), 8)
    return Number(f"{text.fixed(value, decimals)} ± {text.fixed(std, decimals)}", value)
