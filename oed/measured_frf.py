"""From records to FRFs and all that is known of their errors."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.compare import Comparison, compare_methods, measured_loop
from estimators.distortion import Distortion, distortion
from estimators.exchange import read_records
from estimators.frf_estimate import FrfEstimate
from estimators.frf_methods import find_method
from estimators.nonparametric import estimate_frf
from estimators.rigid_limit import check_rigid_limit
from robotmodels import ElasticRobot, frequency_response, load_robot
from robotmodels.arrays import ComplexArray
from robotmodels.errors import IdentificationWarning, InvalidInput
from robotmodels.records import Records, iterate_records

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, the steps done and the steps in all (0: not known yet)."""


@dataclass(frozen=True, eq=False)
class MeasuredFrf:
    """FRFs estimated from records.

    Attributes
    ----------
    first : records of the first position; the others have its shape.
    missing : experiments that the records of all positions lack.
    method, covariance, delay : how they were estimated; the delay in s.
    estimate : FRFs with their covariance.
    distortion : noise and distortion apart; None where there is one measured period only.
    robot : whose linear model goes with them, or None.
    modelled : (Q, F, n, n) FRFs of that model, or None.
    comparison : of the methods on the loop of the first position, or None.
    warnings : what a user should know of the data, each said once.
    """

    first: Records
    missing: int
    method: str
    covariance: str
    delay: float
    estimate: FrfEstimate
    distortion: Distortion | None
    robot: ElasticRobot | None
    modelled: ComplexArray | None
    comparison: Comparison | None
    warnings: tuple[str, ...]

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motors, numbers where no robot is given."""
        if self.robot is not None:
            return tuple(self.robot.motor_names)
        return tuple(f"motor {i + 1}" for i in range(self.estimate.response.shape[3]))


def measured_frf(
    path: Path,
    method: str = "ari",
    *,
    covariance: str = "total",
    delay: float = 0.0,
    hold: bool = True,
    robot: str | None = None,
    compare: bool = False,
    runs: int = 200,
    progress: Progress | None = None,
) -> MeasuredFrf:
    """Read records and estimate their FRFs.

    Parameters
    ----------
    path : records as HDF5, MATLAB or CSV file.
    method, covariance, delay, hold : as in `estimators.estimate_frf`.
    robot : name or file of the robot that was measured.
    compare : whether to compare the methods on the loop of the first position, by simulation.
    runs : simulated campaigns of the comparison; their seed is fixed.

    Raises
    ------
    InvalidInput : if a file cannot be used, or the robot is another one, or the records lack what
        the covariance or the comparison needs.
    """
    find_method(method)
    if not np.isfinite(delay):
        raise InvalidInput(f"delay: {delay!r} s is not a time")
    elastic = None if robot is None else load_robot(robot)
    with _collected() as said:
        report = _silent if progress is None else progress
        report("FRFs", 0, 0)
        source = _Source(path)
        _check_robot(source.first, elastic, path)
        estimate = estimate_frf(source, method, covariance=covariance, delay=delay, hold=hold)
        missing = source.missing
        report("FRFs", 1, 1)
        apart = None
        if source.first.torque.shape[3] > 1:
            report("distortion", 0, 0)
            apart = distortion(source, method, delay=delay, hold=hold)
            report("distortion", 1, 1)
        else:
            warnings.warn(
                "one measured period: noise and distortion cannot be told apart",
                IdentificationWarning,
                stacklevel=1,
            )
        modelled = None
        if elastic is not None:
            modelled = frequency_response(elastic, estimate.positions, estimate.omega)
            if modelled.shape != estimate.response.shape:
                raise InvalidInput(
                    f"{path}: FRFs of shape {estimate.response.shape[2:]}, those of the robot "
                    f"{elastic.name!r} are {modelled.shape[2:]}"
                )
            check_rigid_limit(estimate, elastic)
        ranking = None
        if compare:
            report("comparison", 0, 0)
            loop = measured_loop(source.first, 0, delay=delay, hold=hold)
            ranking = compare_methods(loop, runs, rng=np.random.default_rng(0))
            report("comparison", 1, 1)
    return MeasuredFrf(
        source.first,
        missing,
        method,
        covariance,
        delay,
        estimate,
        apart,
        elastic,
        modelled,
        ranking,
        tuple(said),
    )


@contextmanager
def _collected() -> Iterator[list[str]]:
    """Give a list of the warnings about the data, each once; others go where they would."""
    said: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", IdentificationWarning)
        yield said
    for warning in caught:
        if not issubclass(warning.category, IdentificationWarning):
            warnings.warn_explicit(
                warning.message, warning.category, warning.filename, warning.lineno
            )
        elif str(warning.message) not in said:
            said.append(str(warning.message))


class _Source:
    """Records that can be read again and again; HDF5 files one position at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lazy = path.suffix.lower() in (".h5", ".hdf5")
        self.read: list[Records] = [] if self.lazy else [read_records(path)]
        self.missing = 0
        found = next(iter(iterate_records(path)), None) if self.lazy else self.read[0].at(0)
        if found is None:
            raise InvalidInput(f"{path}: no records in it; at least one position is needed")
        self.first = found

    def __iter__(self) -> Iterator[Records]:
        """Yield records and count the experiments that are missing."""
        self.missing = 0
        for part in iterate_records(self.path) if self.lazy else self.read:
            self.missing += int(part.missing.sum())
            yield part


def _silent(stage: str, done: int, total: int) -> None:
    """Report to nobody."""


def _check_robot(records: Records, robot: ElasticRobot | None, path: Path) -> None:
    if robot is None:
        return
    n, motors = records.positions.shape[1], tuple(robot.motor_names)
    if n != len(motors):
        raise InvalidInput(
            f"{path}: {n} motors; the robot {robot.name!r} has {len(motors)}: {', '.join(motors)}"
        )
