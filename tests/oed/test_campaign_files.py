"""Campaigns that are killed, edited or out of reach, and two terminals at once."""

import os
import re
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from axis_campaign import TRUTH, change, run_open, write_campaign
from killed import killed_at_moments

from estimators import run_spectra
from estimators.fitting.run_fit import FrictionLevel
from oed import Campaign
from oed.campaign.history import History
from oed.campaign.planning import known_now
from oed.campaign.status import CampaignStatus
from oed.campaign.visit_plan import fair_torques, line_grid
from oed.campaign.visits import VisitFolder
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.loop_settings import LimitChoice
from oed.experiment.prepare import friction_of
from reports.pages.campaign_page import write_campaign_page
from reports.summaries.campaign_summary import remarks, status_json, status_text
from robotmodels import InvalidInput, Records, load_robot
from robotmodels.common.atomic_files import exclusive_folder
from robotmodels.common.fingerprints import folder_digest
from robotmodels.exports.robot_files import with_friction

LIBRARIES = ("oed.campaign.campaign",)


def no_files(plan: ExperimentPlan, folder: Path) -> ExperimentPlan:
    """Write files for a controller: a folder alone."""
    folder.mkdir()
    return plan


def ask(path: str) -> None:
    """Ask for visits, in a process that is killed."""
    Campaign.load(path).ask()


def status(path: str) -> None:
    """Fit what is here, in a process that is killed."""
    Campaign.load(path).status()


def tell(path: str, number: str, records: str) -> None:
    """Tell records, in a process that is killed."""
    Campaign.load(path).tell(int(number), records)


def taken_back(path: Path, number: int) -> Path:
    """Take a visit's records back as if they had not been told."""
    records = path.parent / f"visit_{number}.h5"
    shutil.move(path.parent / "out" / "visits" / f"{number:03d}" / "records.h5", records)
    return records


@pytest.fixture(scope="module")
def fitted_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a campaign whose first visits are fitted."""
    folder = tmp_path_factory.mktemp("fitted")
    path = write_campaign(folder, ("1.0e-5", "1.0e-4"))  # beside it the simulation is exact
    run_open(path)
    run_open(path)
    Campaign.load(path).status()
    return folder


@pytest.fixture
def fitted(fitted_once: Path, tmp_path: Path) -> Path:
    """A campaign file of one's own, whose first visits are fitted."""
    shutil.copytree(fitted_once, tmp_path, dirs_exist_ok=True)
    return tmp_path / "campaign.yaml"


@pytest.mark.parametrize("moment", range(1, 6))
def test_planned_visits_appear_together(fitted: Path, monkeypatch, moment: int) -> None:
    """Or none of them, where the process ends before one of its renamings."""
    visits = Campaign.load(fitted).visits
    folder, left = VisitFolder(fitted.parent / "new"), moment
    rename = os.replace

    def ends(source: object, target: object) -> None:
        nonlocal left
        left -= Path(str(target)).parent == folder.folder
        if left == 0:
            raise KeyboardInterrupt
        rename(source, target)

    monkeypatch.setattr(os, "replace", ends)
    plans = [visit.plan for visit in visits]
    if moment <= len(plans) + 1:
        with pytest.raises(KeyboardInterrupt):
            folder.add(plans, "first", "digest", no_files)
    else:
        folder.add(plans, "first", "digest", no_files)
    folder.recover()
    assert len(folder.all()) == (0 if moment == 1 else len(plans))
    assert all(path.name.isdigit() for path in folder.folder.iterdir())


@pytest.mark.slow
def test_killed_at_any_moment_it_asks_for_the_same_visits(tmp_path: Path) -> None:
    """All visits of a stage appear, or none; after a kill the same ones are asked for."""
    path = write_campaign(tmp_path)
    run_open(path)
    whole = shutil.copytree(tmp_path / "out", tmp_path / "whole")
    ends = killed_at_moments(ask, [str(path)], tmp_path / "out", LIBRARIES)
    change(path, ("output: out", "output: whole"))
    ask(str(path))
    assert len(ends) >= 40
    for end in ends:
        assert folder_digest(end / "visits") == folder_digest(whole / "visits")


