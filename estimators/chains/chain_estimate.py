"""Estimated masses, springs and couplings of chains, and how far to trust them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.chains.chain_trust import chain_intervals, chain_trust, chain_verdict
from estimators.chains.modal_model import modal_response, modal_sensitivity
from estimators.chains.modes import FittedModes
from estimators.chains.parameter_maps import ChainLayout, forward_map, inverse_map, inverse_slope
from estimators.trust.intervals import Interval, Verdict
from estimators.trust.trust import Trust
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import NotIdentifiable
from robotmodels.linear.coupled_chains import CoupledChains

_ROUNDS = 60


@dataclass(frozen=True, eq=False)
class ChainEstimate:
    """Masses, springs and couplings with their covariance.

    Attributes
    ----------
    layout : ChainLayout
        What is where.
    values : ndarray, (k,)
        Values in SI units, couplings with their signs.
    covariance : ndarray, (k, k)
        Covariance of the values themselves, not of their logarithms [SI].
    method : str
        Where they come from.
    condition : float, dimensionless
        Largest growth of a relative error from poles and gains to parameters.
    trust : Trust or None
        The rule's verdict and intervals on all that was fitted; None for the inverse problem, which
        is the start of what is recommended.
    """

    layout: ChainLayout
    values: Array
    covariance: Array
    method: str
    condition: float
    trust: Trust | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, those of `CoupledChains`."""
        return self.layout.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters along a line; kg m^2 and N m/rad about an axis."""
        return tuple("N/m" if name.startswith("K") else "kg" for name in self.names)

    @property
    def std(self) -> Array:
        """Standard deviations, (k,), in SI units; zero for what was given."""
        if self.intervals:
            return np.array([i.std for i in self.intervals])
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def relative_std(self) -> Array:
        """Standard deviations over magnitudes, (k,)."""
        return np.asarray(self.std / np.maximum(np.abs(self.values), 1e-300))

    @cached_property
    def intervals(self) -> tuple[Interval, ...]:
        """The recommended 95 % interval of each parameter; none for the inverse problem."""
        return () if self.trust is None else chain_intervals(self.trust, self.names, self.values)

    @property
    def verdict(self) -> Verdict | None:
        """The verdict on masses, springs and couplings; None for the inverse problem."""
        return None if self.trust is None else chain_verdict(self.trust, self.intervals)

    @property
    def chains(self) -> CoupledChains:
        """The chains, undamped."""
        return CoupledChains(*self.layout.split(self.values))

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = [f"{self.method}, condition {self.condition:.3g}"]
        if self.verdict is not None:
            lines.append(f"{self.verdict}: {self.verdict.reason}")
        refused = [i.low is None and i.high is None for i in self.intervals] or [False] * len(
            self.names
        )
        for name, value, unit, std, none in zip(
            self.names, self.values, self.units, self.std, refused, strict=True
        ):
            spread = "" if none else f"+- {std:<10.3g} "
            lines.append(f"  {name:<{width}}  {value:12.6g} {spread}{unit}")
        return "\n".join(lines)


def inverse_estimate(
    found: FittedModes, layout: ChainLayout, first_masses: Array | None
) -> ChainEstimate:
    """Return the solution of the inverse eigenvalue problem for fitted modes, [HBH] 3.4.

    The covariance is that of the modes carried through every step (delta method).

    Raises
    ------
    NotIdentifiable
        If a mass, a spring or the mass matrix comes out not positive: more masses than these data
        support.
    """
    p = layout.modal.size
    x = found.x[:p]
    with np.errstate(all="ignore"):
        theta = inverse_map(x, layout, first_masses)
    check_physical(theta, layout)
    slope = inverse_slope(x, layout, first_masses)
    covariance = slope @ found.covariance[:p, :p] @ slope.T
    if first_masses is not None:
        covariance[layout.first] = covariance[:, layout.first] = 0.0
    return ChainEstimate(
        layout, theta, covariance, "inverse eigenvalue problem", _condition(slope, x, theta, layout)
    )


def structured_estimate(
    found: FittedModes, start: ChainEstimate, first_masses: Array | None
) -> tuple[ChainEstimate, float]:
    """Return the maximum-likelihood chains, their damping free mode by mode, and the cost.

    Poles and zeros of M > 1 chains of N > 1 masses are more numbers than the chains have
    parameters; the inverse problem takes just enough of them, this uses all.

    Raises
    ------
    NotIdentifiable
        If the parameters' information is singular.
    """
    from scipy.optimize import least_squares

    layout, k = start.layout, len(start.values)
    problem = _Structured(found, start, first_masses is not None)
    solved = least_squares(
        problem.residuals,
        np.zeros(int(problem.free.sum())),
        jac=problem.jacobian,
        x_scale="jac",
        ftol=1e-10,
        xtol=1e-11,
        gtol=1e-15,
        max_nfev=_ROUNDS,
    )
    theta, cost = problem.theta(solved.x), float(2 * solved.cost)
    inner = found.data.covariance_of(problem.jacobian(solved.x), cost, problem.names)
    free = problem.free[:k]
    scale = np.where(np.arange(k) < layout.positive, theta, 1.0)[free]
    size = int(free.sum())
    covariance = np.zeros((k, k))
    covariance[np.ix_(free, free)] = inner[:size, :size] * np.outer(scale, scale)
    method = "maximum likelihood, damping free by modes"
    trust = problem.trust(solved.x, inner, cost)
    return ChainEstimate(layout, theta, covariance, method, start.condition, trust), cost


class _Structured:
    """Whitened FRF errors of chains, as a function of what is free.

    That is u: ln of masses and springs over their start, couplings less theirs, and what modes have
    besides (damping) less its own.
    """

    def __init__(self, found: FittedModes, start: ChainEstimate, first_given: bool) -> None:
        self.found, self.start = found, start
        self.p = start.layout.modal.size
        free = np.ones(len(start.values), dtype=bool)
        if first_given:
            free[start.layout.first] = False
        self.free = np.concatenate([free, np.ones(found.layout.size - self.p, dtype=bool)])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of u's entries."""
        every = self.start.layout.names + self.found.layout.names[self.p :]
        return tuple(name for name, free in zip(every, self.free, strict=True) if free)

    def theta(self, u: Array) -> Array:
        """Return masses, springs and couplings."""
        v, positive = self._full(u), self.start.layout.positive
        theta = self.start.values.copy()
        theta[:positive] *= np.exp(v[:positive])
        theta[positive:] += v[positive : len(theta)]
        return theta

    def residuals(self, u: Array) -> Array:
        data = self.found.data
        try:
            x, _ = self._modes(u)
        except np.linalg.LinAlgError:
            return np.full(data.size, 1e6)
        G = modal_response(x, self.found.layout, data.omega)
        return data.whitened(G - data.response)[:, 0]

    def jacobian(self, u: Array) -> Array:
        return self.found.data.whitened(self.sensitivity(u)[1])

    def sensitivity(self, u: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return FRFs (F, M, M) and their derivatives by u, (F, M, M, r)."""
        x, slope = self._modes(u)
        G, J = modal_sensitivity(x, self.found.layout, self.found.data.omega)
        both = np.concatenate([J[..., : self.p] @ slope, J[..., self.p :]], axis=-1)
        return G, both[..., self.free]

    def trust(self, u: Array, covariance: Array, cost: float) -> Trust:
        """Return the rule's verdict on the solution u.

        Parameters
        ----------
        covariance : ndarray, (r, r)
            Covariance of u.
        """
        data, theta = self.found.data, self.theta(u)
        x, _ = self._modes(u)
        free, p, k = self.free, self.start.layout.positive, len(theta)
        masses, _, _ = self.start.layout.split(theta)
        i, j = np.triu_indices(len(masses), 1)
        # Couplings may be zero: they count in units of the masses they couple. Losses are not
        # judged: in units of twice their standard deviations each of them is identifiable.
        lost = 2 * np.sqrt(np.diag(covariance))[int(free[:k].sum()) :]
        unit = np.concatenate([np.ones(p), np.sqrt(masses[i, -1] * masses[j, -1])])
        fitted, J = self.sensitivity(u)
        return chain_trust(
            data.of_size(2 * cost / data.size) if data.scaled else data,
            self.names,
            np.concatenate([theta[free[:k]], x[self.p :]]),
            np.concatenate([np.concatenate([theta[:p], unit[p:]])[free[:k]], lost]),
            fitted,
            J * np.concatenate([unit[free[:k]], lost]),
            (x, self.found.layout),
            int(free[:p].sum()),
        )

    def _modes(self, u: Array) -> tuple[Array, Array]:
        """Return modes, and the slope of what chains make of them."""
        x, slope = forward_map(self.theta(u), self.start.layout, self.found.shapes)
        more = self.found.x[self.p :] + self._full(u)[len(self.start.values) :]
        return np.concatenate([x, more]), slope

    def _full(self, u: Array) -> Array:
        v = np.zeros(len(self.free))
        v[self.free] = u
        return v


def check_physical(theta: Array, layout: ChainLayout) -> None:
    """Refuse masses, springs and couplings that no chains have.

    Raises
    ------
    NotIdentifiable
        Naming the parameters.
    """
    p = layout.positive
    wrong = [n for n, v in zip(layout.names[:p], theta[:p], strict=True) if not v > 0]
    remedy = (
        f"{layout.masses} masses a chain are more than these FRFs support; give fewer, "
        "or measure more lines with less noise"
    )
    if wrong:
        raise NotIdentifiable(tuple(wrong), f"not positive: {remedy}")
    masses, _, couplings = layout.split(theta)
    if np.linalg.eigvalsh(np.diag(masses[:, -1]) + couplings)[0] <= 0:
        raise NotIdentifiable(
            tuple(layout.names[p:]), f"mass matrix not positive definite: {remedy}"
        )


def _condition(slope: Array, x: Array, theta: Array, layout: ChainLayout) -> float:
    """Return the norm of d ln theta / d ln (J, lambda, weights); couplings against their masses."""
    m, n = layout.chains, layout.modes
    scale_theta = np.abs(theta)
    masses, _, _ = layout.split(theta)
    last = masses[:, -1]
    i, j = np.triu_indices(m, 1)
    scale_theta[layout.positive :] = np.sqrt(last[i] * last[j])
    inertia = layout.modal.split(x)[0]
    diagonal = np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)))[np.triu_indices(m)]
    # lambda = omega^2 and w = phi^2: half the slopes by their logarithms.
    scale_x = np.concatenate([diagonal, np.full(n, 0.5), 0.5 * np.abs(x[len(diagonal) + n :])])
    return float(np.linalg.norm(slope * scale_x / scale_theta[:, None], 2))
