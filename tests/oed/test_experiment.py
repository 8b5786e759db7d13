import json

import numpy as np
import pytest

from oed.experiment.experiment_file import load_experiment, planned_positions
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.loop_settings import per_motor
from oed.experiment.predicted_peaks import predicted_peaks
from oed.experiment.prepare import prepare
from oed.experiment.run_experiment import run_experiment
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

FILE = """\
schema: experiment/1
robot: moberg_axis1
positions: [[0.3], [-0.2]]
repetitions: [2, 1]
multisine: {band: [2.0, 40.0], sample_time: 0.002, period: 0.5, detection: 3}
blocks: 2
periods: 2
limits: {torque: 20.0, swing: 0.002}
imperfections: {friction: 0, angle_noise: 1.0e-6, nonlinear_gears: false}
seed: 3
output: out
"""


def loaded(folder, text=FILE, *changes):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "experiment.yaml"
    path.write_text(text, encoding="utf-8")
    return load_experiment(path)


def test_paths_are_relative_to_the_file(tmp_path):
    found = loaded(tmp_path, FILE, ("robot: moberg_axis1", "robot: there/robot.yaml"))
    assert found.output == tmp_path.resolve() / "out"
    assert found.robot == str(tmp_path.resolve() / "there" / "robot.yaml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("blocks: 2", "block: 2", "unknown key 'block' (did you mean 'blocks'?)"),
        ("detection: 3", "detecton: 3", "'multisine.detecton' (did you mean 'detection'?)"),
        ("swing: 0.002", "swng: 0.01", "'limits.swng' (did you mean 'swing'?)"),
        ("angle_noise", "angel_noise", "(did you mean 'angle_noise'?)"),
        ("[2.0, 40.0]", "[40.0, 2.0]", "lower frequency comes first"),
        ("[2.0, 40.0]", "[2.0, 400.0]", "half the sampling frequency, 250 Hz"),
        ("period: 0.5", "period: 0.501", "250.5 samples"),
        ("detection: 3", "detection: 1", "multisine.detection"),
        ("detection: 3", "spacing: quasi_log", "needs a count"),
        ("torque: 20.0, swing: 0.002", "margin: 0.1", "none of torque, rms_torque, speed"),
        ("torque: 20.0", "torque: -20.0", "limits.torque"),
        ("positions: [[0.3], [-0.2]]\nrepetitions: [2, 1]\n", "", "neither of positions and des"),
        ("seed: 3", "design: design.json", "both of positions and design"),
        ("repetitions: [2, 1]", "repetitions: [2]", "1 given for 2 positions"),
        ("periods: 2", "periods: 0", "periods"),
        ("blocks: 2", "blocks: 2\nfiles: [pdf]", "files[0]: input should be 'csv', 'mat' or"),
        ("blocks: 2", "blocks: 2\ncarrier: {speed: -1}", "carrier.speed"),
        ("blocks: 2", "blocks: 2\nsettle: -1", "settle"),
        ("blocks: 2", "blocks: 2\nworkcell: {flor: 0}", "workcell"),
        ("blocks: 2", "blocks: few", "'few'"),
    ],
)
def test_mistakes_name_the_key(tmp_path, old, new, said):
    with pytest.raises(InvalidInput) as error:
        loaded(tmp_path, FILE, (old, new))
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[[0.3], [-0.2]]", "[[0.3, 0.1], [-0.2, 0]]", "2 angles each; 1 are needed"),
        ("[[0.3], [-0.2]]", "[[0.3], [-0.2, 0]]", "positions[1]: 2 angles"),
        ("torque: 20.0", "torque: [20.0, 3.0]", "limits.torque: 2 given; one number, or 1"),
        ("swing: 0.002", "swing: [0.1, 0.1]", "limits.swing: 2 given"),
        ("swing: 0.002", "rms_torque: [1, 2]", "limits.rms_torque: 2 given"),
        ("swing: 0.002}", "swing: 0.002}\ncarrier: {speed: [1, 2]}", "carrier.speed: 2 given"),
        ("swing: 0.002}", "swing: 0.002}\ncarrier: {speed: 500}", "transient_periods: 1 of 0.5 s"),
        (
            "swing: 0.002}",
            "swing: 0.002}\ntransient_periods: 9\ncarrier: {speed: 500}",
            "carrier.frequency: 4 Hz; a multiple of 1 / period = 2 Hz below the lowest line, 2",
        ),
        (
            "swing: 0.002}",
            "swing: 0.002}\nworkcell: {floor: 0.0, ignored: [[a, b]]}",
            "ignored: 'a' is not a link",
        ),
        ("angle_noise: 1.0e-6", "backlash: [0, 0, 0]", "imperfections.backlash: 3 given"),
        ("robot: moberg_axis1", "robot: moberg_axis2", "'moberg_axis1'"),
        ("[[0.3], [-0.2]]", "[[0.3], [99]]", "position 1"),
    ],
)
def test_what_does_not_fit_the_robot_is_named(tmp_path, old, new, said):
    with pytest.raises(InvalidInput) as error:
        prepare(loaded(tmp_path, FILE, (old, new)))
    assert said in str(error.value)


