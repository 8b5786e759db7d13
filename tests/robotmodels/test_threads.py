"""Work shared out over threads: all of it once, and errors come through."""

import threading
from collections.abc import Iterator

import numba
import pytest
from hypothesis import given, strategies as st

from robotmodels.kernel.threads import WORTHWHILE, over_threads


@pytest.fixture(autouse=True, scope="module")
def all_threads() -> Iterator[None]:
    before = numba.get_num_threads()
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    yield
    numba.set_num_threads(before)


@given(items=st.integers(0, 100), work=st.sampled_from([1, WORTHWHILE]), shares=st.integers(1, 200))
def test_all_items_are_worked_on_once(items: int, work: int, shares: int) -> None:
    seen: list[int] = []
    over_threads(lambda start, stop: seen.extend(range(start, stop)), items, work, shares)
    assert sorted(seen) == list(range(items))


def test_little_work_stays_in_this_thread() -> None:
    threads: list[threading.Thread] = []
    over_threads(lambda *_: threads.append(threading.current_thread()), 100, 1, 4)
    assert set(threads) == {threading.current_thread()}


def test_an_error_in_a_thread_is_raised() -> None:
    def fail(start: int, stop: int) -> None:
        if stop == 100:
            raise ZeroDivisionError(f"{start} to {stop}")

    with pytest.raises(ZeroDivisionError):
        over_threads(fail, 100, WORTHWHILE, 2)
