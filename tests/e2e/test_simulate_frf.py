"""From an experiment file to records, from records to FRFs and their page: files alone."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from command_line import oed

import robotmodels
from estimators import read_frf, read_records, write_records

EXPERIMENT = """\
schema: experiment/1
robot: moberg_axis1
positions: [[0.3]]
multisine: {band: [1.0, 40.0], sample_time: 0.002, period: 1.0, detection: 4}
blocks: 3
periods: 2
transient_periods: 3
limits: {speed: 5.0}
imperfections: {angle_noise: 1.0e-7, friction: 0, nonlinear_gears: false}
seed: 3
output: results/axis
"""


def write(folder, text=EXPERIMENT):
    path = folder / "experiment.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("experiment")
    code, out, err = oed("simulate", write(folder), "--workers", 1)
    assert (code, err) == (0, "")
    return folder / "results" / "axis", out


@pytest.fixture(scope="module")
def estimated(simulated):
    folder, _ = simulated
    code, out, err = oed("frf", folder / "records.h5", "--robot", "moberg_axis1", "--compare")
    assert (code, err) == (0, "")
    return folder, out


def test_simulate_writes_plan_and_records(simulated):
    folder, out = simulated
    assert {"plan.yaml", "plan.h5", "records.h5"} <= {p.name for p in folder.iterdir()}
    assert "1 position, 3 blocks of 1 run, 3 + 2 periods of 1 s" in out
    assert "speed of motor 'm1' in position 1 meets its limit" in out
    assert str(folder / "records.h5") in out
    assert len(out.splitlines()) < 20


def test_estimates_are_the_linear_models(estimated):
    folder, out = estimated
    assert sorted(p.name for p in folder.iterdir()) == sorted(
        ["frf.h5", "frf.html", "plan.h5", "plan.yaml", "records.h5"]
    )
    estimate = read_frf(folder / "frf.h5")
    robot = robotmodels.load_robot("moberg_axis1")
    G = robotmodels.frequency_response(robot, estimate.positions, estimate.omega)
    assert np.abs(estimate.response / G - 1).max() < 0.01
    assert "methods on this loop, best first" in out
    assert str(folder / "frf.html") in out
    assert "var(--second)" in (folder / "frf.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("ending", [".mat", ".csv"])
def test_other_formats_give_the_same_frfs(estimated, ending, tmp_path):
    folder, _ = estimated
    path = tmp_path / f"records{ending}"
    write_records(path, read_records(folder / "records.h5"))
    for records, there in ((path, "there"), (folder / "records.h5", "here")):
        code, _, err = oed("frf", records, "-o", tmp_path / there)
        assert (code, err) == (0, "")
    mine, other = (read_frf(tmp_path / there / "frf.h5") for there in ("there", "here"))
    assert np.abs(mine.response / other.response - 1).max() < 1e-12


def test_identify_finds_the_springs_from_records(tmp_path):
    noisy = EXPERIMENT.replace("1.0e-7", "1.0e-5").replace("results/axis", "noisy")
    assert oed("simulate", write(tmp_path, noisy), "--workers", 1)[0] == 0
    folder = tmp_path / "noisy"
    records = read_records(folder / "records.h5")
    single = {k: getattr(records, k)[:, :1] for k in ("reference", "torque", "angle", "saturated")}
    write_records(tmp_path / "one.h5", replace(records, **single))
    truth = robotmodels.load_robot("moberg_axis1")
    for path, kind in ((folder / "records.h5", "periods"), (tmp_path / "one.h5", "detection")):
        code, out, err = oed(
            "identify", "moberg_axis1", path, "--noise", kind, "-o", tmp_path, "--json"
        )
        assert (code, err) == (0, "")
        said = json.loads(out)
        assert said["reached"] == 4
        assert said["verdict"] == "trustworthy"
        low, high = np.array([(one["low"], one["high"]) for one in said["intervals"]]).T
        assert (np.log(high / low) < 0.1).all()
        middle = np.log(np.sqrt(low * high) / truth.parameters.values)
        assert (np.abs(middle) < 2 * np.log(high / low)).all()  # well beyond four deviations
        robot = robotmodels.load_robot(said["file"])
        assert set(robot.file.fitted.relative_std) == set(truth.parameters.names)
        assert kind in robot.file.fitted.provenance["data"]
        assert robot.file.fitted.correlation is not None
    code, out, err = oed("identify", "moberg_axis1", tmp_path / "one.h5", "-o", tmp_path)
    assert (code, err) == (0, "")
    assert "runs in each: 1" in out
    assert "N m/rad" in out
    assert "trustworthy" in out
    code, out, err = oed("identify", "ur10", tmp_path / "one.h5", "-o", tmp_path)
    assert code == 2
    assert f"{tmp_path / 'one.h5'}: runs: not of ur10" in err
    still = replace(records, **(single | {"angle": np.ones_like(single["angle"])}))
    write_records(tmp_path / "dead.h5", still)
    code, _, err = oed("identify", "moberg_axis1", tmp_path / "dead.h5", "--noise", "detection")
    assert code == 2
    assert "position 1: output 1 is constant in all runs" in err
    code, _, err = oed("identify", "moberg_axis1", tmp_path / "one.h5", "--noise", "blocks")
    assert code == 2
    assert "noise 'blocks' needs 1 runs a block, two blocks" in err


ONE_RUN = """\
schema: experiment/1
robot: manutec_r3
positions: [[0.0, 0.5, -0.8, 0.0, 0.6, 0.0], [0.4, -0.2, 0.6, 0.3, -0.5, 0.2]]
multisine: {band: [0.5, 60.0], count: 32, period: 2.0, sample_time: 0.001, detection: 4}
runs: 1
blocks: 1
periods: 1
limits: {torque: [10.0, 10.0, 10.0, 2.1, 2.1, 2.1], speed: 6.0}
imperfections: {friction: 0.0, angle_noise: 1.0e-5, torque_disturbance: 0.01}
seed: 4
output: one
"""


def test_twelve_seconds_on_a_robot_show_three_springs(tmp_path):
    """One run of one period in two positions, six motors in closed loop."""
    code, out, _ = oed("simulate", write(tmp_path, ONE_RUN), "--workers", 1)
    assert code == 0
    assert "1 block of 1 run" in out
    assert "12 s on a robot" in out
    command = "identify", "manutec_r3", tmp_path / "one" / "records.h5", "--json"
    code, out, err = oed(*command)
    assert (code, err) == (0, "")
    said = json.loads(out)
    assert said["verdict"] == "trustworthy"
    truth = robotmodels.load_robot("manutec_r3").parameters.values
    low, high = np.log([(one["low"], one["high"]) for one in said["intervals"]]).T
    assert (high[:3] - low[:3] < 0.01).all()  # springs within 1 %
    assert (np.abs((low + high) / 2 - np.log(truth)) < high - low).all()  # four deviations
    code, _, err = oed("frf", tmp_path / "one" / "records.h5", "-o", tmp_path)
    assert code == 2
    assert "1 of 6 runs a block, and a local model would span 24 of 24 lines" in err
    assert "oed identify" in err


OUTPUTS = """\
outputs:
  - {motor: m1, quantity: angle}
  - {joint: axis, quantity: angle}
  - {spring: g1, quantity: torque}
