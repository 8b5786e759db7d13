"""Fits to runs: any number of runs in a position, noise of inputs and outputs alike."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimators.fitting.fitted_model import FittedModel, lines_in_words
from estimators.fitting.run_problem import SML, RunProblem
from estimators.input_output.coulomb import CoulombPart
from estimators.input_output.run_scatter import variance_factor
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.common.arrays import Array, IntArray


@dataclass(frozen=True)
class FrictionLevel:
    """Estimated level of a motor's Coulomb friction [N m].

    Attributes
    ----------
    motor : str
        Its name.
    level : float
        Mean over positions; not a number, as all else, where it is at rest in all of them.
    std : float
        Standard deviation of the mean.
    lowest, highest : float
        Of the positions.
    in_file : float or None
        What the robot file says; None of other models.
    """

    motor: str
    level: float
    std: float
    lowest: float
    highest: float
    in_file: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class RunFit(FittedModel):
    """A fit to runs: the end of one search, converged or not.

    Its cost is V of `estimators.input_output.likelihood`, and `weighting` "joint" or "row_wise".
    All else as in `FittedModel`.

    Attributes
    ----------
    data : RunSpectra
        Runs it was fitted to.
    """

    data: RunSpectra
    residual: str = field(default=SML, init=False)

    @property
    def row_wise(self) -> bool:
        """Whether outputs were weighed one by one."""
        return self.weighting == "row_wise"

    @property
    def logarithmic(self) -> bool:
        """Whether residuals are logarithms: they are not."""
        return False

    @property
    def has_likelihood(self) -> bool:
        """Whether exp(-cost) is a likelihood: it is."""
        return True

    @cached_property
    def problem(self) -> RunProblem:
        """The problem that the fit is the end of."""
        return RunProblem(
            model=self.model,
            data=self.data,
            bounds=self.bounds,
            prior=self.prior,
            weighting=self.weighting,
        )

    @property
    def coulomb(self) -> Array | None:
        """Levels of the motors' Coulomb friction in each position, (Q, n) [N m], if fitted.

        Not a number where the motor is at rest.
        """
        if self.data.coulomb is None:
            return None
        part = self.problem.errors(self.parameters.values).eliminated
        assert isinstance(part, CoulombPart)
        return np.where(part.seen, self.data.coulomb.levels + part.levels, np.nan)

    def friction_levels(self, covariance: Array) -> tuple[FrictionLevel, ...]:
        """Return the level of each motor's Coulomb friction; none where it is not fitted.

        Standard deviations come from the noise, as large as the cost tells it is, and the errors of
        the parameters; or from the scatter over positions where that is larger.

        Parameters
        ----------
        covariance : ndarray, (p, p)
            Covariance of ln theta.
        """
        if self.coulomb is None:
            return ()
        levels = np.ma.masked_invalid(self.coulomb)
        file = getattr(self.model, "file", None)
        names = [f"motor {i + 1}" for i in range(levels.shape[1])]
        stated: list[float | None] = [None] * len(names)
        if file is not None:
            names = [motor.name for motor in file.motors]
            stated = [motor.coulomb for motor in file.motors]
        count = levels.count(axis=0)
        std = np.sqrt(np.diag(self._covariance_of_mean_levels(covariance, count)))
        scatter = np.ma.filled(levels.std(axis=0, ddof=1) / np.sqrt(count), 0.0)
        mean, low, high = levels.mean(axis=0), levels.min(axis=0), levels.max(axis=0)
        columns = (mean, np.ma.array(np.maximum(std, scatter), mask=count == 0), low, high)
        numbers = (np.ma.filled(column, np.nan).tolist() for column in columns)
        return tuple(map(FrictionLevel, names, *numbers, stated))

    def _covariance_of_mean_levels(self, covariance: Array, count: IntArray) -> Array:
        """Return the covariance of means over `count` (n,) positions by the noise, (n, n)."""
        problem, values = self.problem, self.parameters.values
        response, jacobian = problem.derived(values)
        errors = problem.errors(values, response)
        part = errors.eliminated
        assert isinstance(part, CoulombPart)
        changes = problem.likelihood.whitened_changes(errors, jacobian)
        slopes = part.levels_of(changes).sum(axis=0)
        factor = variance_factor(self.data.degrees_of_freedom, problem.rows)[:, None, None]
        total = (factor * part.covariance).sum(axis=0) + slopes @ covariance @ slopes.T
        inflation = max(self.cost / self.expected_cost, 1.0)
        return np.asarray(inflation * total / np.maximum(np.outer(count, count), 1))

    @property
    def _mean_levels(self) -> Array | None:
        """Means over positions of the levels of friction, (n,) [N m], if fitted."""
        if self.coulomb is None:
            return None
        return np.asarray(np.ma.filled(np.ma.masked_invalid(self.coulomb).mean(axis=0), np.nan))

    @property
    def expected_cost(self) -> float:
        """What noise makes of the cost on average, see `RunProblem`."""
        return self.problem.expected_cost

    @property
    def _cost_in_words(self) -> str:
        return f"{self.expected_cost:.6g} expected, outputs {self.weighting.replace('_', ' ')}"

    def _data_in_words(self) -> str:
        positions, runs = self.data.inputs.shape[:2]
        return (
            f"{runs} {'run' if runs == 1 else 'runs'} at each of {positions} positions, "
            f"{lines_in_words(self.data.omega)}, noise by {self.data.noise}"
        )
