import json
import math
import shutil

import h5py
import numpy as np
import pytest
from command_line import oed
from conftest import STUDY, write_study

FILES = {"design.json", "fit.json", "uncertainty.json", "report.html", "stages", ".last-run.json"}
STAGES = {
    "candidates",
    "information",
    "design",
    "data",
    "fit-lls",
    "fit-nls",
    "result",
    "uncertainty",
    "comparison",
    "posterior",
    "profiles",
    "importance",
    "cross-check",
    "tool",
    "residuals",
    "responses",
}
INFORMATION = "stages/information/information.h5"


def read(folder, name):
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


def test_everything_is_written_and_nothing_else(small_study):
    folder, _ = small_study
    assert {path.name for path in folder.iterdir()} == FILES
    assert {path.name for path in (folder / "stages").iterdir()} == STAGES


def test_certificate_in_ten_lines_of_numpy(small_study):
    folder, _ = small_study
    design = json.loads((folder / "design.json").read_text())
    matrices = h5py.File(folder / INFORMATION)["matrices"][:]
    weights = np.zeros(len(matrices))
    weights[design["relaxed"]["support"]] = design["relaxed"]["weights"]
    information = np.tensordot(weights, matrices, axes=1)
    sensitivity = np.trace(np.linalg.solve(information, matrices), axis1=1, axis2=2)
    gap = sensitivity.max() / len(information) - 1
    assert weights.sum() == pytest.approx(1)
    assert gap == pytest.approx(design["relaxed"]["gap"], abs=1e-12)
    assert gap <= 1e-6


def test_efficiency_of_the_plan_holds_against_the_relaxed_design(small_study):
    folder, _ = small_study
    design = read(folder, "design")
    matrices = h5py.File(folder / INFORMATION)["matrices"][:]
    repetitions, weights = np.zeros(len(matrices)), np.zeros(len(matrices))
    for position in design["positions"]:
        repetitions[position["candidate"]] = position["repetitions"]
    weights[design["relaxed"]["support"]] = design["relaxed"]["weights"]
    plan = np.tensordot(repetitions / repetitions.sum(), matrices, axes=1)
    relaxed = np.tensordot(weights, matrices, axes=1)
    ratio = math.exp((np.linalg.slogdet(plan)[1] - np.linalg.slogdet(relaxed)[1]) / len(plan))
    assert repetitions.sum() == design["exact"]["experiments"] == 5
    assert ratio == pytest.approx(design["exact"]["efficiency"], abs=2e-6)
    assert design["exact"]["efficiency"] <= ratio


def test_design_names_positions_as_the_information_does(small_study):
    folder, _ = small_study
    design = read(folder, "design")
    with h5py.File(folder / INFORMATION) as file:
        positions, names = file["positions"][:], file["names"].asstr()[:].tolist()
    assert names == design["parameters"]
    assert names == ["d2.stiffness", "d3.stiffness", "d2.damping", "d3.damping"]
    assert design["motors"] == ["m2", "m3"]
    assert design["candidates"] == len(positions) == 20
    for position in design["positions"]:
        assert position["position"] == positions[position["candidate"]].tolist()
    assert design["frequencies_hz"][0] == pytest.approx(3)
    assert design["frequencies_hz"][-1] == pytest.approx(60)
    assert design["noise"] == {"relative": 0.03, "floor": 0.01}


def test_fit_finds_the_truth_within_its_uncertainty(small_study):
    folder, _ = small_study
    fit, uncertainty = read(folder, "fit"), read(folder, "uncertainty")
    truth = np.array([row["truth"] for row in fit["parameters"]])
    estimate = np.array([row["estimate"] for row in fit["parameters"]])
    assert truth.tolist() == [4.0e4, 2.5e4, 60.0, 37.5]
    z = np.log(estimate / truth) / uncertainty["theorem1"]["std"]
    np.testing.assert_allclose(uncertainty["z"], z, rtol=1e-9)
    assert np.abs(z).max() < 4
    assert fit["residual"] == "nls"
    n_data = 12 * 4 * len(read(folder, "design")["positions"])
    assert fit["cost"] == pytest.approx(n_data, abs=5 * math.sqrt(n_data))


