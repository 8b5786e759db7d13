import warnings
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import LINES, SAMPLES, Bench, bench_records, truth

import estimators
from estimators import estimate_frf
from estimators.frf.averaging import METHODS
from estimators.frf.record_checks import check_condition
from robotmodels import IdentificationWarning, InvalidInput
from robotmodels.records.records import Records


def changed(records, names, change):
    arrays = {name: np.array(getattr(records, name)) for name in names.split()}
    for array in arrays.values():
        change(array)
    return replace(records, **arrays)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("setup", [Bench(), Bench(hold=False), Bench(delay=3.7e-3)])
def test_exact_records_give_the_exact_frf(method, setup):
    estimate = estimate_frf(bench_records(setup), method, hold=setup.hold, delay=setup.delay)
    assert np.allclose(estimate.response[0], truth(estimate.omega), rtol=1e-9)
    assert (estimate.omega == 2 * np.pi * LINES).all()
    assert estimate.repetitions.tolist() == [4]


def test_hold_and_delay_matter():
    plain = bench_records()
    G = truth(2 * np.pi * LINES)
    wrong = estimate_frf(plain, hold=False).response[0]
    # Half a sample of delay: 28 degrees at 79 Hz and 500 samples a second.
    assert np.angle(wrong[-1] / G[-1], deg=True) == pytest.approx(-180 * 79 / SAMPLES, abs=1e-6)
    late = estimate_frf(plain, delay=1e-3).response[0]
    assert np.allclose(np.angle(late / G), 2 * np.pi * LINES[:, None, None] * 1e-3)


def test_covariance_is_honest_in_closed_loop():
    covered = []
    for seed in range(20):
        setup = Bench(blocks=8, periods=2, noise=2e-4, feedback=20.0, seed=seed)
        records = bench_records(setup)
        estimate = estimate_frf(records, structure="diagonal")
        error = np.abs(estimate.response[0] - truth(estimate.omega)) ** 2
        covered.append(error / estimate.variance[0])
    # |error|^2 / variance over 7 degrees of freedom: F(2, 14) with mean 14/12 and std 1.38.
    assert np.mean(covered) == pytest.approx(14 / 12, abs=4 * 1.38 / np.sqrt(np.size(covered)))
    # Negative control: the variance of a single block.
    assert np.mean(covered) / 8 != pytest.approx(14 / 12, rel=0.5)


def test_noise_covariance_of_one_block():
    records = bench_records(Bench(blocks=1, periods=6, noise=1e-4))
    with pytest.raises(InvalidInput, match=r"position 1: one block; .*two periods; .*oed identify"):
        estimate_frf(records)
    estimate = estimate_frf(records, covariance="noise", structure="diagonal")
    error = np.abs(estimate.response[0] - truth(estimate.omega)) ** 2
    assert np.mean(error / estimate.variance[0]) == pytest.approx(1.25, rel=0.25)  # F(2, 10)
    with pytest.raises(InvalidInput, match="one period; a noise covariance needs at least 2"):
        estimate_frf(bench_records(Bench(periods=1)), covariance="noise")


def test_full_and_diagonal_agree():
    records = bench_records(Bench(noise=1e-4))
    full, diagonal = (estimate_frf(records, structure=s) for s in ("full", "diagonal"))
    assert full.has_full_covariance
    assert not diagonal.has_full_covariance
    assert np.allclose(full.variance, diagonal.variance)


def test_missing_blocks_are_passed_over_and_counted():
    records = bench_records(Bench(noise=1e-4))
    kept = replace(records, **{k: getattr(records, k)[:, :3] for k in SIGNALS})

    def drop(array):
        array[:, 3] = np.nan

    missing = changed(records, "torque angle", drop)
    found, expected = estimate_frf(missing), estimate_frf(kept)
    assert (found.response == expected.response).all()
    assert found.repetitions.tolist() == [3]

    def nothing(array):
        array[:] = np.nan

    with pytest.raises(InvalidInput, match="position 1: every run is missing"):
        estimate_frf(changed(records, "torque angle", nothing))


SIGNALS = ("reference", "torque", "angle", "saturated")


