import csv
from dataclasses import replace

import h5py
import numpy as np
import pytest
import yaml
from scipy.io import loadmat
from two_axes import RATIOS, ROBOT, N, T, plan

from oed import ExperimentPlan, crest_factor, export_csv, export_mat
from robotmodels import InvalidInput

FIELDS = ("robot", "periods", "transient_periods", "blocks", "motors", "duration")
ARRAYS = ("positions", "repetitions", "phases", "scale", "start", "visits")
SINE = ("samples", "sample_time", "lines", "detection", "amplitudes", "odd", "inputs")


def assert_equal(a, b):
    for name in FIELDS:
        assert getattr(a, name) == getattr(b, name)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for name in SINE:
        np.testing.assert_array_equal(getattr(a.multisine, name), getattr(b.multisine, name))
    for name in ("motors", "positions", "speed", "acceleration"):
        np.testing.assert_array_equal(getattr(a.moves, name), getattr(b.moves, name))


def test_the_same_seed_gives_the_same_plan_and_another_one_another():
    assert_equal(plan(seed=7, crest_iterations=5), plan(seed=7, crest_iterations=5))
    assert (plan(seed=7).phases.shape != plan(seed=8).phases.shape) or (
        plan(seed=7).phases != plan(seed=8).phases
    ).all()


def test_every_visit_and_block_has_its_own_phases():
    measured = plan()
    assert measured.visits.tolist() == [0, 1, 1]
    assert measured.phases.shape == (3, 2, len(measured.multisine.lines), 2)
    flat = measured.phases.reshape(6, -1)
    assert all((flat[i] != flat[j]).all() for i in range(6) for j in range(i))
    np.testing.assert_allclose(measured.visited, measured.positions[[0, 1, 1]])


def test_reference_is_scaled():
    measured = plan()
    louder = measured.rescaled(np.array([1.0, 2.0, 3.0]))
    assert measured.reference(0).shape == (2, 2, N, 2)
    np.testing.assert_allclose(louder.reference(2), 3 * measured.reference(2))
    np.testing.assert_allclose(louder.rescaled(2.0).scale, [2, 4, 6])
    np.testing.assert_array_equal(louder.signals[2], louder.reference(2))


def test_fewer_runs_are_the_first_of_the_orthogonal_ones(tmp_path):
    whole, single = plan(), plan(runs=1)
    assert (whole.runs, single.runs) == (2, 1)
    assert single.reference(0).shape == (2, 1, N, 2)
    np.testing.assert_array_equal(single.reference(2), whole.reference(2)[:, :1])
    assert single.excitation_duration == whole.excitation_duration / 2
    single.save(tmp_path / "plan.yaml")
    assert ExperimentPlan.load(tmp_path / "plan.yaml").runs == 1
    export_mat(single, tmp_path / "matlab", RATIOS)
    file = loadmat(tmp_path / "matlab" / "visit_001.mat")
    assert file["reference"].shape == (N, 2, 1, 2)
    with pytest.raises(InvalidInput, match="runs: 3; a block has 1 to 2, as many as motors"):
        plan(runs=3)


def test_positions_are_put_in_order_on_request(tmp_path):
    positions = np.array([[0.0, 0.0], [1.2, 1.5], [0.1, 0.1], [1.1, 1.4]])
    usual = {"positions": positions, "repetitions": (1, 2, 3, 1), "start": (-0.1, 0.0)}
    plain, short = plan(**usual), plan(**usual, reorder=True)
    assert plain.order is None
    assert short.order.order.tolist() == [0, 2, 3, 1]
    np.testing.assert_array_equal(short.positions, positions[[0, 2, 3, 1]])
    assert short.repetitions.tolist() == [1, 3, 1, 2]
    # Moves are rounded up to whole samples.
    assert short.order.saved > 1.0
    assert plain.duration - short.duration == pytest.approx(short.order.saved, abs=8 * T)
    short.save(tmp_path / "plan.yaml")
    kept = ExperimentPlan.load(tmp_path / "plan.yaml").order
    assert kept.order.tolist() == short.order.order.tolist()
    assert (kept.duration, kept.unordered_duration) == (
        short.order.duration,
        short.order.unordered_duration,
    )
    assert kept.optimal


def test_crest_factors_are_lowered_on_request():
    plain, low = plan(), plan(crest_iterations=50)
    peaks = [crest_factor(p.reference(1)).max() for p in (plain, low)]
    assert peaks[1] < 0.8 * peaks[0]


def test_duration_is_excitation_and_moves():
    measured = plan(start=(0.0, 0.0))
    # 3 visits, 2 blocks, 2 experiments, 2 + 1 periods of 0.5 s.
    assert measured.excitation_duration == pytest.approx(18.0)
    # Quintics: the first is bound by acceleration, the second by speed, the third is none.
    first = np.sqrt(10 / np.sqrt(3) * 0.3 / 3)
    second = 15 / 8 * 1.5
    assert measured.duration == pytest.approx(18 + first + second, abs=2 * T)
    assert [len(measured.move_to(v)) > 0 for v in range(3)] == [True, True, False]
    assert len(plan().move_to(0)) == 0  # it starts in its first position


