"""A campaign for one axis, quick to simulate and to fit."""

from pathlib import Path

import numpy as np

from oed import Campaign, simulate_visits
from robotmodels import load_robot, save_robot
from robotmodels.exports.robot_files import with_values

TRUTH = "moberg_axis1"
AXIS = """
schema: campaign/1
robot: guesses.yaml
guesses_within: 1.5
targets: {stiffness: 0.05, damping: 0.3}
minutes: 20
candidates: {sobol: 4}
multisine: {band: [1.0, 60.0], sample_time: 0.002, period: 2.0, detection: 5}
limits: {speed: 5.0, swing: 0.05}
imperfections: {angle_noise: 1.0e-5, friction: 0, nonlinear_gears: false}
output: out
"""


def write_campaign(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the campaign file, with changes, and guesses that are off by a third at most."""
    truth = load_robot(TRUTH)
    factors = np.exp(np.random.default_rng(2).uniform(-0.3, 0.3, len(truth.parameters)))
    guesses = with_values(truth, truth.parameters.values * factors, None)
    save_robot(guesses, folder / "guesses.yaml")
    path = folder / "campaign.yaml"
    path.write_text(AXIS)
    return change(path, *changes)


def change(path: Path, *changes: tuple[str, str]) -> Path:
    """Change a file's text."""
    for before, after in changes:
        assert before in path.read_text()
        path.write_text(path.read_text().replace(before, after))
    return path


def run_open(path: Path, truth: str = TRUTH) -> list[int]:
    """Simulate what is open, or planned next; return the numbers of the visits."""
    campaign = Campaign.load(path)
    visits = campaign.ask()
    simulate_visits(campaign.settings, campaign.robot, load_robot(truth), visits)
    return [visit.number for visit in visits]
