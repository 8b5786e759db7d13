"""Files for controllers: the same motion in every format, and every sample judged."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from oed.experiment.controller_files import check_files, write_controller_files
from oed.experiment.experiment_file import load_experiment
from oed.experiment.prepare import gear_ratios, prepare
from oed.experiment.trajectory_bag import read_trajectories, write_trajectories
from robotmodels import InvalidInput
from robotmodels.description.friction import shaft_friction

FILE = """
schema: experiment/1
robot: manutec_r3
positions: [[0.0, 0.5, -0.8, 0.0, 0.6, 0.0], [0.1, 0.4, -0.7, 0.2, 0.5, 0.0]]
runs: 1
blocks: 1
periods: 2
transient_periods: 2
multisine: {band: [5.0, 40.0], sample_time: 0.004, period: 1.0}
limits: {torque: [8, 8, 8, 4, 4, 1], speed: 200.0, swing: 0.05, rms_torque: 6.0,
         command_speed: 60.0, command_acceleration: 2.0e+4}
settle: 0.1
carrier: {speed: 2.0}
output: out
"""
ALL = ("csv", "mat", "trajectory")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return settings, prepared experiment and folder of all files."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "experiment.yaml").write_text(FILE)
    settings = load_experiment(folder / "experiment.yaml")
    prepared = prepare(settings)
    write_controller_files(prepared.plan, folder / "c", ALL, settings, prepared.robot)
    return settings, prepared, folder / "c"


@pytest.fixture
def tampered(written, tmp_path):
    """Return the same with a copy of the folder."""
    shutil.copytree(written[2], tmp_path / "c")
    return *written[:2], tmp_path / "c"


def refuse(tampered, name, message):
    settings, prepared, folder = tampered
    with pytest.raises(InvalidInput, match=message):
        check_files(prepared.plan, folder / name, name, settings, prepared.robot)


def change(path: Path, row: int, column: int, factor: float, shift: float = 0.0):
    """Change a cell of a CSV file."""
    lines = path.read_text().splitlines()
    cells = lines[row + 1].split(",")
    cells[column] = repr(float(cells[column]) * factor + shift)
    lines[row + 1] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")


def test_the_bag_plays_what_the_speeds_say(written):
    """A controller with this position gain and fed-forward speed is told the plan's speeds."""
    _, prepared, folder = written
    plan, gain = prepared.plan, prepared.controller.position_gain
    ratios = gear_ratios(prepared.robot)
    names, motions = [], []
    for name, times, p, v in read_trajectories(folder / "trajectory"):
        names.append(name)
        np.testing.assert_allclose(np.diff(times), 0.004, atol=1e-9)
        motions.append((p, v))
    assert names == [
        "visit 1, settle",
        "visit 1, block 1, run 1",
        "visit 2, move",
        "visit 2, settle",
        "visit 2, block 1, run 1",
    ]
    p, v = motions[4]
    np.testing.assert_allclose(np.diff(p, axis=0), 0.002 * (v[1:] + v[:-1]), atol=1e-12)
    told = (v + gain * (p - plan.positions[1])) * ratios
    played = plan.played(plan.reference(1)[0, 0], 4)
    np.testing.assert_allclose(told[: len(played)], played, atol=1e-9 * np.abs(played).max())
    np.testing.assert_allclose(p[-1], plan.positions[1], atol=1e-6)
    told = (folder / "README.txt").read_text()
    assert "Brakes" in told
    (row,) = (line for line in told.splitlines() if line.startswith("torque [N m]"))
    predicted = prepared.scaling.peaks.largest[:, 0].max(axis=0)
    friction = shaft_friction(prepared.robot.file)
    largest = [float(x) for x in row.split("]")[1].split()]
    assert (largest <= 1.001 * (predicted + friction)).all()
    assert (largest >= 0.6 * predicted).all()


