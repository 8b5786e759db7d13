"""From records to FRFs with the statistics of their errors."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import robotmodels
from estimators.frf.averaging import find_method
from estimators.frf.distortion import Distortion, distortion
from estimators.frf.estimate_frf import estimate_frf
from estimators.frf.excitation import LOCAL, Excitation, excitation
from estimators.frf.file_formats import read_records
from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.local_rational_model import local_frf, window_width
from estimators.frf.method_comparison import MethodComparison, compare_methods, measured_loop
from estimators.frf.repeated_visits import merge_distortion, merge_visits, visits_of
from estimators.frf.rigid_body_check import check_rigid_limit
from estimators.frf.torque_loop import TorqueLoop, check_torque_loop, torque_loop
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import IdentificationWarning, InvalidInput, naming
from robotmodels.common.progress import StageProgress
from robotmodels.records.records import Records, iterate_records

if TYPE_CHECKING:
    from robotmodels import ElasticRobot

_LOCAL_MODEL: dict[str, Any] = {"order": 2, "denominator": 2}
"""Follows a resonance that is narrow against the window of lines."""


@dataclass(frozen=True, eq=False)
class MeasuredFrf:
    """FRFs estimated from records.

    Attributes
    ----------
    first : Records
        Records of the first visit; the others have its shape.
    visits : tuple of ndarray of int
        For each position the visits to it, as they are numbered in the records from 0.
    missing : int
        Runs that the records of all positions lack.
    method : str
        Method of the estimate.
    covariance : str
        Covariance of the estimate; that of the method "local" is "local", from residuals.
    delay : float, s
        Delay that the estimate was corrected for.
    estimate : FrfEstimate
        FRFs with their covariance.
    distortion : Distortion or None
        Noise and distortion, separated; None where there is one measured period only, or where the
        method is local.
    excitation : Excitation
        Rank and conditioning of the torques at the lines of the estimate.
    left_out : ndarray, (L,), rad/s
        Excited lines of the band that are not estimated.
    robot : ElasticRobot or None
        Robot whose linear model goes with them, or None.
    modelled : ndarray of complex or None, (Q, F, n, n)
        FRFs of that model, or None.
    comparison : MethodComparison or None
        Comparison of the methods on the loop of the first position, or None.
    torque_loop : TorqueLoop or None
        Loop between commanded and measured torques; None where records do not hold both.
    warnings : tuple of str
        Warnings on the data, each of them once.
    """

    first: Records
    visits: tuple[IntArray, ...]
    missing: int
    method: str
    covariance: str
    delay: float
    estimate: FrfEstimate
    distortion: Distortion | None
    excitation: Excitation
    left_out: Array
    robot: "ElasticRobot | None"
    modelled: ComplexArray | None
    comparison: MethodComparison | None
    torque_loop: TorqueLoop | None
    warnings: tuple[str, ...]

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motors, numbers without a robot."""
        if self.robot is not None:
            return tuple(self.robot.motor_names)
        return tuple(f"motor {i + 1}" for i in range(self.estimate.response.shape[3]))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs; without a robot those of the motors, then numbered sensors."""
        if self.robot is not None:
            return tuple(self.robot.output_names)
        m = self.estimate.response.shape[2]
        return (*self.motors, *(f"sensor {i + 1}" for i in range(m)))[:m]


def measured_frf(
    path: Path,
    method: str = "ari",
    *,
    covariance: str = "total",
    structure: str = "full",
    local: bool | None = None,
    delay: float = 0.0,
    hold: bool = True,
    band: tuple[float, float] | None = None,
    robot: str | None = None,
    compare: bool = False,
    runs: int = 200,
    progress: StageProgress | None = None,
) -> MeasuredFrf:
    """Read records and estimate their FRFs, one per position: visits to it are averaged.

    Parameters
    ----------
    path : Path
        Records as HDF5, MATLAB or CSV file.
    method : str
        As in `estimators.estimate_frf`.
    covariance : str
        As in `estimators.estimate_frf`.
    structure : str
        As in `estimators.estimate_frf`.
    delay : float
        As in `estimators.estimate_frf`.
    hold : bool
        As in `estimators.estimate_frf`.
    local : bool
        Whether neighbouring lines stand in for runs, see `estimators.local_frf`; this takes the
        place of method and covariance, and serves where there are fewer runs than motors. By
        default it does there.
    band : tuple of float, optional
        Lowest and highest frequency of the estimate [rad/s]; all excited lines by default. Lines
        whose torques do not tell all motors apart are left out with a warning.
    robot : str, optional
        Name or file of the robot that was measured.
    compare : bool
        Whether to compare the methods on the loop of the first position, by simulation.
    runs : int
        Simulated campaigns of the comparison; their seed is fixed.

    Raises
    ------
    InvalidInput
        If a file cannot be used, or the robot is another one, or the records lack what the
        covariance or the comparison needs.
    """
    find_method(method)
    if not np.isfinite(delay):
        raise InvalidInput(f"delay: {delay!r} s is not a time")
    elastic = None if robot is None else robotmodels.load_robot(robot)
    report = _silent if progress is None else progress
    with collected_warnings() as messages:
        source = _source(path, elastic)
        if source.needs_local if local is None else local:
            method = covariance = LOCAL
        usable, left_out = _usable(source, method, band, insist=bool(local))
        signals: dict[str, Any] = {"delay": delay, "hold": hold, "lines": usable.lines}
        with _stage(report, "FRFs"):
            visits = _visits(source, elastic, method, covariance, structure, signals)
            estimate, missing = merge_visits(visits), source.missing
        with _stage(report, "distortion"):
            levels = _distortion(source, method, signals)
        modelled = None if elastic is None else _modelled(estimate, elastic, path)
        ranking = _comparison(source.first, runs, signals, report) if compare else None
    return MeasuredFrf(
        source.first,
        tuple(visits_of(visits.positions)),
        missing,
        method,
        covariance,
        delay,
        estimate,
        levels,
        usable,
        left_out,
        elastic,
        modelled,
        ranking,
        None if source.first.commanded else torque_loop(source, lines=usable.lines),
        tuple(messages),
    )


@contextmanager
def _stage(report: StageProgress, name: str) -> Iterator[None]:
    report(name, 0, 0)
    yield
    report(name, 1, 1)


def _usable(
    source: "_Source", method: str, band: tuple[float, float] | None, insist: bool
) -> tuple[Excitation, Array]:
    """Return what torques tell at the lines to be estimated, and the lines left out, warned of.

    Raises
    ------
    InvalidInput
        If no line is left, or a local model would not be local, unless that is to `insist` on.
    """
    model = _LOCAL_MODEL if method == LOCAL else {}
    everything = excitation(source, method, band=band, **model)
    usable, words = everything.at_usable_lines(), everything.left_out(source.first)
    if not len(usable.lines):
        raise InvalidInput(
            f"{source.path}: {'; '.join(words)}; excite the motors independently of each other, or "
            "fit the runs themselves (oed identify)"
        )
    if method == LOCAL and not insist:
        _check_local(source, len(usable.lines))
    for message in words:
        warnings.warn(message, IdentificationWarning, stacklevel=1)
    return usable, np.setdiff1d(everything.omega, usable.omega)


def _check_local(source: "_Source", lines: int) -> None:
    """Refuse windows of more than half of all lines: resonances would not be followed.

    Raises
    ------
    InvalidInput
        Saying what to do.
    """
    blocks, runs, *_, n = source.first.torque.shape[1:]
    width = window_width(None, (lines, n, blocks * runs), **_LOCAL_MODEL, who=str(source.path))
    if 2 * width > lines:
        raise InvalidInput(
            f"{source.path}: {runs} of {n} runs a block, and a local model would span "
            f"{width} of {lines} lines; fit the runs themselves (oed identify), measure more runs "
            "or lines, or force it (oed frf --local)"
        )


def _visits(
    source: "_Source",
    robot: "ElasticRobot | None",
    method: str,
    covariance: str,
    structure: str,
    signals: dict[str, Any],
) -> FrfEstimate:
    """Estimate the FRFs of every visit; those of a robot have no images of held torques."""
    if method == LOCAL:
        visits = local_frf(source, structure=structure, **_LOCAL_MODEL, **signals)
    else:
        signals = {"covariance": covariance, "structure": structure, **signals}
        visits = estimate_frf(source, method, **signals)
    if robot is None or not signals["hold"]:
        return visits
    return visits.without_images(robot, source.first, signals["delay"])


def _distortion(source: "_Source", method: str, signals: dict[str, Any]) -> Distortion | None:
    """Return noise and distortion; None, with a warning why, where they cannot be separated."""
    if method != LOCAL and source.first.torque.shape[3] > 1:
        return merge_distortion(distortion(source, method, **signals))
    why = "the local method" if method == LOCAL else "one measured period"
    message = f"{why}: noise and distortion cannot be distinguished"
    warnings.warn(message, IdentificationWarning, stacklevel=1)
    return None


def _comparison(
    records: Records, runs: int, signals: dict[str, Any], report: StageProgress
) -> MethodComparison:
    """Compare the methods on the loop of the records' first position."""
    with _stage(report, "comparison"):
        loop = measured_loop(records, 0, **signals)
        return compare_methods(loop, runs, rng=np.random.default_rng(0))


