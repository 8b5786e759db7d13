"""A small version of `make trust`: whether intervals cover and verdicts are true, some cells."""

import numpy as np
import pytest
from trust_cells import GROUPS, Cell, known_noise_std, linearisation_of, runs
from trust_results import failures, summary

RUNS = 120
ROBUST = 4.5  # standard errors by which a figure of so few runs may miss what is asked of many


def figures(cell, count=RUNS):
    return summary(cell, runs(cell, 0, count), known_noise_std(cell, linearisation_of(cell)))


def share_below(limit, count):
    """Return the largest share that a true one of `limit` shows by chance."""
    return limit + ROBUST * np.sqrt(limit * (1 - limit) / count)


@pytest.mark.parametrize(
    "cell",
    [
        Cell("moberg", 2),
        Cell("moberg", 4, (2, 1), "noise", "lls", "user"),
        Cell("chain", 3, weights="combined"),
        Cell("chain", 4, full=True),
        Cell("manutec", 4),
        Cell("moberg", 0, correlation=0.6),
        Cell("chain", 4, correlation=0.9),
        Cell("moberg", 0, factor=3.0),
    ],
    ids=lambda cell: cell.name,
)
def test_intervals_of_a_right_model_cover(cell):
    result = figures(cell)
    errors = RUNS * len(result["coverage"]) / 3  # estimates of a study hang together
    coverage = float(np.mean(result["coverage"]))
    assert 1 - share_below(0.05, errors) < coverage <= 0.998
    assert float(np.mean(result["quarter"])) < 0.6
    assert result["verdicts"].get("model error", 0) < share_below(0.02, RUNS)
    white = not cell.correlation and cell.factor == 1
    expected = "trustworthy" if white else "noise correlated" if cell.correlation else None
    if expected is None:
        # Of parameters whose std the larger noise takes beyond one, the other verdict is right.
        wide = result["verdicts"].get("not identifiable", 0)
        assert result["verdicts"]["noise understated"] + wide > 0.95
        assert wide < 0.2
    else:
        assert result["verdicts"][expected] > 1 - share_below(0.03, RUNS)


@pytest.mark.parametrize(
    "cell",
    [
        Cell("moberg", 4, wrong="delay .1 ms"),
        Cell("chain", 0, wrong="missing masses, soft"),
        Cell("manutec", 4, wrong="hardening"),
        Cell("chain", 20, wrong="outliers"),
    ],
    ids=lambda cell: cell.name,
)
def test_a_wrong_model_gives_no_interval(cell):
    assert figures(cell, 40)["verdicts"].get("model error", 0) > 0.9


@pytest.mark.parametrize("blocks", [3, 6])
def test_weights_and_variances_of_the_line_itself_fail(blocks):
    """Negative control: the engine sees intervals that are too short."""
    cell = Cell("chain", blocks, rule="former")
    result = figures(cell)
    assert failures(Cell("chain", blocks), result)
    assert float(np.mean(result["coverage"])) < 0.92


def test_all_cells_are_listed_once():
    cells = [cell for listed in GROUPS.values() for cell in listed()]
    assert len({cell.name for cell in cells}) == len(cells)
    assert sum(cell.complete for cell in cells) == 12
