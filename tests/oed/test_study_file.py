import math

import numpy as np
import pytest

from oed.study.settings.study_file import Frequencies, load_study
from oed.study.stages.run import frequency_grid
from robotmodels.common.errors import InvalidInput

LEAST = """\
schema: study/1
robot: {robot}
frequencies: {{low: 2.0, high: 80.0, count: 5}}
noise: {{relative: 0.03, floor: 0.01}}
candidates: {{per_joint: {{elbow_joint: 3}}}}
output: out
"""


def written(folder, robot="ur10", more=""):
    path = folder / "study.yaml"
    path.write_text(LEAST.format(robot=robot) + more, encoding="utf-8")
    return path


def test_what_is_left_out_has_the_documented_defaults(tmp_path):
    study = load_study(written(tmp_path))
    assert study.seed == 1
    assert (study.design.criterion, study.design.experiments) == ("D", 15)
    assert study.design.tolerance == 1e-6
    assert [one.residual for one in study.estimators] == ["lls", "nls"]
    assert (study.fit.decades, study.fit.starts) == (0.3, 4)
    assert study.posterior.ensembles == 4
    assert study.frequencies.spacing == "log"


def test_paths_start_at_the_study_file_and_names_stay_names(tmp_path):
    study = load_study(written(tmp_path))
    assert study.robot == "ur10"
    assert study.output == tmp_path.resolve() / "out"
    study = load_study(written(tmp_path, robot="robots/mine.yaml"))
    assert study.robot == str(tmp_path.resolve() / "robots" / "mine.yaml")


@pytest.mark.parametrize("spacing", ["log", "linear"])
def test_frequencies_include_both_ends_and_are_evenly_spaced(spacing):
    grid = Frequencies(low=2.0, high=80.0, count=9, spacing=spacing)
    omega = frequency_grid(grid)
    assert omega[0] == pytest.approx(2 * math.pi * 2)
    assert omega[-1] == pytest.approx(2 * math.pi * 80)
    steps = np.diff(np.log(omega) if spacing == "log" else omega)
    np.testing.assert_allclose(steps, steps[0])


def test_the_nearest_key_is_named_at_every_depth(tmp_path):
    path = written(tmp_path, more="posterior: {ensembels: 4}\n")
    with pytest.raises(InvalidInput, match=r"'posterior\.ensembels'.*did you mean 'ensembles'"):
        load_study(path)


def test_a_key_given_twice_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="'seed' is given twice"):
        load_study(written(tmp_path, more="seed: 1\nseed: 2\n"))


def test_another_schema_is_refused(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("study/1", "study/2"))
    with pytest.raises(InvalidInput, match=r"schema: .*study/1.*study/2"):
        load_study(path)


EXPERIMENT = """\
data:
  experiment:
    multisine: {{band: [3.0, 40.0], sample_time: 0.004, period: 0.5}}
    limits: {{speed: 1.0}}
  {data}
fit: {{{fit}}}
"""


def recorded(folder, data="hold: true", fit="starts: 1"):
    return load_study(written(folder, more=EXPERIMENT.format(data=data, fit=fit)))


def test_records_are_fitted_as_runs_unless_the_file_says_otherwise(tmp_path):
    study = recorded(tmp_path)
    assert study.fits_runs
    assert [(one.residual, one.weights) for one in study.estimators] == [("sml", "auto")]
    assert recorded(tmp_path, "noise: [0.05, 1.0e-5]").data.noise == (0.05, 1e-5)
    frfs = {
        "method: log": "starts: 1",
        "hold: true": "minimum_snr: 3.0",
        "delay: 0": "residuals: [nls]",
    }
    for data, fit in frfs.items():
        assert not recorded(tmp_path, data, fit).fits_runs


MISTAKEN = {
    "mixed": ("hold: true", "residuals: [sml, nls]", "sml is of runs, other residuals are of FRFs"),
    "method": ("method: log", "residuals: [sml]", "data.method: it is of FRFs"),
    "weights": ("hold: true", "residuals: [sml], variances: own", "fit.variances: it is of FRFs"),
    "noise": ("noise: blocks", "residuals: [nls]", "data.noise: it is that of runs"),
    "kind": (
        "hold: true",
        "estimators: [{name: a, residual: sml, weights: optimal}]",
        "a: weights 'optimal' are none of sml, which has auto, joint, row_wise",
    ),
    "no weights": (
        "hold: true",
        "estimators: [{name: a, residual: nls}]",
        "weights 'auto' are none of nls, which has user, optimal, combined",
    ),
    "reweight": (
        "hold: true",
        "estimators: [{name: a, residual: sml, reweight: true}]",
        "a: reweight: only of FRFs",
    ),
    "result": ("hold: true", "result: nls", "fit.result: 'nls' is none of the estimators"),
}


@pytest.mark.parametrize("mistake", MISTAKEN)
def test_what_does_not_belong_to_runs_is_named(mistake, tmp_path):
    data, fit, words = MISTAKEN[mistake]
    with pytest.raises(InvalidInput, match=words):
        recorded(tmp_path, data, fit)


def test_runs_need_records(tmp_path):
    with pytest.raises(InvalidInput, match="residual sml compares runs"):
        load_study(written(tmp_path, more="fit: {residuals: [sml]}\n"))