"""


def test_any_number_of_outputs_and_a_band(tmp_path):
    """One motor, its encoder, one behind the gear, and a torque sensor."""
    robot = tmp_path / "axis.yaml"
    robotmodels.save_robot(robotmodels.load_robot("moberg_axis1"), robot)
    robot.write_text(robot.read_text(encoding="utf-8") + OUTPUTS, encoding="utf-8")
    path = write(tmp_path, EXPERIMENT.replace("robot: moberg_axis1", "robot: axis.yaml"))
    code, _, err = oed("simulate", path, "--workers", 1)
    assert (code, err) == (0, "")
    folder = tmp_path / "results" / "axis"
    command = "frf", folder / "records.h5", "--robot", robot, "--band", 0, 20
    code, out, err = oed(*command)
    assert (code, err) == (0, "")
    assert "FRFs     ari, 3 x 1 at" in out
    assert "torques  1 of 1 independent at a line; condition number 1" in out
    said = json.loads(oed(*command, "--json")[1])
    omega, shape = np.array(said["omega"]), (1, len(said["omega"]))
    assert 0 < omega[0] < omega[-1] < 2 * np.pi * 20
    assert np.shape(said["rank"]) == np.shape(said["condition"]) == shape
    assert (said["left_out"], said["torque_loop"]) == ([], None)
    estimate = read_frf(folder / "frf.h5")
    model = robotmodels.load_robot(robot)
    expected = robotmodels.frequency_response(model, estimate.positions, estimate.omega)
    error = np.abs(estimate.response - expected).max(axis=1) / np.abs(expected).max(axis=1)
    assert error.max() < 0.02
    page = (folder / "frf.html").read_text(encoding="utf-8")
    assert "g1 torque" in page
    assert "Every line" in page


def test_measured_torques_are_not_held(estimated, tmp_path):
    folder, _ = estimated
    for options, there in ((("--no-hold",), "free"), ((), "held")):
        assert oed("frf", folder / "records.h5", *options, "-o", tmp_path / there)[0] == 0
    held, free = (read_frf(tmp_path / there / "frf.h5") for there in ("held", "free"))
    half = held.omega * 0.002 / 2  # the hold's response is sinc(half) exp(-j half)
    expected = np.sin(half) / half * np.exp(-1j * half)
    assert (free.response / held.response)[0, :, 0, 0] == pytest.approx(expected, rel=1e-9)


def test_images_of_held_torques_are_taken_off_by_the_robots_model(estimated, tmp_path):
    folder, _ = estimated
    assert oed("frf", folder / "records.h5", "-o", tmp_path)[0] == 0
    with_images, without = read_frf(tmp_path / "frf.h5"), read_frf(folder / "frf.h5")
    robot = robotmodels.load_robot("moberg_axis1")
    model = robotmodels.frequency_response(robot, without.positions, without.omega)
    apart = [np.abs(one.response / model - 1)[0, -5:].max() for one in (without, with_images)]
    assert apart[0] < apart[1] / 3


def refused(folder, words, *command):
    before = sorted(folder.rglob("*"))
    code, out, err = oed(*command)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1
    for word in words:
        assert word in err, err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("blocks: 3", "blcks: 3", ["experiment.yaml", "'blcks'", "'blocks'"]),
        ("blocks: 3", "blocks: [3", ["experiment.yaml", "not valid YAML"]),
        ("robot: moberg_axis1", "robot: moberg_axis2", ["'moberg_axis1'"]),
        ("[[0.3]]", "[[0.3, 0.4]]", ["positions", "2 angles", "m1"]),
        ("[[0.3]]", "[[300.0]]", ["position 0"]),
        ("positions: [[0.3]]", "design: none.json", ["none.json", "no such file"]),
        ("period: 1.0", "period: 0.01", ["band"]),
        ("output: results/axis", "output: experiment.yaml", ["output", "folder"]),
    ],
)
def test_mistakes_in_the_experiment(tmp_path, right, wrong, words):
    assert right in EXPERIMENT
    path = write(tmp_path, EXPERIMENT.replace(right, wrong))
    refused(tmp_path, words, "simulate", path, "--workers", 1)


def test_unstable_controller_writes_nothing(tmp_path):
    gains = "controller: {speed_gain: 50.0, integral_time: 0.05, position_gain: 5.0}\nseed: 3"
    path = write(tmp_path, EXPERIMENT.replace("seed: 3", gains))
    refused(tmp_path, ["unstable"], "simulate", path, "--workers", 1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--method", "arj"), ["'arj'", "ari"]),
        (("--covariance", "totl"), ["'totl'", "'total'"]),
        (("--robot", "ur10"), ["1 motors", "'ur10' has 6"]),
        (("--robot", "ur11"), ["'ur11'", "'ur10'"]),
        (("--band", 30, 20), ["band: 30 to 20 Hz holds none of the excited lines"]),
    ],
)
def test_mistakes_with_frf(simulated, options, words, tmp_path):
    folder, _ = simulated
    refused(tmp_path, words, "frf", folder / "records.h5", *options, "-o", tmp_path / "there")


def test_files_that_are_no_records(tmp_path):
    path = write(tmp_path)
    refused(tmp_path, ["none.h5", "no such file"], "frf", tmp_path / "none.h5")
    refused(tmp_path, ["experiment.yaml", "'.yaml'", ".h5, .mat, .csv"], "frf", path)
    text = tmp_path / "text.h5"
    text.write_text("not HDF5", encoding="utf-8")
    refused(tmp_path, ["text.h5", "not an HDF5 file"], "frf", text)


LOADED = """
import atexit, sys
atexit.register(lambda: print("loaded:", *sys.modules))
from reports.cli import main
main()
"""


def loaded(*words):
    """Return the modules that a command has loaded when it ends, in a process of its own."""
    run = subprocess.run(
        [sys.executable, "-c", LOADED, *map(str, words)], capture_output=True, text=True, check=True
    )
    return set(run.stdout.rpartition("loaded:")[2].split())


def inside(modules, *packages):
    return {m for m in modules if m.startswith(tuple(f"{p}." for p in packages)) or m in packages}


STUDY = ("oed.study", "oed.design", "oed.exact", "oed.plan_comparison", "oed.candidates")
FITS = ("estimators.fitting", "estimators.uncertainty", "estimators.sampling", "estimators.chains")


@pytest.mark.parametrize("robot", [(), ("--robot", "moberg_axis1", "--compare")])
def test_frf_loads_neither_study_nor_fits(simulated, robot, tmp_path):
    modules = loaded("frf", simulated[0] / "records.h5", "-o", tmp_path, *robot)
    assert "estimators.frf.frf_from_records" in modules
    assert (tmp_path / "frf.html").exists()
    assert not inside(modules, *STUDY, *FITS)
    assert ("pinocchio" in modules) == bool(robot)  # needed for a robot's model alone


def test_help_loads_commands_alone(simulated):
    modules = loaded("frf", "--help")
    assert "reports.commands.frf" in modules
    assert not inside(modules, "oed", "estimators", "numpy")
