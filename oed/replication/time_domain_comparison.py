"""The same records fitted in time, by mujoco.sysid, and as FRFs: [WM] section 7 asks which does.

The case is small enough for rollouts: a Manutec r3 without gravity (its static deflection would
be a second unknown of every rollout), three gear springs and dampers, one position, six runs of
1.5 s at 1 kHz in closed loop with encoder noise. Both ways start from the same parameters and
search within 10^+-1.5 of the truth.
"""

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from oed.study.settings.study_file import RivalChoice
from robotmodels.common.arrays import Array
from robotmodels.common.progress import Progress

if TYPE_CHECKING:
    from oed.replication.rollout_fit import RolloutCase
    from robotmodels import ElasticRobot
    from robotmodels.records.records import Records


REACH = 1.5
"""Decades about the truth between which parameters are sought."""
CLOSE = 0.05
"""A start succeeds if every spring ends nearer than this to the truth, in ln."""
ROLLOUTS = 400
"""Rollouts of all runs after which the rival's search from one start is stopped."""
_SAMPLE_TIME, _SAMPLES, _PERIODS = 1e-3, 500, 3
_LINES = np.arange(1, 32, 2)
_POSITION = np.array([[0.3, 0.4, 0.5, 0.2, 0.6, 0.1]])
_ANGLE_NOISE = 1e-5


@dataclass(frozen=True)
class MethodResult:
    """What one way of fitting came to from starts at one distance.

    Attributes
    ----------
    name : {"frequency domain", "mujoco.sysid"}
        Name of the way.
    decades : float
        The starts are the truth times 10^U(-decades, decades).
    starts, successes : int
        Number of starts, and of those that end with all springs within 5 %.
    spring_error, damper_error : float
        Median |ln(estimate/truth)| of the successes, of all without any.
    seconds : float
        Seconds of wall time per start, FRFs included; not what is loaded or compiled once.
    unfinished : int
        Number of stopped searches.
    """

    name: Literal["frequency domain", "mujoco.sysid"]
    decades: float
    starts: int
    successes: int
    spring_error: float
    damper_error: float
    seconds: float
    unfinished: int


@dataclass(frozen=True)
class TimeDomainComparison:
    """Both ways beside each other.

    Attributes
    ----------
    ways : tuple of MethodResult
        Ways at each distance, ours and then the rival's.
    missing : str
        Module that mujoco.sysid lacks here, so that it could not run; else nothing.
    misfit : float
        rms of its rollouts at the true parameters minus the records, in stds of the noise.
    limit : int
        Limit of rollouts per start.
    """

    ways: tuple[MethodResult, ...]
    missing: str
    misfit: float
    limit: int