def test_a_missing_experiment_takes_its_block_along_unless_the_method_sums():
    records = bench_records(Bench(noise=1e-5))

    def drop(array):
        array[:, 1, 0] = np.nan

    lacking = changed(records, "torque angle", drop)
    with pytest.warns(
        IdentificationWarning, match=r"blocks 2 lack runs and are left out; h1 and jio"
    ):
        assert estimate_frf(lacking).repetitions.tolist() == [3]
    for method in ("h1", "jio"):
        found = estimate_frf(lacking, method)
        assert found.repetitions.tolist() == [4]
        error = np.abs(found.response[0] - truth(found.omega)).max(axis=(1, 2))
        assert (error < 0.05 * np.abs(found.response[0]).max(axis=(1, 2))).all()

    def all_blocks(array):
        array[:, :, 0] = np.nan

    none = changed(records, "torque angle", all_blocks)
    with (
        pytest.warns(IdentificationWarning, match="lack runs"),
        pytest.raises(InvalidInput, match="no block is complete, as ari needs"),
    ):
        estimate_frf(none)
    assert estimate_frf(none, "jio").repetitions.tolist() == [4]  # four phases, two motors


def test_positions_one_by_one_or_joined():
    one, two = bench_records(Bench(seed=1)), bench_records(Bench(seed=2))
    together = estimate_frf(Records.join([one, two]))
    apart = estimate_frf(r for r in (one, two))
    assert (together.response == apart.response).all()
    assert len(together.positions) == 2
    with pytest.raises(InvalidInput, match="records: none given"):
        estimate_frf([])
    other = replace(two, sample_time=1e-3)
    with pytest.raises(InvalidInput, match="position 2: its frequencies differ"):
        estimate_frf([one, other])
    fewer = replace(two, angle=two.angle[..., :1])
    with pytest.raises(InvalidInput, match=r"position 2: 1 x 2 FRFs .* position 1 are 2 x 2"):
        estimate_frf([one, fewer])


def test_transients_are_dropped_with_a_warning():
    records = bench_records(Bench(periods=8, transient=1.0, noise=1e-6))
    with pytest.warns(IdentificationWarning, match=r"position 1: the first \d of 8 periods drop"):
        found = estimate_frf(records)
    G = truth(found.omega)
    low = G.shape[0] // 4  # where a slow transient shows
    error = np.abs(found.response[0] / G - 1)[:low].max()
    assert error < 0.01
    kept = estimate_frf(records, transient=0).response[0]
    assert np.abs(kept / G - 1)[:low].max() > 5 * error
    with pytest.raises(InvalidInput, match="transient: 8 of 8 periods cannot be dropped"):
        estimate_frf(records, transient=8)


# Mistakes ---------------------------------------------------------------------------------------


def test_dependent_torques_are_named():
    records = bench_records()

    def same(array):
        array[:, 2, 1] = array[:, 2, 0]

    broken = changed(records, "torque", same)
    with pytest.raises(
        InvalidInput, match=r"position 1, block 3: the torques at line \d+ \(\d+ Hz\).* condition"
    ):
        estimate_frf(broken)
    # Other blocks make up for it where sums are inverted.
    assert np.isfinite(estimate_frf(broken, "h1").response).all()


def test_dependent_references_are_named():
    records = bench_records()

    def same(array):
        array[..., 1] = array[..., 0]

    with pytest.raises(InvalidInput, match=r"the references at line \d+ .* condition number"):
        estimate_frf(changed(records, "reference", same), "jio")


def test_nearly_dependent_torques_are_warned_of():
    inputs = np.array([[[1.0, 1.0], [1.0, 1.0 + 1e-4]]])
    with pytest.warns(IdentificationWarning, match="condition number 4e.04; the FRF there is poor"):
        check_condition(inputs, np.array([6.0]), np.array([1]), "here")
    # Units of a motor's torque are no fault.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scaled = np.array([[[1e5, 1e5], [1e-5, -1e-5]]])
        check_condition(scaled, np.array([6.0]), np.array([1]), "here")


def test_saturation_is_warned_of():
    def met(array):
        array[0, 1, 0, 2, 1] = True

    with pytest.warns(IdentificationWarning, match=r"met by motors 2 in 1 of 8 runs"):
        estimate_frf(changed(bench_records(), "saturated", met))


