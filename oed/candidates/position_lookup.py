"""Which candidate is meant by the angles of a position that a person or a file names."""

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput

SAME_POSITION = 1e-6
"""Largest difference of any angle [rad or m]: files and people round."""


def candidate_at(positions: Array, position: Array, name: str, remedy: str) -> int:
    """Return the index of the candidate at a position.

    For positions that come from outside only: what is computed carries the candidate's index.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad or m
        Candidates.
    position : ndarray, (n,), rad or m
        Angles of one of them, to within `SAME_POSITION`.
    name : str
        What messages call the position.
    remedy : str
        What to do where no candidate is there.

    Raises
    ------
    InvalidInput
        Naming the position, if it has another number of angles or is no candidate.
    """
    if position.shape != positions.shape[1:]:
        raise InvalidInput(f"{name}: {position.size} angles; {positions.shape[1]} are needed")
    distances = np.abs(positions - position).max(axis=1)
    closest = int(np.argmin(distances))
    if not distances[closest] <= SAME_POSITION:
        raise InvalidInput(
            f"{name}: {np.round(position, 4).tolist()} is not among the candidates; the nearest is "
            f"candidate {closest}, {np.round(positions[closest], 4).tolist()}, "
            f"{distances[closest]:.3g} away; {remedy}"
        )
    return closest
