"""Fits by maximum likelihood to noisy inputs and outputs of any number of runs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.fitting.fit_problem import checked_bounds, checked_start
from estimators.fitting.fit_trust import judged_trust, model_directions
from estimators.fitting.fitted_robot import fitted_robot, lines_in_words
from estimators.fitting.priors import Prior
from estimators.fitting.search import check_effort
from estimators.fitting.trust_region import Residuals, trust_region
from estimators.input_output.likelihood import RunProblem
from estimators.input_output.linearised_runs import (
    error_covariance,
    expected_square,
    linearise_runs,
)
from estimators.input_output.run_spectra import RunSpectra
from estimators.trust.intervals import Interval, Verdict
from estimators.trust.rule import gather_evidence, variance_scale
from estimators.trust.trust import Trust
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.common.printing import ReprHtml
from robotmodels.description.parameters import Parameters
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.response import Elastic

_JOINT = 4
"""Degrees of freedom per output from which on outputs are weighed together."""


@dataclass(frozen=True, eq=False)
class RunFit(ReprHtml):
    """The end of one search, converged or not.

    Attributes
    ----------
    model : Elastic
        Model that was fitted.
    data : RunSpectra
        Runs it was fitted to.
    row_wise : bool
        Whether outputs were weighed one by one.
    parameters : Parameters
        Fitted values.
    cost : float
        V, see `likelihood`, with the prior's part; infinite where the search could not begin.
    start : ndarray, (p,)
        Values at which the search began.
    bounds : ndarray, (2, p)
        Lowest and highest values.
    status, message, evaluations
        As those of `estimators.Fit`.
    prior : Prior or None
        Prior knowledge of some parameters.
    """

    model: Elastic
    data: RunSpectra
    row_wise: bool
    parameters: Parameters
    cost: float
    start: Array
    bounds: Array
    status: int
    message: str
    evaluations: int
    prior: Prior | None = None

    @property
    def converged(self) -> bool:
        """Whether a local minimum was reached."""
        return self.status > 0

    @property
    def problem(self) -> RunProblem:
        """The problem that the fit is the end of."""
        return RunProblem(self.model, self.data, self.row_wise, self.bounds, self.prior)

    @property
    def expected_cost(self) -> float:
        """What noise makes of the cost on average, without a prior.

        nu/(nu - m) (m F E - p/2) with covariances of nu degrees of freedom, summed over positions;
        row by row with m = 1.
        """
        _, runs, lines, m = self.data.outputs.shape
        factor = expected_square(self.data.degrees_of_freedom, 1 if self.row_wise else m)
        return float((factor * m * lines * runs).sum() - factor.mean() * len(self.parameters) / 2)

    @cached_property
    def trust(self) -> Trust:
        """How far the fit can be trusted, by the rule of `estimators.trust`, with all evidence.

        Raises
        ------
        SolverFailed
            If the search could not begin.
        """
        if not np.isfinite(self.cost):
            raise SolverFailed(f"no intervals without a fit: {self.message}")
        problem, values = self.problem, self.parameters.values
        at = problem.sensitivities(values)
        errors = problem.errors(at[0])

        def changes(changed: ComplexArray) -> ComplexArray:
            whitened = problem.whitened_changes(errors, changed)
            return np.asarray(whitened.reshape(*whitened.shape[:2], -1, whitened.shape[-1]))

        data = self.data
        directions = model_directions(self.model, data.positions, data.omega, values, at, changes)
        fit = linearise_runs(problem, errors, changes(at[1]))
        evidence = gather_evidence(fit, directions, converged=self.converged)
        scatter = evidence.scatter.scaled(variance_scale(evidence))
        return judged_trust(self._residual, values, self.bounds, evidence, scatter)

    @property
    def verdict(self) -> Verdict:
        """The verdict on the whole fit, with its reason."""
        return self.trust.verdict

    def intervals(self) -> tuple[Interval, ...]:
        """Return the recommended 95 % interval of each parameter, in SI units."""
        return self.trust.intervals

    def covariance(self) -> Uncertainty:
        """Return the covariance of ln theta of the maximum likelihood, see `error_covariance`.

        Raises
        ------
        NotIdentifiable
            If the information is singular.
        """
        matrix = error_covariance(self.problem, self.parameters.values)
        return Uncertainty(self.parameters.names, matrix, self._residual)

    def robot(self) -> ElasticRobot:
        """Return the robot with the fitted values, its uncertainty and where it comes from.

        Raises
        ------
        InvalidInput
            If the model that was fitted is no robot, or no body can have the fitted inertia.
        NotIdentifiable
            If the information is singular.
        """
        data = self.data
        provenance = {
            "data": f"{data.inputs.shape[1]} runs at each of {len(data.positions)} positions, "
            f"{lines_in_words(data.omega)}",
            "fit": f"{self._residual}, noise by {data.noise}, cost {self.cost:.9g}, "
            f"{'converged' if self.converged else 'not converged'}",
        }
        values, covariance = self.parameters.values, self.covariance().covariance
        return fitted_robot(self.model, values, self.trust, provenance, covariance)

    @property
    def _residual(self) -> str:
        return "sml row by row" if self.row_wise else "sml"

    def __str__(self) -> str:
        p, std = self.parameters, self.trust.std
        width = max(len(name) for name in p.names)
        lines = [
            f"{self._residual} fit: {'converged' if self.converged else 'NOT converged'}, cost "
            f"{self.cost:.6g} ({self.expected_cost:.6g} expected), {self.evaluations} evaluations "
            f"({self.message})"
        ]
        for name, value, unit, part in zip(p.names, p.values, p.units, std, strict=True):
            lines.append(f"  {name:<{width}}  {value:12.6g} {unit:<10} +- {100 * part:.2g} %")
        return "\n".join([*lines, f"  {self.verdict}: {self.verdict.reason}"])


def fit_runs(
    model: Elastic,
    data: RunSpectra,
    rows: str = "auto",
    start: Array | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    prior: Prior | None = None,
) -> RunFit:
    """Return the maximum-likelihood fit to noisy inputs and outputs, from one start.

    Any number of runs E >= 1 in a position, any number of outputs. Covariances of nu degrees of
    freedom for m outputs can be weighed together from nu >= m + 2 on; "auto" does so from nu >= 4 m
    on and row by row below, which needs 3.

    Parameters
    ----------
    model : Elastic
        Robot, or anything with its ``parameters`` and ``network``.
    data : RunSpectra
        Runs, see `run_spectra`.
    rows : {"auto", "joint", "row_wise"}
        Whether outputs are weighed together, by Sigma, or each by itself.
    start, bounds, max_evaluations, tolerance, prior
        As in `estimators.fit`.

    Raises
    ------
    InvalidInput
        For too few degrees of freedom or data, or a start outside the bounds.
    IdentificationError
        If the model has no FRF at the start, or one of another size.
    """
    check_effort(max_evaluations, tolerance)
    parameters = model.parameters
    limits = read_only(checked_bounds(bounds, parameters))
    begin = checked_start(parameters, start, limits)
    problem = RunProblem(model, data, _row_wise(data, rows), limits, prior)
    _check_model(problem, begin)
    outcome = trust_region(problem, Residuals(problem.evaluate), begin, max_evaluations, tolerance)
    return RunFit(
        model, data, problem.row_wise,
        Parameters(parameters.names, outcome.values, parameters.units),
        outcome.cost, read_only(begin), limits, outcome.status, outcome.message,
        outcome.evaluations, prior,
    )  # fmt: skip


def _row_wise(data: RunSpectra, rows: str) -> bool:
    least, m = float(data.degrees_of_freedom.min()), data.outputs.shape[3]
    if rows not in ("auto", "joint", "row_wise"):
        raise InvalidInput(f"rows: {rows!r} is none of auto, joint, row_wise")
    if rows == "joint" and least < m + 2:
        raise InvalidInput(
            f"rows: 'joint' needs covariances of at least {m + 2} degrees of freedom for {m} "
            f"outputs; these have {least:g}; take 'row_wise', or measure more blocks or periods"
        )
    return rows == "row_wise" or (rows == "auto" and least < _JOINT * m)


def _check_model(problem: RunProblem, start: Array) -> None:
    """Refuse runs that the model cannot explain, by their number or size."""
    data, p = problem.data, len(problem.model.parameters)
    m, n = data.outputs.shape[3], data.inputs.shape[3]
    shape = problem.sensitivities(start)[0].shape[2:]
    if shape != (m, n):
        raise InvalidInput(
            f"runs: {m} outputs of {n} inputs; the model has {shape[0]} of {shape[1]}"
        )
    if 2 * data.outputs.size < p:
        raise InvalidInput(
            f"runs: {2 * data.outputs.size} real data for {p} parameters; measure more lines, runs "
            "or positions, or lock springs"
        )
