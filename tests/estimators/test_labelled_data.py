"""FRFs, posteriors and designs as labelled arrays, read by xarray and ArviZ."""

import sys
from dataclasses import replace
from pathlib import Path

import arviz_stats
import numpy as np
import pytest
import xarray
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_frf_estimate import full_covariance

import estimators
import oed
from estimators.sampling.log_posterior import posterior_density
from robotmodels import InvalidInput, RelativeNoise

MODEL = MassSprings()
NOISE = RelativeNoise(relative=0.02, floor=1e-3)


@pytest.fixture(scope="module")
def data() -> estimators.FrfEstimate:
    return estimators.simulate_frf(MODEL, POSITIONS, OMEGA, NOISE, np.random.default_rng(4))


def test_a_posterior_is_read_by_arviz(data: estimators.FrfEstimate, tmp_path: Path) -> None:
    fit = estimators.fit(MODEL, data, residual="nls", weights="optimal")
    rng = np.random.default_rng(5)
    posterior = estimators.sample_posterior(fit, rng=rng, ensembles=2, walkers=32, steps=1500)
    tree = estimators.posterior_tree(fit, posterior, thin=2)
    theta = tree["posterior"]["theta"]
    length = len(posterior.chains[0, ::2])
    assert theta.sizes["draw"] == 32 * length
    assert theta.parameter.values.tolist() == list(fit.parameters.names)
    np.testing.assert_allclose(
        theta.sel(parameter="k2", chain=1).values[:length], np.exp(posterior.chains[1, ::2, 0, 1])
    )
    summary = arviz_stats.summary(tree, round_to="none")
    np.testing.assert_allclose(summary["mean"], theta.mean(("chain", "draw")).values, rtol=1e-6)
    assert summary["r_hat"].max() < 1.1
    lines = tree["log_likelihood"]["response"]
    cost = posterior_density(fit).costs(theta.values[1, 4][None])[0]
    np.testing.assert_allclose(-lines.values[1, 4].sum(), cost, rtol=1e-10)
    assert 2 < arviz_stats.loo(tree).p < 12  # about the number of parameters, 6
    response = tree["observed_data"]
    np.testing.assert_array_equal(
        response["real"].values + 1j * response["imaginary"].values, data.response
    )
    constant = tree["constant_data"]
    np.testing.assert_array_equal(constant["angles"].values, POSITIONS)
    np.testing.assert_allclose(constant["weights"] * constant["variance"], 1.0)
    with pytest.raises(InvalidInput, match="thin: 0;"):
        estimators.posterior_tree(fit, posterior, thin=0)


def test_frfs_have_names_units_and_variances(data: estimators.FrfEstimate) -> None:
    frfs = estimators.frf_dataset(data, ("a", "b"), ("c", "d"))
    chosen = frfs["response"].sel(output="a", input="d").isel(position=2, frequency=5)
    assert chosen.item() == data.response[2, 5, 0, 1]
    assert frfs["response"].attrs["units"] == "rad/s^2/(N m)"
    np.testing.assert_allclose(frfs["frequency"], OMEGA / (2 * np.pi))
    wide = replace(data, covariance=full_covariance(data.response.shape))
    full = estimators.frf_dataset(wide)
    np.testing.assert_allclose(
        full["variance"].values[1, 2, 1, 0], wide.covariance[1, 2, 1, 1].real
    )
    with pytest.raises(InvalidInput, match="outputs: 3 names; the FRFs have 2"):
        estimators.frf_dataset(data, ("a", "b", "c"))


def test_a_design_has_its_candidates() -> None:
    info = oed.information(MODEL, POSITIONS, OMEGA, NOISE)
    design = oed.optimal_design(info)
    labelled = oed.design_dataset(design, info.positions)
    assert isinstance(labelled, xarray.Dataset)
    np.testing.assert_array_equal(labelled["weight"], design.weights)
    whole = oed.design_dataset(oed.exact_design(info, 4), info.positions)
    assert int(whole["experiments"].sum()) == 4
    assert whole["information"].sel(parameter="k1", other_parameter="c1").shape == ()
    with pytest.raises(InvalidInput, match=r"shape \(2, 1\); the design has 3 candidates"):
        oed.design_dataset(design, POSITIONS[:2])


def test_what_is_missing_is_named(
    data: estimators.FrfEstimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InvalidInput, match=r"pip install 'elastic-robot-oed\[arviz\]'"):
        estimators.frf_dataset(data)
