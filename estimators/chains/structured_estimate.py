"""Maximum-likelihood masses, springs and couplings, begun at those of the inverse problem."""

import numpy as np

from estimators.chains.chain_estimate import ChainEstimate
from estimators.chains.chain_trust import chain_trust
from estimators.chains.modal_model import modal_response, modal_sensitivity
from estimators.chains.modes import FittedModes
from estimators.chains.parameter_maps import forward_map
from estimators.trust.trust import Trust
from robotmodels.common.arrays import Array, ComplexArray

_ROUNDS = 60


def structured_estimate(
    modes: FittedModes, start: ChainEstimate, first_masses: Array | None
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
    problem = _Structured(modes, start, first_masses is not None)
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
    inner = modes.data.covariance_of(problem.jacobian(solved.x), cost, problem.names)
    free = problem.free[:k]
    scale = np.where(np.arange(k) < layout.positive, theta, 1.0)[free]
    size = int(free.sum())
    covariance = np.zeros((k, k))
    covariance[np.ix_(free, free)] = inner[:size, :size] * np.outer(scale, scale)
    method = "maximum likelihood, damping free by modes"
    trust = problem.trust(solved.x, inner, cost)
    return ChainEstimate(layout, theta, covariance, method, start.condition, trust), cost


def structured_cost(modes: FittedModes, estimate: ChainEstimate) -> float:
    """Return the cost of chains as they are, with the damping of the fitted modes."""
    problem = _Structured(modes, estimate, first_given=False)
    return float(np.sum(problem.residuals(np.zeros(int(problem.free.sum()))) ** 2))


class _Structured:
    """Whitened FRF errors of chains, as a function of what is free.

    That is u: ln of masses and springs over their start, couplings less theirs, and what modes have
    besides (damping) less its own.
    """

    def __init__(self, modes: FittedModes, start: ChainEstimate, first_given: bool) -> None:
        self.modes, self.start = modes, start
        self.p = start.layout.modal.size
        free = np.ones(len(start.values), dtype=bool)
        if first_given:
            free[start.layout.first] = False
        self.free = np.concatenate([free, np.ones(modes.layout.size - self.p, dtype=bool)])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of u's entries."""
        every = self.start.layout.names + self.modes.layout.names[self.p :]
        return tuple(name for name, free in zip(every, self.free, strict=True) if free)

    def theta(self, u: Array) -> Array:
        """Return masses, springs and couplings."""
        v, positive = self._full(u), self.start.layout.positive
        theta = self.start.values.copy()
        theta[:positive] *= np.exp(v[:positive])
        theta[positive:] += v[positive : len(theta)]
        return theta

    def residuals(self, u: Array) -> Array:
        data = self.modes.data
        try:
            x, _ = self._modes(u)
        except np.linalg.LinAlgError:
            return np.full(data.size, 1e6)
        G = modal_response(x, self.modes.layout, data.omega)
        return data.whitened(G - data.response)[:, 0]

    def jacobian(self, u: Array) -> Array:
        return self.modes.data.whitened(self.sensitivity(u)[1])

    def sensitivity(self, u: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return FRFs (F, M, M) and their derivatives by u, (F, M, M, r)."""
        x, slope = self._modes(u)
        G, J = modal_sensitivity(x, self.modes.layout, self.modes.data.omega)
        both = np.concatenate([J[..., : self.p] @ slope, J[..., self.p :]], axis=-1)
        return G, both[..., self.free]

    def trust(self, u: Array, covariance: Array, cost: float) -> Trust:
        """Return the rule's verdict on the solution u.

        Parameters
        ----------
        covariance : ndarray, (r, r)
            Covariance of u.
        """
        data, theta = self.modes.data, self.theta(u)
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
            (x, self.modes.layout),
            int(free[:p].sum()),
        )

    def _modes(self, u: Array) -> tuple[Array, Array]:
        """Return modes, and the slope of what chains make of them."""
        x, slope = forward_map(self.theta(u), self.start.layout, self.modes.shapes)
        more = self.modes.x[self.p :] + self._full(u)[len(self.start.values) :]
        return np.concatenate([x, more]), slope

    def _full(self, u: Array) -> Array:
        v = np.zeros(len(self.free))
        v[self.free] = u
        return v
