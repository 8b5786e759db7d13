"""Positions and spectra together: which position to excite at which frequency lines, how strongly.

The information of an experiment is linear in the power of each line, and so are its limits. With
powers P_f of a position's lines between zero and upper limits, and C P <= c for every limit
(mean squares of torques and speeds, total power), the experiments in a position fill a polytope; a
design shares the experiments between corners of these polytopes. The corners are too many to list:
the best one of each position, by the gradient at the present design, is generated when it is
needed, and when none gains more than the design allows, no other spectrum in any position helps.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from oed.criteria.criteria import Criterion, objective_of
from oed.design.certificate import efficiency_bound
from oed.design.column_generation import generate_columns
from oed.design.spectrum_polytope import LineLimit, SpectrumPolytopes
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.printing import ReprHtml


@dataclass(frozen=True, eq=False)
class SpectrumDesign(ReprHtml):
    """Shares of the experiments and the powers of their lines, certified.

    Attributes
    ----------
    weights : ndarray, (Q,)
        Shares of the experiments that sum to one.
    power : ndarray, (Q, F)
        Mean power of each line in an experiment of each position; zero where none is.
    amplitude : ndarray, (Q, F)
        Amplitude of sines with these powers, sqrt(2 power).
    value : float
        As of a `Design`.
    gap : float
        As of a `Design`, over all spectra.
    information : ndarray
        As of a `Design`.
    criterion : str
        As of a `Design`.
    names : tuple of str
        As of a `Design`.
    uniform_efficiency : float
        Uniform efficiency of the best positions with one common flat spectrum scaled to the limits.
    rounds : int
        Sets of spectra solved.
    """

    weights: Array
    power: Array
    value: float
    gap: float
    information: Array
    criterion: str
    names: tuple[str, ...]
    uniform_efficiency: float
    rounds: int

    @property
    def amplitude(self) -> Array:
        """Amplitudes of the lines' sines, (Q, F)."""
        return np.sqrt(2.0 * self.power)

    @property
    def efficiency(self) -> float:
        """Certified lower bound on the efficiency against every spectrum in every position."""
        return efficiency_bound(self.gap)

    def __str__(self) -> str:
        used = np.flatnonzero(self.weights)
        lines = [
            f"{self.criterion}-optimal spectra in {len(used)} of {len(self.weights)} positions, "
            f"certified gap {self.gap:.1e}; flat ones keep {self.uniform_efficiency:.3f}"
        ]
        for q in used:
            count = int((self.power[q] > 0).sum())
            lines.append(f"  position {q}: share {self.weights[q]:.3g}, power in {count} lines")
        return "\n".join(lines)


def optimal_spectrum(
    lines: Array,
    names: tuple[str, ...],
    limits: Mapping[str, LineLimit],
    criterion: str | Criterion = "D",
    line_most: float = np.inf,
    tolerance: float = 1e-5,
    max_rounds: int = 200,
    prior: Array | None = None,
) -> SpectrumDesign:
    """Return positions and powers of the lines that maximise the criterion.

    Parameters
    ----------
    lines : ndarray, (Q, F, p, p)
        Information of each position and line for a unit of power.
    names : tuple of str
        p parameter names.
    limits : mapping of str to LineLimit
        What holds in every experiment, by name; at least one must count every line.
    criterion : str or Criterion
        As in `optimal_design`; one that is not smooth, such as E, takes cvxpy and longer.
    line_most : float
        Largest power of one line.
    tolerance : float
        Largest certified gap accepted.
    max_rounds : int
        Largest number of sets of spectra.
    prior : ndarray, (p, p), optional
        Information of experiments there are already, in units of the shares.

    Raises
    ------
    InvalidInput
        If lines, limits and prior do not fit, a line has no limit, or `max_rounds` is not positive.
    NotIdentifiable
        Naming the parameters, if all lines in all positions leave some open.
    SolverFailed
        If the gap stays above the tolerance.
    """
    polytopes = SpectrumPolytopes.checked(lines, names, limits, line_most)
    objective = objective_of(criterion, names)
    solution = generate_columns(polytopes, objective, prior, tolerance, max_rounds)
    weights, power = solution.means(len(polytopes.lines))
    design = solution.design
    return SpectrumDesign(
        weights=read_only(weights),
        power=read_only(np.real(power)),
        value=design.value,
        gap=solution.gap,
        information=design.information,
        criterion=design.criterion,
        names=polytopes.names,
        uniform_efficiency=objective.efficiency(solution.flat.information, design.information),
        rounds=solution.rounds,
    )
