"""The stage of a study that repeats [WM] section 6: its estimators beside theirs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.uncertainty.covariance import Uncertainty, covariance
from oed.replication.conclusions import Judged, conclusions
from oed.replication.six_estimators import REFERENCE, Evaluation, evaluate
from oed.replication.table_1 import Groups, Table1, groups_of, hardest_spring, table_1
from oed.replication.time_domain_comparison import ROLLOUTS, Rivalry, compare
from oed.study.settings.replication_settings import ESTIMATORS
from oed.study.stages.context import Run, truth_of
from oed.study.stages.data_stages import Data
from oed.study.stages.fit_stages import Search, weights_of
from oed.study.stages.serialisation import dataclass_files
from oed.study.stages.stage_cache import Stage
from robotmodels.common.arrays import Array
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class Published:
    """All that the paper shows, from this study's data.

    Attributes
    ----------
    evaluation : Evaluation
        All models of the six estimators.
    reference : Fit
        The best LLS15U fit.
    theorem1 : Uncertainty
        Theorem1 of it.
    table : Table1
        As Table 1.
    groups : Groups
        Parameters of gearboxes and arm.
    hardest : str
        The arm spring that is left out of the second share.
    conclusions : tuple of Judged
        The seven, judged.
    rivalry : Rivalry or None
        Fits in time beside fits of FRFs; None unless the study asks for it.
    """

    evaluation: Evaluation
    reference: Fit
    theorem1: Uncertainty
    table: Table1
    groups: Groups
    hardest: str
    conclusions: tuple[Judged, ...]
    rivalry: Rivalry | None

    @property
    def by_cost(self) -> dict[str, float]:
        """Part of each estimator's models with a reasonable cost."""
        share = self.evaluation.reasonable_by_cost.mean(axis=1)
        return dict(zip(ESTIMATORS, share.tolist(), strict=True))

    @property
    def by_springs(self) -> dict[str, float]:
        """Part of each estimator's models with reasonable springs, the hardest one left out."""
        share = self.evaluation.reasonable_by_springs((self.hardest,)).mean(axis=1)
        return dict(zip(ESTIMATORS, share.tolist(), strict=True))

    @property
    def by_all_springs(self) -> dict[str, float]:
        """Part of each estimator's models with all springs reasonable."""
        share = self.evaluation.reasonable_by_springs().mean(axis=1)
        return dict(zip(ESTIMATORS, share.tolist(), strict=True))


def compared(
    run: Run, data: Stage[Data], searches: Mapping[str, Stage[Search]], starts: Array
) -> Published:
    """Return this study's figures, table and verdicts."""
    evaluation = _evaluation(run, data, searches, starts).value
    reference = searches[REFERENCE].value.runs[0]
    theorem1, groups = covariance(reference), groups_of(run.robot)
    table = table_1(evaluation, theorem1)
    plant = None if run.study.data.measured else run.plant
    return Published(
        evaluation,
        reference,
        theorem1,
        table,
        groups,
        hardest_spring(evaluation, theorem1, groups),
        conclusions(evaluation, theorem1, table, groups, truth_of(run.robot, plant)),
        None if run.study.rival is None else _rivalry(run).value,
    )


def _evaluation(
    run: Run, data: Stage[Data], searches: Mapping[str, Stage[Search]], starts: Array
) -> Stage[Evaluation]:
    estimate = data.value.estimate

    def compute(folder: Path, report: Progress | None) -> Evaluation:
        found = {name: searches[name].value for name in ESTIMATORS}
        kind, choice = found[REFERENCE].estimator, run.study.fit.user_weights
        user = np.asarray(weights_of(kind, estimate, choice))
        return evaluate(run.robot, estimate, found, user, starts, run.executor, report)

    inputs = {
        "robot": run.robot_digest,
        "data": data.digest,
        "fits": {name: searches[name].digest for name in ESTIMATORS},
        "user_weights": run.study.fit.user_weights.model_dump(mode="json"),
    }
    return run.stages.run("published", inputs, compute, dataclass_files(Evaluation))


def _rivalry(run: Run) -> Stage[Rivalry]:
    """Return both ways of fitting; computed again where mujoco.sysid has come to be there."""
    from oed.replication.rollout_fit import missing

    choice = run.study.rival
    assert choice is not None

    def compute(folder: Path, report: Progress | None) -> Rivalry:
        return compare(choice, run.rng("rival"), run.executor, report)

    inputs = {"missing": missing(), "limit": ROLLOUTS, **run.settings("rival", "seed")}
    return run.stages.run("rival", inputs, compute, dataclass_files(Rivalry))
