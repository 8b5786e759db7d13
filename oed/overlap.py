"""Overlap two stages of work: the first holds the interpreter, the second lets go of it."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Half = TypeVar("Half")
Whole = TypeVar("Whole")


def overlapped(
    first: Callable[[Item], Half], second: Callable[[Half], Whole], items: Iterable[Item]
) -> Iterator[Whole]:
    """Yield ``second(first(item))`` of each item, in order, one item ahead.

    `first` (as a rule `network`, by Pinocchio) is called here, `second` (the compiled kernel) in
    a thread, at the same time as `first` of the next item. What either raises, this raises.
    """
    with ThreadPoolExecutor(1) as thread:
        running: Future[Whole] | None = None
        for item in items:
            half = first(item)
            done, running = running, thread.submit(second, half)
            if done is not None:
                yield done.result()
        if running is not None:
            yield running.result()
