"""Chains identified from FRFs: values, covariance, what looks doubtful, other masses predicted."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.chains.chain_estimate import ChainEstimate
from estimators.chains.model_order import OrderProposal, prominent_modes
from estimators.chains.modes import FittedModes
from estimators.chains.parameter_maps import forward_map, inverse_map, inverse_slope
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import resonances
from robotmodels.linear.response import check_omega

_HIDDEN = 9.0  # Wald statistic of a mode in one motor: three standard deviations
_POOR = 0.3  # relative standard deviation
_UNLIKELY = 1e-3
_MOST_NAMED = 6


def notes(identification: "ChainIdentification", *, explained: bool = False) -> tuple[str, ...]:
    """Return one sentence for each thing that looks doubtful, none where all is well.

    Parameters
    ----------
    explained : bool
        Whether another model, that with dampers, explains what modes do not.
    """
    return (
        *_errors(identification, explained),
        *_modes(identification),
        *_parameters(identification),
    )


def _errors(identification: "ChainIdentification", explained: bool) -> list[str]:
    sentences = []
    if identification.left_out:
        hertz = identification.modes.data.omega[0] / (2 * np.pi)
        sentences.append(
            f"{identification.left_out} at the low end, below {hertz:.3g} Hz, left out of the "
            "lines: friction distorts what is there"
        )
    if explained:
        return sentences
    if identification.excess:
        sentences.append(
            f"noise does not explain the misfit: {100 * identification.excess:.2g} % of each FRF "
            "was added as an error, as strong dampers, which `fit_dampers` allows for, friction, "
            "backlash or a mode outside the band would make it"
        )
    p = identification.structure_p_value
    if p < _UNLIKELY:
        doubt = "the structure, or the number of masses, is in doubt"
        if identification.modes.layout.turned:
            doubt = f"dampers couple the modes, which `fit_dampers` allows for, or {doubt}"
        sentences.append(
            f"poles and zeros are unlike those of any such chains without dampers (probability "
            f"{p:.1g}): {doubt}"
        )
    return sentences


def _modes(identification: "ChainIdentification") -> list[str]:
    modes = identification.modes
    sentences: list[str] = []
    if modes.data.undamped:
        return sentences
    hertz = modes.omega / (2 * np.pi)
    for r in np.flatnonzero(~prominent_modes(modes)):
        sentences.append(
            f"the mode at {hertz[r]:.4g} Hz all but cancels against a zero in every chain: "
            "the order may be too high for the data"
        )
    hidden = [
        f"{hertz[r]:.4g} Hz in chain {i + 1}"
        for r, i in np.argwhere(modes.visibility < _HIDDEN)
        if prominent_modes(modes)[r]
    ]
    if hidden:
        sentences.append(
            f"pole and zero cancel within noise at {', '.join(hidden[:_MOST_NAMED])}"
            f"{' and others' if len(hidden) > _MOST_NAMED else ''}"
        )
    return sentences


def _parameters(identification: "ChainIdentification") -> list[str]:
    estimate = identification.structured
    p = estimate.layout.positive
    poor = [
        n for n, s in zip(estimate.names[:p], estimate.relative_std[:p], strict=True) if s > _POOR
    ]
    if not poor:
        return []
    return [
        f"{', '.join(poor[:_MOST_NAMED])}{' and others' if len(poor) > _MOST_NAMED else ''}: "
        f"standard deviations above {100 * _POOR:.0f} %; the order is too high for these data, "
        "or they are too few"
    ]


@dataclass(frozen=True, eq=False)
class ChainIdentification:
    """Chains identified from FRFs.

    Attributes
    ----------
    modes : FittedModes
        Poles, zeros and gains.
    inverse : ChainEstimate
        Solution of the inverse eigenvalue problem.
    structured : ChainEstimate
        The result, which `masses`, `springs` and `couplings` show: maximum-likelihood chains
        started from the inverse problem; for the other methods and exact FRFs, its solution itself.
    cost : float
        Cost of these chains; what it exceeds the modes' by tells whether these are chains.
    order : OrderProposal or None
        How N was proposed, or None where it was given.
    left_out : int
        Lines at the low end left out for friction.
    excess : float
        Relative error added to the covariance given, so that it explains the misfit; 0 where it
        did.
    """

    modes: FittedModes
    inverse: ChainEstimate
    structured: ChainEstimate
    cost: float
    order: OrderProposal | None
    left_out: int
    excess: float

    @property
    def masses(self) -> Array:
        """(M, N) [kg]."""
        return np.asarray(self.structured.layout.split(self.structured.values)[0])

    @property
    def springs(self) -> Array:
        """(M, N - 1) [N/m]."""
        return np.asarray(self.structured.layout.split(self.structured.values)[1])

    @property
    def couplings(self) -> Array:
        """(M, M), zero diagonal [kg]."""
        return np.asarray(self.structured.layout.split(self.structured.values)[2])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of masses, springs and couplings, in the order of `covariance`."""
        return self.structured.names

    @property
    def covariance(self) -> Array:
        """(k, k) of the values in SI units."""
        return self.structured.covariance

    @property
    def n_masses(self) -> int:
        """Number N of masses in a chain."""
        return self.structured.layout.masses

    @property
    def chains(self) -> CoupledChains:
        """The chains, undamped; for dampers see `estimators.fit_dampers`."""
        return self.structured.chains

    @property
    def notes(self) -> tuple[str, ...]:
        """What looks doubtful, one sentence each."""
        return notes(self)

    @property
    def misfit(self) -> float:
        """Squared residuals of the modes over their expectation; near 1 where noise is all."""
        return float("nan") if self.modes.data.scaled else self.modes.misfit

    @cached_property
    def structure_p_value(self) -> float:
        """Probability by chance of modes at least as unlike any chains' as these.

        Modes of M > 1 chains of N > 2 masses are more numbers than the chains have parameters. What
        the inverse problem and back again changes them by, h, is tested against its own
        covariance (Wald). NaN where nothing is to be tested.
        """
        from scipy.stats import chi2

        layout, modes = self.inverse.layout, self.modes
        p, k = layout.modal.size, len(self.inverse.values)
        spare = p - k
        if spare < 1 or modes.data.undamped:
            return float("nan")
        x = modes.x[:p]
        theta = inverse_map(x, layout)
        back, slope = forward_map(theta, layout, modes.shapes)
        scale = np.where(np.arange(k) < layout.positive, theta, 1.0)
        H = slope @ (inverse_slope(x, layout) / scale[:, None]) - np.eye(p)
        values, vectors = np.linalg.eigh(H @ modes.covariance[:p, :p] @ H.T)
        parts = (vectors.T @ (back - x))[-spare:] ** 2 / values[-spare:]
        return float(chi2.sf(parts.sum(), spare))

    def __str__(self) -> str:
        sentences = [f"note: {note}" for note in self.notes]
        return "\n".join([str(self.structured), str(self.inverse), *sentences])


@renamed_keywords(since="0.2", found="identification")
def predict_masses(identification: ChainIdentification, omega: Array) -> ComplexArray:
    """Return accelerations of all masses per motor torque, (F, M N, M), in the chains' order.

    Shapes are those of the identified chains without damping; damping ratios, motor friction and
    delay those of the fitted modes.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.

    Raises
    ------
    InvalidInput
        If a frequency is not positive.
    """
    s = 1j * check_omega(omega)
    model, modes = identification.chains.linear_model(), identification.modes
    undamped = resonances(model)
    w, zeta = undamped.frequencies, modes.damping
    h = s[:, None] ** 2 / (s[:, None] ** 2 + 2 * zeta * w * s[:, None] + w**2)
    motors = model.selector.T @ undamped.shapes
    elastic = np.einsum("fr,dr,mr->fdm", h, undamped.shapes, motors)
    together = np.kron(np.eye(len(identification.masses)), np.ones((identification.n_masses, 1)))
    inertia = together.T @ model.mass @ together
    rigid = np.linalg.inv(inertia + np.diag(modes.friction) / s[:, None, None])
    late = np.exp(-s * modes.delay)
    return np.asarray(late[:, None, None] * (together @ rigid + elastic))
