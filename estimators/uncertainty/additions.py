"""Which more measurements would help most."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.uncertainty.identifiability import bounded_inverse, checked_information
from robotmodels.arrays import Array, IntArray, read_only
from robotmodels.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class Additions:
    """What each of C more measurements would do.

    Attributes
    ----------
    order : ndarray of int, (C,)
        Candidates, the best first.
    gain : ndarray, (C,)
        Factor by which the mean standard deviation of the chosen parameters falls.
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
    """Return which more measurements, positions or sensors, would help most.

    Parameters
    ----------
    information : ndarray, (p, p)
        Information that there is already; it may be singular.
    candidates : ndarray, (C, p, p)
        Candidates that each more measurement would add.
    names : sequence of str
        p parameters.
    parameters : sequence of str, optional
        Those that should become better known, by the geometric mean of their standard deviations;
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
    unknown = [name for name in parameters or () if name not in names]
    if unknown:
        raise InvalidInput(f"parameters: {unknown[0]!r} is none of {', '.join(names)}")
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
