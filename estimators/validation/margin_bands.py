"""Margins of a controller over what a fit leaves open: bands, and how often it is unstable."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.sampling.exported_draws import parameter_draws
from estimators.uncertainty.recommended import recommended_uncertainty
from estimators.validation.bands import checked_spread
from robotmodels.common.arrays import Array, IntArray, check_count, real_numbers
from robotmodels.common.errors import NoEquilibrium
from robotmodels.common.progress import Progress, tell
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.response import Elastic
from robotmodels.simulation.linear_feedback import LinearFeedback, Notch, linear_feedback
from robotmodels.simulation.loop_margins import LoopMargins, loop_margins, no_margins, stacked


@dataclass(frozen=True, eq=False)
class MarginBand:
    """Margins at the fit, ends of their intervals over draws, and draws that are unstable.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    nominal : LoopMargins
        At the fitted values.
    lower, upper : LoopMargins
        Ends of the intervals of each margin; unstable draws have none, see `LoopMargins`.
    unstable : ndarray of int, (Q,)
        Draws that are unstable, or with which the robot would fall.
    draws : int
        Number of draws.
    level : float
        Nominal coverage of each interval.
    """

    positions: Array
    nominal: LoopMargins
    lower: LoopMargins
    upper: LoopMargins
    unstable: IntArray
    draws: int
    level: float

    @property
    def probability(self) -> Array:
        """Probability of instability, (Q,)."""
        return np.asarray(self.unstable / self.draws)

    @property
    def probability_bound(self) -> Array:
        """Upper 95 % limit of that probability by the number of draws, (Q,) (Clopper, Pearson)."""
        from scipy.stats import beta

        k, N = self.unstable, self.draws
        return np.asarray(np.where(k == N, 1.0, beta.ppf(0.95, k + 1, np.maximum(N - k, 1))))


def predict_margins(
    source: FittedModel | ElasticRobot,
    controller: Any,
    positions: Array,
    *,
    rng: np.random.Generator,
    draws: int | Array = 100,
    level: float = 0.95,
    progress: Progress | None = None,
) -> MarginBand:
    """Return a fit's prediction of a controller's margins in any positions, with bands.

    Parameters
    ----------
    source : Fit, RunFit or ElasticRobot
        A fit; or a robot whose file has standard deviations.
    controller : Any
        What `robotmodels.linear_feedback` takes.
    positions : ndarray, (Q, n), rad
        Positions.
    rng : Generator
        Source of the draws.
    draws : int or ndarray, (N, p)
        Number of draws from `recommended_uncertainty`, or draws of ln theta such as those of a
        posterior, all of which are used.
    level : float
        Nominal coverage of each interval.
    progress : Progress, optional
        Called with the draws done and their number.

    Raises
    ------
    InvalidInput
        If the controller has another number of motors, or draws do not fit.
    NotIdentifiable
        If the fit leaves a combination of parameters open.
    NoEquilibrium
        If the robot falls at the fitted values.
    """
    model = source if isinstance(source, ElasticRobot) else source.model
    feedback = linear_feedback(controller)
    positions = np.atleast_2d(real_numbers(positions, "positions"))
    theta = np.asarray(source.parameters.values)
    nominal = loop_margins(model, positions, feedback, theta)
    if isinstance(draws, int | np.integer):
        spread = recommended_uncertainty(source)
        draws = parameter_draws(theta, spread.covariance, check_count(draws, "draws", 2), rng)
    drawn = np.asarray(checked_spread(model.parameters.names, draws, level))
    each = []
    for i, x in enumerate(drawn):
        each.append(_margins_or_none(model, positions, feedback, np.exp(x)))
        tell(progress, i + 1, len(drawn))
    values = stacked(each)
    lower, upper = (_quantile(values, q) for q in ((1 - level) / 2, (1 + level) / 2))
    unstable = np.asarray((~values["stable"].astype(bool)).sum(axis=0))
    return MarginBand(positions, nominal, lower, upper, unstable, len(drawn), level)


def _quantile(values: dict[str, Array], level: float) -> LoopMargins:
    """Return quantiles over draws of all margins, not interpolated, as some are infinite."""
    fields: dict[str, Any] = {
        name: np.quantile(value, level, axis=0, method="inverted_cdf")
        for name, value in values.items()
    }
    return LoopMargins(**fields)


def _margins_or_none(
    model: Elastic, positions: Array, feedback: LinearFeedback, theta: Array
) -> LoopMargins:
    """Return margins in positions, none where the robot would fall."""
    each = []
    for position in positions:
        try:
            each.append(loop_margins(model, position[None], feedback, theta))
        except NoEquilibrium:
            each.append(no_margins(len(feedback.D)))
    fields: dict[str, Any] = {k: np.concatenate(v) for k, v in stacked(each).items()}
    return LoopMargins(**fields)


_GAINS = (0.5, 0.7, 1.4, 2.0)
"""Factors of a loop's gain that are tried; more of it damps what the motor moves."""


