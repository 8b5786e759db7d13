"""The cost of a fit to runs: maximum likelihood with noisy inputs and outputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import (
    Derived,
    FitProblem,
    all_finite,
    check_positions,
    checked_bounds,
)
from estimators.fitting.priors import Prior
from estimators.input_output.free_response import FreePart, FreeResponse, sampled_states
from estimators.input_output.likelihood import Errors, RunLikelihood
from estimators.input_output.local_transient import LocalPolynomials
from estimators.input_output.run_scatter import (
    by_line,
    expected_square,
    input_scatter,
    products,
    run_correlation,
    variance_factor,
)
from estimators.input_output.run_spectra import RunSpectra, run_spectra
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import IdentificationError, InvalidInput, nearest
from robotmodels.linear.residuals import ResidualForm
from robotmodels.linear.response import Elastic, by_ln_theta, frequency_response
from robotmodels.linear.spring_network import SpringNetwork
from robotmodels.records.records import Records

if TYPE_CHECKING:
    from robotmodels.kernel import RunKernel

SML = "sml"
"""Name of the residual."""

ROWS = ("auto", "joint", "row_wise")

_JOINT = 4
"""Degrees of freedom per output from which on outputs are weighed together."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunProblem(FitProblem):
    """The cost V of runs, see `estimators.input_output.likelihood`, with what `FitProblem` holds.

    Attributes
    ----------
    data : RunSpectra
        Spectra of the runs.
    """

    data: RunSpectra

    @property
    def row_wise(self) -> bool:
        """Whether outputs are weighed one by one, by the name of the weights."""
        return self.weighting == "row_wise"

    @property
    def name(self) -> str:
        """Name of the residual."""
        return SML

    @property
    def used_data(self) -> int:
        """Number of real data that carry weight."""
        return 2 * self.data.outputs.size

    @property
    def size(self) -> int:
        """Complex numbers in the data."""
        return self.data.outputs.size

    @property
    def identity(self) -> tuple[object, object]:
        """Data, and what was computed of them, see `FitProblem`."""
        data = self.data
        measured = data.positions, data.omega, data.inputs, data.outputs, data.degrees_of_freedom
        states = data.sample_time, data.polynomials, data.delay
        friction = () if data.coulomb is None else (data.coulomb.shares,)
        return (self.name, self.row_wise, *states, *measured, *friction), data.covariance

    @property
    def any_outputs(self) -> bool:
        """Whether there is compiled code for other outputs than the motors' motions."""
        return True

    @property
    def rows(self) -> int:
        """Outputs that are weighed together."""
        return 1 if self.row_wise else self.data.outputs.shape[3]

    @property
    def expected_cost(self) -> float:
        """What noise makes of the cost at its minimum on average, without a prior.

        nu/(nu - m) (m F E - p/2) with covariances of nu degrees of freedom, summed over positions;
        row by row with m = 1. Less what is eliminated.
        """
        factor = expected_square(self.data.degrees_of_freedom, self.rows)
        return float(self.expected_squares.sum() - factor.mean() * len(self.names) / 2)

    @property
    def expected_squares(self) -> Array:
        """What noise makes of the squared errors of each position at the true parameters, (Q,)."""
        _, runs, lines, m = self.data.outputs.shape
        numbers = np.full(len(self.positions), float(m * lines * runs))
        if self.data.estimates_along:
            part = self.errors(self.model.parameters.values).eliminated
            numbers -= (0.0 if part is None else part.degrees_of_freedom(runs)) / 2
        return np.asarray(expected_square(self.data.degrees_of_freedom, self.rows) * numbers)

    def likelihood_scale(self, values: Array) -> float:
        """Return the factor of V that makes exp(-V) as wide as the covariance, on average.

        Less than one where covariances were sampled, or rows are correlated and not weighed
        together (Pauli, Racugno and Ventura 2011).
        """
        bread, meat = self.sandwich_parts(values)
        return len(bread) / float(np.trace(np.linalg.lstsq(bread, meat)[0]))

    @cached_property
    def likelihood(self) -> RunLikelihood:
        """The cost of an FRF."""
        return RunLikelihood(self.data, self.row_wise)

    def free_response(self, values: Array) -> FreeResponse | LocalPolynomials | None:
        """Return the free responses of the states, if runs do not end as they began."""
        data = self.data
        if data.polynomials:
            return LocalPolynomials(data.omega, data.outputs.shape[3])
        if data.sample_time is None:
            return None
        late = np.exp(1j * data.omega * data.delay)[:, None]
        sensors = self.model.network(self.positions[:1], values).linear_model().measured
        factor = late * sensors.sensors(data.omega) * (1j * data.omega[:, None]) ** data.derivatives
        shift = np.exp(1j * data.omega * data.sample_time)
        return FreeResponse(self._states(values), shift, np.asarray(factor))

    def errors(self, values: Array, response: ComplexArray | None = None) -> Errors:
        """Return the errors at `values` (p,), where the model's FRF is `response` if known."""
        if response is None:
            response = frequency_response(self.model, self.positions, self.omega, values)
        return self.likelihood.errors(response, self.free_response(values))

    def residuals(self, values: Array) -> tuple[Lines, Lines]:
        """Return whitened errors (Q, F, m, E) and their derivatives, see `FitProblem`."""
        G, J = self.derived(values)
        all_finite(G, J)
        errors = self.errors(values, G)
        return errors.whitened, -self._slopes(values, errors, J)

    def squares(self, response: ComplexArray, values: Array) -> Array:
        """Return the parts of the cost, (w, Q, F, m, E)."""
        if self.data.estimates_along:
            each = zip(response, values, strict=True)
            white = np.stack([self.errors(theta, G).whitened for G, theta in each])
        else:
            white = self.likelihood.errors(response).whitened
        return np.asarray(white.real**2 + white.imag**2)

    def _linearised(self, values: Array) -> LinearisedFit:
        """Return the fit about its solution; its elements are the whitened outputs of all runs."""
        G, J = self.derived(values)
        errors, freedom = self.errors(values, G), self.data.degrees_of_freedom
        q, f, m, runs = errors.whitened.shape
        ones, size = np.ones((q, f, m * runs)), expected_square(freedom, self.rows)
        covariance: Lines = ones * size[:, None, None]
        if self.row_wise and m > 1:
            covariance = size[:, None, None, None] * run_correlation(errors, runs)
        prior = np.zeros((len(self.names),) * 2)
        with np.errstate(divide="ignore"):  # of one output by itself
            single = 1 / (1 / freedom + m / self.data.shared_draws)
        return LinearisedFit(
            names=self.names,
            residuals=errors.whitened.reshape(q, f, -1),
            jacobian=by_line(self._slopes(values, errors, J)),
            weights=ones,
            noise_weights=ones,
            covariance=covariance,
            deviations=None,
            degrees_of_freedom=single,
            line_correlation=np.empty(0),
            sharing=float(1 + (f * m * runs / self.data.shared_draws).mean()),
            prior=prior if self.prior is None else self.prior.information(self.names),
            scatter_factor=(variance_factor(freedom, self.rows) / size)[:, None, None],
        )

    def by_output(self, values: Array) -> Array:
        """Return numbers of a line's outputs in all runs (m E,) as the matrix (m, E)."""
        return values.reshape(self.data.outputs.shape[3], -1)

    def information(self, values: Array) -> Array:
        """Return the information of the runs in each position, (Q, p, p), were the model right.

        H = 2 Re sum tr((U U^H - C_UU) dG_j^H Sigma^-1 dG_i), that of the true inputs on average:
        far from the fit, measured inputs tell them better than the likelihood does.
        """
        G, J = self.derived(values)
        errors = self.errors(values, G)
        inputs = self.likelihood.inputs(errors.eliminated)
        if self.row_wise:
            inputs = np.broadcast_to(inputs[:, :, None], errors.inputs.shape)
        measured = replace(errors, inputs=inputs, gain=np.zeros_like(errors.gain))
        seen = by_line(self._through(measured, J))
        noise = input_scatter(self.likelihood, measured, J)
        pairs = zip(seen, noise, strict=True)
        return np.stack([products(a, a) - products(b, b) for a, b in pairs])

    def changes(self, values: Array, at: Derived) -> Callable[[ComplexArray], Lines]:
        """Return what turns changes of the FRF into those of whitened outputs, (Q, F, m E, r)."""
        errors = self.errors(values, at[0])

        def changes(changed: ComplexArray) -> Lines:
            return by_line(self._through(errors, changed))

        return changes

    def sandwich_parts(self, values: Array) -> tuple[Array, Array]:
        """Return the information of the true inputs and the covariance of the cost's gradient.

        H and H + D, see `input_scatter`. Row by row the correlations of the outputs enter the
        second, and sampled covariances enlarge it by `variance_factor`.
        """
        at = self.derived(values)
        fit = self.linearise(values)
        scattered = input_scatter(self.likelihood, self.errors(values, at[0]), at[1])
        bread = products(fit.jacobian, fit.jacobian) - products(scattered, scattered)
        if fit.covariance.ndim == 4:
            through = fit.covariance @ fit.jacobian
        else:
            through = fit.covariance[..., None] * fit.jacobian
        enlarged = np.asarray(fit.scatter_factor)[..., None] * through
        return bread, products(fit.jacobian, enlarged)

    def compiles(self, network: SpringNetwork) -> bool:
        """Tell whether only springs, dampers and inertias are free, nothing is eliminated."""
        from robotmodels.kernel import run_kernel_suits

        return not self.data.estimates_along and run_kernel_suits(network)

    def kernel(self, network: SpringNetwork) -> "RunKernel":
        """Return the compiled cost about a network's equilibria."""
        from robotmodels.kernel import RunKernel

        columns, root = self.likelihood.columns, self.likelihood.noise_root
        return RunKernel(network, self.omega, *columns, root, self.row_wise)

    def robust(self, squares: Array) -> Array:
        """Refuse: runs have no robust loss, see `run_problem`."""
        raise NotImplementedError

    def _through(self, errors: Errors, changed: ComplexArray) -> ComplexArray:
        """Return whitened changes (Q, F, m, E, r) less what states can imitate of them."""
        white = self.likelihood.whitened_changes(errors, changed)
        return white if errors.eliminated is None else errors.eliminated.taken_off(white)

    def _slopes(self, values: Array, errors: Errors, jacobian: ComplexArray) -> ComplexArray:
        """Return the derivatives of whitened modelled outputs, (Q, F, m, E, p)."""
        white = self.likelihood.whitened_changes(errors, jacobian)
        part = errors.eliminated
        if part is None:
            return white
        free = self.free_response(values)
        if not (isinstance(free, FreeResponse) and isinstance(part, FreePart)):
            return part.taken_off(white)
        slopes = by_ln_theta(self._states, values)
        moved = free.moved(slopes, part.amplitudes)
        return part.taken_off(white + errors.whiten(moved))

    def _states(self, values: Array) -> Array:
        assert self.data.sample_time is not None
        model = self.model.network(self.positions, values).linear_model()
        return sampled_states(model, self.data.sample_time, self.data.derivatives)


