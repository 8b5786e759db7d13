"""One simulated experiment of a series: data, fit, intervals."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.least_squares import fit
from estimators.frf.estimate import FrfEstimate, noisy_frf
from estimators.uncertainty.interval_methods import intervals_of
from robotmodels.arrays import Array, ComplexArray, IntArray
from robotmodels.errors import IdentificationError
from robotmodels.noise import RelativeNoise
from robotmodels.response import Elastic, frequency_response

Experiment = Callable[[np.random.Generator], FrfEstimate]


@dataclass(frozen=True, eq=False)
class FrfExperiment:
    """An experiment at the level of FRFs: the true model's, with errors of a known law.

    Attributes
    ----------
    model : Elastic
        The true one.
    positions : ndarray
        As in `estimators.simulate_frf`.
    omega : ndarray
        As in `estimators.simulate_frf`.
    noise : RelativeNoise
        As in `estimators.simulate_frf`.
    repetitions : ndarray of int or None
        As in `estimators.simulate_frf`.
    """

    model: Elastic
    positions: Array
    omega: Array
    noise: RelativeNoise
    repetitions: IntArray | None = None

    @cached_property
    def response(self) -> ComplexArray:
        """The true FRFs, (Q, F, m, n), found once for all runs."""
        return np.asarray(frequency_response(self.model, self.positions, self.omega))

    def __call__(self, rng: np.random.Generator) -> FrfEstimate:
        """Return one simulated estimate."""
        return noisy_frf(
            self.response, self.positions, self.omega, self.noise, rng, self.repetitions
        )


@dataclass(frozen=True, eq=False)
class Recipe:
    """What is done with every simulated experiment; arguments of `monte_carlo`."""

    experiment: Experiment
    model: Elastic
    residual: str
    weights: str | NDArray[Any]
    methods: tuple[str, ...]
    level: float
    noise: str

    def run(self, seed: int) -> "dict[str, Array] | str":
        """Return the arrays of one run, or the reason why there are none."""
        rng = np.random.default_rng(seed)
        p = len(self.model.parameters)
        try:
            found = fit(self.model, self.experiment(rng), self.residual, self.weights)
            if not found.converged:
                return f"not converged: {found.message}"
            stds, ends = np.empty((len(self.methods), p)), np.empty((len(self.methods), p, 2))
            for i, method in enumerate(self.methods):
                stds[i], ends[i] = intervals_of(found, method, self.level, rng, noise=self.noise)
        except (IdentificationError, np.linalg.LinAlgError) as error:
            return str(error)
        return {
            "estimates": np.log(found.parameters.values),
            "stds": stds,
            "intervals": ends,
            "costs": np.array(found.cost),
        }
