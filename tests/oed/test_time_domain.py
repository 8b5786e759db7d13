"""Fits in time beside fits of FRFs, on the case that a published study has for them."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oed.replication import replicate, rollout_fit, time_domain_comparison
from oed.replication.time_domain_comparison import TimeDomainComparison, compare, judged
from oed.study.settings.study_file import Study, TimeDomainChoice, load_study
from oed.study.stage_cache import open_stages
from oed.study.stages.run import Run
from reports.page_elements import filled
from reports.pages import replication_tables as tables
from robotmodels import load_robot
from robotmodels.common.plain_data import json_data

NEAR = TimeDomainChoice(starts=2, decades=(0.05,))


@pytest.fixture(scope="module")
def case():
    return time_domain_comparison.case()


@pytest.fixture(scope="module")
def short(case):
    """A fifth of a second of two of the six experiments."""
    whole = time_domain_comparison.rollouts_of(*case)
    return replace(whole, torque=whole.torque[:2, :200], angle=whole.angle[:2, :200])


def test_rollouts_at_the_true_parameters_are_like_the_records(short):
    truth = short.parameters.values
    assert rollout_fit.missing() == ""
    assert rollout_fit.misfit(short, truth) < 1.3
    log = logging.getLogger("absl")
    log.setLevel(logging.INFO)
    assert rollout_fit.misfit(short, 1.02 * truth) > 10
    assert log.level == logging.INFO  # silence is not left behind


def test_a_fit_in_time_finds_springs_from_nearby(short):
    truth = short.parameters.values
    found = rollout_fit.fit_rollouts(short, 1.03 * truth, 1.5, 60)
    springs = [name.endswith("stiffness") for name in short.parameters.names]
    assert np.abs(np.log(found.values / truth))[springs].max() < 5e-3
    assert 20 < found.rollouts <= 60


def test_a_fit_in_time_that_is_given_up_says_so(short):
    truth = short.parameters.values
    for limit in (0, 3):
        found = rollout_fit.fit_rollouts(short, 1.03 * truth, 1.5, limit)
        assert not found.ended
        assert found.rollouts <= limit
        assert np.allclose(found.values, 1.03 * truth)  # the best so far


def unmoved(robot, position, rollouts, start, reach, limit):
    return rollout_fit.RolloutFit(start, True, limit, 2.0)


def page_of(found):
    table = tables.time_domain(found)
    return filled("published_time_domain.html.j2", comparison=found, table=table, seconds=9.0)


def test_frfs_of_the_same_records_find_the_truth_and_a_missing_module_is_told(case, monkeypatch):
    monkeypatch.setattr(time_domain_comparison, "case", lambda: case)
    monkeypatch.setattr(rollout_fit, "missing", lambda: "tabulate")
    monkeypatch.setattr(time_domain_comparison, "fit_prediction_errors", unmoved)
    nearer = TimeDomainChoice(starts=1, decades=(0.02, 0.05))
    found = compare(nearer, np.random.default_rng(0))
    assert [way.name for way in found.ways] == ["frequency domain", "prediction error"] * 2
    for ours in found.ways[::2]:
        assert (ours.successes, ours.starts, ours.unfinished) == (1, 1, 0)
        assert ours.spring_error < 0.01
    assert found.missing == "tabulate"
    assert json_data(found)["misfit"] is None
    page = page_of(found)
    assert "its module tabulate is not installed" in page
    assert "pip install" in page


def test_both_ways_start_alike_and_are_judged_alike(case, monkeypatch):
    asked = []

    def near(rollouts, start, reach, limit):
        asked.append(start)
        return rollout_fit.RolloutFit(start, limit > 0, limit, 2.0)

    monkeypatch.setattr(time_domain_comparison, "case", lambda: case)
    monkeypatch.setattr(rollout_fit, "missing", lambda: "")
    monkeypatch.setattr(rollout_fit, "fit_rollouts", near)
    monkeypatch.setattr(time_domain_comparison, "fit_prediction_errors", unmoved)
    monkeypatch.setattr(rollout_fit, "misfit", lambda rollouts, values: 1.5)
    told = []
    found = compare(NEAR, np.random.default_rng(0), progress=lambda *a: told.append(a))
    _, predicted, theirs = found.ways
    names = ["frequency domain", "prediction error", "mujoco.sysid"]
    assert [way.name for way in found.ways] == names
    assert told == [(i, 4) for i in range(1, 5)]
    assert replace(predicted, name="mujoco.sysid") == theirs
    robot, _ = case
    ln = np.log(np.array(asked) / robot.parameters.values)
    assert np.abs(ln).max() < 0.05 * np.log(10)
    assert theirs.seconds == 2.0
    springs = ln[:, [name.endswith("stiffness") for name in robot.parameters.names]]
    assert theirs.successes == int((np.abs(springs).max(axis=1) < 0.05).sum())
    page = page_of(found)
    assert "by 1.5 standard deviations" in page
    assert "mujoco.sysid" in page


def test_fits_by_fewer_methods_are_not_taken_for_all(tmp_path, monkeypatch):
    """A module that was missing and is there now: the stage is computed again, and only then."""
    study = load_study(Path(__file__).parents[2] / "studies" / "published.yaml")
    computed = []

    def fake(*_):
        computed.append(rollout_fit.missing())
        return TimeDomainComparison((), computed[-1], 1.0, 1)

    monkeypatch.setattr(replicate, "compare", fake)
    with open_stages(tmp_path / "stages") as stages:
        run = Run(study, load_robot("manutec_r3"), stages, None)
        for module in ("tabulate", "tabulate", "", ""):
            monkeypatch.setattr(rollout_fit, "missing", lambda module=module: module)
            assert replicate._time_domain(run, study.time_domain).value.missing == module
    assert computed == ["tabulate", ""]


def test_success_asks_for_every_spring():
    robot = load_robot("manutec_r3")
    truth = robot.parameters.values
    springs = np.array([name.endswith("stiffness") for name in robot.parameters.names])
    off = np.where(np.cumsum(springs) == 1, 1.2, 1.0)  # one spring alone
    way = judged("mujoco.sysid", robot, 1.0, np.array([truth, truth * off]), 3.0, 1)
    assert (way.successes, way.starts, way.unfinished) == (1, 2, 1)
    assert way.spring_error == 0.0  # of the success
    none = judged("mujoco.sysid", robot, 1.0, np.array([1.2 * truth]), 3.0, 0)
    assert none.successes == 0
    assert np.isclose(none.spring_error, np.log(1.2))


def test_fits_in_time_without_the_published_study_is_refused():
    with pytest.raises(ValueError, match="time_domain: it belongs to a study with compare_with"):
        Study.model_validate(
            {
                "schema": "study/1",
                "robot": "ur10",
                "frequencies": {"low": 2.0, "high": 80.0, "count": 10},
                "noise": {"relative": 0.03, "floor": 0.01},
                "candidates": {},
                "time_domain": {"starts": 2},
                "output": "out",
            }
        )
