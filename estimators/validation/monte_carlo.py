"""Repeated simulated experiments: whether intervals cover the truth as often as they say."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.sampling.likelihood import Noise
from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.simulated_experiment import INTERVAL_METHODS, Experiment, RunSettings
from robotmodels.common.arrays import Array, BoolArray, IntArray, check_level, read_only
from robotmodels.common.checkpoint_file import CheckpointFile
from robotmodels.common.errors import IdentificationError, InvalidInput, SolverFailed, check_word
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress
from robotmodels.linear.response import Elastic, network_of

Run = dict[str, Array] | str


class RunStore:
    """Results of runs in order, in an HDF5 file that is whole at any time.

    Parameters
    ----------
    path : Path
        Path of the file.
    fingerprint : str
        Fingerprint of the series, so that another one is not continued.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.file = CheckpointFile(path, fingerprint, "runs", "another series of experiments")

    def load(self) -> list[Run]:
        """Return the stored runs: arrays, or the reason why there are none.

        Raises
        ------
        InvalidInput
            If the file holds something else.
        """
        if not self.file.path.exists():
            return []
        with self.file.reading() as file:
            reasons = file["reasons"].asstr()[:]
            arrays = {name: file[name][:] for name in file if name != "reasons"}
        return [
            reason or {name: array[i] for name, array in arrays.items()}
            for i, reason in enumerate(reasons)
        ]

    def save(self, runs: Sequence[Run]) -> None:
        """Write all runs so far.

        Raises
        ------
        InvalidInput
            If the file cannot be written.
        """
        import h5py

        shapes = next((run for run in runs if not isinstance(run, str)), {})
        reasons = [run if isinstance(run, str) else "" for run in runs]
        with self.file.writing() as file:
            file.create_dataset("reasons", data=reasons, dtype=h5py.string_dtype())
            for name, like in shapes.items():
                nothing = np.full(np.shape(like), np.nan)
                rows = [nothing if isinstance(run, str) else run[name] for run in runs]
                file.create_dataset(name, data=np.stack(rows))


# Fewest runs between two writes, and tasks into which a series is parted: the runs of one prepare
# together what does not depend on the data.
CHUNK = 20
TASKS = 32


@dataclass(frozen=True, eq=False)
class MonteCarlo(ReprHtml):
    """Estimates and intervals of N repeated experiments that have an answer.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    truth : ndarray, (p,)
        Truth [SI]; not a number where it is unknown.
    methods : tuple of str
        k, of `INTERVAL_METHODS`.
    level : float
        Nominal coverage of the intervals.
    estimates : ndarray, (N, p)
        Estimates of ln theta.
    stds : ndarray, (N, k, p)
        Standard deviations of ln theta that each method claims.
    intervals : ndarray, (N, k, p, 2)
        Intervals of ln theta.
    costs : ndarray, (N,)
        Costs of the fits.
    failures : tuple of str
        Reasons of the runs without an answer.
    """

    names: tuple[str, ...]
    truth: Array
    methods: tuple[str, ...]
    level: float
    estimates: Array
    stds: Array
    intervals: Array
    costs: Array
    failures: tuple[str, ...]

    def uncertainty(self) -> Uncertainty:
        """Return the estimates' scatter."""
        covariance = np.atleast_2d(np.cov(self.estimates, rowvar=False, ddof=1))
        return Uncertainty(self.names, covariance, "Monte Carlo")

    @property
    def bias(self) -> Array:
        """Mean error of ln theta, (p,)."""
        return np.asarray(self.estimates.mean(axis=0) - np.log(self.truth))

    def covered(self, method: str) -> BoolArray:
        """Return whose interval holds the truth, (N, p)."""
        ends = self.intervals[:, self._index(method)]
        truth = np.log(self.truth)
        return np.asarray((ends[..., 0] <= truth) & (truth <= ends[..., 1]))

    def coverage(self, method: str) -> Array:
        """Return the share of runs whose interval holds the truth, (p,); not a number if unknown.

        Raises
        ------
        InvalidInput
            For a method whose intervals were not computed.
        """
        shares = self.covered(method).mean(axis=0)
        return np.where(np.isfinite(self.truth), shares, np.nan)

    def overall(self, method: str) -> float:
        """Return the coverage over all parameters whose truth is a number."""
        return float(np.nanmean(self.coverage(method)))

    def band(self) -> tuple[float, float]:
        """Return where the coverage of one exact interval lies with 99 % probability, binomial."""
        from scipy.stats import binom

        n = len(self.estimates)
        low, high = (float(binom.ppf(tail, n, self.level)) / n for tail in (0.005, 0.995))
        return low, high

    def covers(self, method: str) -> BoolArray:
        """Return for which parameters, (p,), a method covers at least as often as it should."""
        return np.asarray(self.coverage(method) >= self.band()[0])

    def _index(self, method: str) -> int:
        check_word("Monte Carlo: method", method, self.methods)
        return self.methods.index(method)

    def __str__(self) -> str:
        low, high = self.band()
        lines = [
            f"{len(self.estimates)} experiments, {len(self.failures)} without an answer; "
            f"{100 * self.level:g} % intervals, an exact one would cover {low:.3f} to {high:.3f}"
        ]
        for method in self.methods:
            shares = self.coverage(method)
            worst = int(np.nanargmin(shares))
            lines.append(
                f"  {method:<10} covers {self.overall(method):.3f}, least {shares[worst]:.3f} "
                f"for {self.names[worst]}"
            )
        return "\n".join(lines)


