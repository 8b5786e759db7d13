"""A design's prediction against its outcome, and what to measure next."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.identifiability import bounded_inverse, checked_information
from robotmodels.common.arrays import IMPROBABLE, Array, IntArray, read_only
from robotmodels.common.errors import InvalidInput, NotIdentifiable, check_word


@dataclass(frozen=True, eq=False)
class Additions:
    """Gain in precision by each of C candidate measurements.

    Attributes
    ----------
    order : ndarray of int, (C,)
        Candidates, the best first.
    gain : ndarray, (C,)
        Factor by which the mean standard deviation of the parameters to improve falls.
    std : ndarray, (C, p)
        Standard deviations of ln theta afterwards.
    """

    order: IntArray
    gain: Array
    std: Array


def best_additions(
    information: Array,
    candidates: Array,
    names: Sequence[str],
    parameters: Sequence[str] | None = None,
) -> Additions:
    """Rank candidate measurements, positions or sensors, by their gain in precision.

    Parameters
    ----------
    information : ndarray, (p, p)
        Information that there is already; it may be singular.
    candidates : ndarray, (C, p, p)
        Candidates that each more measurement would add.
    names : sequence of str
        p parameters.
    parameters : sequence of str, optional
        Parameters to improve, by the geometric mean of their standard deviations;
        the volume of the joint confidence region of all where None.

    Raises
    ------
    InvalidInput
        If matrices do not fit, or a parameter is unknown.
    """
    matrix = checked_information(information, len(names))
    more = np.asarray(candidates, dtype=float)
    if more.ndim != 3 or more.shape[1:] != matrix.shape or not len(more):
        raise InvalidInput(
            f"candidates: shape {more.shape} given; (C, {len(names)}, {len(names)}) is needed"
        )
    for name in parameters or ():
        check_word("parameters:", name, names)
    after = bounded_inverse(matrix + more)
    std = np.sqrt(np.diagonal(after, axis1=-2, axis2=-1))
    if parameters is None:
        logs = (np.linalg.slogdet(bounded_inverse(matrix))[1] - np.linalg.slogdet(after)[1]) / 2
        gain = np.exp(logs / len(names))
    else:
        columns = [list(names).index(name) for name in parameters]
        before = np.sqrt(np.diag(bounded_inverse(matrix)))
        gain = np.exp(np.mean(np.log(before[columns] / std[:, columns]), axis=1))
    order = np.argsort(-gain, kind="stable")
    return Additions(read_only(order), read_only(gain), read_only(std))


@dataclass(frozen=True, eq=False)
class DesignOutcome:
    """Comparison of an estimated covariance with the predicted one.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    ratio : ndarray, (p,)
        Standard deviations that came out over those predicted.
    directions : ndarray, (p,)
        The same for the directions in which they differ most, smallest first.
    efficiency : float
        (det predicted / det outcome)^(1/p), one if the design predicted it exactly.
    probability : float
        Probability that repeated experiments scatter as little, or as much, as they did if the
        prediction is right, two-sided; not a number where the outcome is no sample.
    """

    names: tuple[str, ...]
    ratio: Array
    directions: Array
    efficiency: float
    probability: float

    @property
    def as_predicted(self) -> bool:
        """Whether the outcome does not contradict the prediction; within 10 % if no sample."""
        if np.isfinite(self.probability):
            return self.probability > IMPROBABLE
        return bool(self.directions[0] >= 0.9 and self.directions[-1] <= 1.1)

    def __str__(self) -> str:
        worst = int(np.argmax(self.ratio))
        return (
            f"{'as' if self.as_predicted else 'NOT as'} predicted: efficiency "
            f"{self.efficiency:.3g}, standard deviations {self.ratio.min():.3g} to "
            f"{self.ratio.max():.3g} times the predicted ones, most for {self.names[worst]}"
        )


def compare_with_design(
    predicted: Uncertainty, outcome: Uncertainty, samples: int | None = None
) -> DesignOutcome:
    """Return how the outcome of an experiment compares with the prediction of its design.

    Parameters
    ----------
    predicted : Uncertainty
        Inverse of the design's information at the parameters it was made for.
    outcome : Uncertainty
        Outcome of the fit, the posterior, or repeated experiments.
    samples : int, optional
        Number of experiments that an outcome's sample covariance was made from. Then (samples - 1)
        tr(predicted^-1 outcome) is chi square with p (samples - 1) degrees.

    Raises
    ------
    InvalidInput
        If the two are about different parameters, or there are fewer than 2 samples.
    NotIdentifiable
        If the predicted covariance is singular.
    """
    if predicted.names != outcome.names:
        raise InvalidInput(
            f"outcome: about {', '.join(outcome.names)}, the prediction about "
            f"{', '.join(predicted.names)}"
        )
    if samples is not None and samples < 2:
        raise InvalidInput(f"samples: {samples}; at least 2 are needed")
    std = predicted.std
    values, vectors = np.linalg.eigh(predicted.correlation)
    if not values[0] > 0:
        raise NotIdentifiable(predicted.names, "predict from a design of full rank")
    white = (vectors / np.sqrt(values)).T / std
    squares = np.linalg.eigvalsh(white @ outcome.covariance @ white.T)
    probability = float("nan")
    if samples is not None:
        from scipy.stats import chi2

        tail = chi2.cdf((samples - 1) * squares.sum(), len(std) * (samples - 1))
        probability = float(2 * min(tail, 1 - tail))
    squares = np.maximum(squares, 0.0)
    with np.errstate(divide="ignore"):
        efficiency = float(np.exp(-np.mean(np.log(squares))))
    return DesignOutcome(
        names=predicted.names,
        ratio=read_only(outcome.std / std),
        directions=read_only(np.sqrt(squares)),
        efficiency=efficiency,
        probability=probability,
    )
