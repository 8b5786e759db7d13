"""``oed schema``: what may stand in a file, for editors."""

from enum import StrEnum
from typing import Annotated

import typer

from reports.commands.options import say


class Kind(StrEnum):
    """The files that people write."""

    STUDY = "study"
    EXPERIMENT = "experiment"
    ROBOT = "robot"
    CHAIN_STUDY = "chain_study"
    IMPORT = "import"
    DEFLECTION_STUDY = "deflection_study"
    VISIT_STUDY = "visit_study"
    CAMPAIGN = "campaign"
    CONTROLLER = "controller"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(schema)


def schema(
    kind: Annotated[Kind, typer.Argument(help="Kind of file.")] = Kind.STUDY,
) -> None:
    """Print the JSON Schema of a file, with which an editor completes and checks it.

    Example: oed schema study > study.schema.json
    """
    from reports.commands.schemas import json_schema

    say(str, lambda: json_schema(kind.value), as_json=True)