def monte_carlo(
    experiment: Experiment,
    model: Elastic,
    *,
    rng: np.random.Generator,
    runs: int = 500,
    residual: str = "nls",
    weights: str | NDArray[Any] = "optimal",
    truth: Array | None = None,
    methods: Sequence[str] = ("theorem1",),
    level: float = 0.95,
    noise: str = "known",
    store: str | Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> MonteCarlo:
    """Return estimates and intervals of many simulated experiments, each fitted from the truth.

    Parameters
    ----------
    experiment : Experiment
        Makes one estimate: an `FrfExperiment`, or any function of a random generator, such as a
        closed-loop simulation followed by `estimate_frf`. Its model may differ from the one that is
        fitted: that is how model errors are studied.
    model : Elastic
        What is fitted, from its nominal parameters on.
    rng : Generator
        Source of the runs' seeds.
    residual : str
        Residual of the fits, as in `estimators.fit`.
    weights : str or ndarray
        Weights of the fits, as in `estimators.fit`.
    truth : ndarray, (p,), optional
        True values [SI] that intervals should cover; the model's nominal values where None; not a
        number for a parameter without a true value.
    methods : sequence of str
        Methods whose intervals to compute: "recommended" (see `Fit.intervals`), "theorem1",
        "scaled" and "empirical" (see `covariance`), "posterior" (by importance sampling, by emcee
        where its weights fail), "profile".
    level : float
        Level of the intervals.
    noise : str
        Noise of posteriors and profiles, as in `sample_posterior`.
    store : str or Path, optional
        HDF5 file that keeps the runs; an interrupted series goes on from it. It knows an experiment
        by what that gives first.
    executor : Executor, optional
        Takes shares of the runs; in sequence where None.
    progress : Progress, optional
        Called with the runs done and their number.

    Raises
    ------
    InvalidInput
        For too few runs, an unknown method, or the store of another series.
    SolverFailed
        If fewer than two runs have an answer, with the first reason.
    """
    _check(runs, methods, level)

    Noise(noise)  # refuses what does not fit before the first run
    settings = RunSettings(experiment, model, residual, weights, tuple(methods), level, noise)
    seeds = rng.integers(2**63 - 1, size=runs, dtype=np.int64)
    checkpoint = (
        None if store is None else RunStore(Path(store), _fingerprint(settings, int(seeds[0])))
    )
    results = _results(settings, seeds, checkpoint, executor, progress)
    good = [r for r in results if not isinstance(r, str)]
    failures = tuple(r for r in results if isinstance(r, str))
    if len(good) < 2:
        raise SolverFailed(f"Monte Carlo: {len(good)} of {runs} runs have an answer; {failures[0]}")
    arrays = {name: read_only(np.stack([r[name] for r in good])) for name in good[0]}
    values = model.parameters.values if truth is None else np.asarray(truth, dtype=float)
    return MonteCarlo(
        names=model.parameters.names,
        truth=read_only(values),
        methods=tuple(methods),
        level=level,
        failures=failures,
        **arrays,
    )


def _results(
    settings: RunSettings,
    seeds: IntArray,
    checkpoint: RunStore | None,
    executor: Executor | None,
    progress: Progress | None,
) -> list[Run]:
    """Return the result of each run, those of the checkpoint first."""
    results: list[Run] = [] if checkpoint is None else checkpoint.load()[: len(seeds)]
    size = max(1, -(-len(seeds) // TASKS))
    tasks = [seeds[k : k + size].tolist() for k in range(len(results), len(seeds), size)]
    shares = (
        map(settings.several, tasks) if executor is None else executor.map(settings.several, tasks)
    )
    stored = len(results)
    for share in shares:
        results += share
        if checkpoint is not None and (
            len(results) >= stored + CHUNK or len(results) == len(seeds)
        ):
            checkpoint.save(results)
            stored = len(results)
        if progress is not None:
            progress(len(results), len(seeds))
    return results


def _check(runs: int, methods: Sequence[str], level: float) -> None:
    if runs < 2:
        raise InvalidInput(f"runs: {runs}; at least 2 are needed")
    for method in methods:
        check_word("methods:", method, INTERVAL_METHODS)
    check_level(level, "monte_carlo")


def _fingerprint(settings: RunSettings, seed: int) -> str:
    """Return what tells one series from another: its settings, model and first experiment."""
    choices = (settings.residual, settings.weights, settings.methods, settings.level)
    inputs = (choices, settings.noise, seed, settings.model.parameters)
    try:
        first = settings.experiment(np.random.default_rng(seed))
    except IdentificationError as error:
        return fingerprint((inputs, str(error)))
    return fingerprint(inputs, (first, network_of(settings.model, first.positions)))
