"""The application behind ``oed``: its commands are the modules of `reports.commands`.

Exit codes: 0 when all went well; 2 for a mistake in a command or a file; 1 for what is nobody's
mistake, such as a full disk; 130 when interrupted, 128 + n when ended by signal n.
"""

import re
import sys
from concurrent.futures.process import BrokenProcessPool
from typing import Annotated

import typer

from reports.commands import register_all
from reports.commands.options import fail
from reports.commands.quiet import HELP
from reports.commands.stopping import watched_signals
from reports.summaries.progress import QUIET
from robotmodels.common.errors import IdentificationError
from robotmodels.common.file_paths import disk_full, reason

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Optimal experiment design and uncertainty for elastic robots.\n\n"
    "Example: oed run studies/ur10.yaml",
    epilog="Exit codes: 0 done, 1 failed, 2 a mistake in the command or a file, 130 interrupted.",
)
register_all(app)


_DISK_FULL = "the disk is full; free some space and run the same command again"


def _version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"oed {version('elastic-robot-oed')}")
        raise typer.Exit


@app.callback()
def _oed(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Print the version and end."
        ),
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help=HELP)] = False,
) -> None:
    """Take the options before a command."""
    QUIET.set(quiet)


def run() -> None:
    """Run the command that was typed; a user's mistake ends in one line and exit code 2."""
    try:
        with watched_signals():
            code = app(standalone_mode=False) or 0
        sys.exit(code)
    except IdentificationError as error:
        if disk_full(error):
            fail(_DISK_FULL, 1)
        fail(str(error), 2)
    except typer.TyperException as error:
        if message := _usage(error):
            fail(message, error.exit_code)
        sys.exit(error.exit_code)  # help was shown
    except BrokenProcessPool:
        fail("a worker process was killed, possibly out of memory; try --workers 1", 1)
    except (OSError, RuntimeError) as error:  # HDF5 raises either
        if disk_full(error):
            fail(_DISK_FULL, 1)
        if not (isinstance(error, OSError) and error.filename):
            raise
        fail(f"{error.filename}: {reason(error)}", 1)


def _usage(error: typer.TyperException) -> str:
    """Return what is wrong with the command and which help says more; nothing if help was shown."""
    message = " ".join(error.format_message().replace("Value error, ", "").split())
    message = re.sub(r"Input should be a valid integer.*", "a whole number is needed", message)
    message = re.sub(r"\. Did you mean (.*\?)", r" (did you mean \1)", message)
    message = message.removesuffix(".")
    context = getattr(error, "ctx", None)
    see = f"see {context.command_path if context else 'oed'} --help"
    return f"{message[0].lower()}{message[1:]}; {see}" if message else ""
