"""How often searches end in the best minimum, by excitation and measuring time: [WM] section 7.

The study's plan is carried out once more in its first positions with smaller amplitudes, on the
same robot with the same friction and noise; the study's own records serve for the full amplitude.
FRFs of the first blocks of these records are fitted from the same starts, all else as in the study.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from estimators.fitting.multistart import multistart
from estimators.frf.estimate_frf import estimate_frf
from estimators.frf.frf_estimate import FrfEstimate
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.prepare import controller_of, imperfections_of
from oed.experiment.run_experiment import SimulatedPlant
from oed.study.parts import MeasuredData
from oed.study.results import FittedStudy
from oed.study.settings.study_file import LocalMinimaChoice
from oed.study.stages.fit import SAME_COST, weights_of
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationWarning, InvalidInput
from robotmodels.common.progress import Progress, tell
from robotmodels.records.records import Records, iterate_records

SEARCHED = ("LLS15U", "NLS15O")
"""Estimators of the study, here in fewer positions."""


@dataclass(frozen=True)
class MinimaReached:
    """What searches of one estimator came to.

    Attributes
    ----------
    reached : float
        Part of the starts that ended in the best minimum.
    error : float
        Median |ln(estimate/truth)| of the best model's springs that have a true value.
    """

    reached: float
    error: float


@dataclass(frozen=True)
class Excitation:
    """Excitation of an experiment, and the minima that fits to its data reached.

    Attributes
    ----------
    amplitude : float
        Amplitude, over the study's.
    blocks : int
        Blocks per position.
    seconds : float, s
        Measured time, transients left out.
    deviation : float
        Median relative standard deviation of the FRFs.
    searches : tuple of MinimaReached
        Those of `SEARCHED`.
    """

    amplitude: float
    blocks: int
    seconds: float
    deviation: float
    searches: tuple[MinimaReached, ...]


@dataclass(frozen=True)
class LocalMinima:
    """All amplitudes and numbers of blocks.

    Attributes
    ----------
    positions, starts : int
        Numbers of them.
    excitations : tuple of Excitation
        By falling amplitude, then by number of blocks.
    """

    positions: int
    starts: int
    excitations: tuple[Excitation, ...]


def local_minima(
    run: Run,
    choice: LocalMinimaChoice,
    results: FittedStudy,
    progress: Progress | None = None,
) -> LocalMinima:
    """Measure and fit with every amplitude and number of blocks; `progress` counts the fits.

    Raises
    ------
    InvalidInput
        If the study simulated no experiment.
    """
    starts = results.fits.starts[: choice.starts]
    amplitudes = sorted(choice.amplitudes, reverse=True)
    excitations: list[Excitation] = []
    for amplitude in amplitudes:
        records = list(_measured(run, choice.positions, amplitude, results))
        for blocks in sorted(choice.blocks):
            excitations.append(_fitted(run, records, amplitude, blocks, starts, results.truth))
            tell(progress, len(excitations), len(amplitudes) * len(choice.blocks))
    return LocalMinima(len(records), len(starts), tuple(excitations))


def _measured(
    run: Run, positions: int, amplitude: float, results: FittedStudy
) -> Iterator[Records]:
    """Yield the records of the first positions at a part of the plan's amplitude."""
    settings, data = run.study.data.experiment, results.data
    if settings is None or isinstance(data, MeasuredData) or data.experiment is None:
        raise InvalidInput("local_minima: only an experiment that is simulated can be repeated")
    if amplitude == 1:
        yield from islice(iterate_records(data.experiment.records), positions)
        return
    plan = ExperimentPlan.load(data.experiment.records.with_name("plan.yaml")).rescaled(
        np.asarray(amplitude)
    )
    plant = SimulatedPlant(
        data.plant,
        controller_of(settings, run.robot),
        imperfections_of(settings, run.robot),
        run.rng("local minima"),
        run.executor,
    )
    for visit in range(min(positions, len(plan.visited))):
        yield plant.measure(plan, visit)


def first_blocks(records: Records, blocks: int) -> Records:
    """Return the records of the first blocks alone."""
    names = ("reference", "torque", "angle", "saturated")
    return replace(records, **{name: getattr(records, name)[:, :blocks] for name in names})


def _fitted(
    run: Run,
    records: list[Records],
    amplitude: float,
    blocks: int,
    starts: Array,
    truth: Array,
) -> Excitation:
    parts = [first_blocks(one, blocks) for one in records]
    data = run.study.data
    with warnings.catch_warnings():  # that friction rules small amplitudes is what is shown here
        warnings.simplefilter("ignore", IdentificationWarning)
        estimate = estimate_frf(
            parts, data.method, structure="diagonal", hold=data.hold, delay=data.delay
        )
    if data.hold:
        estimate = estimate.without_images(run.robot, parts[0], data.delay)
    periods = sum(int(np.prod(one.angle.shape[:5])) for one in parts)
    return Excitation(
        amplitude,
        blocks,
        periods * parts[0].sample_time,
        float(np.median(np.sqrt(estimate.variance) / np.abs(estimate.response))),
        tuple(_searched(run, name, estimate, starts, truth) for name in SEARCHED),
    )


def _searched(
    run: Run, name: str, estimate: FrfEstimate, starts: Array, truth: Array
) -> MinimaReached:
    (kind,) = (one for one in run.study.estimators if one.name == name)
    weights = weights_of(kind, estimate, run.study.fit)
    fits = multistart(run.robot, estimate, starts, kind.residual, weights, executor=run.executor)
    costs = np.array([one.cost for one in fits])
    springs = [end.endswith(".stiffness") for end in run.robot.parameters.names]
    error = np.abs(np.log(fits[0].parameters.values / truth))[springs]
    reached = costs <= fits[0].cost * (1 + SAME_COST)
    return MinimaReached(float(reached.mean()), float(np.nanmedian(error)))
