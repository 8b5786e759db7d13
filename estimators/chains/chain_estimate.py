"""Estimated masses, springs and couplings of chains, and how far to trust them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.chains.chain_trust import chain_intervals, chain_verdict
from estimators.chains.parameter_maps import ChainLayout
from estimators.trust.intervals import Interval, Verdict
from estimators.trust.trust import Trust
from robotmodels.common.arrays import Array
from robotmodels.common.errors import NotIdentifiable
from robotmodels.linear.coupled_chains import CoupledChains


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
