"""Results on a terminal and in a notebook."""

import numpy as np
import pytest

import estimators
import oed
from estimators.uncertainty.identifiability import identifiability


@pytest.fixture(scope="module")
def results():
    rng = np.random.default_rng(1)
    roots = rng.standard_normal((30, 4, 3))
    info = oed.InformationSet(
        rng.standard_normal((30, 2)), np.swapaxes(roots, 1, 2) @ roots, ("a", "b<c", "d")
    )
    design = oed.optimal_design(info)
    exact = oed.exact_design(info, n_experiments=9, design=design)
    found = np.linalg.inv(exact.information)
    return {
        "design": design,
        "exact": exact,
        "uncertainty": estimators.Uncertainty(info.names, found, "Theorem 1"),
        "identifiability": identifiability(exact.information, info.names),
    }


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("design", ("D-optimal design", "of 30 candidates", "certified gap")),
        ("exact", ("9 experiments in", "efficiency >= 0.")),
        ("uncertainty", ("b<c", "Theorem 1")),
        ("identifiability", ("costs others", "b<c")),
    ],
)
def test_results_print_and_show(results, name, words):
    text = str(results[name])
    assert "array(" not in text
    for word in words:
        assert word in text
    page = results[name]._repr_html_()
    assert page.startswith("<pre>")
    assert "b<c" not in page
    assert page.count("\n") == text.count("\n")
