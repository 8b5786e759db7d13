"""Designs over continua of candidates: columns are added until none could help.

Every position has a convex set of spectra, and the information is linear in them. A design over
some spectra is solved; at its derivative W each position's best spectrum is computed, and so a
bound on every spectrum in every position, as in `oed.design.certificate`.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from oed.criteria.objective import Objective
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.information_sets.candidates import Matrices
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, NotIdentifiable, SolverFailed

_REMEDY = "add positions or lines, or fix or tie some of these parameters"


@dataclass(frozen=True, eq=False)
class Columns:
    """Spectra in some positions.

    Attributes
    ----------
    owners : ndarray of int, (k,)
        Position of each.
    spectra : ndarray, (k, ...)
        Spectra, real or complex.
    matrices : ndarray, (k, p, p) or (k, K, p, p)
        Their information.
    """

    owners: IntArray
    spectra: NDArray[Any]
    matrices: Array

    def joined(self, used: IntArray, more: "Columns") -> "Columns":
        """Return some of the columns and more."""
        return Columns(
            np.concatenate([self.owners[used], more.owners]),
            np.concatenate([self.spectra[used], more.spectra]),
            np.concatenate([self.matrices[used], more.matrices]),
        )


class SpectrumSets(Protocol):
    """The spectra that each position may have."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""

    def flat(self) -> Columns:
        """Return the flat spectrum of every position."""

    def best_columns(self, weight: Array, level: float) -> tuple[float, Columns]:
        """Return a bound on tr(W H) of every spectrum, and some of the largest ones.

        Positions that cannot come above `level` need not be searched.
        """


@dataclass(frozen=True, eq=False)
class GeneratedDesign:
    """The last design, its columns, the one over flat spectra, and the certified gap."""

    columns: Columns
    design: Design
    flat: Design
    gap: float
    rounds: int

    def means(self, positions: int) -> tuple[Array, NDArray[Any]]:
        """Return the shares (Q,) of the positions, and the mean spectrum of each, (Q, ...)."""
        owners, spectra, w = self.columns.owners, self.columns.spectra, self.design.weights
        weights = np.asarray(np.bincount(owners, w, positions), dtype=float)
        means = np.zeros((positions, *spectra.shape[1:]), dtype=spectra.dtype)
        shares = w / np.where(weights > 0, weights, 1.0)[owners]
        np.add.at(means, owners, shares.reshape(-1, *(1,) * (spectra.ndim - 1)) * spectra)
        return weights, means


def generate_columns(
    sets: SpectrumSets,
    objective: Objective,
    prior: Array | None,
    tolerance: float,
    max_rounds: int,
) -> GeneratedDesign:
    """Return the best shares and spectra, certified over all of them.

    Raises
    ------
    InvalidInput
        If `max_rounds` is not positive.
    NotIdentifiable
        Naming the parameters that flat spectra in all positions leave open.
    SolverFailed
        If the gap stays above the tolerance.
    """
    if max_rounds < 1:
        raise InvalidInput(f"max_rounds: {max_rounds!r}; at least 1 is needed")
    columns = sets.flat()
    flat = design = _design(sets.names, columns, objective, prior, tolerance)
    for done in range(1, max_rounds + 1):
        gap, more = _certified(sets, objective, design, prior, tolerance)
        if gap <= tolerance:
            return GeneratedDesign(columns, design, flat, gap, done)
        columns = columns.joined(design.support, more)
        design = _design(
            sets.names, columns, objective, prior, 0.01 * max(tolerance, min(gap, 1.0))
        )
    raise SolverFailed(
        f"optimal spectrum: the certified gap is {gap:.2g} after {max_rounds} rounds, above the "
        f"tolerance {tolerance:.2g}; allow more rounds or a larger tolerance"
    )


def _certified(
    sets: SpectrumSets, objective: Objective, design: Design, prior: Array | None, tolerance: float
) -> tuple[float, Columns]:
    """Return the gap over all spectra, and the best ones."""
    information = design.information
    # Without a unique derivative, as for E, the solver's witness gives the tighter bound.
    unique = objective.smooth and len(objective.groups) == 1
    witness = objective.witness(information) if unique else design.witness
    weight = objective.summed_by_sample(witness, information.shape)
    prior_value = 0.0 if prior is None else float(np.vdot(weight, prior))
    level = float(np.vdot(weight, information)) - prior_value
    largest, columns = sets.best_columns(weight, level * (1 + 0.1 * tolerance))
    bound = np.log(prior_value + largest) - objective.log_polar(witness)
    return float(np.expm1(bound - objective.log_value(information))), columns


def _design(
    names: tuple[str, ...],
    columns: Columns,
    objective: Objective,
    prior: Array | None,
    tolerance: float,
) -> Design:
    """Return the best shares of experiments with these spectra."""
    least = max(tolerance, 1e-8 if len(objective.groups) == 1 else 1e-7)
    least = least if objective.smooth else max(tolerance, 1e-6)
    candidates = Matrices(names, columns.matrices)
    try:
        return optimal_design(candidates, objective, None, prior, least)
    except NotIdentifiable as error:
        raise NotIdentifiable(error.names, _REMEDY, error.combinations) from error
