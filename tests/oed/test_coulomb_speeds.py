"""Studies count Coulomb friction as dampers at the speeds of their data, or at stated ones."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import robotmodels
from oed.study.settings.study_file import load_study
from oed.study.sources import _at_simulated_speeds
from oed.study.stages.run import open_run
from robotmodels import IdentificationError, Records
from robotmodels.description.friction import friction_sentences

ROBOT = robotmodels.load_robot("manutec_r3")
RMS = np.array([1.0, 2.0, 3.0, 0.5, 0.4, 0.3])  # rad/s


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a frictional robot, and records in which its motors move by RMS."""
    motors = [m.model_copy(update={"coulomb": 0.1}) for m in ROBOT.file.motors]
    file = ROBOT.file.model_copy(update={"motors": motors})
    robotmodels.save_robot(replace(ROBOT, file=file), tmp_path / "robot.yaml")
    time = 1e-3 * np.arange(1000)
    angle = np.sqrt(2) * RMS / (20 * np.pi) * np.sin(20 * np.pi * time)[:, None]
    angle = angle[None, None, None, None]
    still = np.zeros((*angle.shape[:4], 6), dtype=bool)
    Records(
        np.zeros((1, 6)), 1e-3, np.zeros_like(angle), angle, angle, np.array([10]),
        np.array([], dtype=int), still,
    ).save(tmp_path / "records.h5")  # fmt: skip
    return tmp_path


def study(folder, data, **others):
    content = {"schema": "study/1", "robot": "robot.yaml", "output": "out", "data": data}
    (folder / "study.yaml").write_text(yaml.safe_dump(content | others), encoding="utf-8")
    return load_study(folder / "study.yaml")


def damping(robot):
    return np.diagonal(robotmodels.linearize(robot, np.zeros((1, 6))).damping[0])


@pytest.mark.parametrize("speeds", ["data", RMS.tolist()])
def test_measured_studies_count_friction_as_a_damper(folder, speeds):
    data = {"records": "records.h5"}
    with open_run(study(folder, data)) as run:
        plain, digest = run.robot, run.robot_digest
    with open_run(study(folder, {**data, "coulomb_speeds": speeds})) as run:
        counted = run.robot
        assert run.robot_digest != digest  # or stages of another robot would be taken
    added = [m.equivalent for m in counted.file.motors]
    np.testing.assert_allclose(added, 0.1 * np.sqrt(2 / np.pi) / RMS, rtol=1e-6)
    assert not any(m.equivalent for m in plain.file.motors)
    assert (damping(counted) >= damping(plain)).all()
    assert (damping(counted) > damping(plain)).sum() >= 6
    assert "DOMINATES" in friction_sentences(counted.file)[0]


EXPERIMENT = {
    "multisine": {"band": [2.0, 40.0], "sample_time": 0.002, "period": 1.0},
    "blocks": 2,
    "limits": {"torque": 6.0, "speed": 100.0},
}
SIMULATED = {
    "frequencies": {"low": 2.0, "high": 40.0, "count": 5},
    "noise": {"relative": 0.03, "floor": 0.01},
    "candidates": {"sobol": 4},
}


def test_simulated_studies_take_the_speeds_of_their_experiment(folder):
    data = {"experiment": EXPERIMENT, "coulomb_speeds": "data"}
    with open_run(study(folder, data, **SIMULATED)) as run:
        assert not any(m.equivalent for m in run.robot.file.motors)  # of the design
        after = _at_simulated_speeds(run, folder / "records.h5")
        speeds = [m.coulomb_speed for m in after.robot.file.motors]
        np.testing.assert_allclose(speeds, RMS, rtol=1e-6)
    with open_run(study(folder, {"experiment": EXPERIMENT}, **SIMULATED)) as run:
        assert _at_simulated_speeds(run, folder / "records.h5") is run


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"records": "records.h5", "coulomb_speeds": "dat"}, r"data\.coulomb_speeds: .*'data', f"),
        ({"records": "records.h5", "coulomb_speeds": [1.0, -2.0]}, r"coulomb_speeds: .* positive"),
        ({"frf": "records.h5", "coulomb_speeds": "data"}, r"'data' are the speeds of an experim"),
        ({"records": "records.h5", "coulomb_speeds": [1.0]}, r"data\.coulomb_speeds: .*6 positive"),
    ],
)
def test_speeds_that_cannot_be(folder, data, message):
    with pytest.raises(IdentificationError, match=message), open_run(study(folder, data)):
        pass