def test_one_number_serves_all_motors():
    motors = ("a", "b")
    assert per_motor("limits.speed", 2.0, motors).tolist() == [2.0, 2.0]
    assert per_motor("limits.speed", [2.0, 3.0], motors).tolist() == [2.0, 3.0]


DESIGN = {
    "schema": "design/1",
    "robot": "moberg_axis1",
    "positions": [
        {"candidate": 4, "position": [0.1], "weight": 0.4, "repetitions": 3},
        {"candidate": 7, "position": [-0.4], "weight": 0.6, "repetitions": 1},
    ],
}


def from_design(folder, document):
    (folder / "design.json").write_text(json.dumps(document), encoding="utf-8")
    source = "positions: [[0.3], [-0.2]]\nrepetitions: [2, 1]"
    return loaded(folder, FILE, (source, "design: design.json"))


def test_positions_of_a_design(tmp_path):
    experiment = from_design(tmp_path, DESIGN)
    positions, repetitions = planned_positions(experiment, "moberg_axis1")
    assert positions.tolist() == [[0.1], [-0.4]]
    assert repetitions.tolist() == [3, 1]


@pytest.mark.parametrize(
    ("document", "said"),
    [
        (DESIGN | {"robot": "ur10"}, "for the robot 'ur10', this experiment's is 'moberg_axis1'"),
        (DESIGN | {"schema": "fit/1"}, "'design/1' is needed"),
        (DESIGN | {"positions": [{"position": [0.1]}]}, "missing key 'positions[0].repetitions'"),
        (
            DESIGN | {"positions": [{"position": [0.1], "repetitions": 2.9, "candidate": 0}]},
            "a whole number is needed, found 2.9",
        ),
        ([1], "'design/1' is needed"),
    ],
)
def test_designs_that_cannot_be_used(tmp_path, document, said):
    with pytest.raises(InvalidInput, match=r"design\.json") as error:
        planned_positions(from_design(tmp_path, document), "moberg_axis1")
    assert said in str(error.value)


def test_absent_design(tmp_path):
    experiment = from_design(tmp_path, DESIGN)
    (tmp_path / "design.json").unlink()
    with pytest.raises(InvalidInput, match="no such file"):
        planned_positions(experiment, "moberg_axis1")


def test_plan_fills_the_swing_and_says_so(tmp_path):
    ready = prepare(loaded(tmp_path))
    again = predicted_peaks(ready.plan, ready.robot, ready.controller)
    assert np.abs(again.swing[:, 2]).max() == pytest.approx(0.002, rel=1e-9)
    assert np.abs(ready.scaling.peaks.swing - again.swing).max() < 1e-9 * np.abs(again.swing).max()
    assert again.largest[:, 0].max() < 20.0
    assert "swing of motor 'm1'" in str(ready.scaling.binding)
    assert ready.scaling.binding.factor == pytest.approx(1.0)


def test_margin_holds_for_the_swing_too(tmp_path):
    ready = prepare(loaded(tmp_path, FILE, ("swing: 0.002", "swing: 0.002, margin: 0.2")))
    assert np.abs(ready.scaling.peaks.swing[:, 2]).max() == pytest.approx(0.0016, rel=1e-9)


def test_a_wide_swing_leaves_the_torque_to_bind(tmp_path):
    ready = prepare(loaded(tmp_path, FILE, ("swing: 0.002", "swing: 3.0")))
    assert "torque of motor 'm1'" in str(ready.scaling.binding)
    assert ready.scaling.peaks.largest[:, 0].max() == pytest.approx(20.0, rel=1e-9)


