"""The design: how good the chosen positions are, and the proof of it."""

from oed.study.pipeline import StudyResults
from reports import figures, text
from reports.parts import Section, figure
from reports.template import filled


def section(results: StudyResults) -> Section | None:
    """Return the section; none where the positions were given with the data."""
    if results.study.data.measured:
        return None
    design = results.design
    sensitivity = figure(
        "sensitivity",
        # Per share of all experiments, whether weights are shares or experiments.
        figures.sensitivity_function(design.sensitivity * design.weights.sum(), design.support),
        "Sensitivity of every candidate position in falling order, those of the design marked",
    )
    body = filled(
        "design.html.j2",
        results=results,
        count=len(results.information.positions),
        parameters=len(design.names),
        positions=len(results.used),
        experiments=int(results.exact.repetitions.sum()),
        gap=text.significant(design.gap, 2),
        efficiency=text.efficiency(results.exact.efficiency),
        sensitivity=sensitivity,
    )
    return Section("design", "Design", body)
