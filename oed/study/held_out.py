"""Measured positions that are not fitted but predicted: a split of the data."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimators.frf.estimate import FrfEstimate
from estimators.frf.visits import distortion_in
from oed.study.data import Data
from oed.study.run import Run
from oed.study.stage_files import dataclass_files
from oed.study.stages import Stage
from robotmodels.arrays import IntArray
from robotmodels.errors import InvalidInput
from robotmodels.progress import Progress


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
