import numpy as np
import pytest
from mass_springs import OMEGA, MassSprings
from noisy_runs import noisy_runs
from test_frf_estimate import full_covariance
from test_least_squares import MODEL, TRUTH, exact, noisy

from estimators import Prior, covariance, fit, multistart, read_fits, write_fits
from robotmodels import CoupledChains, InvalidInput

FIELDS = ("residual", "cost", "status", "message", "evaluations", "loss", "converged")


def fits(estimate):
    prior = Prior(("k1", "c2"), np.array([800.0, 2.0]), np.array([0.1, 0.5]))
    failed = multistart(MassSprings(weakest=1e3), estimate, [TRUTH])
    return (
        *multistart(MODEL, estimate, [TRUTH, TRUTH * 1.1]),
        fit(MODEL, estimate, "nls", "optimal", prior=prior),
        fit(MODEL, estimate, "lls_magnitude", positions=[2, 0], loss="huber"),
        fit(MODEL, estimate, "lls", full_covariance((3, len(OMEGA), 2, 2))),
        *failed,
    )


def test_every_bit_of_a_fit_comes_back(tmp_path):
    estimate = noisy()
    written = fits(estimate)
    path = tmp_path / "fits.h5"
    write_fits(path, written)
    read = read_fits(path, MODEL, estimate)
    for a, b in zip(written, read, strict=True):
        assert [getattr(a, n) for n in FIELDS] == [getattr(b, n) for n in FIELDS]
        for name in ("weights", "start", "bounds"):
            assert np.array_equal(getattr(a, name), getattr(b, name))
            assert getattr(b, name).dtype == getattr(a, name).dtype
        assert a.parameters.names == b.parameters.names
        assert np.array_equal(a.parameters.values, b.parameters.values)
        assert np.array_equal(a.estimate.response, b.estimate.response)
        assert (a.prior is None) == (b.prior is None)
        if a.converged:
            assert np.array_equal(covariance(a).covariance, covariance(b).covariance)
    assert read[2].prior.names == ("k1", "c2")
    assert np.array_equal(read[2].prior.std, written[2].prior.std)
    assert read[0].estimate is estimate
    assert read[0].weights.base is read[1].weights.base  # shared ones are stored once
    write_fits(path, written[:1])
    assert len(read_fits(path, MODEL, estimate)) == 1


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(InvalidInput, match="no fits to write"):
        write_fits(tmp_path / "fits.h5", [])
    (one,) = multistart(MODEL, exact(), [TRUTH])
    chains = CoupledChains(np.ones((1, 2)), np.ones((1, 1)), np.zeros((1, 1)), np.ones((1, 1)))
    other = fit(chains, _of(chains))
    with pytest.raises(InvalidInput, match="fits of different parameters"):
        write_fits(tmp_path / "fits.h5", [one, other])
    assert not list(tmp_path.iterdir())


def _of(model):
    from estimators import simulate_frf
    from robotmodels import RelativeNoise

    return simulate_frf(
        model, np.zeros((1, 0)), np.array([0.5, 1.0]), RelativeNoise(), np.random.default_rng(0)
    )


def test_files_that_do_not_fit_are_refused(tmp_path):
    import h5py

    estimate, path = noisy(), tmp_path / "fits.h5"
    with pytest.raises(InvalidInput, match="no such file"):
        read_fits(path, MODEL, estimate)
    path.write_text("nothing")
    with pytest.raises(InvalidInput, match="not an HDF5 file; fits are needed"):
        read_fits(path, MODEL, estimate)
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "frf/1"
    with pytest.raises(InvalidInput, match="'frf/1'; 'fits/1' is needed"):
        read_fits(path, MODEL, estimate)
    write_fits(path, [fit(MODEL, estimate)])
    chains = CoupledChains(np.ones((1, 2)), np.ones((1, 1)), np.zeros((1, 1)), np.ones((1, 1)))
    with pytest.raises(InvalidInput, match="the model's free parameters are K1, c1"):
        read_fits(path, chains, estimate)
    with pytest.raises(InvalidInput, match="which the estimate does not have"):
        read_fits(path, MODEL, estimate.subset([0, 1]))
    shorter = type(estimate)(
        estimate.positions,
        estimate.omega[:9],
        estimate.response[:, :9],
        estimate.covariance[:, :9],
        estimate.repetitions,
    )
    with pytest.raises(InvalidInput, match="weights of shape"):
        read_fits(path, MODEL, shorter)


@pytest.mark.parametrize("weights", ["joint", "row_wise"])
def test_fits_to_runs_come_back(weights, tmp_path):
    data, path = noisy_runs(np.random.default_rng(1), 1), tmp_path / "fits.h5"
    prior = Prior(("k1",), np.array([800.0]), np.array([0.1]))
    (written,) = multistart(MODEL, data, [TRUTH], weights=weights, positions=[2, 0], prior=prior)
    write_fits(path, [written])
    (read,) = read_fits(path, MODEL, data)
    assert [getattr(read, n) for n in FIELDS] == [getattr(written, n) for n in FIELDS]
    assert (read.weighting, read.prior.names) == (weights, ("k1",))
    assert np.array_equal(read.data.outputs, written.data.outputs)
    assert read.problem.evaluate(TRUTH)[0] @ read.problem.evaluate(TRUTH)[0] > 0
    with pytest.raises(InvalidInput, match="weights_0"):
        read_fits(path, MODEL, noisy())
    write_fits(path, fits(noisy()))
    with pytest.raises(InvalidInput, match=r"weights_0|other data"):
        read_fits(path, MODEL, data)
