"""Folders of small whole files that mutants are made of: written, measured and computed ones."""

import contextlib
import io
import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]

ARM = """\
<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0.25 0 0" rpy="0 0 0"/>
      <mass value="12"/>
      <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.4"/>
    </inertial>
    <collision>
      <origin xyz="0.25 0 0"/>
      <geometry><box size="0.5 0.08 0.08"/></geometry>
    </collision>
  </link>
  <link name="fore">
    <inertial>
      <origin xyz="0.2 0 0"/>
      <mass value="6"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.15" iyz="0" izz="0.15"/>
    </inertial>
    <collision>
      <origin xyz="0.2 0 0" rpy="0 1.5708 0"/>
      <geometry><cylinder radius="0.04" length="0.4"/></geometry>
    </collision>
  </link>
  <link name="tool">
    <inertial>
      <mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 1.2" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="100" velocity="3"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="fore"/>
    <origin xyz="0.5 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.4" upper="2.4" effort="100" velocity="3"/>
  </joint>
  <joint name="finger" type="prismatic">
    <parent link="fore"/>
    <child link="tool"/>
    <origin xyz="0.4 0 0"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.1" effort="100" velocity="1"/>
  </joint>
</robot>
"""

ROBOT = """\
schema: robot/1
name: arm
urdf: arm.urdf
lock: {finger: 0.0}
motors:
  - {name: m1, joint: shoulder, gear_ratio: 100, inertia: 4.0e-4, viscous: 2.0e-3, coulomb: 0.05}
  - {name: m2, joint: elbow, gear_ratio: -80, inertia: 2.0e-4, viscous: 1.5e-3}
springs:
  - {name: d1, joint: shoulder, axis: drive, stiffness: 2.0e4, damping: 40}
  - {name: d2, joint: elbow, axis: drive, stiffness: 8.0e3, damping: 20}
"""

# Every key of a robot file.
RICH_ROBOT = """\
schema: robot/1
name: rich arm
source: nowhere
urdf: arm.urdf
gravity: [0.0, 0.0, -9.81]
lock: {finger: 0.05}
motors:
  - {name: m1, joint: shoulder, gear_ratio: -100, inertia: 4.0e-4, viscous: 0.002, torque_gain: 1.1}
  - {name: m2, joint: elbow, gear_ratio: 80, inertia: 2.0e-4, viscous: 1.5e-3, coulomb: 0.03}
springs:
  - name: d1
    joint: shoulder
    axis: drive
    stiffness: {low: 1.5e4, high: 4.0e4, torque: 30.0}
    damping: 40
  - {name: b1x, joint: shoulder, axis: x, stiffness: 9.0e4, damping: 80}
  - {name: d2, joint: elbow, axis: drive, stiffness: 8.0e3, damping: 20}
  - name: c2
    link: fore
    at: [0.2, 0.0, 0.0]
    axis: z
    stiffness: 5.0e4
    damping: 30
    distal: {mass: 3.0, com: [0.3, 0.0, 0.0], inertia: [0.01, 0.0, 0.0, 0.05, 0.0, 0.05]}
parameters:
  fixed: [b1x.damping]
  tied: [[d2.damping, c2.damping]]
  extra: [m1.inertia, payload.mass, payload.com.x, c2.at]
payload: {link: tool, mass: 2.0, com: [0.05, 0.0, 0.02], inertia: [0.01, 0.01, 0.01]}
output: velocity
accelerometers:
  - {name: s1, link: fore, at: [0.3, 0.0, 0.0], direction: [0.0, 0.0, 1.0]}
delay: 1.0e-4
"""

STUDY = """\
schema: study/1
robot: robot.yaml
seed: 3
frequencies: {low: 3.0, high: 60.0, count: 6, spacing: log}
noise: {relative: 0.03, floor: 0.01}
candidates:
  per_joint: {shoulder: 3, elbow: 3}
  limits: {shoulder: [-2.0, 2.0], elbow: [-2.0, 2.0]}
design: {criterion: D, experiments: 3, tolerance: 1.0e-6}
fit: {residuals: [lls, nls], decades: 0.2, starts: 2}
compare: {random: 1, runs: 7}
posterior: {ensembles: 2, walkers: 16, steps: 120}
profiles: 1
output: results
"""

