"""Joints that follow others: coordinates q = T r + c of independent ones r.

Virtual work gives T^T M T, T^T g and T^T (dg/dq) T for the mass matrix, gravity and its slope, T
being constant.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.description.joint_drives import Coupling


@dataclass(frozen=True, eq=False)
class CoordinateMap:
    """A linear map from independent coordinates to those of all joints.

    Attributes
    ----------
    matrix : ndarray, (D, d)
        T.
    offset : ndarray, (D,), rad or m
        c.
    """

    matrix: Array
    offset: Array

    def joints(self, coordinates: Array) -> Array:
        """Return q, (Q, D), of `coordinates` r, (Q, d)."""
        return np.asarray(coordinates @ self.matrix.T + self.offset)

    def congruent(self, matrices: Array) -> Array:
        """Return T^T A T, (..., d, d), of `matrices` A (..., D, D)."""
        return np.asarray(self.matrix.T @ matrices @ self.matrix)


def coordinate_map(
    names: Sequence[str], couplings: Mapping[str, Coupling]
) -> tuple[dict[str, int], CoordinateMap | None]:
    """Return the index of each independent joint, and the map; None where none follows.

    Parameters
    ----------
    names : sequence of str
        Names of all D joints, in the order of their coordinates.
    couplings : mapping of str to Coupling
        What joints among them follow, each an independent one.
    """
    independent = {n: i for i, n in enumerate(n for n in names if n not in couplings)}
    if len(independent) == len(names):
        return independent, None
    matrix, offset = np.zeros((len(names), len(independent))), np.zeros(len(names))
    for row, name in enumerate(names):
        coupling = couplings.get(name, Coupling(name, 1.0, 0.0))
        matrix[row, independent[coupling.leader]] = coupling.multiplier
        offset[row] = coupling.offset
    return independent, CoordinateMap(matrix, offset)