@pytest.mark.parametrize(
    ("file", "column", "factor", "shift", "message"),
    [
        ("visit_001_block_01_run_01", 8, 1, 70.0, "motor 'm2' at 0.4 s: command_speed"),
        ("visit_001_block_01_run_01", 2, 1, 3.0, "motor 'm2' at 0.4 s: commanded position 3.5 rad"),
        ("visit_001_block_01_run_01", 4, 1, np.nan, "motor 'm4' at 0.4 s: commanded position nan"),
        ("visit_002_move", 1, 1, 1e-3, "motor 'm1' at 0.396 s: acceleration of the move"),
        ("visit_002_move", 1, 1, 1.0, "motor 'm1' at 0.4 s: speed of the move"),
        ("visit_002_move", 7, 3, 0.0, "motor 'm1' at 0.4 s: acceleration of the move"),
        ("visit_001_settle", 7, 1, 500.0, "motor 'm1' at 0.04 s: speed of the move"),
        ("visit_001_block_01_run_01", 0, 1, 0.1, "sample 101 at 0.5 s; 0.4 s, sampled every 0.004"),
    ],
)
def test_tampered_samples_of_csv_files_are_refused(tampered, file, column, factor, shift, message):
    path = tampered[2] / "csv" / f"{file}.csv"
    change(path, 10 if "settle" in file else 100, column, factor, shift)
    refuse(tampered, "csv", rf"{file}.csv: {message}")


def test_a_run_that_is_louder_than_planned_breaks_what_is_predicted(tampered):
    """No command is refused for itself; the model under the controller says what they lead to."""
    settings, prepared, folder = tampered
    lenient = settings.model_copy(
        update={
            "limits": settings.limits.model_copy(
                update={"command_speed": None, "command_acceleration": None, "rms_torque": None}
            )
        }
    )
    path = folder / "mat" / "visit_002.mat"
    content = {k: v for k, v in loadmat(path).items() if not k.startswith("__")}
    savemat(path, {**content, "reference": 20 * content["reference"]})
    with pytest.raises(InvalidInput, match=r"visit_002.mat: motor 'm\d' at .* s: torque .* N m is"):
        check_files(prepared.plan, folder / "mat", "mat", lenient, prepared.robot)
    refuse(tampered, "mat", r"visit_002.mat: motor 'm\d' at .* s: command_speed .* rad/s is")


def test_heat_is_judged_in_files(tampered):
    """The same files under a smaller limit of root mean squares."""
    settings, prepared, folder = tampered
    limits = settings.limits.model_copy(update={"rms_torque": [6.0, 6.0, 6.0, 0.2, 4.0, 1.0]})
    changed = (settings.model_copy(update={"limits": limits}), prepared, folder)
    refuse(changed, "mat", "visit_001.mat: motor 'm4' at 0 s: rms_torque .* beyond its limit 0.2")


def test_tampered_bags_are_refused(tampered):
    _, prepared, folder = tampered
    motions = [(n, p.copy(), v.copy()) for n, _, p, v in read_trajectories(folder / "trajectory")]
    motions[1][2][50, 2] += 5.0
    shutil.rmtree(folder / "trajectory")
    joints = [motor.joint for motor in prepared.robot.file.motors]
    write_trajectories(folder / "trajectory", joints, 0.004, motions)
    refuse(tampered, "trajectory", r"visit 1, block 1, run 1: motor 'm3' at 0.2 s: command_speed")
    shutil.rmtree(folder / "trajectory")
    write_trajectories(folder / "trajectory", joints, 0.005, motions)
    refuse(tampered, "trajectory", r"settle: sample 2 at 0.005 s; 0.004 s, sampled every 0.004 s")


def test_files_that_are_no_such_files(tampered):
    folder = tampered[2]
    (folder / "csv" / "sequence.csv").write_text("kind,file\nmove,x.csv\n")
    refuse(tampered, "csv", "csv: not a sequence of csv files")
    (folder / "mat" / "visit_001.mat").write_text("no")
    refuse(tampered, "mat", "visit_001.mat: not a visit for MATLAB")
    (folder / "trajectory" / "metadata.yaml").unlink()
    refuse(tampered, "trajectory", "trajectory: not a bag")


def test_trajectories_need_a_position_gain(written, tmp_path):
    prepared = written[1]
    gains = {"speed_gain": 0.3, "integral_time": 0.1, "position_gain": 0.0}
    (tmp_path / "e.yaml").write_text(FILE + f"controller: {gains}\n")
    loose = load_experiment(tmp_path / "e.yaml")
    with pytest.raises(InvalidInput, match="position gain of motor 'm1' is 0; without one"):
        write_controller_files(
            prepared.plan, tmp_path / "c", ("trajectory",), loose, prepared.robot
        )
    assert not (tmp_path / "c" / "README.txt").exists()