def test_written_and_read_back(tmp_path):
    measured = plan(start=(0.0, 0.0)).rescaled(np.array([0.1, 1 / 3, 2.0]))
    path = tmp_path / "plan.yaml"
    measured.save(path)
    assert_equal(ExperimentPlan.load(path), measured)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plan.h5", "plan.yaml"]
    content = yaml.safe_load(path.read_text())
    assert content["duration"] == measured.duration
    first = path.read_bytes(), (tmp_path / "plan.h5").read_bytes()
    measured.save(path)
    assert (path.read_bytes(), (tmp_path / "plan.h5").read_bytes()) == first


def play(folder):
    """Put the trajectories of a folder together as a robot controller would."""
    positions, speeds = [], []
    with (folder / "sequence.csv").open() as file:
        for row in csv.DictReader(file):
            table = np.loadtxt(folder / row["file"], delimiter=",", skiprows=1, ndmin=2)
            np.testing.assert_allclose(table[:, 0], np.arange(len(table)) * T, atol=1e-9)
            table = np.tile(table, (int(row["repeats"]), 1))
            positions.append(table[:, 1:3])
            speeds.append(table[:, 3:])
    return np.vstack(positions), np.vstack(speeds)


def test_csv_trajectories_play_the_whole_plan(tmp_path):
    measured = plan(start=(0.0, 0.0), blocks=1)
    export_csv(measured, tmp_path / "csv", RATIOS)
    header = (tmp_path / "csv" / "visit_001_move.csv").read_text().splitlines()[0]
    assert header == "time,m1.position,m2.position,m1.speed,m2.speed"
    positions, speeds = play(tmp_path / "csv")
    assert len(positions) == round(measured.duration / T)
    low, high = ROBOT.position_limits.T
    assert ((positions >= low) & (positions <= high)).all()
    steps = np.diff(positions, axis=0) / T
    assert np.abs(steps).max() < 1.0 + 1e-6
    assert (
        np.abs(np.diff(steps, axis=0) / T).max(axis=0) < measured.moves.acceleration + 0.1
    ).all()
    np.testing.assert_allclose(positions[0], 0, atol=1e-12)
    np.testing.assert_allclose(positions[-1], measured.positions[1])
    # The last period is that of the last experiment; the speed of moves is the motors'.
    np.testing.assert_allclose(speeds[-N:], measured.reference(2)[0, 1], rtol=1e-9, atol=1e-9)
    move = measured.move_to(0)
    np.testing.assert_allclose(speeds[: len(move)], RATIOS * move.speeds, rtol=1e-9, atol=1e-9)


