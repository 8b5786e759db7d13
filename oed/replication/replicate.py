"""A study that repeats [WM] section 6: its estimators beside those of the paper."""

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.uncertainty.covariance import Uncertainty, covariance
from oed.replication.as_published import fit_as_published
from oed.replication.conclusions import Judged, conclusions
from oed.replication.local_minima import LocalMinima, local_minima
from oed.replication.six_estimators import REFERENCE, Evaluation, evaluate
from oed.replication.table_1 import Groups, Table1, groups_of, hardest_spring, table_1
from oed.replication.time_domain_comparison import (
    ROLLOUTS,
    TimeDomainComparison,
    compare,
    method_names,
)
from oed.study.results import FittedStudy
from oed.study.settings.study_file import ESTIMATORS, LocalMinimaChoice, TimeDomainChoice
from oed.study.stage_cache import Stage, dataclass_files, open_stages
from oed.study.stages.fit import weighting_of, weights_of
from oed.study.stages.run import Run
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.progress import Progress, StageProgress


@dataclass(frozen=True, eq=False)
class Replication:
    """All that the paper shows, from this study's data.

    Attributes
    ----------
    evaluation : Evaluation
        All models of the six estimators.
    reference : FittedModel
        The best LLS15U fit.
    theorem1 : Uncertainty
        Theorem1 of it.
    table : Table1
        As Table 1.
    groups : Groups
        Parameters of gearboxes and arm.
    hardest : str
        The arm spring that the second share ignores.
    conclusions : tuple of Judged
        The seven, judged.
    time_domain : TimeDomainComparison or None
        Fits in time beside fits of FRFs; None unless the study asks for it.
    minima : LocalMinima or None
        Fits of less excitation; None unless the study asks for it.
    seconds : dict of str to float
        Time per stage, when it was computed.
    as_published : Replication or None
        The same of the paper's excitation, mean, weights and search; None unless the study asks.
    """

    evaluation: Evaluation
    reference: FittedModel
    theorem1: Uncertainty
    table: Table1
    groups: Groups
    hardest: str
    conclusions: tuple[Judged, ...]
    time_domain: TimeDomainComparison | None
    minima: LocalMinima | None
    seconds: dict[str, float]
    as_published: "Replication | None" = None

    @property
    def by_cost(self) -> dict[str, float]:
        """Part of each estimator's models with a reasonable cost."""
        share = self.evaluation.reasonable_by_cost.mean(axis=1)
        return dict(zip(ESTIMATORS, share.tolist(), strict=True))

    @property
    def by_springs(self) -> dict[str, float]:
        """Part of each estimator's models with reasonable springs, the hardest one ignored."""
        share = self.evaluation.reasonable_by_springs((self.hardest,)).mean(axis=1)
        return dict(zip(ESTIMATORS, share.tolist(), strict=True))

    @property
    def by_all_springs(self) -> dict[str, float]:
        """Part of each estimator's models with all springs reasonable."""
        share = self.evaluation.reasonable_by_springs().mean(axis=1)
        return dict(zip(ESTIMATORS, share.tolist(), strict=True))


def replicate(
    results: FittedStudy,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> Replication:
    """Return a fitted study's figures, table and verdicts beside the paper's.

    Its results are stored beside the stages of the study.

    Parameters
    ----------
    results : FittedStudy
        A study with the six estimators.
    progress : StageProgress, optional
        Told how far the computation is.
    executor : Executor, optional
        Computes costs and fits in time in parallel.
    fresh : bool
        Compute stored results again.

    Raises
    ------
    IdentificationError
        Where it cannot be computed, naming what is at fault.
    """
    replication = _replication(results, progress, executor, fresh)
    if not results.study.as_published:
        return replication
    other = fit_as_published(results, progress, executor=executor, fresh=fresh)
    return replace(replication, as_published=_replication(other, progress, executor, fresh))


def _replication(
    results: FittedStudy,
    progress: StageProgress | None,
    executor: Executor | None,
    fresh: bool,
) -> Replication:
    study, robot = results.study, results.robot
    with open_stages(study.output / "stages", progress, fresh) as stages:
        run = Run(study, robot, stages, executor)
        evaluation = _evaluation(run, results).value
        reference = results.fits.searches[REFERENCE].runs[0]
        theorem1, groups = covariance(reference), groups_of(robot)
        table = table_1(evaluation, theorem1)
        return Replication(
            evaluation,
            reference,
            theorem1,
            table,
            groups,
            hardest_spring(evaluation, theorem1, groups),
            conclusions(evaluation, theorem1, table, groups, results.truth),
            None if study.time_domain is None else _time_domain(run, study.time_domain).value,
            None if study.local_minima is None else _minima(run, study.local_minima, results).value,
            stages.seconds,
        )


def _evaluation(run: Run, results: FittedStudy) -> Stage[Evaluation]:
    estimate, starts = results.data.frf, results.fits.starts
    searches = {name: results.fits.searches[name] for name in ESTIMATORS}
    ends = {
        name: [(fit.parameters.values, fit.cost) for fit in search.runs]
        for name, search in searches.items()
    }

    def compute(folder: Path, report: Progress | None) -> Evaluation:
        user, optimal = (
            weights_of(searches[name].estimator, estimate, run.study.fit)
            for name in (REFERENCE, "LLS15O")
        )
        weights = np.asarray(user), "optimal_diagonal" if isinstance(optimal, str) else optimal
        return evaluate(run.robot, estimate, searches, weights, starts, run.executor, report)

    inputs = {
        "robot": run.robot_digest,
        "data": fingerprint(estimate),
        "fits": fingerprint((ends, starts)),
        **weighting_of(run.study.fit),
    }
    return run.stages.run("published", inputs, compute, dataclass_files(Evaluation))


def _time_domain(run: Run, choice: TimeDomainChoice) -> Stage[TimeDomainComparison]:
    """Return all ways of fitting; computed again where there are other methods than before."""

    def compute(folder: Path, report: Progress | None) -> TimeDomainComparison:
        return compare(choice, run.rng("time domain"), run.executor, report)

    inputs = {"methods": method_names(), "limit": ROLLOUTS, **run.settings("time_domain", "seed")}
    return run.stages.run("time-domain", inputs, compute, dataclass_files(TimeDomainComparison))


def _minima(run: Run, choice: LocalMinimaChoice, results: FittedStudy) -> Stage[LocalMinima]:
    def compute(folder: Path, report: Progress | None) -> LocalMinima:
        return local_minima(run, choice, results, report)

    inputs = {
        "robot": run.robot_digest,
        "data": fingerprint((results.data.frf, results.fits.starts)),
        **run.settings("local_minima", "truth", "data", "seed"),
        **weighting_of(run.study.fit),
    }
    return run.stages.run("local-minima", inputs, compute, dataclass_files(LocalMinima))
