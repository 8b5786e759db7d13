"""``oed deflection``: from a file of movements to intervals and a robot file."""

import json

import numpy as np
import pytest
import yaml
from conftest import oed

import robotmodels


@pytest.fixture(scope="module")
def movements(tmp_path_factory):
    """Return a file of one slow movement of a kr300, its answer that of springs at rest."""
    robot = robotmodels.load_robot("kr300")
    time = np.arange(0, 40, 0.02)
    motor = np.tile(np.radians([0, -90, 90, 0, 20, 0]), (len(time), 1))
    for joint, hertz in ((1, 0.05), (2, 0.08)):
        motor[:, joint] += 0.3 * np.sin(2 * np.pi * hertz * time)
    rest = robot.equilibrium(motor)
    link = np.full_like(motor, np.nan)
    link[:, :3] = rest.coordinates[:, :3]
    torque = np.full_like(motor, np.nan)
    torque[:, :3] = -rest.elongations * [s.stiffness for s in robot.file.springs]
    link += 1e-6 * np.random.default_rng(0).standard_normal(link.shape)
    signals = {"motor_angle": motor, "link_angle": link, "motor_torque": torque}
    path = tmp_path_factory.mktemp("movements") / "movements.h5"
    robotmodels.save_movements(path, [robotmodels.Movement(robot.motor_names, 0.02, signals)])
    return path


def test_intervals_shares_and_a_robot_file(movements, tmp_path):
    command = "deflection", "kr300", movements, "--check", movements, "-o", tmp_path
    code, out, err = oed(*command, "--json")
    assert code == 0, err
    document = json.loads(out)
    found = {interval["name"]: interval for interval in document["intervals"]}
    assert found["g2.stiffness"]["low"] < 7.5189e6 < found["g2.stiffness"]["high"]
    assert found["g1.stiffness"]["verdict"] == "not identifiable"
    assert found["g1.stiffness"]["low"] is None
    assert document["explained"][0]["g2.stiffness"] > 0.9
    written = yaml.safe_load((tmp_path / "kr300_identified.yaml").read_text())
    assert written["springs"][1]["stiffness"] == found["g2.stiffness"]["value"]
    code, out, _ = oed(*command)
    assert code == 0
    for words in ("payload.mass", "torque scale 5%", "explained", "written"):
        assert words in out


def test_one_line_for_a_mistake(movements, tmp_path):
    code, _, err = oed("deflection", "kr300", movements, "--payload", "scales")
    assert (code, err.strip()) == (
        2,
        "error: --payload: 'scales'; torques or robot-file is needed",
    )
    code, _, err = oed("deflection", "panda", movements, "-o", tmp_path)
    assert code == 2
    assert "error:" in err
    assert len(err.strip().splitlines()) == 1
