"""Two stages of work at the same time."""

import threading

import pytest

from oed.information_sets.compute import pipelined_map


def test_results_come_in_order():
    assert list(pipelined_map(lambda x: x + 1, lambda x: 2 * x, range(5))) == [2, 4, 6, 8, 10]
    assert list(pipelined_map(str, str, [])) == []


def test_the_first_stage_of_an_item_runs_beside_the_second_of_the_one_before():
    first_of_one, here = threading.Event(), threading.get_ident()

    def first(item):
        assert threading.get_ident() == here
        if item == 1:
            first_of_one.set()
        return item

    def second(item):
        assert threading.get_ident() != here
        # Item 0 ends only once item 1 has begun: one after the other would wait for ever.
        assert item > 0 or first_of_one.wait(120)
        return item

    assert list(pipelined_map(first, second, range(3))) == [0, 1, 2]


@pytest.mark.parametrize("stage", [0, 1])
def test_errors_of_both_stages_arrive(stage):
    def fails(item):
        if item == 2:
            raise ZeroDivisionError(item)
        return item

    stages = [fails, int] if stage == 0 else [int, fails]
    found = []
    with pytest.raises(ZeroDivisionError, match="2"):
        found.extend(pipelined_map(*stages, range(4)))
    assert found in ([], [0], [0, 1])