# Nearly every key of a study file.
RICH_STUDY = """\
schema: study/1
robot: robot.yaml
truth: robot.yaml
seed: 7
frequencies: {low: 3.0, high: 40.0, count: 5, spacing: linear}
noise: {relative: 0.03, floor: 0.01}
candidates:
  per_joint: {shoulder: 2}
  limits: {elbow: [-1.5, 1.5]}
  sobol: 8
  boxes: [{link: tool, low: [0.4, -0.1, 1.1], high: [0.8, 0.1, 1.5], points: [2, 1, 2]}]
  positions: [[0.0, 0.5], [0.3, -0.4]]
  files: [taught.csv, taught.yaml, taught.npy]
  floor: 0.0
  obstacles:
    - {name: wall, normal: [1, 0, 0], offset: -1.8}
    - {name: table, center: [1.6, 0, 0.2], size: [0.6, 1.2, 0.4]}
    - {name: lamp, center: [0, 0.9, 1.2], radius: 0.2}
  self_collision: true
  margin: 0.01
  ignored: [[upper, fore]]
  torque: [9.0, 9.0]
design:
  criterion: As
  interest: [d1.stiffness, d2.stiffness]
  experiments: 6
  most: 2
  time: 3600.0
  measuring: 40.0
  moves: {speed: 1.0, acceleration: 2.0, home: [0, 0.5]}
  mandatory: [[0.0, 0.5]]
  forbidden: [{elbow: [-0.1, 0.1]}]
  groups: {folded: {where: {elbow: [0.4, 1.5]}, most: 4, least: 1}}
  robust: {kind: average, std: 0.3, samples: 2}
  tolerance: 1.0e-6
  solver: newton
data:
  experiment:
    multisine: {band: [3.0, 40.0], sample_time: 0.005, period: 0.5, odd: false}
    blocks: 4
    periods: 2
    transient_periods: 2
    limits: {torque: 60.0, speed: 30.0, swing: 0.2, margin: 0.1, balance: true}
    imperfections: {friction: 0.0, angle_noise: 1.0e-6}
  method: ari
  covariance: total
  structure: diagonal
  delay: 0.0
  hold: true
fit:
  estimators:
    - {name: first, residual: nls, weights: optimal}
    - {name: second, residual: lls, weights: user, positions: best, reweight: true}
  decades: 0.1
  starts: 1
  user_weights: {diagonal: 1.0, off_diagonal: 0.1, low: 5.0}
  result: first
posterior: {ensembles: 2, walkers: 16, steps: 120, r_hat: 1.01, ess: 4000}
profiles: 1
validation: {count: 1}
output: results
"""

MEASURED = """\
schema: study/1
robot: robot.yaml
data: {SOURCE}
fit: {residuals: [nls], decades: 0.1, starts: 1}
posterior: {ensembles: 2, walkers: 16, steps: 120}
profiles: 1
output: results
"""

EXPERIMENT = """\
schema: experiment/1
robot: robot.yaml
positions:
  - [0.5, -0.8]
  - [-0.4, 0.6]
repetitions: [1, 1]
multisine: {band: [2.0, 20.0], sample_time: 0.01, period: 0.5, odd: true}
blocks: 2
periods: 2
transient_periods: 2
limits: {torque: 60.0, speed: 30.0}
moves: {speed: 1.0, acceleration: 2.0}
imperfections: {friction: 0.0, angle_noise: 1.0e-6}
seed: 1
output: measured
"""

RICH_EXPERIMENT = """\
schema: experiment/1
robot: rich.yaml
design: design.json
multisine:
  {band: [2.0, 20.0], sample_time: 0.01, period: 0.5, count: 6, spacing: quasi_log, odd: false,
   detection: 3, slope: -0.5, crest_iterations: 3}
blocks: 2
periods: 1
transient_periods: 1
limits: {torque: [60.0, 50.0], speed: 30.0, swing: 0.2, margin: 0.1, balance: false}
moves: {speed: [1.0, 1.0], acceleration: 2.0}
controller:
  {speed_gain: 0.02, integral_time: [0.5, 0.5], position_gain: 1.0, filter_time: 0.0}
imperfections:
  {friction: 1.0, backlash: 1.0e-5, quantisation: 1.0e-7, angle_noise: [1.0e-6, 1.0e-6],
   torque_disturbance: 1.0e-3, torque_limit: 90.0, nonlinear_gears: true}
seed: 2
output: measured
"""

SMALLER = (
    (r"(joint\w*): \d+", r"\1: 2"),
    (r"starts: \d+", "starts: 1"),
    (r"runs: \d+", "runs: 0"),
    (r"steps: \d+", "steps: 120"),
    (r"count: \d+", "count: 4"),
    (r"ensembles: \d+", "ensembles: 2"),
    (r"blocks: \d+", "blocks: 2"),
    (r"output: .*", "output: results"),
)
"""What makes the studies of the repository cheap."""


def oed(*words: object) -> None:
    """Run a command, which must succeed."""
    from reports import cli

    argv, sys.argv = sys.argv, ["oed", *map(str, words)]
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
    from oed.experiment.plan import ExperimentPlan

    folder.mkdir(parents=True)
    texts = {
        "arm.urdf": ARM,
        "robot.yaml": ROBOT,
        "rich.yaml": RICH_ROBOT,
        "study.yaml": STUDY,
        "rich_study.yaml": RICH_STUDY,
        "experiment.yaml": EXPERIMENT,
        "rich_experiment.yaml": RICH_EXPERIMENT,
        "taught.csv": "shoulder,elbow\n0.1,0.2\n-0.5,0.7\n",
        "taught.yaml": "positions:\n  - [0.2, 0.3]\n  - [-0.6, 0.8]\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    np.save(folder / "taught.npy", np.array([[0.15, 0.25], [0.4, -0.9]]))
    design = {
        "schema": "design/1",
        "robot": "rich arm",
        "positions": [{"candidate": 4, "position": [0.2, 0.4], "repetitions": 1}],
        "order": {"candidates": [4]},
    }
    (folder / "design.json").write_text(json.dumps(design), encoding="utf-8")
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
    _chain_records().save(folder / "chains.h5")


def read_fits(path: str) -> None:
    """Read the fits of the folder of inputs, in that folder."""
    import estimators
    import robotmodels

    estimators.read_fits(path, robotmodels.load_robot("robot.yaml"), estimators.read_frf("frf.h5"))


def _chain_records() -> Any:
    """Return records of two chains of two masses, as `oed chains` takes them."""
    from robotmodels.chain_responses import modally_damped
    from robotmodels.chains import CoupledChains
    from robotmodels.plant.controller import Controller
    from robotmodels.plant.linear import simulate_linear

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
    texts = {"arm.urdf": ARM, "robot.yaml": ROBOT, "study.yaml": STUDY}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
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
