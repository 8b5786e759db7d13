"""Campaigns: visits asked for and told, in simulation, and what interrupts or spoils them."""

import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from axis_campaign import AXIS, change, run_open, write_campaign

from estimators.fitting.least_squares import fit
from estimators.fitting.run_fit import RunFit
from estimators.fitting.settled_runs import settled_runs
from estimators.frf.file_formats import write_records
from oed import Campaign, simulate_visits
from oed.campaign.checks import check_low_level, drift
from oed.campaign.estimate import noise_in
from oed.campaign.planning import known_now
from oed.campaign.settings import load_campaign
from robotmodels import InvalidInput, Records, load_robot, surroundings
from robotmodels.collision.free_moves import free_moves
from robotmodels.collision.obstacles import Box
from robotmodels.exports.robot_files import with_values


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A campaign file for one axis."""
    return write_campaign(tmp_path)


def test_a_campaign_from_guesses_to_accuracies(campaign: Path) -> None:
    """Low level, first visits, accuracies, the first visit once more; the truth is inside."""
    change(campaign, ("1.0e-5", "1.0e-4"))  # beside it the simulation is exact
    for _ in range(8):
        if not run_open(campaign):
            break
    status = Campaign.load(campaign).status()
    assert status.state == "reached"
    assert not status.short_of
    purposes = [visit.purpose for visit in status.visits]
    assert purposes[:2] == ["check", "first"]
    assert purposes[-1] == "repeat"
    assert status.estimate is not None
    truth = load_robot("moberg_axis1").parameters.values
    away = np.log(status.estimate.values / truth) / status.estimate.std
    assert np.abs(away).max() < 4
    assert (status.estimate.std <= status.targets).all()
    assert status.estimate.drift > 1e-3
    times = [visit.plan.duration for visit in status.visits]
    assert all(visit.plan.settle == 1.0 for visit in status.visits)
    assert status.minutes == pytest.approx(sum(times) / 60)


def test_asking_again_repeats_the_open_visits(campaign: Path) -> None:
    """In another process too; a folder that a kill left half-written is none."""
    first = Campaign.load(campaign).ask()
    (first[0].folder.parent / ".unfinished-x").mkdir()
    again = Campaign.load(campaign).ask()
    assert [visit.number for visit in again] == [visit.number for visit in first] == [1]
    np.testing.assert_array_equal(again[0].plan.phases, first[0].plan.phases)


def test_failed_visits_and_other_orders(campaign: Path) -> None:
    """A failed visit is replaced; records may come in any order, twice without effect."""
    Campaign.load(campaign).fail(Campaign.load(campaign).ask()[0].number, "cable torn")
    assert run_open(campaign) == [2]
    opened = Campaign.load(campaign)
    visits = opened.ask()
    simulate_visits(opened.settings, opened.robot, load_robot("moberg_axis1"), visits[::-1])
    visit = visits[0]
    copy = visit.folder / "copy.h5"
    shutil.copy(visit.records_file, copy)
    assert not opened.tell(visit.number, copy)
    matlab = visit.folder / "copy.mat"
    write_records(matlab, Records.load(copy))
    visit.records_file.unlink()
    assert opened.tell(visit.number, matlab)
    np.testing.assert_allclose(Records.load(visit.records_file).angle, Records.load(copy).angle)
    assert Campaign.load(campaign).visits[0].failure == "cable torn"
    with pytest.raises(InvalidInput, match=r"visit 3: its records are here, .*records.h5; remove"):
        opened.fail(visit.number, "no")


def test_records_of_other_visits_are_refused(campaign: Path, tmp_path: Path) -> None:
    run_open(campaign)
    opened = Campaign.load(campaign)
    one, other = opened.ask()[:2]
    simulate_visits(opened.settings, opened.robot, load_robot("moberg_axis1"), [one])
    with pytest.raises(InvalidInput, match=rf"records.h5: not of visit {other.number}: "):
        opened.tell(other.number, one.records_file)
    records = Records.load(one.records_file)
    changed = tmp_path / "changed.h5"
    replace(records, torque=1.01 * records.torque).save(changed)
    with pytest.raises(InvalidInput, match=rf"visit {one.number} has other records"):
        opened.tell(one.number, changed)
    replace(records, reference=-records.reference).save(changed)
    with pytest.raises(InvalidInput, match="other references than planned"):
        opened.tell(one.number, changed)
    replace(records, sample_time=0.004).save(changed)
    with pytest.raises(InvalidInput, match="a period of 4 s, planned 2 s"):
        opened.tell(one.number, changed)
    with pytest.raises(InvalidInput, match="visit 9: the campaign has asked for 3 so far"):
        opened.tell(9, changed)


def test_low_level_runs_show_noise_by_two_periods_at_least(campaign: Path, tmp_path: Path) -> None:
    """Fewer are refused when told, as are missing runs: planning knew no noise."""
    run_open(campaign)
    opened = Campaign.load(campaign)
    visit = opened.visits[0]
    records, told = visit.records, tmp_path / "told.h5"
    visit.records_file.unlink()
    signals = ("torque", "angle", "saturated")
    replace(records, **{key: getattr(records, key)[:, :, :, :1] for key in signals}).save(told)
    with pytest.raises(InvalidInput, match=r"told.h5: visit 1: one period .* record all 2"):
        opened.tell(1, told)
    empty = {key: np.full_like(getattr(records, key), np.nan) for key in signals[:2]}
    replace(records, **empty).save(told)
    with pytest.raises(InvalidInput, match=r"told.h5: visit 1: a run is missing"):
        opened.tell(1, told)


def test_a_robot_file_that_changes_in_between(campaign: Path) -> None:
    Campaign.load(campaign).ask()
    file = campaign.parent / "guesses.yaml"
    file.write_text(file.read_text().replace("gear_ratio: 220", "gear_ratio: 221"))
    with pytest.raises(InvalidInput, match="its robot file was changed after visit 1 was p"):
        Campaign.load(campaign).ask()


def test_a_low_level_run_that_moves_too_much(campaign: Path) -> None:
    """Full amplitude is not offered: the robot is far lighter than its file says."""
    opened = Campaign.load(campaign)
    (visit,) = opened.ask()
    simulate_visits(opened.settings, opened.robot, load_robot("moberg_axis1"), [visit])
    records = Records.load(visit.records_file)
    replace(records, angle=3 * records.angle).save(visit.records_file)
    with pytest.raises(InvalidInput, match=r"speed of motor 'm1' swings by .* full amplitude"):
        opened.ask()


def test_friction_does_not_grow_with_the_amplitude(campaign: Path) -> None:
    """Torque that friction takes at a low level is no more at full amplitude."""
    campaign.write_text(AXIS.replace("speed: 5.0", "torque: 2.0"))
    opened = Campaign.load(campaign)
    (visit,) = opened.ask()
    simulate_visits(opened.settings, opened.robot, load_robot("moberg_axis1"), [visit])
    records = Records.load(visit.records_file)
    visit.records_file.unlink()
    rubbing = records.torque + np.where(np.arange(records.samples)[:, None] % 200 < 100, 0.6, -0.6)
    replace(records, torque=rubbing).save(visit.records_file)
    check_low_level(visit, opened.settings, np.array([0.6]))
    with pytest.raises(InvalidInput, match="torque of motor 'm1' swings by"):
        check_low_level(visit, opened.settings, np.zeros(1))


def test_minutes_that_are_used(campaign: Path) -> None:
    short = AXIS.replace("minutes: 20", "minutes: 0.6\nmost_periods: 4")
    campaign.write_text(short.replace("0.05, d", "0.0001, d"))
    for _ in range(6):
        if not run_open(campaign):
            break
    status = Campaign.load(campaign).status()
    assert status.state == "minutes used"
    assert status.short_of


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("stiffness: 0.05", "stifness: 0.05", "targets: 'stifness' is no free parameter"),
        ("detection: 5", "count: 40", "multisine.detection: missing"),
        ("minutes: 20", "minutes: -1", "minutes"),
    ],
)
def test_files_that_cannot_be(campaign: Path, before: str, after: str, message: str) -> None:
    campaign.write_text(AXIS.replace(before, after))
    with pytest.raises(InvalidInput, match=message):
        Campaign.load(campaign).ask()


def test_gravity_that_uses_up_a_torque_limit(campaign: Path) -> None:
    content = AXIS.replace("guesses.yaml", "manutec_r3").replace("speed: 5.0", "torque: 0.1")
    campaign.write_text(content)
    with pytest.raises(InvalidInput, match=r"limits.torque: at \[.*: motor 'm\d' needs .* to hold"):
        Campaign.load(campaign).ask()


def test_drift_between_two_visits(campaign: Path) -> None:
    """A robot that has become a twentieth softer is noticed, the same one is not."""
    run_open(campaign)
    opened = Campaign.load(campaign)
    visit = opened.ask()[0]
    truth = load_robot("moberg_axis1")
    softer = with_values(truth, truth.parameters.values * 0.95, None)
    again = replace(visit, number=99, folder=campaign.parent / "again")
    again.folder.mkdir()
    values = []
    for robot in (truth, softer):
        simulate_visits(opened.settings, opened.robot, truth, [visit])
        simulate_visits(opened.settings, opened.robot, robot, [again])
        records = [visit.records, again.records]
        data = settled_runs(truth, records, "detection", weak=True)
        found = fit(truth, data)
        assert isinstance(found, RunFit)
        values.append(drift(found, 0, 1))
        again.records_file.unlink()
        visit.records_file.unlink()
    assert values[0] > 1e-3
    assert values[1] < 1e-6


def test_noise_before_a_fit_is_the_scatter_of_periods(campaign: Path) -> None:
    """By the guesses' FRF disturbances of torques are about what they are."""
    change(campaign, ("friction: 0", "friction: 0, torque_disturbance: 0.02"))
    run_open(campaign)
    opened = Campaign.load(campaign)
    visit = opened.visits[0]
    noise = noise_in(visit, opened.robot)
    right = 0.02**2 / visit.plan.multisine.samples
    assert noise[:, 1, 1].real == pytest.approx(np.full(len(noise), right), rel=0.5)
    assert (noise[:, 0, 0].real > 0).all()
    assert not noise[:, 0, 1].any()