def _modelled(estimate: FrfEstimate, robot: "ElasticRobot", path: Path) -> ComplexArray:
    """Return the FRFs of the robot's linear model where others were measured."""
    modelled = np.asarray(robotmodels.frequency_response(robot, estimate.positions, estimate.omega))
    if modelled.shape != estimate.response.shape:
        raise InvalidInput(
            f"{path}: FRFs of shape {estimate.response.shape[2:]}, those of the robot "
            f"{robot.name!r} are {modelled.shape[2:]}"
        )
    check_rigid_limit(estimate, robot)
    return modelled


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Give a list of the warnings about the data, each once; others go where they would."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", IdentificationWarning)
        yield messages
    for warning in caught:
        if not issubclass(warning.category, IdentificationWarning):
            warnings.warn_explicit(
                warning.message, warning.category, warning.filename, warning.lineno
            )
        elif str(warning.message) not in messages:
            messages.append(str(warning.message))


def recorded_seconds(path: Path) -> float:
    """Return how long the measured periods of all runs in a file of records are [s].

    Raises
    ------
    InvalidInput
        If the file cannot be read.
    """
    source = _Source(path)
    runs = sum(part.missing.size - int(part.missing.sum()) for part in source)
    periods, samples = source.first.torque.shape[3:5]
    return float(runs * periods * samples * source.first.sample_time)


