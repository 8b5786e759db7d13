"""Progress bars on a terminal, silence elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from robotmodels.common.progress import StageProgress


@contextmanager
def progress_bars() -> Iterator[StageProgress | None]:
    """Give a function that shows how far each stage is, or None where nobody watches."""
    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield None
        return
    columns = (
        TextColumn("{task.description:<12}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None)
            elif bars.tasks[tasks[stage]].finished:
                return  # it counted its own steps
            # A total of zero announces a stage of unknown length: the bar pulses.
            bars.update(tasks[stage], completed=done, total=total or None)

        yield report
