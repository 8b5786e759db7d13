"""Dampers by nonlinear optimisation from the undamped result, [HBH] section 5."""

from dataclasses import dataclass

import numpy as np

from estimators.chain_dampers.damped_chains import DampedChains
from estimators.chains.chain_estimate import ChainEstimate
from estimators.chains.identified_chains import ChainIdentification
from estimators.fitting.least_squares import Fit, fit
from estimators.uncertainty.covariance import Uncertainty, covariance
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.printing import ReprHtml
from robotmodels.linear.modes import resonances

_LEAST = 1e-2  # of the mean damper, to begin with
_GAIN = 3.0  # in cost for each number more that modes have free


@dataclass(frozen=True, eq=False)
class DamperFit(ReprHtml):
    """Chains with dampers, motor friction and delay, all fitted together.

    Attributes
    ----------
    fit : Fit
        Fit by `estimators.fit`; its parameters are those of `DampedChains`.
    model : DampedChains
        The fitted chains.
    uncertainty : Uncertainty
        Uncertainty of ln of the fit's parameters, Theorem 1.
    estimate : ChainEstimate
        Masses, springs and couplings, with their covariance in SI units.
    """

    fit: Fit
    model: DampedChains
    uncertainty: Uncertainty
    estimate: ChainEstimate

    @property
    def dampers(self) -> Array:
        """(M, N - 1) [N s/m]."""
        return self.model.dampers.reshape(self.model.layout.chains, -1)

    @property
    def dampers_std(self) -> Array:
        """Standard deviations of the dampers, (M, N - 1) [N s/m]."""
        s = self.model.layout.modes
        return np.asarray(
            self.dampers * self.uncertainty.std[s : 2 * s].reshape(self.dampers.shape)
        )

    @property
    def friction_std(self) -> Array:
        """Standard deviations of the motors' viscous friction, (M,) [N s/m]."""
        m = self.model.layout.chains
        values = self.fit.parameters.values
        return np.asarray((values * self.uncertainty.std)[-m - 1 : -1])

    @property
    def delay_std(self) -> float:
        """Standard deviation of the delay [s]."""
        return float(self.fit.parameters.values[-1] * self.uncertainty.std[-1])

    @property
    def misfit(self) -> float:
        """Cost over its expectation, as `FittedModes.misfit`."""
        cost, weights = self.fit.cost, np.asarray(self.fit.weights)
        expected = float(np.sum(self.fit.estimate.variance * weights))
        size = 2 * self.fit.estimate.response.size
        return cost / (expected * max(size - len(self.fit.parameters), 1) / size)

    @property
    def response(self) -> ComplexArray:
        """The fitted FRFs, (F, M, M)."""
        return self.model.linear_model().frequency_response(self.fit.estimate.omega)

    def __str__(self) -> str:
        lines = [str(self.estimate), f"misfit {self.misfit:.3g}"]
        springs = [name for name in self.estimate.names if name.startswith("K")]
        pairs = zip(springs, self.dampers.flat, self.dampers_std.flat, strict=True)
        lines += [
            f"  damper of {name}  {value:.4g} +- {std:.3g} N s/m" for name, value, std in pairs
        ]
        return "\n".join(lines)


@renamed_keywords(since="0.2", found="identification")
def fit_dampers(identification: ChainIdentification) -> DamperFit:
    """Fit dampers parallel to the springs, and everything else with them.

    The search begins at the identified chains; the first dampers are those, none negative, whose
    modal damping is nearest to the measured one.

    Raises
    ------
    NotIdentifiable
        If the data do not say all parameters.
    """
    start = _start(identification)
    data = identification.modes.data
    sized = data.of_size(2 * identification.modes.cost / data.size) if data.scaled else data
    result = fit(start, sized.estimate, residual="nls", weights=1 / data.std[None] ** 2)
    uncertainty = covariance(result)
    model = start.at(result.parameters.values)
    return DamperFit(
        result, model, uncertainty, _structure(result, uncertainty, model, identification)
    )


def recommended_estimate(
    identification: ChainIdentification, dampers: DamperFit | None
) -> ChainEstimate:
    """Return the estimate to quote: with dampers, or with damping free mode by mode.

    That with dampers, unless modes explain the FRFs clearly better, by more than what they have
    free besides lets expect, or only that with modes has a verdict that gives intervals. Where
    motor inertias were given, those of the modes, which take them as exact.
    """
    structured = identification.structured
    inertias_given = structured.trust is None or structured.trust.names[0] != structured.names[0]
    if dampers is None or inertias_given or not dampers.fit.converged:
        return structured
    modes, damped = structured.verdict, dampers.estimate.verdict
    assert modes is not None
    assert damped is not None
    if modes.gives_interval != damped.gives_interval:
        return structured if modes.gives_interval else dampers.estimate
    noise = (
        2 * identification.cost / identification.modes.data.size
        if identification.modes.data.scaled
        else 1.0
    )
    more = identification.modes.layout.sizes[-1] + 1
    clearly = dampers.fit.cost - identification.cost > _GAIN * more * noise
    return structured if clearly else dampers.estimate


def _start(identification: ChainIdentification) -> DampedChains:
    from scipy.optimize import nnls

    layout, modes = identification.structured.layout, identification.modes
    chains = identification.chains
    undamped = resonances(chains.linear_model())
    network = chains.network(np.zeros((1, 0)))
    stretch = (network.incidence() @ undamped.shapes) ** 2
    modal_damping = 2 * modes.damping * modes.omega
    dampers = nnls(stretch.T, modal_damping)[0]
    # One time constant for all springs is the fallback: damping in proportion to stiffness.
    share = float(np.median(modal_damping / modes.omega**2))
    least = _LEAST * max(share, 1e-9) * chains.springs.ravel()
    m = layout.chains
    masses, _, _ = layout.split(identification.structured.values)
    i, j = np.triu_indices(m, 1)
    begin = sum(modes.layout.sizes[:4])
    std = np.sqrt(np.diag(modes.covariance))[begin : begin + m + 1]
    last = np.sqrt(masses[i, -1] * masses[j, -1])
    signed = np.array([*modes.friction, modes.delay])
    offsets = np.concatenate([-last, signed - np.abs(signed) - 10 * std])
    return DampedChains(
        layout,
        np.array(identification.structured.values),
        np.maximum(dampers, least),
        np.array(modes.friction),
        modes.delay,
        offsets,
    )


def _structure(
    result: Fit, uncertainty: Uncertainty, model: DampedChains, identification: ChainIdentification
) -> ChainEstimate:
    """Return theta with its covariance, from that of ln of the fit's parameters."""
    layout = model.layout
    s, d = layout.modes, layout.chains * layout.masses
    pairs = len(layout.names) - layout.positive
    order = np.concatenate(
        [2 * s + np.arange(d), np.arange(s), 2 * s + d + np.arange(pairs)]
    ).astype(np.int64)
    scale = result.parameters.values[order]
    spread = uncertainty.covariance[np.ix_(order, order)] * np.outer(scale, scale)
    return ChainEstimate(
        layout,
        model.theta,
        spread,
        "least squares with dampers",
        identification.inverse.condition,
        result.trust,
    )
