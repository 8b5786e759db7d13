"""Chains of masses and springs whose last masses are coupled through inertia, [HBH] section 2."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array, IntArray, read_only, real_numbers
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.description.parameters import Parameters
from robotmodels.linear.equilibrium_sensitivity import Tangents
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.spring_network import Inertances, SpringNetwork


@dataclass(frozen=True, eq=False)
class CoupledChains:
    """M chains of N masses; a motor drives the first mass of each, [HBH] figure 1.

    Coordinates run chain by chain. Masses are named m1, m2, ..., springs K1, K2, ..., dampers
    c1, c2, ... in that order, as in [HBH]; the coupling between masses 3 and 6 is m3_6. A chain
    moves along a line or about an axis: read kg and N/m as kg m^2 and N m/rad in the latter case.

    Attributes
    ----------
    masses : ndarray, (M, N), kg
        Masses, positive.
    springs : ndarray, (M, N - 1), N/m
        Spring stiffnesses, positive, each between a mass and the next.
    couplings : ndarray, (M, M), kg
        Symmetric with zero diagonal: inertia between the last masses, of either sign; force on
        chain i is minus coupling times acceleration of chain j, [HBH] (1).
    dampers : ndarray or None, (M, N - 1), N s/m
        Positive, parallel to the springs, or None for none.
    extra : tuple of str
        Masses and non-zero couplings that are free too; by default only every spring, then every
        damper, is a free parameter. A free coupling below zero keeps its sign.
    """

    masses: Array
    springs: Array
    couplings: Array
    dampers: Array | None = None
    extra: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("masses", "springs", "couplings", "dampers"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, read_only(real_numbers(value, name)))
        object.__setattr__(self, "extra", tuple(self.extra))
        self._check_shapes()
        self._check_values()
        self._check_mass_matrix()
        _ = self.parameters  # chains that exist can be used

    @cached_property
    def mass_matrix(self) -> Array:
        """Masses and couplings, (M N, M N) [kg]."""
        matrix = np.diag(self.masses.ravel())
        matrix[np.ix_(self._last, self._last)] += self.couplings
        return read_only(matrix)

    @cached_property
    def parameters(self) -> Parameters:
        """The free parameters: springs, dampers, then those of `extra`.

        Raises
        ------
        InvalidInput
            If `extra` names no mass or coupling, or one twice.
        """
        inertias = {name: abs(float(self.mass_matrix[at])) for name, at in self._inertias.items()}
        for name in self.extra:
            wrong = "is not a mass or a non-zero coupling of these chains"
            check_word("extra:", name, inertias, wrong)
            if self.extra.count(name) > 1:
                raise InvalidInput(f"extra: {name!r} is named twice")
        s = self.springs.size
        dampers = self._dampings if self.dampers is not None else np.zeros(0)
        return Parameters(
            names=(
                *(f"K{i + 1}" for i in range(s)),
                *(f"c{i + 1}" for i in range(len(dampers))),
                *self.extra,
            ),
            values=np.array(
                [*self.springs.ravel(), *dampers, *(inertias[name] for name in self.extra)]
            ),
            units=(*["N/m"] * s, *["N s/m"] * len(dampers), *["kg"] * len(self.extra)),
        )

    def linear_model(self) -> LinearModel:
        """Return the linear model; the selector picks the first mass of each chain."""
        return self.network(np.zeros((1, 0))).linear_model().at(0)

    def at(self, parameters: Array | None = None) -> "CoupledChains":
        """Return the chains whose free parameters are `parameters` (p,).

        Raises
        ------
        InvalidInput
            If one is not positive, or the mass matrix is not positive definite.
        """
        if parameters is None:
            return self
        free = dict(zip(self.parameters.names, self.parameters.check(parameters), strict=True))
        s = self.springs.size
        matrix = self.mass_matrix.copy()
        for name in self.extra:
            i, j = self._inertias[name]
            matrix[i, j] = matrix[j, i] = np.copysign(free[name], matrix[i, j])
        masses = np.diag(matrix).reshape(self.masses.shape)
        couplings = matrix[np.ix_(self._last, self._last)] - np.diag(masses[:, -1])
        springs = np.array([free[f"K{i + 1}"] for i in range(s)]).reshape(self.springs.shape)
        dampers = self.dampers
        if dampers is not None:
            dampers = np.array([free[f"c{i + 1}"] for i in range(s)]).reshape(dampers.shape)
        return CoupledChains(masses, springs, couplings, dampers, self.extra)

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network, the same for every row of `positions` (Q, anything).

        Raises
        ------
        InvalidInput
            As `at`.
        """
        chains = self.at(parameters)
        q, s, d = len(np.asarray(positions)), chains.springs.size, chains.masses.size
        selector = np.zeros((d, len(chains.masses)))
        selector[np.arange(0, d, chains.masses.shape[1]), np.arange(len(chains.masses))] = 1.0
        zeros = np.zeros((q, d, d))
        exponents = np.zeros((q, 2 * s, len(chains.parameters)))
        # Undamped chains have no damper to scale: their rows stay zero.
        scaled = np.arange(s if chains.dampers is None else 2 * s)
        exponents[:, scaled, scaled] = 1.0
        inertances, mass = self._free_masses, chains.mass_matrix.copy()
        if inertances is not None:
            free = inertances.coordinates
            inertances = replace(inertances, inertia=np.diag(mass)[free])
            mass[free, free] = 0.0
        return SpringNetwork(
            mass=np.tile(mass, (q, 1, 1)),
            damping=zeros[0],
            stiffness=zeros,
            selector=selector,
            nodes=chains._nodes,
            spring_stiffness=np.tile(chains.springs.ravel(), (q, 1)),
            spring_damping=np.tile(chains._dampings, (q, 1)),
            exponents=exponents,
            parameters=chains.parameters,
            inertances=inertances,
        )

    @renamed_keywords(since="0.2", sag="equilibrium_shift")
    def linearization(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> tuple[SpringNetwork, Tangents | None]:
        """Return `network` and `tangents`.

        Raises
        ------
        InvalidInput
            As `at`.
        """
        return self.network(positions, parameters), self.tangents(
            positions, parameters, equilibrium_shift=equilibrium_shift
        )

    @renamed_keywords(since="0.2", sag="equilibrium_shift")
    def tangents(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> Tangents | None:
        """Return the derivatives by free couplings, None where none is free; nothing sags here.

        Raises
        ------
        InvalidInput
            As `at`.
        """
        coupled = [name for name in self.extra if len(set(self._inertias[name])) == 2]
        if not coupled:
            return None
        chains = self.at(parameters)
        q, p, d = len(np.asarray(positions)), len(chains.parameters), chains.masses.size
        mass = np.zeros((q, p, d, d))
        for i, name in enumerate(self.parameters.names):
            if name in coupled:
                row, column = self._inertias[name]
                mass[:, i, [row, column], [column, row]] = chains.mass_matrix[row, column]
        return Tangents(
            mass=mass,
            damping=np.zeros_like(mass),
            stiffness=np.zeros_like(mass),
            gravity=np.zeros((q, p, d)),
        )

    @cached_property
    def _last(self) -> IntArray:
        """Coordinates of the last masses, (M,)."""
        count, length = self.masses.shape
        return np.asarray(np.arange(1, count + 1) * length - 1)

    @cached_property
    def _free_masses(self) -> Inertances | None:
        """The free masses; None where there are none."""
        names = self.parameters.names
        entries = {name: self._inertias[name] for name in self.extra}
        masses = [(names.index(name), i) for name, (i, j) in entries.items() if i == j]
        if not masses:
            return None
        columns, coordinates = np.array(masses).T
        exponents = np.zeros((2 * len(coordinates), len(names)))
        exponents[len(coordinates) + np.arange(len(coordinates)), columns] = 1.0
        return Inertances(
            coordinates,
            np.zeros(len(coordinates)),
            np.diag(self.mass_matrix)[coordinates],
            exponents,
        )

    @cached_property
    def _nodes(self) -> IntArray:
        """Coordinates that each spring joins, (s, 2)."""
        numbers = np.arange(self.masses.size).reshape(self.masses.shape)
        return np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=1)

    @cached_property
    def _dampings(self) -> Array:
        return np.zeros(self.springs.size) if self.dampers is None else self.dampers.ravel()

    @cached_property
    def _inertias(self) -> dict[str, tuple[int, int]]:
        """Row and column in the mass matrix of each mass and each non-zero coupling."""
        entries = np.argwhere(np.triu(self.mass_matrix) != 0).tolist()
        masses = {f"m{i + 1}": (i, j) for i, j in entries if i == j}
        return masses | {f"m{i + 1}_{j + 1}": (i, j) for i, j in entries if i != j}

    def _check_shapes(self) -> None:
        if self.masses.ndim != 2 or self.masses.shape[0] < 1 or self.masses.shape[1] < 2:
            raise InvalidInput(
                f"masses: shape {self.masses.shape} given; (M, N) is needed, "
                "at least one chain of at least two masses"
            )
        count, length = self.masses.shape
        needed = {"springs": (count, length - 1), "dampers": (count, length - 1)}
        for name, shape in (needed | {"couplings": (count, count)}).items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise InvalidInput(
                    f"{name}: shape {value.shape} given; {shape} is needed "
                    f"for {count} chain{'s' * (count > 1)} of {length} masses"
                )

    def _check_values(self) -> None:
        for name in ("masses", "springs", "dampers"):
            value = getattr(self, name)
            if value is None:
                continue
            wrong = ~(np.isfinite(value) & (value > 0))
            if wrong.any():
                i, j = np.argwhere(wrong)[0]
                raise InvalidInput(f"{name}[{i}, {j}]: {value[i, j]:g} is not a positive number")
        C = self.couplings
        wrong = ~(np.isfinite(C) & np.isfinite(C.T) & np.isclose(C, C.T, rtol=1e-12, atol=0.0))
        wrong |= np.eye(len(C), dtype=bool) & (C != 0)
        if wrong.any():
            i, j = np.argwhere(wrong)[0]
            raise InvalidInput(
                f"couplings[{i}, {j}]: {C[i, j]:g}, and [{j}, {i}]: {C[j, i]:g}; "
                "a symmetric matrix with zero diagonal is needed"
            )

    def _check_mass_matrix(self) -> None:
        """Refuse couplings that make the mass matrix indefinite, naming the worst."""
        end = self.masses[:, -1]
        scale = np.sqrt(np.outer(end, end))
        values, vectors = np.linalg.eigh(np.eye(len(end)) + self.couplings / scale)
        if values[0] > 0:
            return
        share = np.triu(self.couplings / scale * np.outer(vectors[:, 0], vectors[:, 0]))
        i, j = np.unravel_index(np.argmin(share), share.shape)
        raise InvalidInput(
            f"couplings[{i}, {j}]: {self.couplings[i, j]:g} kg is too large for the last masses "
            f"{end[i]:g} and {end[j]:g} kg: the mass matrix is not positive definite"
        )
