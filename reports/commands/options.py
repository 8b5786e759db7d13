"""Options that several commands share, and how a command ends: with text or with JSON."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from reports.commands.workers import available_cores
from robotmodels.common.errors import IdentificationError
from robotmodels.common.printing import printable

Workers = Annotated[
    int,
    typer.Option(min=1, max=1024, help="Number of processes; 1 computes in this one."),
]
AsJson = Annotated[
    bool,
    typer.Option("--json", help="Print the summary as JSON, in SI units, for scripts."),
]
WORKERS = available_cores()
_LONGEST = 1000
"""Line of error [characters]."""

Records = Annotated[Path, typer.Argument(help="Records: .h5, .mat or .csv.")]
Delay = Annotated[
    float,
    typer.Option(min=-1e3, max=1e3, help="Delay of the angles after the torques, in s."),
]
Hold = Annotated[
    bool,
    typer.Option("--hold/--no-hold", help="Zero-order-hold correction, for commanded torques."),
]
BesideRecords = Annotated[
    Path | None, typer.Option("-o", "--output", help="Folder; by default that of the records.")
]


def say(text: Callable[[], str], document: Callable[[], Any], as_json: bool) -> None:
    """Print the summary for people, or the one for scripts."""
    if not as_json:
        typer.echo(printable(text()))
        return
    from robotmodels.common.plain_data import json_text  # loads numpy, which help does without

    typer.echo(printable(json_text(document())))


def warn(warnings: Iterable[str]) -> None:
    """Print warnings beside the summary."""
    for warning in warnings:
        typer.echo(f"warning: {printable(warning)}", err=True)


def fail(message: str, code: int) -> NoReturn:
    """End with one line of error."""
    line = printable(message).replace("\n", "\\n")  # of a path, say
    if len(line) > _LONGEST:  # a key or a name in it; file and remedy stand at the ends
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
    sys.stderr.write(f"error: {line}\n")
    sys.exit(code)


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Name the file that a command works on in errors that do not."""
    try:
        yield
    except IdentificationError as error:
        if str(path) in str(error):
            raise
        raise IdentificationError(f"{path}: {error}") from error


def robot_names(incomplete: str) -> list[str]:
    """Return built-in robots for the shell to complete."""
    from robotmodels import builtin_robots

    return [name for name in builtin_robots() if name.startswith(incomplete)]
