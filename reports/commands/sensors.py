"""``oed sensors``: which sensors are worth their price."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.options import WORKERS, AsJson, Workers, say
from reports.commands.studies import StudyFile, read_study, working
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from oed.design.sensors import SensorDesign


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(sensors)


def sensors(
    study: StudyFile,
    budget: Annotated[float, typer.Option(help="Largest sum of prices.", min=0.0)],
    price: Annotated[
        list[str] | None,
        typer.Option(help="Price of an output of the robot file, NAME=PRICE; 1 by default."),
    ] = None,
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Select sensors to add to the motor encoders within a budget, for a study.

    Each set of sensors is evaluated by its optimal design over the study's candidates.

    Example: oed sensors study.yaml --price tip=900 --price elbow=400 --budget 1000
    """
    prices = read_prices(price or [])
    content = read_study(study)
    from oed.study.sensors import choose_sensors

    with working(study, workers, None) as (progress, executor):
        choice = choose_sensors(content, prices, budget, progress, executor)
    say(lambda: _summary(choice), lambda: _document(choice), as_json)


def read_prices(words: Sequence[str]) -> dict[str, float]:
    """Return prices by name of ``NAME=PRICE``.

    Raises
    ------
    InvalidInput
        Naming what is no such pair, or no price.
    """
    prices = {}
    for word in words:
        name, equals, value = word.rpartition("=")
        try:
            prices[name] = float(value)
        except ValueError:
            equals = ""
        if not (equals and name and 0 <= prices[name] < float("inf")):
            raise InvalidInput(f"--price {word}: NAME=PRICE is needed, such as tip=900")
    return prices


def _summary(choice: "SensorDesign") -> str:
    from reports.summaries.columns import number, table

    rows = [
        (name, "yes" if name in choice.sensors else "", number(factor, 3))
        for name, factor in choice.relative_efficiency.items()
    ]
    header = ("sensor", "bought", "efficiency without it,\nor with it added")
    return "\n".join(
        [
            f"{', '.join(choice.sensors) or 'no sensor'}, for {choice.cost:g}",
            f"  {choice.tried} choices by {choice.design.criterion}, efficiency >= "
            f"{100 * choice.efficiency:.2f} %",
            *table(header, rows, right=(2,)),
        ]
    )


def _document(choice: "SensorDesign") -> dict[str, object]:
    return {
        "sensors": list(choice.sensors),
        "cost": choice.cost,
        "criterion": choice.design.criterion,
        "efficiency": choice.efficiency,
        "relaxed_efficiency": choice.relaxed_efficiency,
        "relative_efficiency": dict(choice.relative_efficiency),
        "usage": dict(choice.usage),
        "tried": choice.tried,
    }
