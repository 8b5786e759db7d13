import numpy as np
import pytest
from closed_loop import Bench, bench_records

from estimators.frf.estimate_frf import first_period
from estimators.frf.record_checks import settling
from estimators.frf.spectra import spectra
from robotmodels import IdentificationWarning, InvalidInput


def judged(level=1e-4, **setup):
    return settling(spectra(bench_records(Bench(**setup))), level=level)


def test_steady_records_are_left_alone():
    firsts = [judged(periods=4, blocks=2, noise=1e-4, seed=s).first for s in range(20)]
    assert max(firsts) == 0


def test_false_alarms_are_as_rare_as_claimed():
    p_values = np.concatenate(
        [
            judged(periods=5, blocks=1, noise=1e-4, feedback=f, seed=s).p_values
            for s in range(40)
            for f in (0.0, 20.0)
        ]
    )
    # Channels may depend on each other, so the claim is an upper bound; not an idle one.
    for level in (0.05, 0.3):
        within = 3 * np.sqrt(level * (1 - level) / len(p_values))
        assert np.mean(p_values < level) < level + within
    assert np.mean(p_values < 0.3) > 0.06
    # Negative control: with a transient nearly every first period is found out.
    seen = [judged(periods=5, blocks=1, noise=1e-4, transient=1.0, seed=s) for s in range(10)]
    assert np.mean([s.p_values[0] < 0.05 for s in seen]) > 0.9


@pytest.mark.parametrize("transient", [0.3, 3.0])
def test_periods_are_dropped_until_the_transient_is_lost(transient):
    # e^{-1/0.3} a period: each further period must shrink it by 28.
    found = judged(periods=9, noise=1e-5, transient=transient)
    assert 0 < found.first < 7
    assert found.settled
    assert (np.diff(found.deviations[: found.first]) < 0).all()
    assert found.deviations[0] > 3 * found.deviations[found.first]


def test_what_is_negligible_is_kept_however_certain():
    assert judged(periods=5, transient=1e-6).first == 0
    loud = settling(spectra(bench_records(Bench(periods=5, transient=1e-6))), negligible=0.0)
    assert loud.first > 0
    assert loud.p_values[0] == 0.0  # nothing else differs


def test_records_that_never_settle_are_warned_of():
    records = bench_records(Bench(periods=5))
    drift = 1 + 0.05 * np.arange(5)[:, None, None]
    found = spectra(type(records)(**(vars(records) | {"angle": records.angle * drift})))
    assert not settling(found).settled
    with (
        pytest.warns(IdentificationWarning, match="the first 3 of 5 periods dropped"),
        pytest.warns(IdentificationWarning, match="here: no period agrees with the later ones"),
    ):
        assert first_period(found, "auto", "here") == 3


def test_two_periods_tell_nothing():
    found = judged(periods=2, transient=1.0)
    assert found.first == 0
    assert found.settled
    assert len(found.p_values) == 0


def test_the_level_is_a_probability():
    with pytest.raises(InvalidInput, match="settling: level 2 does not lie between 0 and 1"):
        judged(level=2)
