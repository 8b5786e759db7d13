"""What is checked before a fit, files and the low-level run; and drift from first to last."""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from estimators.fitting.run_fit import RunFit
from oed.campaign.outlook import Outlook
from oed.campaign.settings import CampaignSettings
from oed.campaign.visits import Visit
from oed.experiment.loop_settings import per_motor
from oed.experiment.multisine import Multisine
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

LOW_LEVEL = 0.2
"""Part of the largest amplitude at which the first visit is run."""

_HOPELESS = 100.0
"""Times the minutes left that targets may need by the guesses, which are not so far off."""

_EXCESS = 1.5
"""At full amplitude so many times a limit may be exceeded: peaks of full runs are planned anew."""


def check_unchanged(visit: Visit, robot_digest: str, grid: Multisine) -> None:
    """Refuse a campaign whose robot or lines are not those that a visit was planned with.

    Raises
    ------
    InvalidInput
        Naming the file and key that were changed.
    """
    sine = visit.plan.multisine
    if visit.robot_digest != robot_digest:
        what = "its robot file was changed"
    elif not np.isclose(sine.period, grid.period, rtol=1e-9, atol=0):
        what = f"multisine.period is {grid.period:g} s, it was {sine.period:g} s"
    elif not np.isclose(sine.sample_time, grid.sample_time, rtol=1e-9, atol=0):
        what = f"multisine.sample_time is {grid.sample_time:g} s, it was {sine.sample_time:g} s"
    elif not np.array_equal(sine.lines, grid.lines):
        what = "multisine or seed give other lines than before"
    else:
        return
    raise InvalidInput(
        f"campaign: {what} after visit {visit.number} was planned; restore it, or give the "
        "campaign another output"
    )


def check_low_level(visit: Visit, settings: CampaignSettings, friction: Array) -> None:
    """Refuse to go on after a low-level run that would break limits at full amplitude.

    Parameters
    ----------
    friction : ndarray, (n,), N m
        Coulomb friction of the motors, which does not grow with the amplitude.

    Raises
    ------
    InvalidInput
        Naming the motor whose torque or speed would, or met its limit.
    """
    records, motors = visit.records, visit.plan.motors
    who = f"visit {visit.number}, at {100 * LOW_LEVEL:.0f} % of the amplitude"
    again = f"to run it again, remove {visit.records_file} and tell that it failed"
    if records.saturated.any():
        motor = motors[int(records.saturated.any(axis=(0, 1, 2, 3)).argmax())]
        raise InvalidInput(
            f"{who}: the torque of motor {motor!r} met its limit; see what holds it, or lower "
            f"the limits; {again}"
        )
    levels, swings = recorded_peaks(records, len(motors))
    units = {"torque": "N m", "speed": "rad/s"}
    for (name, unit), level, swing in zip(units.items(), levels, swings, strict=True):
        choice = getattr(settings.limits, name)
        if choice is None:
            continue
        limit = per_motor(f"limits.{name}", choice, motors)
        same = np.minimum(friction, swing) if name == "torque" else 0.0
        full = np.abs(level) + same + (swing - same) / LOW_LEVEL
        if (full > _EXCESS * limit).any():
            i = int((full / limit).argmax())
            raise InvalidInput(
                f"{who}: {name} of motor {motors[i]!r} swings by {swing[i]:.4g} {unit}, which at "
                f"full amplitude is {full[i]:.4g}, far beyond its limit {limit[i]:.4g}; correct "
                f"the robot file or the controller's gains, or lower the limit; {again}"
            )


def check_hope(outlook: Outlook | None) -> None:
    """Refuse to begin where guesses would have to be absurdly wrong for targets to be reached.

    Raises
    ------
    InvalidInput
        Naming the minutes that are needed and those that remain.
    """
    if outlook is not None and outlook.needed > _HOPELESS * outlook.remaining:
        raise InvalidInput(
            "targets: by the guesses and the noise of the low-level run they need "
            f"{outlook.needed:.1g} min at least, {outlook.remaining:.3g} are left; give limits "
            "more room, or relax the targets"
        )


def recorded_peaks(records: Records, motors: int) -> tuple[Array, Array]:
    """Return levels and largest deviations of the motors' torques and speeds, (2, n) each.

    Torques in N m about their mean, speeds in rad/s about rest: of motion up to the highest line,
    as differences of samples would show the noise of encoders.
    """
    torque = records.torque[0].reshape(-1, motors)
    level = torque.mean(axis=0)
    spectrum = np.fft.rfft(records.angle[0, ..., :motors], axis=3)
    lines = np.arange(spectrum.shape[3])
    omega = 2 * np.pi * lines / (records.samples * records.sample_time)
    spectrum = spectrum * np.where(lines <= records.lines[-1], 1j * omega, 0.0)[:, None]
    speed = np.fft.irfft(spectrum, records.samples, axis=3)
    fastest = np.abs(speed).max(axis=(0, 1, 2, 3))
    swings = np.stack([np.abs(torque - level).max(axis=0), fastest])
    return np.stack([level, np.zeros(motors)]), swings


def drift(fit: RunFit, first: int, last: int) -> float:
    """Return the probability of two visits as different as these if nothing drifts.

    Both have the same plan. The gradients of their costs by ln theta at the fit of all records
    differ by noise alone if the robot stays as it is; their difference over its covariance has a
    chi-square law with as many degrees of freedom as directions that the visits show.

    Parameters
    ----------
    fit : RunFit
        Of the records of all visits.
    first, last : int
        Indices of both positions in its data.
    """
    gradients, scatter = [], []
    for index in (first, last):
        problem = replace(fit.problem, data=fit.data.subset(np.array([index])))
        linear = problem.linearise(fit.parameters.values)
        slopes = linear.jacobian.reshape(-1, linear.jacobian.shape[-1])
        gradients.append(2 * (np.conj(slopes).T @ linear.residuals.ravel()).real)
        scatter.append(problem.sandwich_parts(fit.parameters.values)[1])
    total = scatter[0] + scatter[1]
    scale = 1 / np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(scale[:, None] * total * scale)
    shown = values > 1e-9 * values[-1]
    along = vectors.T[shown] @ (scale * (gradients[1] - gradients[0]))
    return float(chi2.sf(np.sum(along**2 / values[shown]), int(shown.sum())))
