"""Studies of visits: minutes or targets in, visits as files and a page out."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import violations_of
from command_line import oed

from oed.experiment.experiment_plan import ExperimentPlan
from robotmodels import Records, load_robot, save_robot

STUDY = {
    "schema": "study/1",
    "robot": "moberg_axis1",
    "candidates": {"positions": [[0.0], [0.5]]},
    "noise": {"torque": 0.05, "speed": 0.02},
    "design": {"minutes": 0.7},
    "multisine": {"band": [1.0, 40.0], "sample_time": 0.002, "period": 1.0},
    "limits": {"torque": 5.0, "speed": 5.0, "swing": 0.05},
    "most_periods": 8,
    "imperfections": {"angle_noise": 1e-5, "nonlinear_gears": False},
    "output": "out",
}


@pytest.fixture(autouse=True)
def _in_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def written(**changes) -> str:
    content = STUDY | changes
    Path("study.yaml").write_text(yaml.safe_dump(content))
    return "study.yaml"


def refused(*arguments) -> str:
    code, _, err = oed(*arguments)
    assert code == 2
    assert len(err.strip().splitlines()) == 1, err
    return err


def robot_std(path) -> float:
    """Return the geometric mean of the standard deviations that a robot file has of its fit."""
    std = yaml.safe_load(Path(path).read_text())["fitted"]["relative_std"]
    return float(np.exp(np.mean(np.log(list(std.values())))))


def test_minutes_become_visits_records_and_a_page():
    code, out, err = oed("run", written(), "--json")
    assert code == 0, err
    document = json.loads(out)
    assert document["schema"] == "visits/1"
    assert 0 < document["seconds"] <= 42
    assert 0.5 < document["efficiency"] <= 1
    longer = [max(one["relative_std"].values()) for one in document["curve"]]
    assert (np.diff(longer) < 0).all()
    page = Path(shutil.copy("out/report.html", "report.html")).read_text()
    for words in ("begins at", "Root mean square torque of each motor", "oed run study.yaml"):
        assert words in page
    for number, visit in enumerate(document["visits"], start=1):
        plan = ExperimentPlan.load(f"out/visits/{number:03d}/plan.yaml")
        assert plan.positions[0].tolist() == visit["position"]
        assert (plan.periods, plan.runs) == (visit["periods"], visit["runs"])
    total = sum(one["seconds"] for one in document["visits"])
    assert total == pytest.approx(document["seconds"])

    code, out, err = oed("simulate", "study.yaml", "--json")
    assert code == 0, err
    files = json.loads(out)["files"]
    assert len(files) == len(document["visits"])
    records = Records.load(files[0])
    assert records.positions[0].tolist() == document["visits"][0]["position"]
    # Torques are inside the limit that the plan was made for.
    assert np.abs(records.torque).max() <= 5.0
    assert oed("design", "study.yaml")[0] == 0
    assert all(Path(file).exists() for file in files)  # the same plan stays
    # All visits together say more than the first alone.
    widths = []
    for some in (files[:1], files):
        code, out, err = oed(
            "identify", "moberg_axis1", *some, "--starts", 1, "-o", "fit", "--json"
        )
        assert code == 0, err
        widths.append(robot_std("fit/moberg_axis1_identified.yaml"))
    assert widths[1] < widths[0]
    assert "files of records" in refused("identify", "moberg_axis1", *files, "--coulomb")
    err = refused("design", written(design={"minutes": 0.4}))
    assert "records of" in err
    assert "another plan; move that folder away" in err
    for file in Path("out/visits").glob("*/visit.yaml"):
        file.write_text(file.read_text().replace("study", "first"))
    assert "out/visits is a campaign's" in refused("design", "study.yaml")
    assert violations_of(Path("report.html")) == []


def test_targets_are_reached_by_the_visits_as_they_are_written():
    targets = {"a3.stiffness": 0.006, "g1.d*": 0.03}
    code, out, err = oed("design", written(design={"targets": targets}), "--json")
    assert code == 0, err
    document = json.loads(out)
    asked = [one for one in document["parameters"] if one["target"]]
    assert [one["target"] for one in asked] == [0.006, 0.03]
    assert all(one["relative_std"][0] <= one["target"] for one in asked)
    code, out, _ = oed("design", "study.yaml")
    assert "all targets reached" in out
    few = document["seconds"] / 60 / 3
    err = refused("design", written(design={"targets": targets, "minutes": round(few, 2)}))
    assert " min are needed, and design.minutes allows" in err
    assert "; the best within them is 1." in err or "; the best within them is 2." in err
    err = refused("design", written(design={"targets": {"stiffness": 1e-5}}))
    assert " min are needed, and visits are planned for 1" in err


def test_spectra_wait_for_a_fit_or_for_samples():
    err = refused("design", written(design={"minutes": 2, "spectra": "per_motor"}))
    assert "design.spectra: per_motor: the robot file has no fitted value of " in err
    assert "or say robust" in err
    robust = {"kind": "average", "std": 0.2, "samples": 3}
    design = {"minutes": 0.7, "spectra": "per_motor", "robust": robust}
    code, out, err = oed("design", written(design=design), "--json")
    assert code == 0, err
    document = json.loads(out)
    assert document["spectra"]["gap"] <= 1e-4
    assert {one["excitation"] for one in document["visits"]} >= {"spectra 1"}
    assert len(document["parameters"][0]["relative_std"]) == 3
    flat = oed("design", written(output="flat"), "--json")
    predicted = {one["name"]: one["relative_std"][0] for one in json.loads(flat[1])["parameters"]}
    ratios = [one["relative_std"][0] / predicted[one["name"]] for one in document["parameters"]]
    assert np.exp(np.mean(np.log(ratios))) < 0.9  # at the same limits of peaks


def test_fitted_values_are_good_enough_for_spectra(tmp_path):
    robot = load_robot("moberg_axis1")
    fitted = {"relative_std": dict.fromkeys(robot.parameters.names, 0.01)}
    save_robot(robot, tmp_path / "fitted.yaml")
    content = yaml.safe_load((tmp_path / "fitted.yaml").read_text()) | {"fitted": fitted}
    (tmp_path / "fitted.yaml").write_text(yaml.safe_dump(content))
    design = {"minutes": 0.7, "spectra": "full"}
    code, _, err = oed("design", written(robot="fitted.yaml", design=design))
    assert code == 0, err


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"design": {"minutes": 0.01}}, "design.minutes: 0.01 min; the shortest visit takes 0.0"),
        ({"design": {"targets": {"stifness": 0.1}}}, "design.targets: 'stifness' is no free par"),
        ({"design": {"minutes": 1, "excitations": ["zipered"]}}, "design.excitations[0]"),
        ({"design": {"spectra": "flat"}}, "neither minutes nor targets given; one of them is"),
        (
            {"design": {"targets": {"stiffness": 0.1}, "criterion": "D"}},
            "targets define one",
        ),
        ({"design": {"minutes": 1e4}}, " are planned, 100 of the longest visits"),
        (
            {"robot": "manutec_r3", "candidates": {"sobol": 8}, "limits": {"torque": 1e-6}},
            "0.4 N m against friction, which leaves nothing of its limit 1e-06 N m",
        ),
        (
            {"robot": "ur10", "candidates": {"sobol": 8}, "limits": {"torque": 0.01}},
            "to hold the arm alone, which leaves nothing of its limit 0.01 N m",
        ),
        ({"multisine": STUDY["multisine"] | {"slope": 1.0}}, "multisine.slope"),
    ],
)
def test_one_line_for_a_mistake(changes, message):
    assert message in refused("design", written(**changes))


def test_the_kind_of_a_study_is_told_before_the_numerics_are_loaded():
    """Threads of numpy's libraries are limited once the kind is known."""
    code = (
        "import sys; from pathlib import Path; from reports.commands.studies import study_kind; "
        f"print(study_kind(Path({written()!r})), 'numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["visits", "False"]


def test_noise_is_that_of_motors():
    save_robot(load_robot("moberg_axis1"), "robot.yaml")
    content = yaml.safe_load(Path("robot.yaml").read_text())
    content["outputs"] = [
        {"joint": content["motors"][0]["joint"], "quantity": "angle"},
        {"motor": content["motors"][0]["name"], "quantity": "angle"},
    ]
    Path("robot.yaml").write_text(yaml.safe_dump(content))
    err = refused("design", written(robot="robot.yaml"))
    assert "noise: it is that of motors' motion, and robot 'moberg_axis1' measures other" in err


def test_other_commands_and_nothing_planned_yet():
    study = written()
    assert "neither fit nor posterior" in refused("fit", study)
    assert "no visit is planned yet; oed design plans them" in refused("simulate", study)
