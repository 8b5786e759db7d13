"""``oed deflection``: from a file of movements to intervals and a robot file."""

import json

import numpy as np
import pytest
import yaml
from browser import violations_of
from command_line import oed

import estimators
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
        "error: --payload: 'scales' is unknown; there are torques, robot-file",
    )
    code, _, err = oed("deflection", "panda", movements, "-o", tmp_path)
    assert code == 2
    assert "error:" in err
    assert len(err.strip().splitlines()) == 1


STUDY = """\
schema: study/1
robot: kr300
data: {{movements: {movements}}}
fit: {{residuals: [deflection], low_pass: 4.0}}
validation: {{movements: {movements}}}
output: results
"""


def written(folder, movements, *change):
    path = folder / "study.yaml"
    path.write_text(STUDY.format(movements=movements).replace(*change or ("", "")))
    return path


def test_a_study_of_movements_has_numbers_a_robot_file_and_a_page(movements, tmp_path):
    code, out, err = oed("run", written(tmp_path, movements))
    assert (code, err) == (0, "")
    results = tmp_path / "results"
    assert {path.name for path in results.iterdir()} == {
        "deflection.json",
        "kr300_identified.yaml",
        "report.html",
    }
    robotmodels.load_robot(results / "kr300_identified.yaml")  # it finds its URDF
    document = json.loads((results / "deflection.json").read_text())
    robot = robotmodels.load_robot("kr300")
    assumptions = estimators.DeflectionAssumptions(low_pass=4.0)
    records = list(robotmodels.iterate_movements(movements))
    fit = estimators.fit_deflection(robot, records, assumptions=assumptions)
    values = {one["name"]: one["value"] for one in document["intervals"]}
    assert values["g2.stiffness"] == pytest.approx(fit.intervals()[0].value, rel=1e-9)
    assert (document["verdict"], document["reason"]) == (
        "trustworthy",
        "2 of 3 stiffnesses have an interval",
    )
    assert document["explained"][0]["g2.stiffness"] > 0.9
    page = (results / "report.html").read_text()
    for section in ("parameters", "systematic", "deflections", "residuals", "provenance"):
        assert f'id="{section}"' in page
    for words in ("torque scale 5%", "2 of 3 stiffnesses", "deflection-g2", "gear of g3.stiffness"):
        assert words in page
    assert "explained" in out
    report = (results / "report.html").rename(tmp_path / "report.html")
    assert oed("fit", tmp_path / "study.yaml")[0] == 0
    assert not (results / "report.html").exists()
    assert violations_of(report) == []


def test_measured_deflections_are_fitted_ones_and_residuals(movements):
    robot = robotmodels.load_robot("kr300")
    fit = estimators.fit_deflection(robot, list(robotmodels.iterate_movements(movements)))
    (history,) = fit.histories("g3.stiffness")
    residuals = (history.measured - history.fitted)[history.used]
    np.testing.assert_allclose(residuals, fit.estimate.axes[1].regression.residuals, atol=1e-12)
    with pytest.raises(robotmodels.InvalidInput, match=r"'g1\.stiffness' was not fitted"):
        fit.histories("g1.stiffness")


MISTAKES = {
    "no movements": (
        "data: {movements",
        "data: {records",
        "unknown key 'data.records'; known are movements",
    ),
    "other residual": ("[deflection]", "[nls]", "fit.residuals"),
    "posterior": ("output:", "posterior: {steps: 100}\noutput:", "unknown key 'posterior'"),
    "weights": ("low_pass: 4.0", "minimum_snr: 3.0", "unknown key 'fit.minimum_snr'"),
    "no file": ("movements.h5}", "none.h5}", "none.h5: no such file"),
    "payload": ("low_pass: 4.0", "payload: scales", "fit.payload"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_movements_do_not_have_is_named(mistake, movements, tmp_path):
    right, wrong, words = MISTAKES[mistake]
    code, _, err = oed("run", written(tmp_path, movements, right, wrong))
    assert (code, len(err.splitlines())) == (2, 1)
    assert words in err
    assert "study.yaml" in err


def test_movements_have_no_design_and_other_robots_no_such_movements(movements, tmp_path):
    code, _, err = oed("design", written(tmp_path, movements))
    assert (code, len(err.splitlines())) == (2, 1)
    assert "data.movements: movements have neither design nor posterior" in err
    code, _, err = oed("run", written(tmp_path, movements, "kr300", "panda"))
    assert (code, len(err.splitlines())) == (2, 1)
    assert "movements.h5: " in err