@pytest.mark.slow
def test_killed_at_any_moment_of_a_fit_or_records_taken(tmp_path: Path) -> None:
    path = write_campaign(tmp_path)
    run_open(path)
    run_open(path)
    records = taken_back(path, 3)
    out = tmp_path / "out"
    for end in killed_at_moments(tell, [str(path), "3", str(records)], out, LIBRARIES):
        assert (end / "visits/003/records.h5").read_bytes() == records.read_bytes()
    before = Campaign.load(path).status()
    assert len(before.history) == 1
    (out / "history.h5").unlink()
    shutil.rmtree(out / "stages" / "estimate")
    for end in killed_at_moments(status, [str(path)], out, LIBRARIES):
        history = History.load(end / "history.h5", len(before.names))
        np.testing.assert_allclose(history.values, before.history.values)


def test_another_terminal_waits(tmp_path: Path) -> None:
    path = write_campaign(tmp_path)
    with (
        exclusive_folder(tmp_path / "out" / "stages"),
        pytest.raises(InvalidInput, match="is in use by another run"),
    ):
        Campaign.load(path).ask()


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("period: 2.0", "period: 4.0", "multisine.period is 4 s, it was 2 s after visit 1"),
        ("time: 0.002", "time: 0.001", "multisine.sample_time is 0.001 s, it was 0.002 s"),
        ("output", "seed: 2\noutput", "multisine or seed give other lines than before"),
        ("60.0]", "50.0]", "multisine or seed give other lines than before after visit 1 was"),
    ],
)
def test_a_campaign_file_whose_lines_change(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    path = write_campaign(tmp_path)
    ask(str(path))
    change(path, (before, after))
    with pytest.raises(InvalidInput, match=message):
        Campaign.load(path).status()


def test_targets_and_minutes_may_change(fitted: Path) -> None:
    """A target that the minutes do not reach is said to be out of reach, and what is not."""
    change(fitted, ("minutes: 20", "minutes: 0.6"), ("0.05, damping: 0.3", "3e-4"))
    far = Campaign.load(fitted).status()
    assert far.state == "out of reach"
    assert far.outlook is not None
    assert far.outlook.needed > far.outlook.remaining == pytest.approx(far.remaining)
    feasible = 3e-4 * float((far.outlook.std / far.targets).max())
    change(fitted, ("3e-4", f"{1.05 * feasible:.9f}"))
    near = Campaign.load(fitted).status()
    assert near.state == "identifying"
    assert near.outlook is not None
    assert near.outlook.needed == pytest.approx(near.remaining, rel=0.2)
    more = 1.05 * (far.minutes + far.outlook.needed)
    change(fitted, (f"{1.05 * feasible:.9f}", "3e-4"), ("minutes: 0.6", f"minutes: {more:.9f}"))
    assert Campaign.load(fitted).status().state == "identifying"


def test_minutes_below_the_first_visits(tmp_path: Path) -> None:
    path = write_campaign(tmp_path, ("minutes: 20", "minutes: 0.2"))
    with pytest.raises(InvalidInput, match=r"minutes: 0.2; .* need 0.3\d at least; allow more"):
        Campaign.load(path).ask()


def test_the_first_visits_stay_within_the_minutes(tmp_path: Path) -> None:
    """However long the accuracies take by the guesses; where that is absurd nothing is run."""
    path = write_campaign(tmp_path, ("minutes: 20", "minutes: 1"), ("0.05, damping: 0.3", "4e-5"))
    run_open(path)
    far = change(path, ("4e-5", "1e-7"))
    with pytest.raises(InvalidInput, match=r"by the guesses .* min at least, 0\.\d+ are"):
        ask(str(far))
    ask(str(change(path, ("1e-7", "4e-5"))))
    begun = Campaign.load(path).status()
    assert begun.state == "out of reach"
    assert begun.minutes + begun.expected < 0.5
    assert not begun.estimate


@pytest.mark.filterwarnings("ignore:position 1")
def test_limits_that_leave_nothing_to_see(tmp_path: Path) -> None:
    path = write_campaign(tmp_path, ("swing: 0.05", "swing: 1.0e-9"))
    run_open(path)
    with pytest.raises(InvalidInput, match="are left; give limits more room, or relax the targets"):
        ask(str(path))


def test_a_failed_repetition_is_asked_for_again(fitted: Path) -> None:
    """Each fit extends the history, which nothing rests on."""
    first = Campaign.load(fitted).status()
    (visit,) = Campaign.load(fitted).ask()
    assert visit.purpose == "repeat"
    Campaign.load(fitted).fail(visit.number, "power cut")
    assert run_open(fitted) == [visit.number + 1]
    last = Campaign.load(fitted).status()
    assert last.ended
    assert not Campaign.load(fitted).ask()
    assert first.estimate is not None
    assert last.estimate is not None
    assert last.history.visits.tolist() == [2, 3]
    np.testing.assert_array_equal(last.history.values[0], first.estimate.values)
    np.testing.assert_array_equal(last.history.std[-1], last.estimate.std)
    (fitted.parent / "out" / "history.h5").write_bytes(b"no history")
    assert len(Campaign.load(fitted).status().history) == 1


def test_reached_is_in_doubt_where_the_model_or_the_robot_is(fitted: Path) -> None:
    status = Campaign.load(fitted).status()
    assert status.state == "reached"
    assert not status.ended  # the first visit is still to be repeated
    assert status.estimate is not None
    wrong = replace(
        status.estimate.trust, verdicts=("model error",) * 6, reasons=("a spring is missing",) * 6
    )
    for changes, words in (
        ({"trust": wrong}, "model error: a spring is missing"),
        ({"drift": 1e-4}, "the first visit and its repetition differ"),
        ({"reached": 0.5}, "only 50% of the searches"),
    ):
        doubtful = replace(status, estimate=replace(status.estimate, **changes))
        assert doubtful.state == "in doubt"
        assert words in doubtful.estimate.doubts(status.targets)[0]


def test_small_errors_of_the_model_leave_accuracies_reached(fitted: Path) -> None:
    """Told in a line; not so if they may move a parameter by what targets allow beside noise."""
    status = Campaign.load(fitted).status()
    assert status.estimate is not None
    estimate = replace(status.estimate, reached=1.0)
    tests = estimate.trust.tests
    i = int(np.abs(tests.shifts).max(axis=1).argmax())
    unit = np.where(np.arange(len(tests.names)) == i, 1.0, 0.0)
    room = np.sqrt(status.targets**2 - estimate.std**2) / np.abs(tests.shifts[i])

    def with_error(size: float) -> CampaignStatus:
        fired = replace(tests, probabilities=1 - unit, estimates=size * room.min() * unit)
        names = estimate.trust.names
        wrong = ("model error",) * len(names), (f"{tests.names[i]} is off",) * len(names)
        trust = replace(estimate.trust, verdicts=wrong[0], reasons=wrong[1], tests=fired)
        return replace(status, estimate=replace(estimate, trust=trust))

    small, large = with_error(0.9), with_error(1.1)
    assert (small.state, large.state) == ("reached", "in doubt")
    assert not small.estimate.doubts(small.targets)
    (words,) = remarks(small)
    assert words.startswith(f"model error: {tests.names[i]} is off; left out, it moves ")
    assert status_text(small, "campaign.yaml").count("model error") == 1
    assert remarks(large) == [f"model error: {tests.names[i]} is off"]
    assert with_error(np.nan).state == "in doubt"


def test_friction_is_shown(fitted: Path) -> None:
    """In words, for scripts, on the page and in the identified robot."""
    campaign = Campaign.load(fitted)
    status = campaign.status()
    estimate = status.estimate
    assert estimate is not None
    (level,) = estimate.friction
    assert (level.motor, level.in_file) == ("m1", 0.0)
    assert abs(level.level) < 0.01  # simulated without
    rubbing = FrictionLevel("m1", 1.42, 0.01, 1.4, 1.5, 1.2)
    seen = replace(status, estimate=replace(estimate, friction=(rubbing,)))
    words = "friction of m1: 1.420 N m (std 0.010; 1.400 to 1.500 over positions; robot file 1.2)"
    assert words in " ".join(status_text(seen, "campaign.yaml").split())
    (said,) = status_json(seen, fitted)["friction"]
    assert said == asdict(rubbing)
    write_campaign_page(campaign, seen, fitted.parent / "page.html", "campaign.yaml")
    page = (fitted.parent / "page.html").read_text(encoding="utf-8")
    (rows,) = re.findall(r'id="friction".*?</table>', page, flags=re.DOTALL)
    assert [x in rows for x in ("m1", "1.420", "0.010", "1.400", "1.500", "1.2")] == [True] * 6
    assert campaign.identified(seen.estimate).file.motors[0].coulomb == 1.42


def test_plans_heed_the_friction_of_estimates(fitted: Path) -> None:
    """The highest of a visit with a margin; before it the robot file's, not that of rehearsals."""
    campaign = Campaign.load(fitted)
    estimate, settings = campaign.status().estimate, campaign.settings
    assert settings.imperfections.friction == 0
    rubbing = with_friction(campaign.robot, np.array([0.7]))
    assert friction_of(settings, rubbing) == [0.7]
    assert estimate is not None
    level = FrictionLevel("m1", 1.42, 0.01, 1.4, 1.5, 1.2)
    known = known_now(rubbing, replace(estimate, friction=(level,)))
    assert friction_of(settings, known) == pytest.approx([1.52])
    at_rest = FrictionLevel("m1", *4 * (np.nan,), 1.2)
    unseen = known_now(rubbing, replace(estimate, friction=(at_rest,)))
    assert friction_of(settings, unseen) == [0.7]
    limited = settings.model_copy(update={"limits": LimitChoice(torque=10.0)})
    power = np.ones((len(line_grid(limited, 1).lines), 1))
    free, less = (
        fair_torques(limited, robot, np.zeros(1), power / len(power))
        for robot in (with_friction(known, np.zeros(1)), known)
    )
    assert less == pytest.approx(free * (10 - 1.52) / 10)


def test_costs_and_peaks_of_visits(fitted: Path) -> None:
    """Noise alone makes the cost one on average; speeds come near their limit, not beyond."""
    latest = Campaign.load(fitted).status().estimate
    assert latest is not None
    assert latest.visit_costs.shape == (2,)
    assert (np.abs(np.log(latest.visit_costs)) < np.log(5)).all()  # 6 degrees of freedom
    assert (latest.peaks[:, 1] > 3).all()
    assert (latest.peaks[:, 1] < 5.5).all()


def test_lines_below_the_noise_are_no_dead_end(tmp_path: Path) -> None:
    """Encoders so noisy that a low-level run hardly shows; elsewhere such records are refused."""
    path = write_campaign(tmp_path, ("1.0e-5", "8.0e-4"))
    run_open(path)
    visit = Campaign.load(path).visits[0]
    with pytest.raises(InvalidInput, match="no motor's torque is above its noise"):
        run_spectra(Records.load(visit.records_file), "detection")
    run_open(path)
    visit = Campaign.load(path).visits[1]
    records = Records.load(visit.records_file)
    replace(records, lines=records.lines[:9]).save(visit.records_file)  # all that an import sees
    status = Campaign.load(path).status()
    assert status.estimate is not None
    away = np.log(status.estimate.values / load_robot(TRUTH).parameters.values)
    assert (np.abs(away) < 4 * status.estimate.std).all()