@dataclass(frozen=True)
class Suggestion:
    """A start value for tuning: a notch filter at the torque of one motor, or another gain there.

    Attributes
    ----------
    motor : int
        Which, from zero.
    notch : Notch or None
        Filter, None where only the gain changes.
    gain : float
        Factor of the loop's gain.
    before, after : float
        Largest |S_ii| of that motor over the positions, without and with it.
    largest_after : float
        Largest singular value of S over the positions with it.
    """

    motor: int
    notch: Notch | None
    gain: float
    before: float
    after: float
    largest_after: float


def suggestions(
    model: Elastic,
    controller: Any,
    positions: Array,
    parameters: Array | None = None,
    *,
    acceptable: float = 2.0,
) -> tuple[Suggestion, ...]:
    """Return for each motor what lowers its worst peak of |S_ii| over positions, as start values.

    Motors whose peak is `acceptable` have none. Notch filters lie at the frequency of the worst
    peak, as deep as 0.1 or 0.3; gains are 0.5 to 2 times what they are: less where a resonance is
    amplified, more where the integral part or the position loop is too fast for the damping that
    the speed loop gives. Only what leaves all positions stable and the other motors' peaks below
    the worst one counts. They are no tuning: each motor is changed alone.

    Raises
    ------
    InvalidInput, NoEquilibrium
        As `robotmodels.loop_margins`.
    """
    feedback = linear_feedback(controller)
    now = loop_margins(model, positions, feedback, parameters)
    worst = now.peak_sensitivity.max(axis=0)
    best: list[Suggestion] = []
    for motor in np.flatnonzero((worst > acceptable) & np.isfinite(worst)):
        at = now.peak_frequency[int(np.argmax(now.peak_sensitivity[:, motor])), motor]
        tried = [
            _tried(model, feedback, positions, parameters, int(motor), notch, gain, worst)
            for notch, gain in _remedies(float(at))
        ]
        remedy = min(tried, key=lambda s: s.after)
        if remedy.after < worst[motor]:
            best.append(remedy)
    return tuple(best)


def _remedies(frequency: float) -> list[tuple[Notch | None, float]]:
    notches = [Notch(frequency, z, p) for z, p in ((0.05, 0.5), (0.15, 0.5), (0.3, 1.0))]
    return [*((notch, 1.0) for notch in notches), *((None, gain) for gain in _GAINS)]


def _tried(
    model: Elastic, feedback: LinearFeedback, positions: Array, parameters: Array | None,
    motor: int, notch: Notch | None, gain: float, worst: Array,
) -> Suggestion:  # fmt: skip
    changed = feedback.filtered(motor, notch, gain)
    margins = loop_margins(model, positions, changed, parameters)
    peaks = margins.peak_sensitivity.max(axis=0)
    spoiled = (np.delete(peaks, motor) > max(worst.max(), 2.0)).any()
    after = np.inf if spoiled else float(peaks[motor])
    largest = float(margins.largest_sensitivity.max())
    return Suggestion(motor, notch, gain, float(worst[motor]), after, largest)
