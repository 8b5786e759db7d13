"""A study of coupled chains: its file, its records, and what comes out of them."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from estimators.chain_dampers.chains_from_records import measured_chains
from oed.chain_study.run_chain_study import (
    controlled_response,
    run_chain_study,
    simulated_records,
)
from oed.chain_study.study_file import load_chain_study, study_chains, study_controller
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.linear.chain_responses import position_controlled

DOCUMENT = {
    "schema": "chain_study/1",
    "seed": 3,
    "chains": {
        "masses": [[1.0, 2.0], [2.0, 1.5]],
        "springs": [[900.0], [2500.0]],
        "couplings": {"m2_4": 0.5},
        "dampers": [[0.5], [0.9]],
    },
    "experiment": {
        "multisine": {"band": [0.06, 20.0], "sample_time": 0.004, "period": 16.0},
        "amplitude": [0.05, 0.04],
        "angle_noise": 1e-6,
        "controller": {"stiffness": [640.0, 640.0], "damping": 80.0},
    },
    "output": "out",
}


def changed(path, value):
    document = yaml.safe_load(yaml.safe_dump(DOCUMENT))
    section = document
    for key in path[:-1]:
        section = section[key]
    section[path[-1]] = value
    return document


def written(folder, document):
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chain_study")
    return run_chain_study(load_chain_study(written(folder, DOCUMENT)), folder)


def test_chains_are_identified_in_every_way(results):
    truth = results.true_values
    assert truth.tolist() == [1.0, 2.0, 2.0, 1.5, 900.0, 2500.0, 0.5]
    assert results.read_off == pytest.approx(truth, rel=0.01)
    assert results.stepwise.values == pytest.approx(truth, rel=1e-3)
    assert results.measured.recommended.values == pytest.approx(truth, rel=1e-3)
    lanczos = results.measured.identification.inverse
    assert results.stepwise.values == pytest.approx(lanczos.values, rel=1e-9)


def test_steps_are_those_of_the_simulated_chains(results):
    for one, masses, springs in zip(
        results.steps, results.truth.masses, results.truth.springs, strict=True
    ):
        assert one.step.b11 == pytest.approx(springs[0] / masses[0], rel=1e-3)  # (17)
        assert one.first @ one.first == pytest.approx(1.0)


def test_responses_under_the_controllers_are_those_that_were_measured(results):
    responses = results.responses
    model = controlled_response(results, responses.omega, (0,))[:, 0, 0]
    # The other motor resists as a spring and a damper do, but for the sampling.
    spring = position_controlled(results.truth.linear_model(), np.array([0.0, 640.0]))
    low = responses.omega < 3.0
    expected = spring.frequency_response(responses.omega[low])[:, 0, 0]
    assert np.abs(model[low] / expected - 1).max() < 0.05
    assert np.median(np.abs(responses.direct[:, 0] / model - 1)) < 1e-2


CASE_STUDY = Path(__file__).parents[2] / "studies" / "coupled_chains.yaml"


@pytest.mark.slow  # others of this file are the smaller version
def test_chains_with_resonances_of_one_line_are_trusted(tmp_path):
    """Of three true models at most one may be called wrong by chance; a mass 10 % off always is."""
    study = load_chain_study(CASE_STUDY)
    truth = study_chains(study.chains)
    motors = ("one", "two", "three")
    controller = study_controller(study.experiment, motors)
    path, verdicts = tmp_path / "records.h5", []
    for seed in (3, 4, 8):
        records = simulated_records(
            study.model_copy(update={"seed": seed}), truth, controller, motors
        )
        records.save(path)
        verdicts.append(str(measured_chains(path, 3).recommended.verdict))
    assert verdicts.count("model error") <= 1
    wrong = measured_chains(path, 3, first_masses=truth.masses[:, 0] * [1.1, 1.0, 1.0])
    assert wrong.recommended.verdict == "model error"


def test_the_seed_decides(results, tmp_path):
    again = run_chain_study(results.study, tmp_path)
    assert np.array_equal(again.read_off, results.read_off)
    other = run_chain_study(results.study.model_copy(update={"seed": 4}), tmp_path)
    assert not np.array_equal(other.read_off, results.read_off)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("schema",), "chain_study/2", "schema: .*'chain_study/1', found 'chain_study/2'"),
        (("chains", "masses"), [[1.0, 2.0], [3.0]], "masses: rows of 2, 1 numbers"),
        (("chains", "springs"), [[900.0, 1.0], [2500.0, 1.0]], r"springs: shape \(2, 2\) given"),
        (("chains", "couplings"), {"m1_4": 0.5}, r"'m1_4' does not name two last masses.*'m2_4'"),
        (("chains", "couplings"), {"m2_4": 5.0}, "the mass matrix is not positive definite"),
        (("experiment", "amplitude"), [1.0, 2.0, 3.0], "experiment.amplitude: 3 given"),
        (("experiment", "controller", "damping"), [1.0], "experiment.controller.damping: 1 given"),
        (("experiment", "blocks"), 1, "experiment.blocks"),
        (("compare_with",), "hovland_case_study", "has 3 chains of 3 masses, this file 2 of 2"),
        (("experiment", "blocks"), 1000, "at most 10000000 samples"),
        (("experiment", "multisine", "band"), [3.0, 20.0], "0 lines below the anti-resonances"),
    ],
)
def test_mistakes_are_named(tmp_path, path, value, message):
    with pytest.raises(InvalidInput, match=message):
        run_chain_study(load_chain_study(written(tmp_path, changed(path, value))), tmp_path)


def test_controllers_that_are_unstable_are_refused(tmp_path):
    document = changed(("experiment", "controller", "damping"), 900.0)
    with pytest.raises(SolverFailed, match="closed loop is unstable"):
        run_chain_study(load_chain_study(written(tmp_path, document)), tmp_path)


def test_controllers_have_the_stiffness_of_the_file(results):
    controller = study_controller(results.study.experiment, ("one", "two"))
    assert controller.speed_gain * controller.position_gain == pytest.approx([640.0, 640.0])
    assert np.isinf(controller.integral_time).all()
    assert study_chains(results.study.chains).couplings[0, 1] == 0.5
