"""Share positions out over threads: compiled code that lets go of the interpreter."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from multiprocessing import parent_process

import numba

WORTHWHILE = 200
"""Fewest vectors of frequencies per thread; below that, starting it costs more than it saves."""


def over_threads(
    run: Callable[[int, int], None], n_items: int, work_per_item: int, shares: int = 1
) -> None:
    """Call ``run(start, stop)`` on pieces of ``range(n_items)``, in this thread and in others.

    With several `shares` for each thread, a delayed thread leaves its shares to the others. At most
    `numba.get_num_threads` at once, and one in the processes of a pool, which fills the cores
    by itself; `work_per_item` counts vectors of frequencies to solve at. The threads end with the
    call: a kept pool, or numba's own, would not survive in a forked process.
    """
    allowed = numba.get_num_threads() if parent_process() is None else 1
    threads = min(allowed, n_items, n_items * work_per_item // WORTHWHILE)
    if threads <= 1:
        run(0, n_items)
        return
    count = min(threads * shares, n_items)
    pieces = iter(list(pairwise(n_items * i // count for i in range(count + 1))))

    def work() -> None:
        for piece in pieces:
            run(*piece)

    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(work) for _ in range(threads - 1)]
        work()
        for other in others:
            other.result()
