"""The page of ``oed chains``: one HTML file."""

from pathlib import Path

import numpy as np
from markupsafe import Markup

from estimators.chain_dampers.chains_from_records import MeasuredChains
from estimators.chains.model_order import WrongModeCount
from reports import text
from reports.figures.chains_figures import pole_zero_panels, resonance_panels
from reports.figures.response_panels import lines_drawn, response_panels
from reports.page_elements import (
    Figure,
    Section,
    figure,
    filled,
    page,
    page_banner,
)
from reports.pages import chains_tables as tables
from reports.sections.verdict import KINDS
from reports.summaries.chains_summary import method_of, refused, verdict_of
from robotmodels.common.atomic_files import write_text

_CHAINS_STEP = "check the number of masses against the resonances, then measure more blocks"
_CLEARLY_WORSE = 1.5  # misfit of the fit with dampers over that of the modes


def write_chains_page(shown: MeasuredChains, source: Path, path: Path) -> None:
    """Write identified chains as one HTML file that needs nothing else."""
    count, length = shown.identification.masses.shape
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
            banner=chains_banner(shown),
        ),
    )


def chains_banner(shown: MeasuredChains) -> Markup:
    """Return the verdict on identified chains."""
    verdict = verdict_of(shown)
    quotable = verdict.gives_interval
    may = "these numbers may be quoted" if quotable else "do not quote these numbers"
    return page_banner(
        f"{text.sentence(str(verdict))}: {may}",
        KINDS.get(verdict, "refused"),
        text.typeset(text.sentence(verdict.reason)),
        quote=f"Quote the recommended intervals ({method_of(shown)})."
        if quotable
        else "Quote no number of this page.",
        next_step="nothing" if quotable else _CHAINS_STEP,
    )


def write_modes_page(error: WrongModeCount, source: Path, path: Path) -> None:
    """Write the picture of FRFs that show another number of modes than was asked for."""
    drawing = figure(
        "modes",
        resonance_panels(error.omega, error.response, error.resonances),
        f"Magnitudes of the motors' own FRFs and {len(error.resonances)} resonances",
    )
    body = filled("chains_modes.html.j2", error=error, source=source, drawing=drawing)
    write_text(
        path,
        page(
            title=f"{len(error.resonances)} resonances found, {error.expected} expected",
            kind="identified chains",
            kicker="Inverse eigenvalue identification of coupled chains",
            lead="The frequency responses do not show what was asked for.",
            sections=[Section("modes", "Resonances found", body)],
        ),
    )


def chains_sections(shown: MeasuredChains, source: Path) -> list[Section]:
    """Return the sections of the page."""
    identification = shown.identification
    parts: list[tuple[str, str, dict[str, object]]] = [
        ("summary", "Summary", {"facts": _facts(shown), "source": source}),
        ("parameters", "Parameters", {"estimates": tables.parameter_table(shown)}),
        ("modes", "Poles and zeros", {"panels": _poles(shown), "modes": tables.mode_table(shown)}),
        (
            "responses",
            "Frequency responses",
            {"panels": _responses(shown), "words": _fitted_words(shown)},
        ),
    ]
    if shown.dampers is not None:
        ratio = worse_with_dampers(shown)
        damped = {
            "dampers": tables.damper_table(shown),
            "estimates": tables.other_table(shown),
            "worse": text.significant(ratio, 2) if ratio else "",
        }
        parts.insert(2, ("dampers", "Dampers", dict(damped)))
    if identification.order is not None:
        parts.append(("order", "Number of masses", {"orders": tables.order_table(shown)}))
    return [
        Section(name, title, filled(f"chains_{name}.html.j2", shown=shown, **contents))
        for name, title, contents in parts
    ]


def _facts(shown: MeasuredChains) -> dict[str, str]:
    identification = shown.identification
    e = shown.recommended
    hidden = any(map(refused, e.intervals))
    return {
        "chains": text.plural(len(identification.masses), "chain"),
        "lines": text.plural(len(identification.modes.data.omega), "line"),
        "low": text.hertz(identification.modes.data.omega[0]),
        "high": text.hertz(identification.modes.data.omega[-1]),
        "std": "none" if hidden else text.percent(float(np.median(e.relative_std))),
        "condition": text.significant(identification.inverse.condition, 2),
        "misfit": text.significant(identification.misfit, 2),
        "p_value": text.significant(identification.structure_p_value, 2),
        "delay": text.significant(1e6 * identification.modes.delay, 3),
    }


def worse_with_dampers(shown: MeasuredChains) -> float:
    """Return the misfit with dampers over that of the modes if it is clearly more, or 0."""
    if shown.dampers is None or shown.identification.modes.data.scaled:
        return 0.0
    ratio = shown.dampers.misfit / max(shown.identification.modes.misfit, 1e-300)
    return ratio if ratio > _CLEARLY_WORSE else 0.0


def _poles(shown: MeasuredChains) -> Figure:
    e, q = shown.frf.estimate, shown.position
    lines = lines_drawn(e.response.shape)
    drawing = pole_zero_panels(shown.identification.modes, e.omega[lines], e.response[q, lines])
    alt = "Magnitudes of the motors' own FRFs with their poles and zeros"
    return figure("poles", drawing, alt, wide=len(shown.identification.masses) > 1)


def _responses(shown: MeasuredChains) -> Figure:
    e, q, modes = shown.frf.estimate, shown.position, shown.identification.modes
    fitted_lines = e.omega >= modes.data.omega[0]
    fitted = modes.response
    if shown.dampers is not None and not worse_with_dampers(shown):
        fitted = shown.dampers.response
    drawing = response_panels(
        e.omega[fitted_lines],
        e.response[q, fitted_lines],
        np.sqrt(e.variance[q, fitted_lines]),
        fitted,
        shown.frf.motors,
    )
    alt = "Magnitudes and phases of the measured frequency responses and of the identified chains"
    return figure("responses-figure", drawing, alt, wide=len(shown.identification.masses) > 2)


def _fitted_words(shown: MeasuredChains) -> str:
    with_dampers = shown.dampers is not None and not worse_with_dampers(shown)
    return "chains with their dampers" if with_dampers else "modes"
