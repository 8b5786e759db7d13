"""The rules by which a repeated study is judged, on models made up to be clear cases."""

import numpy as np
import pytest

from estimators.uncertainty.covariance import Uncertainty
from oed.replication.conclusions import agreed, conclusions, contest
from oed.replication.paper import CONCLUSIONS, TABLE_1
from oed.replication.six_estimators import Evaluation
from oed.replication.table_1 import (
    Groups,
    Table1,
    groups_of,
    hardest_spring,
    success_share,
    table_1,
)
from oed.study.settings.study_file import ESTIMATORS
from robotmodels import load_robot

N = 40
SPRINGS = tuple(f"{kind}{i}.stiffness" for kind in "gb" for i in range(6))
DAMPERS = tuple(name.replace("stiffness", "damping") for name in SPRINGS)
NAMES = SPRINGS + DAMPERS
GROUPS = Groups(tuple(range(6)), tuple(range(6, 12)), tuple(range(12, 18)), tuple(range(18, 24)))
TRUTH = np.ones(len(NAMES))


def evaluation(good, error=0.01, scatter=None, seed=1):
    """Return models of which `good[name]` of N are reasonable; `error[name]` of the best."""
    rng = np.random.default_rng(seed)
    errors = error if isinstance(error, dict) else dict.fromkeys(ESTIMATORS, error)
    scatter = np.zeros(len(NAMES)) if scatter is None else scatter
    user, start, values = [], [], []
    for name in ESTIMATORS:
        count = good[name]
        user.append(np.concatenate([np.linspace(1, 1.4, count), np.linspace(2, 50, N - count)]))
        start.append(rng.permutation(N))
        best = np.exp(errors[name] * rng.choice([-1, 1], len(NAMES)) * rng.uniform(0.5, 1, 24))
        spread = np.exp(rng.standard_normal((N, len(NAMES))) * scatter)
        spread[0] = 1.0
        values.append(best * spread)
    return Evaluation(
        ESTIMATORS,
        NAMES,
        np.array(start),
        np.array(user),
        np.array(user),
        np.array(values),
        np.ones((len(ESTIMATORS), N)),
    )


def theorem1(std):
    return Uncertainty(NAMES, np.diag(np.asarray(std) ** 2), "made up")


def verdicts(models, std, truth=TRUTH):
    uncertainty = theorem1(std)
    judged = conclusions(models, uncertainty, table_1(models, uncertainty), GROUPS, truth)
    assert tuple(one.conclusion for one in judged) == CONCLUSIONS
    return [one.verdict for one in judged]


LIKE_THE_PAPER = {
    "LLS15U": 32, "LLSM15U": 20, "LLS15O": 14, "NLS15U": 2, "NLS15O": 0, "LLS1U": 1,
}  # fmt: skip
STD = np.concatenate([np.full(6, 0.01), np.full(6, 0.05), np.full(6, 0.1), np.full(6, 0.4)])
STD = STD * np.linspace(1, 1.2, 24)
UNKNOWN = np.full(24, np.nan)


def test_models_like_the_papers_support_its_conclusions():
    models = evaluation(LIKE_THE_PAPER, scatter=2 * STD)
    assert verdicts(models, STD, UNKNOWN) == ["supported"] * 7


def test_the_opposite_models_support_none():
    opposite = {
        "LLS15U": 8, "LLSM15U": 30, "LLS15O": 30, "NLS15U": 30, "NLS15O": 38, "LLS1U": 30,
    }  # fmt: skip
    models = evaluation(opposite, scatter=2 * STD[::-1])
    assert verdicts(models, STD[::-1], UNKNOWN)[:6] == ["not supported"] * 6
    assert verdicts(models, STD, UNKNOWN)[6] == "not supported"


def test_equal_models_decide_nothing():
    models = evaluation(dict.fromkeys(ESTIMATORS, N))
    found = verdicts(models, np.full(24, 0.01), UNKNOWN)
    assert found[:6] == ["undecided"] * 6


def test_known_errors_decide_where_all_starts_succeed():
    worse = dict.fromkeys(ESTIMATORS, 0.3) | {"LLS15U": 0.01}
    models = evaluation(dict.fromkeys(ESTIMATORS, N), worse)
    assert verdicts(models, np.full(24, 0.01))[:4] == ["supported"] * 4
    better = dict.fromkeys(ESTIMATORS, 0.01) | {"LLS15U": 0.3}
    assert (
        verdicts(evaluation(dict.fromkeys(ESTIMATORS, N), better), np.full(24, 0.1))[1:3]
        == ["not supported"] * 2
    )


