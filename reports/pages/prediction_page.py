"""The page of what a fit predicts of a tool: compliance, modes, responses, maps."""

from pathlib import Path

from markupsafe import Markup

from estimators.trust.trust import Trust
from estimators.validation.predict_tool import ToolPrediction
from reports import text
from reports.figures.prediction_figures import driving_point, workspace
from reports.page_elements import Figure, Section, Table, figure, filled, page
from reports.sections.tool import prediction_table
from reports.sections.verdict import bands_banner
from robotmodels.common.arrays import Array
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
    sections = []
    if len(prediction.points) > _SHOWN:
        alt = "Compliance, lowest resonance, its damping, and their deviations, over the workspace"
        caption = "Each dot is a position; all standard deviations are relative."
        drawing = figure("workspace", workspace(prediction), alt, caption=caption, wide=True)
        sections.append(Section("map", "Over the workspace", _body([drawing])))
    if prediction.response is not None:
        count = min(len(prediction.points), _SHOWN)
        drawings = _responses(prediction, count)
        sections.append(Section("responses", "Responses", _body(drawings)))
    table = prediction_table(prediction)
    sections.append(Section("positions", "Compliance and modes", _body([], table)))
    level = text.level(prediction.compliance.level)
    lead = f"What the identified parameters say of {where}, with {level} "
    lead += f"bands of their remaining uncertainty ({spread}); errors of the model are not in them."
    banner = bands_banner(prediction.compliance.level, trust)
    content = page(name, "prediction", "How stiff the tool is", lead, sections, banner)
    write_text(path, content)


def _responses(prediction: ToolPrediction, count: int) -> list[Figure]:
    frame = prediction.frame
    alt = "Magnitude over frequency along x, y and z with bands"
    caption = (
        f"{prediction.motion.capitalize()} of {frame.link} per force along the same axis of the "
        f"{frame.axes}, motors {prediction.motors}. "
        f"Shaded: {text.level(prediction.compliance.level)} bands; "
        "below: relative standard deviation of the magnitude."
    )
    return [
        figure(
            f"response-{i + 1}",
            driving_point(prediction, i),
            alt,
            caption=caption,
            label=f"Position {i + 1}: tool at {_words(point)} m",
        )
        for i, point in enumerate(prediction.points[:count])
    ]


def _words(point: Array) -> str:
    return ", ".join(text.fixed(float(x), 2) for x in point)


def _body(figures: list[Figure], shown: Table | None = None) -> Markup:
    return filled("prediction.html.j2", figures=figures, table=shown)
