"""The function that is sampled: a fit's cost as a log density, fast where the kernel can."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.priors import Prior
from estimators.sampling.likelihood import Noise
from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.errors import IdentificationError, InvalidInput, SolverFailed
from robotmodels.linear.linear_model import LinearModel, stacked_measurements
from robotmodels.linear.spring_network import SpringNetwork

if TYPE_CHECKING:
    from robotmodels.kernel import FitKernel


# Matrix entries solved in one call when small systems are evaluated for many walkers.
BATCH = 2**20


@dataclass(frozen=True, eq=False)
class LogPosterior:
    """Logarithm of the posterior of ln theta: the likelihood of V, the prior, flat in the bounds.

    Where every parameter is a spring, a damper or a motor's inertia, equilibria are fixed at
    the fit. That neglects the shift of the equilibria within the posterior, which is of the order
    of the deflection under gravity times the relative width. Payloads, locations and all other
    parameters change the skeleton: then the robot is linearised anew for every walker, a hundred
    times slower.

    Attributes
    ----------
    problem : FitProblem
        Problem of the fit.
    network : SpringNetwork
        Network at the fitted parameters.
    noise : Noise
        How V becomes a likelihood.
    prior : Prior or None
        Normal ones of ln theta; None for flat ones.
    bounds : ndarray, (2, p)
        Bounds of ln theta.
    """

    problem: FitProblem
    network: SpringNetwork
    noise: Noise
    prior: Prior | None
    bounds: Array

    @property
    def names(self) -> tuple[str, ...]:
        """The p parameters."""
        return self.network.parameters.names

    @property
    def data(self) -> int:
        """Number of real data."""
        return self.problem.used_data

    def __call__(self, ln_theta: Array) -> Array:
        """Return log p (W,), up to a constant, at `ln_theta` (W, p); minus infinity outside.

        Raises
        ------
        SolverFailed
            If the cost is not a number, with the parameters.
        """
        ln_theta = np.atleast_2d(ln_theta)
        inside = ((ln_theta >= self.bounds[0]) & (ln_theta <= self.bounds[1])).all(axis=1)
        result = np.full(len(ln_theta), -np.inf)
        if not inside.any():
            return result
        theta = np.exp(ln_theta[inside])
        value = self._log_likelihood(theta)
        wrong = np.isnan(value)
        if wrong.any():
            raise SolverFailed(f"posterior: no cost at {self.described(theta[np.argmax(wrong)])}")
        if self.prior is not None:
            value = value - self.prior.cost(self.names, theta)
        result[inside] = value
        return result

    def costs(self, parameters: Array) -> Array:
        """Return the fit's cost V (W,), without the prior, at `parameters` (W, p) [SI]."""
        if self.kernel is not None:
            return self.kernel(parameters)
        return np.concatenate([squares.sum(axis=1) for squares in self._squares(parameters)])

    def line_log_likelihood(self, parameters: Array) -> Array:
        """Return minus the parts of V from each line, (W, Q, F), scaled as known noise is.

        Raises
        ------
        InvalidInput
            If the scale of the noise is unknown, which couples all lines.
        """
        if self.noise.kind != "known":
            raise InvalidInput("log likelihood of lines: the scale of the noise must be known")
        shape = len(parameters), len(self.problem.positions), len(self.problem.omega), -1
        squares = np.concatenate([*self._squares(parameters)])
        return np.asarray(-self.noise.scale * squares.reshape(shape).sum(axis=-1))

    def described(self, theta: Array) -> str:
        """Name the three parameters of `theta` (p,) [SI] that are farthest from the fit."""
        fitted = self.network.parameters.values
        order = np.argsort(-np.abs(np.log(theta / fitted)))[:3]
        return ", ".join(f"{self.names[i]} = {theta[i]:.4g} (fit {fitted[i]:.4g})" for i in order)

    def _log_likelihood(self, theta: Array) -> Array:
        return self.noise.of_cost(self.costs(theta), self.data)

    def _squares(self, parameters: Array) -> Iterator[Array]:
        """Yield the parts of V, (w, elements or lines), of batches of parameters."""
        for G, values in self._responses(parameters):
            finite = np.isfinite(G).all(axis=(1, 2, 3, 4))
            if not finite.any():
                yield np.full((len(G), 1), np.inf)
                continue
            finite_squares = self.problem.squares(G[finite], values[finite])
            squares = np.full((len(G), finite_squares[0].size), np.inf)
            squares[finite] = finite_squares.reshape(len(finite_squares), -1)
            yield squares

    def _responses(self, parameters: Array) -> Iterator[tuple[ComplexArray, Array]]:
        """Yield FRFs (w, Q, F, m, n) and parameters; not finite where there are none."""
        omega = self.problem.omega
        if not self.network.only_springs:
            for theta in parameters:
                yield self._response_anew(theta)[None], theta[None]
            return
        q, d = self.network.mass.shape[:2]
        together = max(1, BATCH // (q * len(omega) * d**2))
        for first in range(0, len(parameters), together):
            some = parameters[first : first + together]
            yield batched_frequency_response(self.network, some, omega), some

    def _response_anew(self, theta: Array) -> ComplexArray:
        """Return the FRF with the equilibria and the skeleton of theta."""
        from robotmodels import kernel

        problem = self.problem
        try:
            network = problem.model.network(problem.positions, theta)
        except IdentificationError:
            m, n = self.network.frequency_response(problem.omega[:1]).shape[2:]
            shape = len(problem.positions), len(problem.omega), m, n
            return np.full(shape, np.inf + 0j)
        return kernel.frequency_response(network, problem.omega)

    @cached_property
    def kernel(self) -> "FitKernel | None":
        """The compiled cost; None where there is none, or the skeleton changes."""
        suits = self.problem.compiles(self.network)
        return self.problem.kernel(self.network) if suits else None

    def __getstate__(self) -> dict[str, Any]:
        # Compiled code works on addresses: another process makes its own.
        return {name: value for name, value in self.__dict__.items() if name != "kernel"}


def log_posterior(fit: FittedModel, noise: Noise, prior: Prior | None = None) -> LogPosterior:
    """Return the function that is sampled.

    Raises
    ------
    InvalidInput
        If the prior names no free parameter, the noise does not fit the residual, or the fit's loss
        is a robust one, which is no likelihood.
    SolverFailed
        If the fit's cost is not finite, or not that at its parameters.
    """
    theta = fit.parameters.values
    if not np.isfinite(fit.cost):
        raise SolverFailed(f"posterior: the fit's cost is {fit.cost:g}: {fit.message}")
    if fit.loss != "linear":
        raise InvalidInput(
            f"posterior: the loss {fit.loss!r} is no likelihood; fit with loss='linear', "
            "outliers given the weight zero"
        )
    if prior is not None:
        prior.columns(fit.parameters.names)
    problem = fit.problem
    target = LogPosterior(
        problem=problem,
        network=fit.model.network(problem.positions, theta),
        noise=noise,
        prior=prior,
        bounds=read_only(np.log(fit.bounds)),
    )
    cost = float(target.costs(theta[None])[0])
    if not np.isclose(cost, fit.data_cost, rtol=1e-6):
        raise SolverFailed(
            f"posterior: the cost at the fit is {cost:g}, the fit's {fit.data_cost:g}"
        )
    return target


def posterior_density(
    fit: FittedModel,
    *,
    noise: str = "known",
    scale: float | None = None,
    prior: Prior | None = None,
) -> LogPosterior:
    """Return the density that `sample_posterior` samples; arguments as there.

    Raises
    ------
    InvalidInput, SolverFailed
        As `log_posterior`, or for noise settings that do not fit.
    """
    if scale is None:
        scale = fit.problem.likelihood_scale(fit.parameters.values) if noise == "known" else 1.0
    return log_posterior(fit, Noise(noise, float(scale)), prior or fit.prior)


def batched_frequency_response(
    network: SpringNetwork, parameters: Array, omega: Array
) -> ComplexArray:
    """Return FRFs (w, Q, F, m, n) at parameters (w, p), equilibria fixed."""
    w, s = len(parameters), len(network.nodes)
    inertances = network.inertances
    friction = inertances is not None and bool(
        inertances.exponents[: len(inertances.friction)].any()
    )
    if not network.only_motors or friction:
        models = [network.linear_model(theta) for theta in parameters]
        batch = LinearModel(
            mass=np.stack([model.mass for model in models]),
            damping=np.stack([model.damping for model in models]),
            stiffness=np.stack([model.stiffness for model in models]),
            selector=network.selector,
            measurement=stacked_measurements(models),
        )
        return batch.frequency_response(omega)
    from robotmodels import kernel

    # One network of w Q positions: the kernel has no axis for parameters.
    each = [network.coefficients_at(theta) for theta in parameters]
    without_springs = [network.without_springs(theta) for theta in parameters]
    damping = without_springs[0][1]
    wide = replace(
        network,
        mass=np.concatenate([mass for mass, _ in without_springs]),
        damping=damping if damping.ndim == 2 else damping[0],
        stiffness=np.tile(network.stiffness, (w, 1, 1)),
        spring_stiffness=np.concatenate([first[:, :s] for first, _ in each]),
        spring_damping=np.concatenate([second[:, :s] for _, second in each]),
        exponents=np.tile(network.exponents, (w, 1, 1)),
        inertances=None,
        measurement=None,
    )
    G = kernel.frequency_response(wide, omega) * network.motor_factors(omega)[:, None, :]
    return G.reshape(w, -1, *G.shape[1:])