def compare(
    choice: RivalChoice,
    rng: np.random.Generator,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> TimeDomainComparison:
    """Fit the case's records both ways from the same starts.

    Parameters
    ----------
    rng : Generator
        Random generator of the starts.
    executor : Executor, optional
        Runs the rival's fits, which take nearly all of the time.
    progress : Progress, optional
        Told how many of these are done.
    """
    from oed.replication.rollout_fit import misfit, missing

    robot, records = case()
    lacks = missing()
    distances = [
        (decades, _starts(robot, choice.starts, decades, rng)) for decades in choice.decades
    ]
    ways = _ours(robot, records, distances)
    if lacks:
        return TimeDomainComparison(tuple(ways), lacks, float("nan"), ROLLOUTS)
    rollouts = rollouts_of(robot, records)
    theirs = _theirs(robot, rollouts, distances, executor, progress)
    pairs = zip(ways, theirs, strict=True)
    return TimeDomainComparison(
        tuple(way for pair in pairs for way in pair),
        lacks,
        misfit(rollouts, robot.parameters.values),
        ROLLOUTS,
    )


def case() -> "tuple[ElasticRobot, Records]":
    """Return the robot and the records of its runs, from standstill on."""
    from robotmodels import ElasticRobot, load_robot
    from robotmodels.simulation.controller import default_controller
    from robotmodels.simulation.imperfections import Imperfections
    from robotmodels.simulation.simulate import simulate

    loaded = load_robot("manutec_r3")
    file = loaded.file.model_copy(update={"gravity": (0.0, 0.0, 0.0)})
    robot = ElasticRobot(file, loaded.folder)
    rng = np.random.default_rng(0)
    n = len(robot.motor_names)
    turned = np.exp(2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))[:, :, None]
    phases = np.exp(2j * np.pi * rng.random((n, 1, len(_LINES))))
    spectrum = np.zeros((1, n, n, _SAMPLES // 2 + 1), dtype=complex)
    spectrum[0, :, :, _LINES] = np.moveaxis(turned * phases.swapaxes(0, 1), -1, 0) * _SAMPLES / 2
    signals = 0.5 * np.swapaxes(np.fft.irfft(spectrum, n=_SAMPLES), 2, 3)
    (records,) = simulate(
        robot,
        _POSITION,
        signals,
        default_controller(robot, _SAMPLE_TIME),
        lines=_LINES,
        imperfections=Imperfections(friction=0.0, nonlinear_gears=False, angle_noise=_ANGLE_NOISE),
        rng=rng,
        periods=_PERIODS,
        transient=0,
    )
    return robot, records


def rollouts_of(robot: "ElasticRobot", records: "Records") -> "RolloutCase":
    """Return the records as the rival wants them."""
    from oed.replication.rollout_fit import rollout_case

    shape = (-1, _PERIODS * _SAMPLES, len(robot.motor_names))
    return rollout_case(
        robot,
        _POSITION[0],
        records.torque[0, 0].reshape(shape),
        records.angle[0, 0].reshape(shape),
        _SAMPLE_TIME,
        _ANGLE_NOISE,
    )


def _starts(robot: "ElasticRobot", count: int, decades: float, rng: np.random.Generator) -> Array:
    from estimators.fitting.multistart import perturbed_starts

    return perturbed_starts(robot.parameters, count, decades, rng)


def _ours(
    robot: "ElasticRobot", records: "Records", distances: Sequence[tuple[float, Array]]
) -> list[MethodResult]:
    """Fit FRFs from every start; their estimation is shared among all starts."""
    from estimators.fitting.least_squares import fit
    from estimators.fitting.multistart import multistart
    from estimators.frf.estimate_frf import estimate_frf

    bounds = np.outer([10**-REACH, 10**REACH], robot.parameters.values)
    begun = time.perf_counter()
    estimate = estimate_frf(records, covariance="noise", transient=1)
    shared = (time.perf_counter() - begun) / sum(len(starts) for _, starts in distances)
    # Compiling and loading, done once, are no part of a fit.
    fit(robot, estimate, "lls", "user", distances[0][1][0], bounds, max_evaluations=1)
    ways = []
    for decades, starts in distances:
        begun = time.perf_counter()
        fits = multistart(robot, estimate, starts, "lls", "user", bounds)
        seconds = shared + (time.perf_counter() - begun) / len(starts)
        values = np.array([one.parameters.values for one in fits])
        unfinished = sum(not one.converged for one in fits)
        ways.append(judged("frequency domain", robot, decades, values, seconds, unfinished))
    return ways


def _theirs(
    robot: "ElasticRobot",
    rollouts: "RolloutCase",
    distances: Sequence[tuple[float, Array]],
    executor: Executor | None,
    progress: Progress | None,
) -> list[MethodResult]:
    """Fit rollouts from every start."""
    from oed.replication.rollout_fit import fit_rollouts

    fit = partial(fit_rollouts, rollouts, reach=REACH, limit=ROLLOUTS)
    every = np.concatenate([starts for _, starts in distances])
    ran = map(fit, every) if executor is None else executor.map(fit, every)
    fits = []
    for done, one in enumerate(ran, start=1):
        fits.append(one)
        if progress is not None:
            progress(done, len(every))
    ways = []
    for decades, starts in distances:
        group, fits = fits[: len(starts)], fits[len(starts) :]
        values = np.array([one.values for one in group])
        seconds = float(np.mean([one.seconds for one in group]))
        unfinished = sum(not one.ended for one in group)
        ways.append(judged("mujoco.sysid", robot, decades, values, seconds, unfinished))
    return ways


def judged(
    name: Literal["frequency domain", "mujoco.sysid"],
    robot: "ElasticRobot",
    decades: float,
    values: Array,
    seconds: float,
    unfinished: int,
) -> MethodResult:
    """Return how often all springs came near the truth, how near those came, and the time.

    Parameters
    ----------
    values : ndarray, (N, p)
        Where the searches ended.
    """
    error = np.abs(np.log(values / robot.parameters.values))
    springs = np.array([end.endswith("stiffness") for end in robot.parameters.names])
    good = error[:, springs].max(axis=1) < CLOSE
    best = error[good] if good.any() else error
    return MethodResult(
        name,
        decades,
        len(values),
        int(good.sum()),
        float(np.median(best[:, springs])),
        float(np.median(best[:, ~springs])),
        seconds,
        unfinished,
    )
