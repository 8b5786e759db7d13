"""The stage of a study that predicts FRFs in positions it did not measure in, and measures them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.frf.estimate import FrfEstimate, simulate_frf
from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.validation import Validation, validate
from oed.study.data import frf_of, shaken
from oed.study.design import Information, Plan
from oed.study.fits import Chosen
from oed.study.held_out import Split
from oed.study.run import Run
from oed.study.stage_files import dataclass_files
from oed.study.stages import Stage
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput
from robotmodels.progress import Progress


@dataclass(frozen=True, eq=False)
class HeldOut:
    """FRFs in positions that were not fitted, and how they lie in their predicted bands.

    Attributes
    ----------
    estimate : FrfEstimate
        The FRFs.
    theorem1 : Validation
        Judged with Theorem 1's covariance.
    """

    estimate: FrfEstimate
    theorem1: Validation


def held_out(
    run: Run,
    info: Stage[Information],
    plan: Stage[Plan],
    result: Stage[Chosen],
    known: Stage[Uncertainty],
) -> Stage[HeldOut]:
    """Return the validation in candidates that the plan does not use.

    Raises
    ------
    InvalidInput
        If there are too few of them.
    """
    positions = _positions(run, info.value, plan.value)

    def compute(folder: Path, report: Progress | None) -> HeldOut:
        return _judged(run, _measured(run, positions, folder, report), result, known)

    inputs = {
        "robot": run.robot_digest,
        "plant": run.plant_digest,
        "positions": positions.tolist(),
        "result": result.digest,
        "uncertainty": known.digest,
        **run.settings("data", "frequencies", "noise", "seed"),
    }
    return run.stages.run("validation", inputs, compute, dataclass_files(HeldOut))


def held_back(
    run: Run, split: Stage[Split], result: Stage[Chosen], known: Stage[Uncertainty]
) -> Stage[HeldOut]:
    """Return the validation in measured positions that were not fitted."""

    def compute(folder: Path, report: Progress | None) -> HeldOut:
        return _judged(run, split.value.held_out, result, known)

    inputs = {
        "robot": run.robot_digest,
        "split": split.digest,
        "result": result.digest,
        "uncertainty": known.digest,
    }
    return run.stages.run("validation", inputs, compute, dataclass_files(HeldOut))


def _judged(
    run: Run, estimate: FrfEstimate, result: Stage[Chosen], known: Stage[Uncertainty]
) -> HeldOut:
    values = result.value.fit.parameters.values
    return HeldOut(estimate, validate(run.robot, values, estimate, known.value))


def _positions(run: Run, info: Information, plan: Plan) -> Array:
    choice = run.study.validation
    assert choice is not None
    assert choice.count is not None  # the schema asks for it where data are simulated
    free = np.flatnonzero(plan.exact.repetitions == 0)
    if len(free) < choice.count:
        raise InvalidInput(
            f"validation.count: {choice.count} positions; {len(free)} candidates are not measured"
        )
    chosen = run.rng("validation").choice(free, choice.count, replace=False)
    return np.asarray(info.positions[np.sort(chosen)])


def _measured(run: Run, positions: Array, folder: Path, report: Progress | None) -> FrfEstimate:
    """Return FRFs measured as the study's own, once in each position."""
    once, rng = np.ones(len(positions), dtype=np.int64), run.rng("held out")
    if run.study.data.experiment is None:
        frequencies, noise = run.study.frequencies, run.study.noise
        assert frequencies is not None
        assert noise is not None
        return simulate_frf(run.plant, positions, frequencies.omega(), noise.law(), rng, once)
    found = shaken(run, positions, once, rng, folder, report)
    estimate = frf_of(run, found.records).estimate
    found.records.unlink()
    return estimate
