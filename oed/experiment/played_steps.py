"""A plan as a controller plays it: step by step, sample by sample."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from robotmodels.common.arrays import Array

Kind = Literal["move", "settle", "ramp", "excitation", "fall"]


@dataclass(frozen=True, eq=False)
class PlayedStep:
    """Samples to play, once or several times in a row; numbers count from 1.

    Attributes
    ----------
    kind : {"move", "settle", "ramp", "excitation", "fall"}
        What it does.
    visit, position : int
        Of the plan.
    block, run : int
        Of the visit; 0 before its first run.
    repeats, drop : int
        How often to play it, and how many of these are transient.
    positions : ndarray, (K, n), rad
        Commanded, arm side.
    speeds : ndarray, (K, n), rad/s
        Commanded, motor shaft.
    """

    kind: Kind
    visit: int
    position: int
    block: int
    run: int
    repeats: int
    drop: int
    positions: Array
    speeds: Array

    @property
    def name(self) -> str:
        """Name of a file for it."""
        visit = f"visit_{self.visit:03d}"
        if not self.run:
            return f"{visit}_{self.kind}"
        name = f"{visit}_block_{self.block:02d}_run_{self.run:02d}"
        return name if self.kind == "excitation" else f"{name}_{self.kind}"


def played_steps(plan: ExperimentPlan, ratios: Array) -> Iterator[PlayedStep]:
    """Yield the steps of a plan in order; moves and rests without samples are left out.

    Parameters
    ----------
    ratios : ndarray, (n,)
        Motor angle per arm angle.
    """
    drop = plan.transient_periods - int(plan.ramp)
    for visit, q in enumerate(plan.visits):
        at = (visit + 1, int(q) + 1)
        path = plan.move_to(visit)
        if len(path):
            yield PlayedStep("move", *at, 0, 0, 1, 0, path.positions, ratios * path.speeds)
        still = np.zeros((round(plan.settle / plan.multisine.sample_time), len(ratios)))
        if len(still):
            yield PlayedStep("settle", *at, 0, 0, 1, 0, plan.positions[q] + still, still)
        for block, runs in enumerate(plan.reference(visit), start=1):
            for run, speeds in enumerate(runs, start=1):
                steady = np.tile(plan.positions[q], (len(speeds), 1))
                of = (*at, block, run)
                if plan.ramp:
                    yield PlayedStep("ramp", *of, 1, 1, steady, plan.envelope[:, None] * speeds)
                yield PlayedStep("excitation", *of, plan.periods + drop, drop, steady, speeds)
                if plan.ramp:
                    K = len(plan.fall)
                    falling = plan.fall[:, None] * speeds[:K]
                    yield PlayedStep("fall", *of, 1, 1, steady[:K], falling)
