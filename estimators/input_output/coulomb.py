"""Coulomb friction at the motors of runs: an input of its own.

Friction c s acts against the motor's torque u, so that the robot answers to u - c s; its course s
is known, see `friction_shares`. The level c of each motor enters the likelihood linearly and is
estimated along, position by position.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimators.input_output.free_response import FreePart
from robotmodels.common.arrays import Array, BoolArray, ComplexArray, IntArray


@dataclass(frozen=True, eq=False)
class CoulombSpectra:
    """Spectra of the motors' friction at a level of one, and what levels were taken off.

    Attributes
    ----------
    shares : ndarray of complex, (Q, E, F, n)
        Spectra of the shares s.
    levels : ndarray, (Q, n), N m
        Levels whose friction was taken off the torques.
    covariance : ndarray of complex, (Q, F, m + 2 n, m + 2 n)
        Of the errors of outputs, torques as recorded, and shares.
    """

    shares: ComplexArray
    levels: Array
    covariance: ComplexArray

    def subset(self, positions: IntArray) -> "CoulombSpectra":
        """Return those of some positions."""
        return CoulombSpectra(
            self.shares[positions], self.levels[positions], self.covariance[positions]
        )

    def single_runs(self) -> "CoulombSpectra":
        """Return those of the same runs, each as the only one of a position."""
        runs = self.shares.shape[1]
        shares = self.shares.reshape(-1, 1, *self.shares.shape[2:])
        levels = np.repeat(self.levels, runs, axis=0)
        return CoulombSpectra(shares, levels, np.repeat(self.covariance, runs, axis=0))

    @staticmethod
    def join(parts: Sequence["CoulombSpectra"]) -> "CoulombSpectra":
        """Return those of all positions of `parts`."""
        return CoulombSpectra(
            np.concatenate([part.shares for part in parts]),
            np.concatenate([part.levels for part in parts]),
            np.concatenate([part.covariance for part in parts]),
        )

    def at(self, levels: Array) -> tuple[ComplexArray, ComplexArray, "CoulombSpectra"]:
        """Return what other levels (Q, n) change.

        Returns
        -------
        inputs : ndarray of complex, (Q, E, F, n)
            To be added to the torques.
        covariance : ndarray of complex, (Q, F, m + n, m + n)
            Of outputs and torques without friction.
        coulomb : CoulombSpectra
            With the new levels.
        """
        n, size = levels.shape[1], self.covariance.shape[-1]
        T = np.broadcast_to(np.eye(size), (len(levels), size, size)).copy()
        T[:, size - 2 * n : size - n, size - n :] = -levels[:, :, None] * np.eye(n)
        T = T[:, None, : size - n]
        inputs = -self.shares * (levels - self.levels)[:, None, None]
        return inputs, T @ self.covariance @ T.swapaxes(-1, -2), replace(self, levels=levels)


@dataclass(frozen=True, eq=False)
class CoulombPart:
    """What friction of the motors does to whitened errors, position by position.

    Attributes
    ----------
    span : FreePart
        Of all runs as one.
    """

    span: FreePart

    @classmethod
    def of(cls, columns: ComplexArray, errors: ComplexArray) -> "CoulombPart":
        """Return the span of columns (Q, F, m, E, n) and what errors (Q, F, m, E) have of it."""
        return cls(FreePart.of(_as_one_run(columns), _as_one_run(errors[..., None])))

    @property
    def levels(self) -> Array:
        """Levels that explain the errors best, beside those taken off before, (Q, n) [N m]."""
        return self.span.amplitudes[..., 0]

    @property
    def seen(self) -> BoolArray:
        """Whether the runs show a level, (Q, n); motors at rest do not."""
        return np.asarray(self.span.inverse.any(axis=2))

    @property
    def covariance(self) -> Array:
        """Covariance of the levels where the FRF is known, of known noise, (Q, n, n) [N^2 m^2]."""
        return np.asarray(self.span.inverse @ self.span.inverse.swapaxes(1, 2) / 2)

    def levels_of(self, changes: ComplexArray) -> Array:
        """Return the levels (Q, n, r) that explain changes (Q, F, m, E, r) of errors best."""
        return self.span.amplitudes_of(_as_one_run(changes))

    def degrees_of_freedom(self, runs: int) -> Array:
        """Return the real degrees of freedom that levels take, (Q,)."""
        return self.span.degrees_of_freedom(1)

    def taken_off(self, columns: ComplexArray) -> ComplexArray:
        """Return columns (Q, F, m, E, ...) less what friction can imitate of them."""
        return self.span.taken_off(_as_one_run(columns)).reshape(columns.shape)


def _as_one_run(columns: ComplexArray) -> ComplexArray:
    q, f, m, runs = columns.shape[:4]
    return columns.reshape(q, f, m * runs, *columns.shape[4:])