def test_a_ramp_is_a_step_of_its_own(tmp_path):
    measured = plan(repetitions=None, blocks=1, transient_periods=2, ramp=True)
    measured.save(tmp_path / "plan.yaml")
    assert ExperimentPlan.load(tmp_path / "plan.yaml").ramp
    export_csv(measured, tmp_path / "csv", RATIOS)
    with (tmp_path / "csv" / "sequence.csv").open() as file:
        steps = [row for row in csv.DictReader(file) if row["kind"] != "move"]
    assert [(row["kind"], row["repeats"], row["drop"]) for row in steps[:2]] == [
        ("ramp", "1", "1"),
        ("excitation", "3", "1"),
    ]
    _, speeds = play(tmp_path / "csv")
    run = speeds[: 4 * N]
    period = measured.reference(0)[0, 0]
    np.testing.assert_allclose(run[N:], np.tile(period, (3, 1)), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(run[:N], measured.envelope[:, None] * period, rtol=1e-9, atol=1e-9)
    export_mat(measured, tmp_path / "mat", RATIOS)
    envelope = loadmat(tmp_path / "mat" / "visit_001.mat")["envelope"].ravel()
    np.testing.assert_array_equal(envelope, measured.envelope)
    assert (envelope[0], envelope[N // 8]) == (0, pytest.approx(0.5, abs=0.02))
    assert (envelope[N // 4 :] == 1).all()
    assert (plan().envelope == 1).all()


def test_plan_files_without_a_ramp_are_read(tmp_path):
    plan().save(tmp_path / "plan.yaml")
    text = (tmp_path / "plan.yaml").read_text()
    (tmp_path / "plan.yaml").write_text(text.replace("ramp: false\n", ""))
    assert_equal(ExperimentPlan.load(tmp_path / "plan.yaml"), plan())


def test_matlab_files_hold_the_plan(tmp_path):
    measured = plan(start=(0.0, 0.0))
    export_mat(measured, tmp_path / "mat", RATIOS)
    assert sorted(p.name for p in (tmp_path / "mat").iterdir()) == [
        f"visit_00{k}.mat" for k in (1, 2, 3)
    ]
    for visit in range(3):
        content = loadmat(tmp_path / "mat" / f"visit_00{visit + 1}.mat")
        reference = np.transpose(content["reference"], (3, 2, 0, 1))
        np.testing.assert_array_equal(reference, measured.reference(visit))
        np.testing.assert_array_equal(content["position"][0], measured.visited[visit])
        assert [str(name[0]) for name in content["motors"].ravel()] == ["m1", "m2"]
        assert content["position_number"].item() == measured.visits[visit] + 1
        path = measured.move_to(visit)
        assert content["move_position"].shape == path.positions.shape
        np.testing.assert_array_equal(content["move_speed"], RATIOS * path.speeds)
        for name in ("periods", "transient_periods", "sample_time"):
            assert content[name].item() in (2, 1, T)
        np.testing.assert_array_equal(content["lines"].ravel(), measured.multisine.lines)


def test_export_needs_a_ratio_per_motor(tmp_path):
    for export in (export_csv, export_mat):
        with pytest.raises(InvalidInput, match=r"gear_ratios: 2 numbers .* per motor: m1, m2"):
            export(plan(), tmp_path / "out", [50.0])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        (
            {"positions": np.array([[0, 0], [0, 2.5]])},
            r"position 1: motor 'm2' at 2.5 is outside its limits \[-2, 2\]",
        ),
        ({"positions": np.zeros((0, 2))}, r"positions: shape \(0, 2\) given; \(Q, 2\)"),
        ({"start": (2.0, 0.0)}, "start 0: motor 'm1' at 2 is outside"),
        ({"periods": 0}, "periods: 0; a whole number >= 1"),
        ({"transient_periods": 0, "ramp": True}, "ramp: it takes a transient period"),
        ({"transient_periods": -1}, "transient_periods: -1; a whole number >= 0"),
        ({"blocks": 0}, "blocks: 0; a whole number >= 1"),
        ({"repetitions": (1,)}, r"repetitions: shape \(1,\) given; \(2,\), one per position"),
        ({"repetitions": (1, 0)}, "repetitions of position 1: 0; a whole number >= 1"),
        ({"speed": (1.0, -1.0)}, "motor 'm2': speed of moves: -1 is not a number > 0"),
    ],
)
def test_errors_of_a_plan_take_one_line(keywords, message):
    with pytest.raises(InvalidInput, match=message) as caught:
        plan(**keywords)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"phases": np.zeros((3, 2, 5, 2))}, r"phases: shape \(3, 2, 5, 2\); \(3, blocks, "),
        ({"scale": np.zeros(3)}, "scale: 3 positive numbers"),
        ({"scale": np.ones(2)}, "scale: 3 positive numbers"),
    ],
)
def test_errors_of_arrays_that_do_not_fit(changed, message):
    with pytest.raises(InvalidInput, match=message):
        replace(plan(), **changed)
    measured = plan()
    with pytest.raises(InvalidInput, match="multisine: 3 inputs; the robot has 2 motors"):
        replace(measured, multisine=replace(measured.multisine, inputs=3, amplitudes=1.0))
    with pytest.raises(InvalidInput, match="blocks: none given"):
        replace(measured, phases=measured.phases[:, :0])


def edited(path, **changes):
    content = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump({**content, **changes}))


@pytest.mark.parametrize("name", ["1e5", "0o17", "on", "1:40", "~", "a # b", ".5"])
def test_names_that_look_like_numbers_are_read_as_they_were_written(tmp_path, name):
    replace(plan(), robot=name).save(tmp_path / "plan.yaml")
    assert ExperimentPlan.load(tmp_path / "plan.yaml").robot == name


def test_files_that_do_not_fit_are_named(tmp_path):
    path, arrays = tmp_path / "plan.yaml", tmp_path / "plan.h5"

    def load(message):
        with pytest.raises(InvalidInput, match=message) as caught:
            ExperimentPlan.load(path)
        assert "\n" not in str(caught.value)
        plan().save(path)

    load("plan.yaml: no such file")
    edited(path, periods=0)
    load("plan.yaml: periods: 0; a whole number >= 1")
    edited(path, perods=1)
    load(r"plan.yaml:44: unknown key 'perods' \(did you mean 'periods'\?\)")
    edited(path, positions=[[0.0, 0.0], [0.0]])
    load("plan.yaml: positions: rows of equal length")
    edited(path, blocks=3)
    load("plan.yaml: blocks: 3, but plan.h5 holds the phases of 2")
    plan(seed=9).save(tmp_path / "other.yaml")
    edited(path, signals="other.h5")
    load("other.h5: its signals are not those of the plan that names it")
    with h5py.File(arrays, "a") as file:
        del file["scale"]
    load(r"plan.h5: 'scale' is missing \(found: 'amplitudes', 'phases', 'fingerprint'\)")
    arrays.write_text("text")
    load("plan.h5: not an HDF5 file")
    arrays.unlink()
    load("plan.h5: no such file")
    assert_equal(ExperimentPlan.load(path), plan())


def test_a_failed_write_leaves_the_old_plan(tmp_path, monkeypatch):
    path = tmp_path / "plan.yaml"
    plan().save(path)
    before = path.read_bytes()

    def full(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(InvalidInput, match=r"plan.yaml: cannot be written to \(no space left\)"):
        plan(seed=2).save(path)
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 2
    with pytest.raises(InvalidInput, match=r"a plan's file name ends in \.yaml"):
        plan().save(tmp_path / "plan.json")
