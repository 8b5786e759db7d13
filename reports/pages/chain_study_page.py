"""The page of a study of coupled chains: the case study of [HBH], or one like it."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from oed.chain_study import paper
from oed.chain_study.run_chain_study import ChainStudyResults
from reports import text
from reports.figures.chain_study_figures import cross_panels, direct_panels
from reports.page_elements import Figure, Section, figure, filled, page
from reports.pages import chain_study_tables as tables
from reports.pages.chains_page import chains_banner
from reports.summaries.chain_study_summary import largest_errors
from robotmodels.common.atomic_files import write_text


def write_chain_study_page(results: ChainStudyResults, path: Path) -> None:
    """Write a study of coupled chains as one HTML file that needs nothing else."""
    count, length = results.truth.masses.shape
    repeats = tables.repeats(results)
    sections = [
        _section("summary", "Summary", results=results, repeats=repeats, facts=_facts(results)),
        _section("responses", "Responses", direct=_direct(results), cross=_cross(results)),
        _section(
            "steps",
            "Poles, zeros, gains",
            frequencies=tables.frequency_table(results),
            gains=tables.gain_table(results),
            steps=tables.step_table(results),
            vectors=tables.vector_table(results),
        ),
        _section("parameters", "Parameters", parameters=tables.parameter_table(results)),
    ]
    if repeats:
        sections.append(_section("errata", "Errata of the paper", errata=paper.ERRATA))
    content = page(
        title=f"{text.plural(count, 'chain')} of {length} masses",
        kind="coupled chains",
        kicker="Hovland, Berglund and Hanssen, section 4, repeated in simulation"
        if repeats
        else "Inverse eigenvalue identification of coupled chains, simulated",
        lead="Masses, springs and couplings from motor torques and angles alone, step by step.",
        sections=sections,
        banner=chains_banner(results.measured),
    )
    write_text(path, content)


def _section(name: str, title: str, **contents: object) -> Section:
    return Section(name, title, filled(f"chain_study_{name}.html.j2", **contents))


def _facts(results: ChainStudyResults) -> dict[str, str]:
    errors = largest_errors(results)
    count, length = results.truth.masses.shape
    return {
        "chains": text.plural(count, "chain"),
        "masses": str(length),
        **{name: text.percent(error) for name, (error, _) in errors.items()},
    }


def _direct(results: ChainStudyResults) -> list[Figure]:
    count = len(results.truth.masses)
    return _figures(results, "Direct responses", ([0], list(range(1, count))), (2, 4))


def _cross(results: ChainStudyResults) -> list[Figure]:
    pairs = list(combinations(range(len(results.truth.masses)), 2))
    return _figures(results, "Cross responses", (pairs[:1], pairs[1:]), (3, 5))


def _figures(
    results: ChainStudyResults,
    what: str,
    groups: Sequence[Sequence[int] | Sequence[tuple[int, int]]],
    numbers: tuple[int, int],
) -> list[Figure]:
    """Return the figures of groups of panels, as they are numbered in the paper."""
    drawn = []
    for group, number in zip(groups, numbers, strict=True):
        if not len(group):
            continue
        like = f" as figure {number} of the paper." if tables.repeats(results) else "."
        if isinstance(group[0], tuple):
            drawing = cross_panels(results, [pair for pair in group if isinstance(pair, tuple)])
        else:
            drawing = direct_panels(results, [int(np.ravel(chain)[0]) for chain in group])
        alt = f"{what}, measured and of the fitted modes, over angular frequency"
        drawn.append(figure(f"figure-{number}", drawing, alt, caption=f"{what}{like}"))
    return drawn
