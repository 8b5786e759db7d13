"""The same records fitted as FRFs and in time, in two ways: [WM] section 7 asks which does.

The case is small enough for rollouts: a Manutec r3 without gravity (its static deflection would be
a second unknown of every rollout), three gear springs and dampers, one position, six runs of 1.5 s
at 1 kHz in closed loop with encoder noise. In time: by one-step predictions with a noise model, see
`prediction_error_fit`, and by rollouts of mujoco.sysid. All start from the same parameters and
search within 10^+-1.5 of the truth.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Literal

import numpy as np

from oed.replication.prediction_error_fit import fit_prediction_errors
from oed.study.settings.study_file import TimeDomainChoice
from robotmodels.common.arrays import Array
from robotmodels.common.progress import Progress, tell

if TYPE_CHECKING:
    from oed.replication.rollout_fit import RolloutCase, RolloutFit
    from robotmodels import ElasticRobot
    from robotmodels.records.records import Records


REACH = 1.5
"""Decades about the truth between which parameters are sought."""
CLOSE = 0.05
"""A start succeeds if every spring ends nearer than this to the truth, in ln."""
ROLLOUTS = 400
"""Rollouts, or predictions, of all runs after which a search from one start is stopped."""
_SAMPLE_TIME, _SAMPLES, _PERIODS = 1e-3, 500, 3
_LINES = np.arange(1, 32, 2)
_POSITION = np.array([[0.3, 0.4, 0.5, 0.2, 0.6, 0.1]])
_ANGLE_NOISE = 1e-5


MethodName = Literal["frequency domain", "prediction error", "mujoco.sysid"]


def method_names() -> tuple[MethodName, ...]:
    """Return the methods that can run here."""
    from oed.replication.rollout_fit import missing

    methods: tuple[MethodName, ...] = ("frequency domain", "prediction error", "mujoco.sysid")
    return methods[:-1] if missing() else methods


@dataclass(frozen=True)
class MethodResult:
    """What one way of fitting came to from starts at one distance.

    Attributes
    ----------
    name : {"frequency domain", "prediction error", "mujoco.sysid"}
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

    name: MethodName
    decades: float
    starts: int
    successes: int
    spring_error: float
    damper_error: float
    seconds: float
    unfinished: int


@dataclass(frozen=True)
class TimeDomainComparison:
    """All ways beside each other.

    Attributes
    ----------
    ways : tuple of MethodResult
        Ways at each distance: of FRFs, by predictions, by rollouts.
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
    choice: TimeDomainChoice,
    rng: np.random.Generator,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> TimeDomainComparison:
    """Fit the case's records in all ways from the same starts.

    Parameters
    ----------
    rng : Generator
        Random generator of the starts.
    executor : Executor, optional
        Runs the fits in time, which take nearly all of the time.
    progress : Progress, optional
        Told how many of these are done.
    """
    from oed.replication.rollout_fit import fit_rollouts, misfit, missing

    robot, records = case()
    lacks = missing()
    distances = [
        (decades, _starts(robot, choice.starts, decades, rng)) for decades in choice.decades
    ]
    rollouts = rollouts_of(robot, records)
    predict = partial(fit_prediction_errors, robot, _POSITION[0], rollouts)
    searches: dict[MethodName, Callable[..., RolloutFit]] = {"prediction error": predict}
    if not lacks:
        searches["mujoco.sysid"] = partial(fit_rollouts, rollouts)
    total = len(searches) * choice.starts * len(distances)
    done = count(1)

    def finished() -> None:
        tell(progress, next(done), total)

    ways = [_ours(robot, records, distances)]
    for name, search in searches.items():
        ways.append(_in_time(name, search, robot, distances, executor, finished))
    return TimeDomainComparison(
        tuple(way for group in zip(*ways, strict=True) for way in group),
        lacks,
        float("nan") if lacks else misfit(rollouts, robot.parameters.values),
        ROLLOUTS,
    )


def case() -> "tuple[ElasticRobot, Records]":
    """Return the robot and the records of its runs, from standstill on."""
    robot = small_robot()
    return robot, simulated(robot, 0.5, 1, 0.0, np.random.default_rng(0))


def small_robot() -> "ElasticRobot":
    """Return the robot of the case."""
    from robotmodels import ElasticRobot, load_robot

    loaded = load_robot("manutec_r3")
    file = loaded.file.model_copy(update={"gravity": (0.0, 0.0, 0.0)})
    return ElasticRobot(file, loaded.folder)


def simulated(
    robot: "ElasticRobot", amplitude: float, blocks: int, friction: float, rng: np.random.Generator
) -> "Records":
    """Return records of blocks of orthogonal multisines.

    Parameters
    ----------
    amplitude : float, rad/s
        Of each line of the speed reference, motor shafts.
    friction : float
        Factor of the robot file's Coulomb friction.
    """
    from robotmodels.simulation.controller import default_controller
    from robotmodels.simulation.imperfections import Imperfections
    from robotmodels.simulation.simulate import simulate

    n = len(robot.motor_names)
    turned = np.exp(2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))[..., None]
    phases = np.exp(2j * np.pi * rng.random((blocks, n, 1, len(_LINES))))
    spectrum = np.zeros((blocks, n, n, _SAMPLES // 2 + 1), dtype=complex)
    spectrum[..., _LINES] = turned * phases.swapaxes(1, 2) * _SAMPLES / 2
    signals = amplitude * np.swapaxes(np.fft.irfft(spectrum, n=_SAMPLES), 2, 3)
    (records,) = simulate(
        robot,
        _POSITION,
        signals,
        default_controller(robot, _SAMPLE_TIME),
        lines=_LINES,
        imperfections=Imperfections(
            friction=friction, nonlinear_gears=False, angle_noise=_ANGLE_NOISE
        ),
        rng=rng,
        periods=_PERIODS,
        transient=0,
    )
    return records


def rollouts_of(robot: "ElasticRobot", records: "Records") -> "RolloutCase":
    """Return the records as mujoco.sysid takes them."""
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
    estimate = estimate.without_images(robot, records)
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


def _in_time(
    name: MethodName,
    search: "Callable[..., RolloutFit]",
    robot: "ElasticRobot",
    distances: Sequence[tuple[float, Array]],
    executor: Executor | None,
    finished: Callable[[], None],
) -> list[MethodResult]:
    """Fit records in time from every start."""
    fit = partial(search, reach=REACH, limit=ROLLOUTS)
    every = np.concatenate([starts for _, starts in distances])
    ran = map(fit, every) if executor is None else executor.map(fit, every)
    fits = []
    for one in ran:
        fits.append(one)
        finished()
    ways = []
    for decades, starts in distances:
        group, fits = fits[: len(starts)], fits[len(starts) :]
        values = np.array([one.values for one in group])
        seconds = float(np.mean([one.seconds for one in group]))
        unfinished = sum(not one.ended for one in group)
        ways.append(judged(name, robot, decades, values, seconds, unfinished))
    return ways


def judged(
    name: MethodName,
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
