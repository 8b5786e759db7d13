"""The stage ``comparison``: the plan and its alternatives in simulated experiments."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from oed.plan_comparison.baseline_plans import even_plan, grid_levels, grid_plan, random_plan
from oed.plan_comparison.compare_plans import checked_runs, compare_plans
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.stage_cache import Files, Stage, dataclass_files
from oed.study.stages.design import StudyDesign
from oed.study.stages.design_inputs import criterion_of
from oed.study.stages.information import Information
from oed.study.stages.run import SimulatedRun
from robotmodels.common.arrays import IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.process_pool import behind_others
from robotmodels.common.progress import Progress

OPTIMAL = "optimal"


def check_comparison(run: SimulatedRun) -> None:
    """Refuse a comparison that cannot be made before anything is computed.

    Raises
    ------
    InvalidInput
        If the designer's grid does not fit, or there are too few runs.
    """
    choice = run.study.compare
    if not run.study.compares:
        return
    with _naming_section():
        checked_runs(choice.runs, len(run.robot.parameters))
        if choice.grid is not None:
            grid_levels(run.study.design.number, choice.grid, tuple(run.robot.motor_joints))


def comparison(
    run: SimulatedRun, info: Stage[Information], plan: Stage[StudyDesign]
) -> Stage[PlanComparison]:
    """Return the plan beside alternatives of as many experiments, in experiments by the noise law.

    Raises
    ------
    InvalidInput
        If the designer's grid has more points than a plan within its time has experiments.
    SolverFailed
        If too few experiments of a plan can be fitted.
    """

    def compute(folder: Path, report: Progress | None) -> PlanComparison:
        rng = run.rng("comparison")
        return compare_plans(
            run.robot,
            info.value,
            info.value.positions,
            _plans(run, info.value, plan.value, rng),
            run.omega,
            run.noise,
            rng=rng,
            runs=run.study.compare.runs,
            # Springs to tell apart are no parameters: plans are compared by those.
            criterion=criterion_of(run.study.design, run.robot)
            if not run.study.design.distinguish
            else "D",
            executor=behind_others(run.executor),
            progress=report,
            store=folder,
        )

    inputs = {
        "robot": run.robot_digest,
        "information": info.digest,
        "design": plan.digest,
        "criterion": [run.study.design.criterion, *run.study.design.interest],
        **run.settings("compare", "frequencies", "noise", "seed"),
    }
    return run.stages.run("comparison", inputs, compute, Files(_save, _RESULT.load))


def _plans(
    run: SimulatedRun, info: Information, plan: StudyDesign, rng: np.random.Generator
) -> dict[str, IntArray]:
    """Return the plan and its alternatives by name; limits of the design do not bind these."""
    choice, count = run.study.compare, plan.exact.n_experiments
    plans = {OPTIMAL: plan.exact.repetitions}
    if choice.grid is None:
        plans["evenly spread"] = even_plan(info.positions, count)
    else:
        joints = tuple(run.robot.motor_joints)
        with _naming_section():
            plans["grid by hand"] = grid_plan(info.positions, count, choice.grid, joints)
    for k in range(choice.random):
        plans[f"random {k + 1}"] = random_plan(len(info), count, rng)
    return plans


@contextmanager
def _naming_section() -> Iterator[None]:
    """Name the section of the study file in errors."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(f"compare.{error}") from None


_RESULT = dataclass_files(PlanComparison)


def _save(value: PlanComparison, folder: Path) -> None:
    _RESULT.save(value, folder)
    for store in folder.glob("plan_*.h5"):
        store.unlink()
