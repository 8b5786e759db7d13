"""From records to identified chains: FRFs, modes, masses, springs, couplings, dampers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.chain_dampers.damper_fit import DamperFit, fit_dampers, recommended_estimate
from estimators.chains.chain_estimate import ChainEstimate
from estimators.chains.identification import chains_from_frf
from estimators.chains.identified_chains import ChainIdentification, notes
from estimators.frf.frf_from_records import MeasuredFrf, measured_frf
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.common.progress import StageProgress, tell
from robotmodels.records.records import Records, iterate_records

# Fewer blocks say too little about what differs from block to block.
_FEWEST_BLOCKS = 4
_DISTORTED = 2.0  # variance over blocks over that of noise, in the median
_EXPLAINED = ("noise correlated", "trustworthy")  # verdicts of a model that explains the FRFs
_DIFFERENT = 3.0  # standard deviations between estimates from which on they are said to differ


@dataclass(frozen=True, eq=False)
class MeasuredChains:
    """Chains identified from the records of one position.

    Attributes
    ----------
    frf : MeasuredFrf
        FRFs of all positions, and how they were estimated.
    position : int
        Index of the one that was used.
    identification : ChainIdentification
        The identification.
    dampers : DamperFit or None
        The fit with dampers, or None where it failed.
    warnings : tuple of str
        What a user should know, each said once.
    """

    frf: MeasuredFrf
    position: int
    identification: ChainIdentification
    dampers: DamperFit | None
    warnings: tuple[str, ...]

    @property
    def recommended(self) -> ChainEstimate:
        """The estimate to quote, with its intervals and verdict."""
        return recommended_estimate(self.identification, self.dampers)


def measured_chains(
    path: Path,
    n_masses: int | None = None,
    *,
    position: int = 0,
    delay: float = 0.0,
    hold: bool = True,
    first_masses: Array | None = None,
    progress: StageProgress | None = None,
) -> MeasuredChains:
    """Read records of motor torques and angles and identify chains from them.

    Multisines: as many runs a block as motors. Stepped sines: any number of runs,
    each with some of the lines; a line is then judged by the runs that excite it.

    Parameters
    ----------
    path : Path
        Records as HDF5, MATLAB or CSV file.
    n_masses : int, optional
        N; proposed from the data where None.
    position : int
        Index of the position, from 0.
    delay : float
        As in `estimators.estimate_frf`; a delay is estimated in any case.
    hold : bool
        As in `estimators.estimate_frf`.
    first_masses : ndarray, optional
        Motors' inertias (M,), where known.

    Raises
    ------
    InvalidInput
        If the file cannot be used, or there is no such position; or as
        `estimators.identify_chains`.
    NotIdentifiable
        As `estimators.identify_chains`.
    """
    first = _first(path)
    _check_excitation(first, path)
    method, covariance, local = _method(first)
    frf = measured_frf(
        path, method, covariance=covariance, local=local, delay=delay, hold=hold, progress=progress
    )
    count = len(frf.estimate.positions)
    if not 0 <= position < count:
        raise InvalidInput(f"{path}: position {position + 1}; there are positions 1 to {count}")
    tell(progress, "chains", 0, 0)
    identification = chains_from_frf(
        frf.estimate,
        n_masses,
        position=position,
        first_masses=first_masses,
        distortion=_distortion(frf, position),
        sample_time=first.sample_time if hold else None,
        delay=delay,
    )
    dampers, reason = _dampers(identification)
    best = recommended_estimate(identification, dampers)
    explained = best is not identification.structured and best.verdict in _EXPLAINED
    warnings = (*frf.warnings, *notes(identification, explained=explained), *reason)
    warnings = (*warnings, *_disagreement(identification, dampers))
    tell(progress, "chains", 1, 1)
    return MeasuredChains(frf, position, identification, dampers, warnings)


def _disagreement(
    identification: ChainIdentification, dampers: DamperFit | None
) -> tuple[str, ...]:
    """Say by how much the two models of damping differ, where they differ clearly."""
    if dampers is None:
        return ()
    one, other = recommended_estimate(identification, dampers), identification.structured
    other = dampers.estimate if one is other else other
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = np.nan_to_num(np.abs(one.values - other.values) / one.std, nan=0.0)
    far = np.flatnonzero((distances > _DIFFERENT) & (one.std > 0))
    if not far.size:
        return ()
    k = int(far[np.argmax(distances[far])])
    names = ", ".join(one.names[i] for i in far)
    return (
        f"{names}: {other.method} differs from {one.method}, which is recommended, by up to "
        f"{distances[k]:.2g} standard deviations: how the chains are damped decides",
    )


def _dampers(identification: ChainIdentification) -> tuple[DamperFit | None, tuple[str, ...]]:
    try:
        fitted = fit_dampers(identification)
    except IdentificationError as error:
        return None, (f"dampers could not be fitted: {error}",)
    if not fitted.fit.converged:
        return fitted, (f"the fit of the dampers did not converge: {fitted.fit.message}",)
    negative = np.flatnonzero(fitted.model.friction < -3 * fitted.friction_std)
    if negative.size:
        motors = ", ".join(str(i + 1) for i in negative)
        return fitted, (
            f"with dampers the friction of motor {motors} is negative: there is friction "
            "elsewhere in the chain, which this model does not have",
        )
    return fitted, ()


def _method(first: Records) -> tuple[str, str, bool]:
    """Return how FRFs are best estimated from such records: method, covariance, local."""
    _, blocks, runs, periods, _, motors = first.torque.shape
    if runs < motors or (periods < 2 and blocks < 2):
        return "ari", "noise", True
    covariance = "noise" if periods > 1 else "total"
    if runs == motors:
        return "ari", covariance, False
    return ("jio" if first.reference.any() else "h1"), covariance, False


def _distortion(frf: MeasuredFrf, position: int) -> Array | None:
    """Return standard deviations of a block's FRF by distortion, None where it does not show."""
    d = frf.distortion
    if d is None or d.blocks[position] < _FEWEST_BLOCKS:
        return None
    ratio = float(np.median(d.total[position] / d.noise[position]))
    return d.level[position] if ratio > _DISTORTED else None


def _first(path: Path) -> Records:
    from estimators.frf.file_formats import read_records

    if path.suffix.lower() not in (".h5", ".hdf5"):
        return read_records(path).at(0)
    return next(iterate_records(path))


def _check_excitation(first: Records, path: Path) -> None:
    """Refuse motors that no run moves: their FRFs would be noise over noise."""
    spectrum = np.abs(np.fft.rfft(np.nan_to_num(first.torque[0]), axis=3)[:, :, :, first.lines])
    largest = spectrum.max(axis=(0, 1, 2, 3))
    for motor, level in enumerate(largest):
        if not level > 0:
            raise InvalidInput(
                f"{path}: motor {motor + 1} has no torque at any excited line; excite every motor "
                "in some run of each block"
            )
