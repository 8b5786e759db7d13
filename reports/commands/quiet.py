"""The option ``--quiet``, which every command has."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer

from reports.summaries.progress import QUIET

HELP = "No progress on the standard error; warnings and errors are still shown."
Quiet = Annotated[bool, typer.Option("--quiet", help=HELP)]


def add_quiet(app: typer.Typer) -> None:
    """Give the option to every command of `app` and of its groups."""
    for command in app.registered_commands:
        if command.callback is not None:
            command.callback = _with_quiet(command.callback)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            add_quiet(group.typer_instance)


def _with_quiet(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with one more option, which it does not see."""

    @wraps(callback)
    def command(*args: Any, quiet: bool, **options: Any) -> Any:
        if quiet:
            QUIET.set(True)
        return callback(*args, **options)

    signature = inspect.signature(callback, eval_str=True)
    option = inspect.Parameter(
        "quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet
    )
    parameters = [*signature.parameters.values(), option]
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command
