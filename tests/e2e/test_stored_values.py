"""The shipped study gives what it gave before the modules were moved into their rooms."""

import json
from pathlib import Path

import numpy as np
import pytest

import estimators
from oed.study.pipeline import fit_study
from oed.study.settings.study_file import load_study

HERE = Path(__file__).parent
STORED = json.loads((HERE / "stored" / "ur10.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_study_of_the_ur10_gives_the_stored_values(tmp_path):
    study = load_study(HERE.parents[1] / STORED["study"])
    results = fit_study(study.model_copy(update={"output": tmp_path}))
    weights = np.zeros_like(results.plan.design.weights)
    for candidate, weight in STORED["weights"].items():
        weights[int(candidate)] = weight
    np.testing.assert_allclose(results.plan.design.weights, weights, atol=1e-5)
    repetitions = results.plan.exact.repetitions
    assert {str(i): repetitions[i] for i in results.plan.used} == STORED["repetitions"]
    for name, search in results.fits.searches.items():
        assert search.result.cost == pytest.approx(STORED["costs"][name], rel=1e-8)
        # Searches end where a step lowers the cost by 1e-10 of it: 2e-3 standard deviations.
        apart = np.log(search.result.parameters.values / STORED["estimates"][name])
        assert np.abs(apart / STORED["theorem1"]).max() < 2e-3
    theorem1 = estimators.covariance(results.fits.result)
    np.testing.assert_allclose(theorem1.std, STORED["theorem1"], rtol=1e-5)