def test_every_start_of_every_residual_is_on_record(small_study):
    folder, _ = small_study
    runs = read(folder, "fit")["starts"]
    assert set(runs) == {"lls", "nls"}
    for of_residual in runs.values():
        assert sorted(run["start"] for run in of_residual) == [0, 1]
        assert all(run["converged"] for run in of_residual)
        costs = [run["cost"] for run in of_residual]
        assert np.all(np.diff(costs) >= -1e-8 * np.array(costs[1:]))  # equal ones as their starts
    values = {run["start"]: run["values"] for run in runs["lls"]}
    assert values == {run["start"]: run["values"] for run in runs["nls"]}
    ratio = np.log10(np.array(list(values.values())) / [4.0e4, 2.5e4, 60.0, 37.5])
    assert np.abs(ratio).max() <= 0.2
    assert np.abs(ratio).max() > 0.02


def test_log_fit_agrees_with_the_likelihood(small_study):
    folder, _ = small_study
    fit, uncertainty = read(folder, "fit"), read(folder, "uncertainty")
    nls, lls = (fit["estimators"][name]["estimate"] for name in ("nls", "lls"))
    assert nls == pytest.approx([row["estimate"] for row in fit["parameters"]], rel=1e-4)
    apart = np.log(np.divide(lls, nls)) / uncertainty["theorem1"]["std"]
    assert np.abs(apart).max() < 2


def test_the_plan_is_compared_with_alternatives_for_every_parameter(small_study):
    folder, _ = small_study
    plans = read(folder, "uncertainty")["plans"]
    assert list(plans) == ["optimal", "evenly spread", "random 1"]
    for plan in plans.values():
        ratio = np.divide(plan["simulated"], plan["predicted"])
        # Twelve experiments: chi square of eleven degrees within one in a thousand.
        assert np.all((ratio > 0.25) & (ratio < 1.9))
        low, high = plan["relative_efficiency"]["interval"]
        assert low <= plan["relative_efficiency"]["simulated"] <= high
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert 'id="plan-stds"' in page
    assert 'id="plan-deviations"' in page
    design = read(folder, "design")
    assert plans["optimal"]["positions"] == len(design["positions"])


def test_profiles_and_repeated_experiments_stand_in_the_cross_check(small_study):
    folder, _ = small_study
    page = (folder / "report.html").read_text(encoding="utf-8")
    table = page[page.index('id="cross-check-table"') :]
    head = table[: table.index("</thead>")]
    assert "Monte Carlo" in head
    assert "profile" in head


def test_theorem_1_and_emcee_agree(small_study):
    folder, _ = small_study
    uncertainty = read(folder, "uncertainty")
    ratio = np.divide(uncertainty["theorem1"]["std"], uncertainty["emcee"]["std"])
    assert np.all((ratio > 0.85) & (ratio < 1.15))
    assert np.shape(uncertainty["emcee"]["correlation"]) == (4, 4)
    assert len(uncertainty["convergence"]["r_hat"]) == 4


def test_summary_fits_one_screen_and_names_the_report(small_study):
    folder, out = small_study
    lines = out.splitlines()
    assert len(lines) < 20
    assert str(folder / "report.html") in lines[-1]
    assert "optimal better than" in out
    for word in ("candidates", "gap", "efficiency", "R-hat", "ESS", "expected", "trustworthy"):
        assert word in out
    assert out.isascii()


def test_another_seed_gives_other_data(small_study, tmp_path):
    """That the same seed gives the same files, test_resuming tells."""
    folder, _ = small_study
    again = tmp_path / "results" / "here"
    shutil.copytree(folder, again)
    path = write_study(tmp_path, STUDY.replace("seed: 3", "seed: 4"))
    assert oed("fit", path, "--workers", 1)[0] == 0
    assert read(again, "fit")["cost"] != read(folder, "fit")["cost"]
    assert read(again, "design")["relaxed"] == read(folder, "design")["relaxed"]


@pytest.mark.slow
def test_a_cluster_computes_the_same(small_study, tmp_path):
    distributed = pytest.importorskip("distributed")
    folder, _ = small_study
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        path = write_study(tmp_path)
        code, _, err = oed("run", path, "--cluster", cluster.scheduler_address)
    assert (code, err) == (0, "")
    for name in ("design", "fit", "uncertainty"):
        again = (tmp_path / "results" / "here" / f"{name}.json").read_bytes()
        assert again == (folder / f"{name}.json").read_bytes(), name


def test_a_cluster_that_is_not_there_is_one_line(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("reports.commands.workers.PATIENCE", 0.2)
    code, out, err = oed("run", write_study(tmp_path), "--cluster", "tcp://127.0.0.1:9")
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "--cluster tcp://127.0.0.1:9: no scheduler answers" in err
