"""The stages ``split`` and ``validation``: positions that are not fitted, predicted by the result.

Both do what the section ``validation`` of a study asks for: of measured data the first holds
positions out before the fit, which the second judges after it.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimators.fitting.fit_problem import Measured
from estimators.frf.frf_estimate import simulate_frf
from estimators.frf.repeated_visits import distortion_in
from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.held_out_positions import Validation, validate
from oed.study.settings.data_settings import ValidationChoice
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.data import Data, read_data
from oed.study.stages.design import StudyDesign
from oed.study.stages.experiment import simulate_experiment
from oed.study.stages.information import Information
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import MeasuredRun, Run, SimulatedRun
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class Split:
    """Measured data in two parts.

    Attributes
    ----------
    fitted : Data
        Data of the positions that are fitted.
    held_out : FrfEstimate or RunSpectra
        Data in the other positions.
    """

    fitted: Data
    held_out: Measured


def split(run: MeasuredRun, choice: ValidationChoice, data: Stage[Data]) -> Stage[Split]:
    """Return measured data without the positions that a validation holds out, and those.

    Raises
    ------
    InvalidInput
        If there are no such positions, or none remains to fit.
    """
    estimate = data.value.estimate
    out = _positions_out(run, choice, len(estimate.positions))

    def compute(folder: Path, report: Progress | None) -> Split:
        fitted = np.setdiff1d(np.arange(len(estimate.positions)), out)
        distortion = data.value.distortion
        part = replace(
            data.value,
            estimate=estimate.subset(fitted),
            distortion=None if distortion is None else distortion_in(distortion, fitted),
        )
        return Split(part, estimate.subset(out))

    inputs = {"data": data.digest, "held_out": out.tolist()}
    return run.stages.run("split", inputs, compute, dataclass_files(Split))


def _positions_out(run: MeasuredRun, choice: ValidationChoice, count: int) -> IntArray:
    """Return indices (k,) of the data's positions that are not fitted."""
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
    """Data in positions that were not fitted, and how they lie in their predicted bands.

    Attributes
    ----------
    estimate : FrfEstimate or RunSpectra
        The data.
    theorem1 : Validation
        Judged with Theorem 1's covariance.
    """

    estimate: Measured
    theorem1: Validation


def validation(
    run: SimulatedRun,
    count: int,
    info: Stage[Information],
    plan: Stage[StudyDesign],
    result: Stage[SelectedFit],
    theorem1: Stage[Uncertainty],
) -> Stage[HeldOut]:
    """Return the validation in `count` candidates that the plan does not use.

    Raises
    ------
    InvalidInput
        If there are too few of them.
    """
    positions = _unused(run, count, info.value, plan.value)

    def compute(folder: Path, report: Progress | None) -> HeldOut:
        return _held_out(run, _simulated(run, positions, folder, report), result, theorem1)

    inputs = {
        "robot": run.robot_digest,
        "plant": run.plant_digest,
        "positions": positions.tolist(),
        "result": result.digest,
        "uncertainty": theorem1.digest,
        **run.settings("data", "frequencies", "noise", "seed"),
    }
    return run.stages.run("validation", inputs, compute, dataclass_files(HeldOut))


def measured_validation(
    run: MeasuredRun, split: Stage[Split], result: Stage[SelectedFit], theorem1: Stage[Uncertainty]
) -> Stage[HeldOut]:
    """Return the validation in measured positions that were not fitted."""

    def compute(folder: Path, report: Progress | None) -> HeldOut:
        return _held_out(run, split.value.held_out, result, theorem1)

    inputs = {
        "robot": run.robot_digest,
        "split": split.digest,
        "result": result.digest,
        "uncertainty": theorem1.digest,
    }
    return run.stages.run("validation", inputs, compute, dataclass_files(HeldOut))


def _held_out(
    run: Run, measured: Measured, result: Stage[SelectedFit], theorem1: Stage[Uncertainty]
) -> HeldOut:
    values = result.value.fit.parameters.values
    return HeldOut(measured, validate(run.robot, values, measured, theorem1.value))


def _unused(run: SimulatedRun, count: int, info: Information, plan: StudyDesign) -> Array:
    """Return positions (count, n) drawn from the candidates that the plan does not use."""
    free = np.flatnonzero(plan.exact.repetitions == 0)
    if len(free) < count:
        raise InvalidInput(
            f"validation.count: {count} positions; {len(free)} candidates are not measured"
        )
    drawn = run.rng("validation").choice(free, count, replace=False)
    return np.asarray(info.positions[np.sort(drawn)])


def _simulated(
    run: SimulatedRun, positions: Array, folder: Path, report: Progress | None
) -> Measured:
    """Return data simulated as the data of the study, once in each position."""
    once, rng = np.ones(len(positions), dtype=np.int64), run.rng("held out")
    excitation = run.study.data.experiment
    if excitation is None:
        return simulate_frf(run.plant, positions, run.omega, run.noise, rng, once)
    simulated = simulate_experiment(run, excitation, positions, once, rng, folder, report)
    measured = read_data(run, simulated.records).estimate
    simulated.records.unlink()
    return measured
