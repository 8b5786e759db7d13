"""Folders of small whole files that mutants are made of: written, measured and computed ones."""

import contextlib
import io
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

WRITTEN = Path(__file__).resolve().parent / "inputs"
REPOSITORY = WRITTEN.parents[2]

MEASURED = """\
schema: study/1
robot: robot.yaml
data: {SOURCE}
fit: {residuals: [nls], decades: 0.1, starts: 1}
posterior: {ensembles: 2, walkers: 16, steps: 120}
profiles: 1
output: results
"""

SMALLER = (
    (r"(joint\w*): \d+", r"\1: 2"),
    (r"starts: \d+", "starts: 1"),
    (r"runs: \d+", "runs: 0"),
    (r"steps: \d+", "steps: 120"),
    (r"count: \d+", "count: 4"),
    (r"ensembles: \d+", "ensembles: 2"),
    (r"blocks: \d+", "blocks: 2"),
    (r"blocks: \[.*?\]", "blocks: [2]"),
    (r"output: .*", "output: results"),
)
"""What makes the studies of the repository cheap."""


def oed(*words: object) -> None:
    """Run a command, which must succeed."""
    from reports import cli

    argv, sys.argv = sys.argv, ["oed", "--quiet", *map(str, words)]
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            cli.main()
    except SystemExit as ended:
        if ended.code:
            raise RuntimeError(f"{' '.join(sys.argv)}: {err.getvalue()}") from None
    finally:
        sys.argv = argv


def make_seeds(folder: Path) -> None:
    """Write the folders ``inputs``, ``finished`` and ``examples``."""
    _inputs(folder / "inputs")
    _finished(folder / "finished")
    _examples(folder / "examples")


def _inputs(folder: Path) -> None:
    """Write all that people write, or measure, by hand or by our own writers."""
    import estimators
    import oed as oed_api
    import robotmodels
    from oed.experiment.experiment_plan import ExperimentPlan
    from oed.information_sets.stored_information import write_store

    shutil.copytree(WRITTEN, folder)
    np.save(folder / "taught.npy", np.array([[0.15, 0.25], [0.4, -0.9]]))
    oed("simulate", folder / "experiment.yaml", "--workers", 1)
    measured = folder / "measured"
    for name in ("records.h5", "plan.yaml", "plan.h5"):
        shutil.move(measured / name, folder / name)
    shutil.rmtree(measured)
    ExperimentPlan.load(folder / "plan.yaml")
    oed("frf", folder / "records.h5", "-o", folder / "made")
    shutil.move(folder / "made" / "frf.h5", folder / "frf.h5")
    shutil.rmtree(folder / "made")
    records, frf = (
        estimators.read_records(folder / "records.h5"),
        estimators.read_frf(folder / "frf.h5"),
    )
    for ending in ("mat", "csv"):
        estimators.write_records(folder / f"records.{ending}", records)
    for ending in ("mat", "csv", "uff"):
        estimators.write_frf(folder / f"frf.{ending}", frf)
    for name in ("records", "frf"):
        for ending in ("h5", "mat", "csv", "uff"):
            if (folder / f"{name}.{ending}").exists():
                text = MEASURED.replace("SOURCE", f"{name}: {name}.{ending}")
                (folder / f"of_{name}_{ending}.yaml").write_text(text, encoding="utf-8")
    estimators.write_distortion(folder / "distortion.h5", estimators.distortion(records))
    robot = robotmodels.load_robot(folder / "robot.yaml")
    estimators.write_fits(folder / "fits.h5", [estimators.fit(robot, frf)])
    info = oed_api.information(
        robot,
        np.array([[0.2, 0.4], [0.5, -0.5], [-1.0, 1.0]]),
        np.array([20.0, 60.0, 200.0]),
        robotmodels.RelativeNoise(relative=0.03, floor=0.01),
    )
    info.save(folder / "information.h5")
    write_store(folder / "information.store", info.positions, info.names, [info.matrices])
    _chain_records().save(folder / "chains.h5")


def read_fits(path: str) -> None:
    """Read the fits of the folder of inputs, in that folder."""
    import estimators
    import robotmodels

    estimators.read_fits(path, robotmodels.load_robot("robot.yaml"), estimators.read_frf("frf.h5"))


def design_of(path: str) -> None:
    """Design experiments with a file of information matrices."""
    from oed import InformationSet, optimal_design

    read = InformationSet.open if path.endswith(".store") else InformationSet.load
    optimal_design(read(path), solver="newton")


def _chain_records() -> Any:
    """Return records of two chains of two masses, as `oed chains` takes them."""
    from robotmodels.linear.chain_responses import modally_damped
    from robotmodels.linear.coupled_chains import CoupledChains
    from robotmodels.simulation.controller import Controller
    from robotmodels.simulation.linear_simulation import simulate_linear

    chains = CoupledChains(
        np.array([[1.0, 2.0], [2.0, 1.5]]),
        np.array([[900.0], [2500.0]]),
        np.array([[0, 0.5], [0.5, 0]]),
    )
    rng, samples, lines = np.random.default_rng(2), 400, np.arange(3, 61, 2)
    spectrum = np.zeros((2, 2, samples // 2 + 1, 2), dtype=complex)
    phases = np.exp(2j * np.pi * rng.random((2, len(lines), 2)))
    spectrum[:, :, lines] = phases[:, None] * np.array([[1.0, 1.0], [1.0, -1.0]])[None, :, None, :]
    return simulate_linear(
        modally_damped(chains.linear_model(), 0.01),
        np.fft.irfft(spectrum, samples, axis=2) * samples / 40,
        Controller(np.array([40.0, 60.0]), np.ones(2), np.full(2, 2.0), 0.008),
        lines=lines,
        angle_noise=1e-5,
        rng=rng,
        periods=2,
        transient=4,
    )


def _finished(folder: Path) -> None:
    """Write a study with all its stages."""
    folder.mkdir(parents=True)
    for name in ("arm.urdf", "robot.yaml", "study.yaml"):
        shutil.copy(WRITTEN / name, folder)
    oed("run", folder / "study.yaml", "--workers", 1)


def _examples(folder: Path) -> None:
    """Write the robots of the library and the studies of the repository, these made cheap."""
    folder.mkdir(parents=True)
    library = REPOSITORY / "robotmodels" / "library"
    for path in (*library.glob("*.yaml"), *library.glob("*.urdf")):
        shutil.copy(path, folder)
    for path in (REPOSITORY / "studies").glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        for pattern, cheap in SMALLER:
            text = re.sub(pattern, cheap, text)
        (folder / f"study_{path.name}").write_text(text, encoding="utf-8")