class _Source:
    """Records that can be read again and again; HDF5 files one position at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lazy = path.suffix.lower() in (".h5", ".hdf5")
        self.read: list[Records] = [] if self.lazy else [read_records(path)]
        self.missing = 0
        self.first = next(iterate_records(path)) if self.lazy else self.read[0].at(0)

    @property
    def needs_local(self) -> bool:
        """Whether a block has fewer runs than there are motors."""
        return bool(self.first.torque.shape[2] < self.first.torque.shape[-1])

    def __iter__(self) -> Iterator[Records]:
        """Yield records and count the runs that are missing."""
        self.missing = 0
        for part in iterate_records(self.path) if self.lazy else self.read:
            self.missing += int(part.missing.sum())
            yield part


def _source(path: Path, robot: "ElasticRobot | None") -> _Source:
    """Open records, which must be of `robot` unless it is None."""
    source = _Source(path)
    n = source.first.positions.shape[1]
    if robot is not None and n != len(robot.motor_names):
        motors = ", ".join(robot.motor_names)
        raise InvalidInput(
            f"{path}: {n} motors; the robot {robot.name!r} has {len(robot.motor_names)}: {motors}"
        )
    if robot is not None:
        with naming(path):
            check_torque_loop(robot, source.first)
    return source


def _silent(stage: str, done: int, total: int) -> None:
    """Report to nobody."""
