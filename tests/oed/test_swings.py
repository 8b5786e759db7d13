"""Excitations that would make something touch: candidates, visits and experiments refuse them."""

from pathlib import Path

import numpy as np
import pytest

from oed import Campaign, simulate_visits
from oed.campaign.settings import load_campaign
from oed.campaign.swing_room import with_room
from oed.experiment.experiment_file import load_experiment
from oed.experiment.prepare import prepare
from oed.experiment.workcell_settings import WorkcellChoice, surroundings_of
from oed.study.stages.candidates import gather
from robotmodels import InvalidInput, load_robot
from robotmodels.collision.free_moves import contacts, swing_contact

UR10 = load_robot("ur10")
FAR = np.array([0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
PAN = np.eye(6)[0]
BOX = {"name": "crate", "center": [0.0, 0.9, 0.6], "size": [0.3, 0.3, 1.2]}
CELL = surroundings_of(WorkcellChoice.model_validate({"obstacles": [BOX]}), UR10)
LIMITS = "{torque: [6.0, 6.0, 3.0, 1.0, 1.0, 1.0], speed: 100.0"
COMMON = "multisine: {band: [2.0, 30.0], sample_time: 0.004, period: 2.0, detection: 5}\n"


@pytest.fixture(scope="module")
def near() -> np.ndarray:
    """Return a position from which the arm turns 0.02 rad until it touches the crate."""
    angles = np.arange(0.5, 2.5, 0.002)
    touching = CELL.touching(FAR + angles[:, None] * PAN).any(axis=1)
    return FAR + (angles[touching.argmax()] - 0.02) * PAN


def campaign(folder: Path, positions: list, limits: str) -> Path:
    path = folder / "campaign.yaml"
    rows = [[float(x) for x in position] for position in positions]
    path.write_text(
        f"schema: campaign/1\nrobot: ur10\ntargets: {{stiffness: 0.1}}\nminutes: 5\noutput: out\n"
        f"candidates: {{positions: {rows}, obstacles: [{BOX}]}}\nlimits: {limits}}}\n{COMMON}"
    )
    return path


def test_corners_of_a_swing_touch(near):
    for reach, free in ((0.01, True), (0.03, False), (0.2, False)):
        pair = swing_contact(CELL, near, -reach * np.ones(6), reach * np.ones(6))
        assert (pair is None) == free
    assert "crate" in str(pair)
    assert swing_contact(None, near, -PAN, PAN) is None
    assert contacts(CELL, FAR, np.stack([near, FAR + 2.5 * PAN]))[0] is None
    assert str(contacts(CELL, FAR, FAR + 2.5 * PAN)[0]).endswith("and 'crate'")


def test_candidates_have_room_for_the_swing(near, tmp_path):
    """Beside an obstacle, and at the end of a range, there is none."""
    end = FAR.copy()
    end[4] = UR10.position_limits[4, 1] - 0.01
    for swing, left in ((0.005, 3), (0.03, 1)):
        settings = load_campaign(campaign(tmp_path, [FAR, near, end], f"{LIMITS}, swing: {swing}"))
        gathered = gather(settings.candidates, UR10)
        candidates = with_room(gathered, settings, UR10, CELL)
        assert len(candidates) == left
        assert candidates.removed["swing"] == 3 - left
    np.testing.assert_array_equal(candidates.positions, [FAR])
    settings = load_campaign(campaign(tmp_path, [near], f"{LIMITS}, swing: 0.03"))
    with pytest.raises(InvalidInput, match=r"limits.swing: none of 1 candidates .* 'crate' would"):
        with_room(gather(settings.candidates, UR10), settings, UR10, CELL)


def test_visits_that_would_touch_are_not_offered(near, tmp_path):
    """Without a limit of the swing the predicted one counts, with the carrier in it."""
    quiet = campaign(tmp_path, [near], LIMITS.replace("100.0", "[8.0, 8, 8, 8, 8, 8]"))
    (visit,) = Campaign.load(quiet).ask()
    assert len(list((visit.folder / "controller" / "csv").iterdir())) >= 4
    text = quiet.read_text().replace("output: out", "output: carried")
    quiet.write_text(
        text.replace("[8.0, 8, 8, 8, 8, 8]", "60.0")
        + "carrier: {speed: 20.0}\ntransient_periods: 3\n"
    )
    with pytest.raises(InvalidInput, match=r"visit to .* 'crate' would touch within its swing"):
        Campaign.load(quiet).ask()
    assert not list((tmp_path / "carried").glob("visits/0*"))


def test_experiments_heed_their_workcell(near, tmp_path):
    path = tmp_path / "experiment.yaml"

    def refusal(positions, limits, others=""):
        rows = [[float(x) for x in position] for position in positions]
        path.write_text(
            f"schema: experiment/1\nrobot: ur10\nruns: 1\nblocks: 1\npositions: {rows}\n"
            f"workcell: {{obstacles: [{BOX}]}}\nlimits: {limits}}}\noutput: out\n{COMMON}{others}"
        )
        with pytest.raises(InvalidInput) as error:
            prepare(load_experiment(path))
        return str(error.value)

    assert "position 2: 'fore" in refusal([FAR, FAR + 2.8 * PAN], f"{LIMITS}, swing: 0.005")
    carried = refusal(
        [near], f"{LIMITS}, swing: 0.1", "carrier: {speed: 20.0}\ntransient_periods: 3\n"
    )
    assert "'crate' would touch within its swing" in carried


def test_campaigns_with_carriers_go_on(tmp_path):
    """Low level first, of the carrier too; then visits within limits that have it in them."""
    path = tmp_path / "campaign.yaml"
    path.write_text(
        "schema: campaign/1\nrobot: moberg_axis1\nguesses_within: 1.5\nminutes: 5\noutput: out\n"
        "targets: {stiffness: 0.05, damping: 0.3}\ncandidates: {sobol: 4}\n"
        "multisine: {band: [3.0, 60.0], sample_time: 0.005, period: 2.0, detection: 5}\n"
        "limits: {speed: 20.0, swing: 0.05, rms_torque: 20.0}\ncarrier: {speed: 8.0}\n"
        "transient_periods: 3\n"
        "imperfections: {angle_noise: 1.0e-5, friction: 0, nonlinear_gears: false}\n"
    )
    opened = Campaign.load(path)
    truth = load_robot("moberg_axis1")
    (check,) = opened.ask()
    simulate_visits(opened.settings, opened.robot, truth, [check])
    visits = opened.ask()
    full = visits[0].plan.carrier
    np.testing.assert_allclose(check.plan.carrier.amplitudes, 0.2 * full.amplitudes, rtol=0.01)
    assert full.line == 2
    assert all(visit.plan.scale[0] > 0 for visit in visits)
