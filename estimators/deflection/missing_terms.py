"""Tests of residuals for what a robot file or a fit may lack: counterbalance, delay, inertia."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimators.deflection.assumptions import DeflectionAssumptions
from estimators.deflection.axis_deflection import RecordEstimate, deflection
from estimators.deflection.load_balance import balances
from estimators.logs.correlated_regression import Regression

_MATERIAL = 0.15
"""Share of a signal's size from which on a missing term matters. Gears have ripple, and models of
counterbalances are approximate: with enough samples every test would find something."""
_SIGNIFICANT = 0.01


@dataclass(frozen=True)
class MissingTerm:
    """A regressor that was left out, tested in what the fit leaves over.

    Attributes
    ----------
    motor : str
        Name of the motor.
    signal : str
        ``torque`` or ``deflection``: where it was looked for.
    term : str
        What it is.
    p_value : float
        Probability of one as large by chance.
    share : float
        Root mean square of what it explains over that of the signal about its mean.
    remark : str
        Its size, and what would bring it in.
    """

    motor: str
    signal: str
    term: str
    p_value: float
    share: float
    remark: str

    @property
    def matters(self) -> bool:
        """Whether it is neither chance nor small."""
        return self.p_value < _SIGNIFICANT and self.share > _MATERIAL

    @property
    def sentence(self) -> str:
        """What is missing where, in words."""
        return (
            f"{self.motor} lacks {self.term} ({self.share:.0%} of the {self.signal}): {self.remark}"
        )


def missing_terms(here: RecordEstimate, at: DeflectionAssumptions) -> tuple[MissingTerm, ...]:
    """Test torques over angle and acceleration, and deflections over speed where it is left out."""
    return (*_of_torques(here, at), *(() if at.delays else _late_encoders(here, at)))


def _of_torques(here: RecordEstimate, at: DeflectionAssumptions) -> Iterator[MissingTerm]:
    if not here.balances:
        return
    names = here.smooth[0].measured.robot.motor_names
    links = [s.links(d) for s, d in zip(here.smooth, here.delays, strict=True)]
    circles = [[np.stack([np.sin(q), np.cos(q)], axis=1) for q in record[0].T] for record in links]
    inertias = [[a[:, None] for a in record[2].T] for record in links]
    # The payload is as it was estimated: it must not make up for what is missing.
    arguments = here.smooth, here.torques, at, here.payload
    tests = zip(
        balances(*arguments), *(balances(*arguments, x) for x in (circles, inertias)), strict=True
    )
    for before, turned, accelerated in tests:
        name, size = names[before.motor], before.torque
        sine, cosine = turned.regression.coefficients[2:4]
        amplitude, phase = np.hypot(sine, cosine), np.degrees(np.arctan2(cosine, sine))
        p, share = _tested(before.regression, turned.regression, (2, 3), size)
        remark = (
            f"{amplitude:.0f} N m sin(angle {phase:+.0f} deg) more on the gear; is a "
            "counterbalance missing from the robot file, or the mass of a link wrong?"
        )
        yield MissingTerm(name, "torque", "a torque over the angle", p, share, remark)
        p, share = _tested(before.regression, accelerated.regression, (2,), size)
        inertia = accelerated.regression.coefficients[2]
        remark = f"{inertia:.3g} kg m^2 more; is an inertia or the scale of the torque wrong?"
        yield MissingTerm(name, "torque", "a torque over the acceleration", p, share, remark)


def _late_encoders(here: RecordEstimate, at: DeflectionAssumptions) -> Iterator[MissingTerm]:
    pairs = zip(here.smooth, here.delays, strict=True)
    speeds = [smooth.links(delays)[1] for smooth, delays in pairs]
    for before in here.axes:
        j = before.motor
        after = deflection(here, at, j, [speed[:, [j]] for speed in speeds])
        index = 4 if at.eccentric else 2
        p, share = _tested(before.regression, after.regression, (index,), before.deflection)
        delay = -1e3 * after.regression.coefficients[index]
        remark = f"{delay:.3g} ms of delay of the link's encoder; estimate it (delays=True)"
        name = here.smooth[0].measured.robot.motor_names[j]
        yield MissingTerm(name, "deflection", "a deflection over the speed", p, share, remark)


def _tested(
    before: Regression, after: Regression, indices: tuple[int, ...], level: float
) -> tuple[float, float]:
    """Return p value and share of the terms at `indices`."""
    explained = np.sqrt(max(before.rms**2 - after.rms**2, 0.0))
    return after.p_value(indices), float(explained / level) if level else 0.0