def test_amplitudes_follow_the_slope(tmp_path):
    ready = prepare(loaded(tmp_path, FILE, ("detection: 3", "slope: -1.0")))
    grid = ready.plan.multisine
    product = grid.amplitudes[:, 0] * grid.lines
    assert product == pytest.approx(product[0])


def test_records_are_those_of_the_plan(tmp_path):
    ready = prepare(loaded(tmp_path))
    outcome = run_experiment(ready, tmp_path)
    plan = ExperimentPlan.load(tmp_path / "plan.yaml")
    records = Records.load(tmp_path / "records.h5")
    assert records.positions[:, 0].tolist() == [0.3, 0.3, -0.2]
    assert records.torque.shape == (3, 2, 1, 2, 250, 1)
    for visit in range(3):
        assert records.reference[visit, :, :, 0] == pytest.approx(plan.reference(visit), abs=1e-12)
    assert np.array_equal(records.lines, plan.multisine.lines)
    assert np.array_equal(records.detection, plan.multisine.detection)
    assert len(records.detection)
    assert outcome.peak_torque == np.abs(records.torque).max()
    # A linear robot does what the linear model predicts, its start included.
    assert outcome.peak_torque < 1.001 * outcome.predicted_torque
    assert outcome.peak_torque > 0.5 * outcome.predicted_torque
    assert outcome.saturated.tolist() == [0.0]


def test_the_seed_decides(tmp_path):
    seen = []
    for seed in (3, 3, 4):
        ready = prepare(loaded(tmp_path, FILE, ("seed: 3", f"seed: {seed}")))
        run_experiment(ready, tmp_path)
        seen.append(Records.load(tmp_path / "records.h5").angle)
    assert np.array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[0], seen[2])


def test_torques_at_their_limit_are_counted(tmp_path):
    change = ("angle_noise: 1.0e-6", "torque_limit: 0.3")
    outcome = run_experiment(prepare(loaded(tmp_path, FILE, change)), tmp_path)
    assert outcome.saturated.tolist() == [1.0]
    assert outcome.peak_torque[0] == pytest.approx(0.3)


def test_gains_may_be_given(tmp_path):
    gains = "controller: {speed_gain: 0.1, integral_time: 0.5, position_gain: 1.0}\nseed: 3"
    ready = prepare(loaded(tmp_path, FILE, ("seed: 3", gains)))
    assert ready.controller.speed_gain.tolist() == [0.1]
    assert ready.controller.sample_time == 0.002


class Interrupted(Exception):
    pass


def interrupted(folder):
    """Simulate the first of three visits."""

    def progress(stage, done, total):
        if stage == "simulation" and done > total / 3:
            raise Interrupted

    with pytest.raises(Interrupted):
        run_experiment(prepare(loaded(folder)), folder, progress)
    assert [p.name for p in folder.glob("visit_*")] == ["visit_00000.h5"]


def angles(folder, *changes):
    run_experiment(prepare(loaded(folder, FILE, *changes)), folder)
    return Records.load(folder / "records.h5").angle


def test_an_interrupted_experiment_goes_on_with_its_next_visit(tmp_path):
    whole = angles(tmp_path)
    interrupted(tmp_path)
    assert np.array_equal(angles(tmp_path), whole)
    assert not list(tmp_path.glob("visit_*"))


@pytest.mark.parametrize(
    "change",
    [
        ("seed: 3", "seed: 4"),
        ("angle_noise: 1.0e-6", "angle_noise: 2.0e-6"),
        ("[[0.3], [-0.2]]", "[[0.3], [-0.1]]"),
        ("swing: 0.002", "swing: 0.001"),
        ("seed: 3", "controller: {speed_gain: 0.1, integral_time: 0.5, position_gain: 1}\nseed: 3"),
    ],
    ids=str,
)
def test_visits_of_another_experiment_are_not_taken(tmp_path, change):
    interrupted(tmp_path)
    with pytest.raises(InvalidInput, match=r"visit_00000\.h5: holds a visit of another experiment"):
        angles(tmp_path, change)


def test_a_damaged_visit_is_not_taken(tmp_path):
    interrupted(tmp_path)
    file = tmp_path / "visit_00000.h5"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"visit_00000\.h5: .*remove it and run the same again"):
        angles(tmp_path)
