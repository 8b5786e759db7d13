"""One module per command; each has a ``register(app)`` that adds it to the command line."""

import typer

from reports.commands import (
    chains,
    check,
    design,
    fit,
    frf,
    init,
    report,
    run,
    sample,
    schema,
    simulate,
)

_IN_ORDER = (init, check, run, design, fit, sample, report, simulate, frf, chains, schema)


def register_all(app: typer.Typer) -> None:
    """Add every command to `app`, in the order in which help lists them."""
    for command in _IN_ORDER:
        command.register(app)