def test_moves_through_an_obstacle_are_not_free() -> None:
    """A box between two positions of a planar sweep, and none."""
    robot = load_robot("ur10")
    start = np.array([0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    turned = np.eye(6)[0]
    goals = np.stack([start + 2.5 * turned, start - 0.5 * turned])
    reach = np.array([0.0, 0.9, 0.6])
    box = Box("box", tuple(reach), (0.3, 0.3, 1.2))
    among = surroundings(robot, obstacles=[box])
    alone = surroundings(robot)
    assert not among.touching(np.vstack([start, goals])).any()
    assert free_moves(among, start, goals).tolist() == [False, True]
    assert free_moves(alone, start, goals).tolist() == [True, True]
    assert free_moves(None, start, goals).tolist() == [True, True]


def test_guesses_of_the_file_are_none_after_a_fit() -> None:
    """Spectra designed at guesses are refused; those of an estimate are not."""
    robot = load_robot("moberg_axis1")
    names = robot.parameters.names
    guessed = replace(
        robot, file=robot.file.model_copy(update={"guessed": dict.fromkeys(names, 0.5)})
    )
    latest: Any = SimpleNamespace(values=2 * robot.parameters.values, friction=())
    known = known_now(guessed, latest)
    assert not known.file.guessed
    np.testing.assert_allclose(known.parameters.values, 2 * robot.parameters.values)
    assert known_now(guessed, None) is guessed


def test_settings_name_their_keys(campaign: Path) -> None:
    settings = load_campaign(campaign)
    names = load_robot(settings.robot).parameters.names
    asked = settings.accuracies(names)
    assert asked.tolist() == [0.3 if "damping" in name else 0.05 for name in names]
    assert re.fullmatch(r".*/out", str(settings.output))
