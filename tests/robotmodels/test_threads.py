"""Work shared out over threads: all of it once, and errors come through."""

from itertools import pairwise

import pytest

from robotmodels.kernel import threads


@pytest.mark.parametrize(("shares", "pieces"), [(1, 3), (4, 12)])
def test_pieces_cover_everything_once(
    shares: int, pieces: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("numba.get_num_threads", lambda: 3)
    seen: list[tuple[int, int]] = []
    threads.over_threads(lambda *piece: seen.append(piece), 100, threads.WORTHWHILE, shares)
    seen.sort()
    assert len(seen) == pieces
    assert (seen[0][0], seen[-1][1]) == (0, 100)
    assert all(before[1] == after[0] for before, after in pairwise(seen))


def test_little_work_stays_in_this_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.get_num_threads", lambda: 3)
    seen: list[tuple[int, int]] = []
    threads.over_threads(lambda *piece: seen.append(piece), 100, 1, 4)
    assert seen == [(0, 100)]


def test_an_error_in_a_thread_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.get_num_threads", lambda: 3)

    def fail(start: int, stop: int) -> None:
        raise ZeroDivisionError(f"{start} to {stop}")

    with pytest.raises(ZeroDivisionError):
        threads.over_threads(fail, 100, threads.WORTHWHILE, 2)
