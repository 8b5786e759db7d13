"""Which motor shakes on which line: the best spectral matrices of every position, certified."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from oed.criteria.criteria import Criterion
from oed.criteria.objective import Objective
from oed.criteria.robust_criteria import robust_objective
from oed.design.certificate import efficiency_bound
from oed.design.column_generation import GeneratedDesign, generate_columns
from oed.design.free_spectra import FreeSpectra
from oed.design.spectral_oracle import SpectralOracle
from oed.information_sets.excitations import UserSpectrum
from oed.information_sets.matrix_checks import candidate_rows
from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    IntArray,
    check_above_zero,
    one_or_each,
    read_only,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.noise import OutputErrors
from robotmodels.linear.response import Elastic, check_omega


@dataclass(frozen=True, eq=False)
class SpectraDesign(ReprHtml):
    """Shares of the time in positions, and the spectra there, certified.

    Attributes
    ----------
    positions : ndarray, (k, n), rad
        Positions that are used.
    support : ndarray of int, (k,)
        Their indices among the candidates.
    weights : ndarray, (k,)
        Shares of the measured time, which sum to one.
    spectra : ndarray of complex, (k, F, n, n), N^2 m^2
        Phi of a run in each position.
    torques : ndarray of complex, (k, F, n), N m
        A single run in each position within the limits: the first eigenvectors of Phi, or its
        diagonal in random phases.
    run_efficiency : float
        Efficiency of these runs against the spectra; their difference is the loss.
    flat_efficiency : float
        Efficiency of flat spectra in their best positions.
    value : float
        As of a `Design`, of one period in all.
    gap : float
        Certified over all spectra in all candidates.
    information : ndarray
        As of a `Design`.
    criterion : str
        Name of what was maximised.
    names : tuple of str
        p parameter names.
    rounds : int
        Sets of spectra that were solved.
    """

    positions: Array
    support: IntArray
    weights: Array
    spectra: ComplexArray
    torques: ComplexArray
    run_efficiency: float
    flat_efficiency: float
    value: float
    gap: float
    information: Array
    criterion: str
    names: tuple[str, ...]
    rounds: int

    @property
    def efficiency(self) -> float:
        """Certified lower bound on the efficiency against every spectrum in every position."""
        return efficiency_bound(self.gap)

    @property
    def excitations(self) -> tuple[UserSpectrum, ...]:
        """The single runs as excitations, for `experiment_candidates` in these positions."""
        return tuple(
            UserSpectrum(u[:, :, None] * u[:, None, :].conj(), 1, f"spectra of position {q}")
            for q, u in zip(self.support, self.torques, strict=True)
        )

    def __str__(self) -> str:
        lines = [
            f"{self.criterion}-optimal spectra in {len(self.support)} positions, certified gap "
            f"{self.gap:.1e}; flat ones keep {self.flat_efficiency:.3f}, single runs "
            f"{self.run_efficiency:.3f}"
        ]
        for q, weight, Phi in zip(self.support, self.weights, self.spectra, strict=True):
            power = np.einsum("fii->fi", Phi).real
            counts = (power > 1e-3 * power.max(axis=0)).sum(axis=0)
            lines.append(
                f"  position {q}: share {weight:.3g}, lines of the motors "
                f"{', '.join(map(str, counts))}"
            )
        return "\n".join(lines)


def optimal_spectra(
    robot: Elastic | Sequence[Elastic],
    positions: Array,
    omega: Array,
    noise: OutputErrors,
    torque: ArrayLike,
    *,
    full: bool = False,
    line_cap: float = 3.0,
    speed: ArrayLike = np.inf,
    swing: ArrayLike = np.inf,
    criterion: str | Criterion = "D",
    prior: Array | None = None,
    kind: str = "average",
    tolerance: float | None = None,
    max_rounds: int = 100,
) -> SpectraDesign:
    """Return positions and spectral matrices that maximise the criterion.

    Spectra designed at guesses and kept lose most of their gain: before a first fit give samples of
    the robot, `robotmodels.WithParameters` of values drawn from the prior, over which the criterion
    is averaged.

    Parameters
    ----------
    robot : Elastic or sequence of Elastic
        The robot, or one for each sample of theta.
    positions : ndarray, (Q, n), rad
        Candidate positions.
    omega : ndarray, (F,), rad/s
        Lines.
    noise : OutputErrors
        Noise of a period, such as `robotmodels.InputOutputNoise`; it needs a floor.
    torque : float or array_like, (n,), N m
        Largest root mean square torque of each motor.
    full : bool
        Whether phases between motors are chosen too; else motors are independent.
    line_cap : float
        Largest power of a line, summed over motors in units of their flat levels, in parts of the
        flat one: without it a few lines are shaken, and the design is not robust.
    speed : float or array_like, (n,), rad/s
        Largest root mean square speed of each motor.
    swing : float or array_like, (n,), rad
        Largest root mean square deflection of each motor from the position, motor shaft.
    criterion : str or Criterion
        As in `optimal_design`.
    prior : ndarray, (p, p), optional
        Information there is already, in units of the shares.
    kind : {"average", "maximin"}
        How samples of theta count, see `robust_design`.
    tolerance : float, optional
        Largest certified gap; 1e-6, or 1e-5 of full matrices.
    max_rounds : int
        Largest number of sets of spectra.

    Raises
    ------
    InvalidInput
        If positions, torques, motions or noise do not fit, the cap is below one or the kind
        unknown; if parameters of a single robot are guesses by its file.
    NotIdentifiable
        Naming the parameters, if flat spectra in all positions leave some open.
    SolverFailed
        If the gap stays above the tolerance.
    """
    robots = tuple(robot) if isinstance(robot, Sequence) else (robot,)
    if not robots:
        raise InvalidInput("robot: no sample given; at least one is needed")
    if len(robots) == 1:
        _check_estimated(robots[0])
    positions, lines = candidate_rows(positions), check_omega(omega)
    n = positions.shape[1]
    levels = _limits(torque, n, "torque")
    if not line_cap >= 1:
        raise InvalidInput(f"line_cap: {line_cap!r}; flat spectra need 1 at least")
    goal = (1e-5 if full else 1e-6) if tolerance is None else tolerance
    check_above_zero(goal, "tolerance")
    oracle = SpectralOracle(line_cap * n / len(lines), full, 0.05 * goal)
    motions = _limits(speed, n, "speed"), _limits(swing, n, "swing")
    sets = FreeSpectra(robots, positions, lines, noise, levels, *motions, oracle)

    def solved(one: Objective) -> GeneratedDesign:
        return generate_columns(sets, one, prior, goal, max_rounds)

    objective = _objective(criterion, sets, kind, solved)
    return _result(sets, solved(objective), objective, prior)


def _objective(
    criterion: str | Criterion,
    sets: FreeSpectra,
    kind: str,
    solved: Callable[[Objective], GeneratedDesign],
) -> Objective:
    """Return the objective over the samples of theta."""

    def best_value(one: Objective) -> float:
        return one.log_value(solved(one).design.information)

    return robust_objective(criterion, sets.names, len(sets.robots), kind, best_value)


def _check_estimated(robot: Elastic) -> None:
    """Refuse a robot whose file has guesses of free parameters that no fit has replaced."""
    if not isinstance(robot, ElasticRobot):
        return
    fitted = robot.file.fitted.relative_std if robot.file.fitted else {}
    guesses = [n for n in robot.parameters.names if n in robot.file.guessed and n not in fitted]
    if guesses:
        raise InvalidInput(
            f"robot {robot.name!r}: its file has guesses of {', '.join(guesses)}, and spectra "
            "designed at guesses lose most of their gain: fit first, or give samples of the "
            "robot, `robotmodels.WithParameters` of values drawn from the prior"
        )


def _limits(values: ArrayLike, motors: int, what: str) -> Array:
    """Return a positive limit of each motor, (n,), which may be infinite for motions."""
    limits = one_or_each(values, motors, what)
    if not (limits > 0).all() or (what == "torque" and not np.isfinite(limits).all()):
        raise InvalidInput(f"{what}: {np.asarray(values).tolist()}; positive numbers are needed")
    return limits


def _result(
    sets: FreeSpectra, solution: GeneratedDesign, objective: Objective, prior: Array | None
) -> SpectraDesign:
    """Return the design of the last columns, with a single run in each position."""
    weights, means = solution.means(len(sets.positions))
    support = np.flatnonzero(weights)
    X, shares, design = means[support], weights[support], solution.design
    runs = sets.slowed(support, _single_runs(X, sets.oracle.full))
    single = sets.informations(support, runs[..., :, None] * runs[..., None, :].conj())
    reached = np.tensordot(shares, single, axes=1) + (0.0 if prior is None else prior)
    scale = sets.torque[:, None] * sets.torque
    return SpectraDesign(
        positions=read_only(sets.positions[support]),
        support=read_only(support),
        weights=read_only(shares),
        spectra=read_only(scale * X),
        torques=read_only(sets.torque * runs),
        run_efficiency=objective.efficiency(reached, design.information),
        flat_efficiency=objective.efficiency(solution.flat.information, design.information),
        value=design.value,
        gap=solution.gap,
        information=design.information,
        criterion=design.criterion,
        names=design.names,
        rounds=solution.rounds,
    )


def _single_runs(spectra: ComplexArray, full: bool) -> ComplexArray:
    """Return one run of spectra (k, F, n, n), (k, F, n), within the same torques."""
    if full:
        sizes, vectors = np.linalg.eigh(spectra)
        return np.asarray(vectors[..., -1] * np.sqrt(np.maximum(sizes[..., -1:], 0.0)))
    power = np.maximum(np.einsum("kfii->kfi", spectra).real, 0.0)
    phases = np.random.default_rng(0).uniform(0, 2 * np.pi, power.shape)
    return np.asarray(np.sqrt(power) * np.exp(1j * phases))
