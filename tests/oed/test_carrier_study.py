"""The table of the campaign's page: springs of a robot with Coulomb friction, with carriers."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import fit, run_spectra
from oed.experiment.carrier import carrier_in
from oed.experiment.experiment_file import load_experiment
from oed.experiment.prepare import prepare
from oed.experiment.run_experiment import SimulatedPlant

FILE = """
schema: experiment/1
robot: manutec_r3
positions: {positions}
runs: 1
blocks: 1
periods: 4
multisine: {{band: [2.0, 60.0], sample_time: 0.002, period: 4.0, detection: 5,
            crest_iterations: 50}}
limits: {{speed: 10.0}}
imperfections: {{angle_noise: 1.0e-5}}
output: out
"""


@pytest.mark.slow
def test_springs_beside_coulomb_friction(tmp_path):
    """A fit that starts at the truth: medians of errors with carriers of 0, 5, 20 and 40 rad/s."""
    low, high = -0.6 * np.ones(6), 0.6 * np.ones(6)
    rows = np.random.default_rng(0).uniform(low, high, (4, 6)).round(3).tolist()
    (tmp_path / "e.yaml").write_text(FILE.format(positions=rows))
    prepared = prepare(load_experiment(tmp_path / "e.yaml"))
    robot, plan, controller = prepared.robot, prepared.plan, prepared.controller
    springs = ["stiffness" in name for name in robot.parameters.names]
    medians = []
    for speed in (0.0, 5.0, 20.0, 40.0):
        carrier = carrier_in(
            robot, plan.positions, controller, np.full(6, speed), None, plan.multisine
        )
        carried = replace(plan, carrier=carrier)
        plant = SimulatedPlant(robot, controller, prepared.imperfections, np.random.default_rng(3))
        each = [run_spectra(plant.measure(carried, v), "detection") for v in range(4)]
        estimate = fit(robot, type(each[0]).join(each)).parameters.values
        errors = np.abs(np.log(estimate / robot.parameters.values))
        medians.append((np.median(errors[springs]), np.median(errors[np.logical_not(springs)])))
    none, slow, middle, fast = np.array(medians)
    assert none[0] > 0.08
    assert slow[0] < none[0] / 3
    assert (middle < none / [3, 2]).all()
    assert (fast < none / [5, 3]).all()