@pytest.mark.parametrize(("claimed", "verdict"), [(0.3, "supported"), (0.01, "undecided")])
def test_theorem_1_is_judged_by_true_errors_as_well(claimed, verdict):
    std = claimed * np.linspace(0.5, 1.5, 24)
    models = evaluation(dict.fromkeys(ESTIMATORS, N), 0.3, scatter=std)
    assert verdicts(models, std)[6] == verdict


def test_models_that_are_one_minimum_say_nothing_by_their_scatter():
    models = evaluation(LIKE_THE_PAPER, error=0.01, scatter=1e-6 * STD)
    uncertainty = theorem1(STD)
    arguments = models, uncertainty, table_1(models, uncertainty), GROUPS
    last = conclusions(*arguments, UNKNOWN)[6]
    assert last.verdict == "undecided"
    assert "are one minimum" in last.evidence
    assert conclusions(*arguments, TRUTH)[6].verdict == "supported"


def test_a_contest_counts_the_starts_in_which_two_estimators_differ():
    models = evaluation(LIKE_THE_PAPER)
    held = contest(models, "LLS15U", "NLS15U")
    good = {
        name: set(models.start[row][models.user[row] < 1.5])
        for name, row in ((n, models.of(n)) for n in ("LLS15U", "NLS15U"))
    }
    assert held.wins == len(good["LLS15U"] - good["NLS15U"])
    assert held.losses == len(good["NLS15U"] - good["LLS15U"])
    assert held.counts == (32, 2)
    assert held.outcome == 1
    assert contest(models, "NLS15U", "LLS15U").outcome == -1
    assert contest(models, "LLS15U", "LLS15U").p == 1.0


def test_verdicts_of_several_comparisons():
    assert agreed([1, 0]) == agreed([1]) == "supported"
    assert agreed([-1, 0]) == "not supported"
    assert agreed([0, 0]) == agreed([1, -1]) == "undecided"


def test_table_1_is_over_the_best_models_relative_to_the_very_best():
    models = evaluation(LIKE_THE_PAPER, scatter=STD)
    table = table_1(models, theorem1(STD))
    chosen = models.values[models.of("LLS15U"), :31] / models.values[models.of("LLS15U"), 0]
    assert table.count == 31
    np.testing.assert_allclose(table.median, np.median(chosen, axis=0))
    np.testing.assert_allclose(table.std, chosen.std(axis=0, ddof=1))
    np.testing.assert_allclose(table.theory, STD)
    assert table.within == int((np.linspace(1, 1.4, 32) < 1.05).sum())


def test_shares_and_the_spring_that_is_left_out():
    models = evaluation(dict.fromkeys(ESTIMATORS, N))
    models.values[models.of("LLS15U"), 10:, 7] *= 3.0
    assert hardest_spring(models, theorem1(STD), GROUPS) == "b5.stiffness"
    every = models.reasonable_by_springs()[models.of("LLS15U")].sum()
    but_one = models.reasonable_by_springs((NAMES[7],))[models.of("LLS15U")].sum()
    assert (every, but_one) == (10, N)
    share = success_share(models)
    assert share[7] == 10 / N
    assert (np.delete(share, 7) == 1).all()


def test_gearboxes_are_drives_and_pairs_stay_together():
    robot = load_robot("manutec_r3_26")
    groups, names = groups_of(robot), robot.parameters.names
    assert [names[i] for i in groups.gear_springs] == [f"g{i}.stiffness" for i in range(1, 7)]
    assert [names[i] for i in groups.arm_dampers][:2] == ["b1z.damping", "b3y.damping"]
    for spring, damper in zip(groups.springs, groups.dampers, strict=True):
        assert names[spring].split(".")[0] == names[damper].split(".")[0]


def test_the_papers_table_is_as_printed_with_springs_surer_than_dampers():
    ratios = [row[4] / row[5] for row in TABLE_1.values()]
    assert min(ratios) == pytest.approx(1.48, abs=0.01)
    assert max(ratios) == pytest.approx(33.0, abs=0.1)
    assert isinstance(table_1(evaluation(LIKE_THE_PAPER), theorem1(STD)), Table1)
