"""A study goes on from where it was stopped, and computes again only what a change asks for."""

import json
import shutil

import h5py
import numpy as np
import pytest
from command_line import oed
from conftest import ROBOT, STUDY, drawn, write_study
from killed import killed_again_and_again

import estimators
import robotmodels
from robotmodels.common.fingerprints import folder_digest

JSON = ("design.json", "fit.json", "uncertainty.json")


def kept(command, path):
    """Compute a study as far as `command` goes, and return the stages that it says it kept."""
    code, out, err = oed(command, path, "--workers", 1, "--json")
    assert (code, err) == (0, "")
    return set(json.loads(out)["kept"])


@pytest.fixture
def copied(small_study, tmp_path):
    """Return a function that computes a changed study on the results of the small one."""
    folder, _ = small_study
    shutil.copytree(folder, tmp_path / "results" / "here")

    def run(command, *change):
        return kept(command, write_study(tmp_path, STUDY.replace(*change)))

    return run


def test_an_unchanged_study_computes_nothing(copied, small_study, tmp_path):
    folder, _ = small_study
    assert copied("sample", "", "") == {p.name for p in (folder / "stages").iterdir()}
    for name in JSON:
        assert (tmp_path / "results" / "here" / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize(
    ("stage", "array", "value"),
    [
        ("design", "design/weights", np.array([b"heavy"])),
        ("design", "exact/repetitions", np.array(1.5)),
        ("data", "estimate/response", np.zeros(3)),
        ("uncertainty", "covariance", np.array(1.0)),
        ("posterior", "r_hat", np.array([[1.0]])),
        ("cross-check", "trust/ends", np.array(["low", "high"], dtype="S4")),
        ("comparison", "interval", 0.5),
    ],
)
def test_a_stage_whose_arrays_have_another_type_is_computed_again(
    copied, small_study, tmp_path, stage, array, value
):
    """Its digest fits: the file was written so."""
    folder = tmp_path / "results" / "here" / "stages" / stage
    with h5py.File(folder / "result.h5", "r+") as file:
        del file[array]
        file[array] = value
    record = json.loads((folder / "stage.json").read_text())
    record["digest"] = folder_digest(folder, frozenset({"stage.json"}))
    (folder / "stage.json").write_text(json.dumps(record))
    every = {p.name for p in folder.parent.iterdir()}
    assert copied("sample", "", "") == every - {stage}
    for name in JSON:
        again = (tmp_path / "results" / "here" / name).read_bytes()
        assert again == (small_study[0] / name).read_bytes()


PLANNED = {"candidates", "information", "design", "data"}


@pytest.mark.parametrize(
    ("command", "change", "unchanged", "computed"),
    [
        (
            "sample",
            ("steps: 400", "steps: 405"),
            {*PLANNED, "fit-lls"},
            {"posterior", "cross-check"},
        ),
        (
            "fit",
            ("experiments: 5", "experiments: 6"),
            {"candidates", "information"},
            {"design", "data"},
        ),
        ("fit", ("relative: 0.03", "relative: 0.04"), {"candidates"}, {"information", "result"}),
        # The best fit stays the same, and so does all that rests on it.
        ("sample", ("[lls, nls]", "[nls]"), {*PLANNED, "fit-nls", "posterior"}, {"result"}),
    ],
    ids=["posterior", "design", "noise", "one estimator less"],
)
def test_a_changed_key_recomputes_what_rests_on_it(command, change, unchanged, computed, copied):
    found = copied(command, *change)
    assert unchanged <= found
    assert not found & computed


def test_a_changed_robot_file_recomputes_all(copied, tmp_path):
    path = write_study(tmp_path, robot=ROBOT.replace("damping: 60", "damping: 61"))
    assert kept("fit", path) == set()


LIBRARIES = ("pinocchio", "cvxpy", "robotmodels.kernel", "oed.study.pipeline")
LIBRARIES += ("estimators.sampling.posterior", "reports.summaries.study_summary")


def sample(path):
    oed("sample", path, "--workers", 1)


@pytest.mark.slow
def test_killed_again_and_again_it_ends_with_the_same_results(small_study, tmp_path):
    path = write_study(tmp_path)
    folder = tmp_path / "results" / "here"
    # A whole run makes some 180 changes to its folder.
    places = killed_again_and_again(
        sample, [str(path)], folder, [16, 40, 53, 38, 6], libraries=LIBRARIES
    )
    stages = [place.removeprefix(f"{folder}/stages/").partition(".")[0] for place in places]
    assert {"information", "fit-lls", "posterior"} <= set(stages), stages
    assert {"candidates", "information", "design", "fit-lls", "fit-nls"} <= kept("sample", path)
    # Computed anew from the same seed, by other processes and in pieces: the same to the last bit.
    for name in (*JSON, "stages/information/information.h5"):
        assert (folder / name).read_bytes() == (small_study[0] / name).read_bytes(), name


MEASURED = """\
schema: study/1
robot: robot.yaml
data: {frf: frf.h5}
fit: {residuals: [lls, nls], decades: 0.2, starts: 2}
posterior: {ensembles: 2, walkers: 16, steps: 200}
output: results/here
"""


@pytest.fixture
def measured(tmp_path):
    """Path of a study on measured FRFs, and what they were measured with."""
    path = write_study(tmp_path, MEASURED)
    robot = robotmodels.load_robot(tmp_path / "robot.yaml")
    positions = np.array([[-1.0, 0.5], [-1.5, -1.0], [-2.0, 1.5], [-1.0, 0.5]])
    noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
    omega = 2 * np.pi * np.geomspace(3, 60, 12)
    data = estimators.simulate_frf(robot, positions, omega, noise, np.random.default_rng(1))
    estimators.write_frf(tmp_path / "frf.h5", data)
    return path, robot.parameters.values


def test_fit_says_in_one_line_what_is_wrong_with_a_file_of_frfs(measured):
    from dataclasses import replace

    path, _ = measured
    path.write_text(MEASURED.replace("[lls, nls], decades: 0.2, starts: 2", "[nls], starts: 1"))
    right = estimators.read_frf(path.parent / "frf.h5")
    factor = np.degrees(1.0)
    degrees = replace(
        right, response=factor * right.response, covariance=factor**2 * right.covariance
    )
    for data, expected in ((right, 0), (degrees, 1)):
        estimators.write_frf(path.parent / "frf.h5", data)
        code, out, err = oed("fit", path, "--workers", 1)
        assert code == 0, err
        said = [line for line in out.splitlines() if "CHECK" in line]
        assert len(said) == expected, out
    assert "angles look like degrees: gain 5" in said[0]


def test_measured_frfs_are_fitted_without_candidates(measured):
    path, truth = measured
    with drawn():
        code, out, err = oed("run", path, "--workers", 1, "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["positions"] == 3  # two visits to one position are averaged
    assert found["experiments"] == 4
    fit = json.loads((path.parent / "results" / "here" / "fit.json").read_text())
    estimate = np.array([row["estimate"] for row in fit["parameters"]])
    std = np.array(list(found["relative_std"].values()))
    assert np.abs(np.log(estimate / truth) / std).max() < 4
    assert [row["truth"] for row in fit["parameters"]] == [None] * 4
    assert "<h2" in (path.parent / "results" / "here" / "report.html").read_text()


MISTAKES = {
    "absent file": ("frf: frf.h5", "frf: frf_.h5", ["study.yaml", "data.frf", "frf_.h5"]),
    "two sources": ("frf: frf.h5", "frf: frf.h5, records: r.h5", ["data", "records and frf"]),
    "candidates": ("fit:", "candidates: {sobol: 8}\nfit:", ["candidates", "measured data"]),
    "typing error": ("data: {frf", "data: {rfr", ["'data.rfr'", "'frf'"]),
    "another robot": ("robot.yaml", "moberg_axis1", ["study.yaml", "frf.h5", "1 motors"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_with_measured_data_name_file_and_key(mistake, measured):
    path, _ = measured
    right, wrong, words = MISTAKES[mistake]
    path.write_text(MEASURED.replace(right, wrong, 1))
    code, out, err = oed("run", path, "--workers", 1)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    for word in words:
        assert word in err, err
    assert not (path.parent / "results").exists()
