"""The stages of a study that keep positions out of the fit and predict them from it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimators.frf.frf_estimate import FrfEstimate, simulate_frf
from estimators.frf.repeated_visits import distortion_in
from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.held_out_positions import Validation, validate
from oed.study.stages.context import Run
from oed.study.stages.data_stages import Data, frf_of, shaken
from oed.study.stages.design_stages import Information, Plan
from oed.study.stages.fit_stages import Chosen
from oed.study.stages.serialisation import dataclass_files
from oed.study.stages.stage_cache import Stage
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class Split:
    """Measured data in two parts.

    Attributes
    ----------
    fitted : Data
        The one part.
    held_out : FrfEstimate
        FRFs in the other positions.
    """

    fitted: Data
    held_out: FrfEstimate


def split_data(run: Run, data: Stage[Data]) -> Stage[Split]:
    """Return measured data without the positions that the study holds out, and those.

    Raises
    ------
    InvalidInput
        If there are no such positions, or none is left to fit.
    """
    estimate = data.value.estimate
    out = _held_out(run, len(estimate.positions))

    def compute(folder: Path, report: Progress | None) -> Split:
        rest = np.setdiff1d(np.arange(len(estimate.positions)), out)
        known = data.value.distortion
        fitted = replace(
            data.value,
            estimate=estimate.subset(rest),
            distortion=None if known is None else distortion_in(known, rest),
        )
        return Split(fitted, estimate.subset(out))

    inputs = {"data": data.digest, "held_out": out.tolist()}
    return run.stages.run("split", inputs, compute, dataclass_files(Split))


def _held_out(run: Run, count: int) -> IntArray:
    """Return which of the data's positions are held out, (k,)."""
    choice = run.study.validation
    assert choice is not None
    if choice.positions is not None:
        wrong = [i for i in choice.positions if i >= count]
        if wrong:
            raise InvalidInput(
                f"validation.positions: there is no position {wrong[0]}; the data have {count}, "
                "counted from 0"
            )
        out = np.unique(choice.positions)
    else:
        number = max(1, round((choice.share or 0.0) * count))
        out = np.sort(run.rng("validation").choice(count, min(number, count), replace=False))
    if len(out) == count:
        raise InvalidInput(
            f"validation: all {count} positions of the data are held out; leave some to fit"
        )
    return out


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
        return simulate_frf(run.plant, positions, run.omega, run.noise, rng, once)
    found = shaken(run, positions, once, rng, folder, report)
    estimate = frf_of(run, found.records).estimate
    found.records.unlink()
    return estimate
