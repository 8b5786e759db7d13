"""The page of what a fit predicts of a tool: compliance, modes, responses, maps."""

from pathlib import Path

from markupsafe import Markup

from estimators.trust.trust import Trust
from estimators.validation.predict_tool import ToolPrediction
from reports.figures.prediction_figures import driving_point, workspace
from reports.page_elements import Figure, Section, Table, figure, filled, page
from reports.sections.tool import prediction_table
from reports.sections.verdict import bands_banner
from robotmodels.common.atomic_files import write_text

_SHOWN = 6
"""Positions whose responses are drawn."""


def write_prediction_page(
    prediction: ToolPrediction, name: str, spread: str, path: Path, trust: Trust | None = None
) -> None:
    """Write a prediction as one HTML file that needs nothing else.

    Parameters
    ----------
    spread : str
        What the bands rest on, in words.
    trust : Trust, optional
        Of the fit that predicts; None of a robot file.
    """
    frame = prediction.frame
    where = f"{frame.link} at {', '.join(f'{x:g}' for x in frame.at)} m, axes of the {frame.axes}"
    sections = [
        Section("positions", "Compliance and modes", _body([], prediction_table(prediction)))
    ]
    if prediction.response is not None:
        count = min(len(prediction.points), _SHOWN)
        sections.append(Section("responses", "Responses", _body(_responses(prediction, count))))
    if len(prediction.points) > _SHOWN:
        alt = "Compliance, lowest resonance, its damping, and their deviations, over the workspace"
        drawing = figure("workspace", workspace(prediction), alt, wide=True)
        sections.append(Section("map", "Over the workspace", _body([drawing])))
    lead = f"What the identified parameters say of {where}, with {prediction.compliance.level:.0%} "
    lead += f"bands of what they leave open ({spread}); errors of the model are not in them."
    banner = bands_banner(prediction.compliance.level, trust)
    content = page(name, "prediction", "How stiff the tool is", lead, sections, banner)
    write_text(path, content)


def _responses(prediction: ToolPrediction, count: int) -> list[Figure]:
    alt = "Magnitude over frequency along x, y and z with bands"
    return [
        figure(f"response-{i + 1}", driving_point(prediction, i), alt, label=f"position {i + 1}")
        for i in range(count)
    ]


def _body(figures: list[Figure], shown: Table | None = None) -> Markup:
    return filled("prediction.html.j2", figures=figures, table=shown)
