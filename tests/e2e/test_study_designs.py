"""What a study file may ask of its design: limits, times, robustness, candidates by the million."""

import json
import re

import numpy as np
import pytest
from command_line import oed
from conftest import STUDY, write_study

from oed.exact.plan_score import standard_deviations
from oed.experiment.experiment_file import load_experiment, planned_positions
from oed.information_sets.stored_information import StoredInformation
from oed.study.pipeline import design_study, fit_study
from oed.study.settings.study_file import load_study
from reports.sections import candidates, design, positions
from robotmodels.common.errors import InvalidInput

EXPERIMENT = """\
schema: experiment/1
robot: robot.yaml
design: {design}
multisine: {{band: [3.0, 40.0], sample_time: 0.004, period: 0.5}}
limits: {{torque: 60.0}}
output: results
"""
PLAIN = "design: {criterion: D, experiments: 5, tolerance: 1.0e-6}"


def study(folder, wanted, more=""):
    content = STUDY.replace(PLAIN, f"design: {wanted}").replace(
        "candidates:\n", f"candidates:\n{more}"
    )
    return write_study(folder, content)


def designed(folder, wanted, more=""):
    return design_study(load_study(study(folder, wanted, more)))


def test_limits_on_positions_are_kept(tmp_path):
    found = designed(
        tmp_path,
        "{experiments: 6, most: 2, mandatory: [[-1.0, 0.3]], forbidden: [{elbow_joint: [-3, -2]}],"
        " groups: {up: {where: {shoulder_lift_joint: [-0.6, 0]}, most: 1},"
        " bent: {where: {elbow_joint: [1, 3]}, least: 3}}}",
        more="  positions: [[-1.0, 0.3]]\n",
    )
    counts = found.plan.exact.repetitions
    lift, elbow = found.plan.information.positions.T
    assert counts.sum() == 6
    assert counts.max() <= 2
    assert counts[np.flatnonzero((lift == -1.0) & (elbow == 0.3))].sum() >= 1
    assert counts[elbow <= -2].sum() == 0
    assert counts[lift >= -0.6].sum() <= 1
    assert counts[elbow >= 1].sum() >= 3
    said = design.limits(found.study.design)
    assert "at most 2 visits in one position" in said
    assert "at least 3 in the group bent" in said


def test_a_time_suffices_for_experiments_and_moves_and_orders_the_visits(tmp_path):
    wanted = "{time: 300, measuring: 40, most: 2, moves: {speed: 0.5, acceleration: 1.0}}"
    found = designed(tmp_path, wanted)
    count = found.plan.exact.repetitions.sum()
    assert found.plan.order.duration <= found.plan.order.unordered_duration
    total = 40 * count + found.plan.order.duration
    assert 200 < total <= 300
    assert sorted(found.plan.order.order) == list(range(len(found.plan.used)))
    said = design.section(found).body
    assert "numbered in the order of visits" in said
    assert "of the 5\u202fmin 0\u202fs allowed" in said


def test_positions_are_measured_and_numbered_in_the_order_of_visits(tmp_path):
    wanted = "{experiments: 6, most: 1, solver: newton, moves: {speed: 0.5, acceleration: 1.0}}"
    found = fit_study(load_study(study(tmp_path, wanted)))
    assert found.plan.order.duration < found.plan.order.unordered_duration
    places = found.plan.information.positions[found.plan.used]
    np.testing.assert_array_equal(found.data.estimate.positions, places)
    np.testing.assert_array_equal(
        found.plan.information.positions[found.plan.exact.support][found.plan.order.order], places
    )
    assert "rows in the order of visits" in positions.position_table(found).caption


def test_a_number_of_experiments_that_is_the_default_is_no_lesser_limit(tmp_path):
    by_time = designed(tmp_path, "{solver: newton, time: 1200, measuring: 40}")
    assert by_time.plan.exact.repetitions.sum() > 15
    both = designed(tmp_path, "{solver: newton, time: 1200, measuring: 40, experiments: 15}")
    assert both.plan.exact.repetitions.sum() == 15
    assert {"candidates", "information"} == set(both.run.loaded)


@pytest.mark.parametrize("kind", ["maximin", "average"])
def test_a_robust_design_keeps_more_at_its_samples(kind, tmp_path):
    std = "{stiffness: 0.5, damping: 1.0}"
    found = designed(
        tmp_path, f"{{solver: newton, robust: {{kind: {kind}, std: {std}, samples: 4}}}}"
    )
    kept, nominal = found.plan.robust.efficiency, found.plan.robust.nominal_efficiency
    assert len(kept) == 4
    assert nominal[0] == pytest.approx(1, abs=1e-5)
    if kind == "maximin":
        assert kept.min() > nominal.min() + 0.02
    else:
        assert np.log(kept).mean() > np.log(nominal).mean()
    assert found.plan.exact.efficiency > 0.9
    assert found.plan.exact.information.shape == (4, 4, 4)
    said = design.section(found).body
    assert 'id="robust"' in said
    assert "at worst" in said if kind == "maximin" else "on average" in said