def run_problem(
    model: Elastic,
    data: RunSpectra | Records,
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> RunProblem:
    """Return the problem of a fit to runs; arguments as in `estimators.fit`.

    Raises
    ------
    InvalidInput
        For other residuals, weights or losses than runs have, too few degrees of freedom or data,
        or runs that the model cannot explain by their number or size.
    """
    if residual not in (None, SML):
        name = residual if isinstance(residual, str) else getattr(residual, "name", residual)
        raise InvalidInput(
            f"residual: {name!r} compares FRFs; runs have 'sml', or estimate FRFs of them first"
        )
    if loss != "linear":
        raise InvalidInput(f"loss: {loss!r} is defined for FRFs; runs have 'linear' only")
    spectra = run_spectra(data) if isinstance(data, Records) else data
    if positions is not None:
        check_positions(positions)
        spectra = spectra.subset(np.asarray(positions))
    check_model(model, spectra)
    return RunProblem(
        model=model,
        data=spectra.without_images(model),
        weighting=_weighting(spectra, "auto" if weights is None else weights),
        bounds=read_only(checked_bounds(bounds, model.parameters)),
        prior=prior,
    )


def _weighting(data: RunSpectra, rows: str | NDArray[Any]) -> str:
    """Return "joint" or "row_wise": whether outputs are weighed together or one by one.

    Covariances of nu degrees of freedom for m outputs can be weighed together from nu >= m + 2 on;
    "auto" does so from nu >= 4 m on and row by row below, which needs 3.
    """
    least, m = float(data.degrees_of_freedom.min()), data.outputs.shape[3]
    if not (isinstance(rows, str) and rows in ROWS):
        near = nearest(rows, ROWS) if isinstance(rows, str) else ""
        raise InvalidInput(f"weights: {str(rows)[:60]!r} is none of {', '.join(ROWS)}{near}")
    if rows == "joint" and least < m + 2:
        raise InvalidInput(
            f"weights: 'joint' needs covariances of at least {m + 2} degrees of freedom for {m} "
            f"outputs; these have {least:g}; take 'row_wise', or measure more blocks or periods"
        )
    if rows == "auto":
        return "row_wise" if least < _JOINT * m else "joint"
    return rows


def check_model(model: Elastic, data: RunSpectra) -> None:
    """Refuse runs that the model cannot explain.

    Raises
    ------
    InvalidInput
        If it has other numbers of inputs and outputs, a torque loop that measured torques have
        behind them, states that cannot be estimated along, or transients are polynomials of lines
        that are not dense against its resonances.
    """
    m, n = data.outputs.shape[3], data.inputs.shape[3]
    who = f"of {getattr(model, 'name', 'the model')}"
    try:
        one = frequency_response(model, data.positions[:1], data.omega[:1])
    except IdentificationError as error:
        raise InvalidInput(f"runs: not {who}: {error}") from error
    if one.shape[2:] != (m, n):
        raise InvalidInput(
            f"runs: {m} outputs of {n} inputs, not {who}, which has {one.shape[2]} of "
            f"{one.shape[3]}"
        )
    first = model.network(data.positions[:1], model.parameters.values).linear_model()
    if not (data.commanded or first.measured.torque.ideal):
        raise InvalidInput(
            f"runs: torque_gain, torque_delay and torque_lag {who} act on commanded torques, these "
            "were measured; leave them out of the robot file"
        )
    if data.polynomials:
        everywhere = model.network(data.positions, model.parameters.values)
        LocalPolynomials(data.omega, m).check(everywhere.linear_model())
    elif data.sample_time is not None:
        sampled_states(first, data.sample_time, data.derivatives)
