"""The commands, one module each or several alike; each has a ``register(app)`` that adds them."""

import typer

from reports.commands import (
    campaign,
    chains,
    check,
    deflection,
    export,
    frf,
    hammer,
    identify,
    import_log,
    init,
    margins,
    predict,
    replicate,
    report,
    run,
    schema,
    sensors,
    simulate,
    steps,
    structure,
    view,
)
from reports.commands.quiet import add_quiet

_IN_ORDER = (
    init,
    check,
    run,
    steps,
    structure,
    sensors,
    replicate,
    report,
    view,
    export,
    predict,
    margins,
    simulate,
    campaign,
    import_log,
    frf,
    identify,
    hammer,
    deflection,
    chains,
    schema,
)


def register_all(app: typer.Typer) -> None:
    """Add every command to `app`, in the order in which help lists them."""
    for command in _IN_ORDER:
        command.register(app)
    add_quiet(app)
