"""Progress of long computations: bars on a terminal, a line for each stage elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import datetime
from functools import partial
from typing import TextIO

from robotmodels.common.progress import Progress, StageProgress

QUIET: ContextVar[bool] = ContextVar("quiet", default=False)
"""Whether nothing is told of progress."""


@contextmanager
def progress_bars() -> Iterator[StageProgress | None]:
    """Give a function that shows how far each stage is, or None where that is not asked for."""
    if QUIET.get():
        yield None
        return
    from rich.console import Console  # it takes a tenth of a second, which help does without

    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield stage_lines(sys.stderr)
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

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


@contextmanager
def progress_of(stage: str) -> Iterator[Progress | None]:
    """Give a function that shows how far one stage is, or None where that is not asked for."""
    with progress_bars() as bars:
        yield None if bars is None else partial(bars, stage)


def stage_lines(stream: TextIO) -> StageProgress:
    """Return a function that writes a line with the time when a stage begins."""
    begun: set[str] = set()

    def report(stage: str, done: int, total: int) -> None:
        if stage in begun or done == total > 0:  # which tells of a stage that was stored before
            return
        begun.add(stage)
        stream.write(f"{datetime.now():%Y-%m-%d %H:%M:%S}  {stage}\n")
        stream.flush()

    return report