def test_design_json_tells_order_and_robustness(tmp_path):
    path = study(
        tmp_path, "{experiments: 4, solver: newton, moves: {}, robust: {std: 0.5, samples: 2}}"
    )
    assert oed("design", path, "--workers", 1)[0] == 0
    document = json.loads((tmp_path / "results" / "here" / "design.json").read_text())
    used = [one["candidate"] for one in document["positions"]]
    assert document["order"]["candidates"] == used
    assert document["order"]["seconds"] >= 0
    assert len(document["robust"]["efficiency"]) == 2
    # An experiment by this design visits in its order.
    document["order"]["candidates"].reverse()
    made = tmp_path / "design.json"
    made.write_text(json.dumps(document))
    by_candidate = {one["candidate"]: one["position"] for one in document["positions"]}
    shaken = EXPERIMENT.format(design=made)
    (tmp_path / "experiment.yaml").write_text(shaken)
    positions, _ = planned_positions(load_experiment(tmp_path / "experiment.yaml"), "two joints")
    assert positions.tolist() == [by_candidate[i] for i in document["order"]["candidates"]]


def test_many_candidates_are_kept_in_a_store(tmp_path, monkeypatch):
    whole = designed(tmp_path / "memory", "{experiments: 5}")
    monkeypatch.setattr("oed.study.stages.information.LARGEST_IN_MEMORY", 1000)
    path = study(tmp_path, "{experiments: 5}")
    stored = design_study(load_study(path))
    assert isinstance(stored.plan.information, StoredInformation)
    assert stored.plan.used.tolist() == whole.plan.used.tolist()
    one, other = (standard_deviations(found.plan.exact.information) for found in (whole, stored))
    np.testing.assert_allclose(one, other, rtol=1e-9)
    assert candidates.section(stored) is not None
    again = design_study(load_study(path))
    assert {"candidates", "information", "design"} <= set(again.run.loaded)
    # What comes after takes candidates from the store too.
    best = "{name: one, residual: nls, weights: optimal, positions: best}"
    estimators = f"fit: {{estimators: [{best}], result: one, starts: 1}}"
    path.write_text(re.sub(r"^fit: .*$", estimators, path.read_text(), flags=re.M))
    code, out, err = oed("fit", path, "--workers", 1)
    assert (code, err) == (0, "")
    assert "5 visits, 10 runs" in out


MISTAKES = {
    "time alone": ("{time: 100}", "design: time needs measuring"),
    "too little time": ("{time: 10, measuring: 20}", "design: time: 10 s; one experiment takes 20"),
    "no limit": ("{groups: {a: {where: {elbow_joint: [0, 1]}}}}", "groups.a: neither most nor"),
    "no such key": ("{robust: {std: 0.3, sample: 3}}", "'design.robust.sample'.*'samples'"),
    "no number": ("{robust: {std: x}}", "design.robust.std: a number is needed"),
    "no such parameter": ("{robust: {std: {stifness: 1.0}}}", "design.robust.std: 'stifness'"),
    "no candidate": ("{mandatory: [[0.0, 0.1]]}", r"mandatory\[0\].*nearest is .*\[-0.5, 0.0\]"),
    "angles": ("{mandatory: [[0.0]]}", r"mandatory\[0\]: 1 angles; 2 are needed"),
    "joint": ("{forbidden: [{elbow: [0, 1]}]}", r"forbidden\[0\]: 'elbow' is not.*'elbow_joint'"),
    "empty group": (
        "{groups: {a: {where: {elbow_joint: [0.01, 0.02]}, most: 1}}}",
        "groups.a.where: no candidate",
    ),
    "home": ("{moves: {home: [1.0]}}", "moves.home: 1 angles; 2 are needed"),
    "speeds": ("{moves: {speed: [1, 1, 1]}}", "design.moves.speed: 3 given"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_does_not_fit_is_named(mistake, tmp_path):
    wanted, words = MISTAKES[mistake]
    with pytest.raises(InvalidInput, match=words):
        designed(tmp_path, wanted)


COMPARED = {
    "grid": ("{grid: {elbow_joint: 9}}", "compare.grid: 9 points for 5 experiments"),
    "runs": ("{runs: 3}", "compare.runs: 3; at least 7 are needed for 4 parameters"),
    "key": ("{rnadom: 3}", "'compare.rnadom'.*'random'"),
}


@pytest.mark.parametrize("mistake", COMPARED)
def test_comparisons_that_do_not_fit_are_named(mistake, tmp_path):
    compare, words = COMPARED[mistake]
    content = STUDY.replace("{random: 1, runs: 12}", compare)
    code, _, err = oed("run", write_study(tmp_path, content), "--workers", 1)
    assert code == 2
    assert not (tmp_path / "results").exists()
    assert re.search(words, err), err


def test_a_grid_larger_than_the_plan_that_time_allows_is_named(tmp_path):
    content = STUDY.replace(PLAIN, "design: {solver: newton, time: 300, measuring: 40}")
    content = content.replace("{random: 1, runs: 12}", "{grid: {elbow_joint: 9}}")
    code, _, err = oed("run", write_study(tmp_path, content), "--workers", 1)
    assert code == 2
    assert re.search(r"study.yaml: comparison: compare.grid: 9 points for \d experiments", err), err


def test_positions_by_hand_that_do_not_fit(tmp_path):
    with pytest.raises(InvalidInput, match=r"positions\[1\]: 3 angles; 2 are needed"):
        designed(tmp_path, "{}", more="  positions: [[0.0, 0.1], [0.0, 0.1, 0.2]]\n")