def test_references_that_do_not_repeat_are_refused():
    def shift(array):
        array[:, :, :, 1] = np.roll(array[:, :, :, 1], 3, axis=-2)

    with pytest.raises(InvalidInput, match="reference is not periodic: period 2 differs"):
        estimate_frf(changed(every_period(bench_records()), "reference", shift))


def every_period(records):
    reference = np.broadcast_to(records.reference, records.torque.shape)
    return replace(records, reference=reference)


def cut(records, samples):
    """Cut the same recording into periods of another length."""
    signals = {}
    for name in ("reference", "torque", "angle"):
        a = getattr(records, name)
        rows = a.reshape(*a.shape[:3], -1, a.shape[-1])[:, :, :, : 2 * samples]
        signals[name] = rows.reshape(*a.shape[:3], 2, samples, a.shape[-1])
    return replace(records, saturated=records.saturated[:, :, :, :2], **signals)


def test_wrong_sample_counts_are_refused():
    records = every_period(bench_records())
    with pytest.raises(InvalidInput, match=r"not periodic.*are there 490 samples a period"):
        estimate_frf(cut(records, 490))
    with pytest.raises(InvalidInput, match=r"only .* % of the reference's power lies at"):
        estimate_frf(replace(records, lines=LINES - 1, detection=np.array([5])))
    silent = replace(cut(records, 490), reference=np.zeros_like(cut(records, 490).reference))
    with (
        pytest.warns(IdentificationWarning, match=r"only .* % of the torque's power lies at"),
        pytest.warns(IdentificationWarning, match="periods differ more than they agree"),
        pytest.warns(IdentificationWarning, match="from the end of a period to its start"),
        pytest.raises(InvalidInput, match=r"declared as excited, .* number of samples a period"),
    ):
        estimate_frf(silent)


def test_motors_that_stand_still_are_refused():
    def still(array):
        array[..., 1] = 3.0

    with pytest.raises(InvalidInput, match=r"torque of motor 2 is constant"):
        estimate_frf(changed(bench_records(), "torque", still))


def test_numbers_of_experiments_are_checked():
    short = bench_records(Bench(experiments=1))
    with pytest.raises(InvalidInput, match=r"1 of 2 runs a block.*local_frf"):
        estimate_frf(short)
    records = bench_records()
    twice = {k: np.concatenate([getattr(records, k)] * 2, axis=2) for k in SIGNALS}
    long = replace(records, **twice)
    with pytest.raises(InvalidInput, match="4 runs a block for 2 motors; ari needs 2"):
        estimate_frf(long)
    assert np.allclose(estimate_frf(long, "h1").response[0], truth(2 * np.pi * LINES))


def test_jio_needs_a_reference():
    records = bench_records()
    silent = replace(records, reference=np.zeros_like(records.reference))
    with pytest.raises(InvalidInput, match="jio needs the reference"):
        estimate_frf(silent, "jio")
    assert np.isfinite(estimate_frf(silent).response).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"covariance": "totl"},
            "covariance 'totl' is unknown .did you mean 'total'..; there are",
        ),
        ({"structure": "banded"}, "structure 'banded' is unknown; there are full, diagonal"),
        ({"delay": np.nan}, "delay: nan s is not a number"),
        ({"method": "lpm"}, "method 'lpm' is unknown"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(InvalidInput, match=message):
        estimate_frf(bench_records(), **options)


def test_noise_free_records_have_the_variance_of_rounding():
    records = bench_records(Bench(periods=1, blocks=2))
    same = replace(records, **{k: getattr(records, k)[:, [0, 0]] for k in SIGNALS})
    with pytest.raises(InvalidInput, match="blocks 1 and 2 hold the same samples; a copy counts"):
        estimate_frf(same)

    def rounded(array):
        array[:, 1] *= 1 + 2**-52

    with pytest.warns(IdentificationWarning, match="blocks 1 and 2 have the same phases"):
        estimate = estimate_frf(changed(same, "angle", rounded))
    assert (estimate.variance > 0).all()
    assert np.sqrt(estimate.variance.max()) < 1e-12 * np.abs(estimate.response).max()


def test_functions_are_public():
    for name in ("estimate_frf", "local_frf", "distortion", "compare_methods", "read_frf"):
        assert callable(getattr(estimators, name))
