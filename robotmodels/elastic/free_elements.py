"""The numbers of a robot file that can be parameters, and which of them are free."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.description.friction import JointFriction
from robotmodels.description.parameters import Parameters
from robotmodels.description.robot_file import Hardening, Motor, RobotFile, Spring
from robotmodels.description.spring_laws import SpringLaws
from robotmodels.elastic.extra_elements import apply_extra, extra_elements
from robotmodels.linear.spring_network import Inertances

_INERTIAL = ("viscous", "inertia")


@dataclass(frozen=True, eq=False)
class Elements:
    """Stiffnesses, dampings, then the extras of a robot file, and the free parameters behind them.

    A free parameter scales every element tied to it, so tied elements keep their ratio.
    """

    file: RobotFile
    prismatic: frozenset[str]

    @cached_property
    def _table(self) -> dict[str, tuple[float, str]]:
        """Values and units of all elements, by name."""
        return self._spring_elements | self._extra

    @cached_property
    def _spring_elements(self) -> dict[str, tuple[float, str]]:
        """Values and units of all stiffnesses, then all dampings, by name."""
        stiffnesses: dict[str, tuple[float, str]] = {}
        dampings: dict[str, tuple[float, str]] = {}
        for spring in self.file.springs:
            linear = self.linear(spring)
            unit = "N/m" if linear else "N m/rad"
            k = spring.stiffness
            if isinstance(k, Hardening):
                stiffnesses[f"{spring.name}.stiffness.low"] = (k.low, unit)
                stiffnesses[f"{spring.name}.stiffness.high"] = (k.high, unit)
            else:
                stiffnesses[f"{spring.name}.stiffness"] = (k, unit)
            dampings[f"{spring.name}.damping"] = (
                spring.damping,
                "N s/m" if linear else "N m s/rad",
            )
        return stiffnesses | dampings

    def linear(self, spring: Spring) -> bool:
        """Whether a spring is that of a prismatic joint, in N/m."""
        return spring.axis == "drive" and spring.joint in self.prismatic

    @cached_property
    def _extra(self) -> dict[str, tuple[float, str]]:
        possible = extra_elements(self.file)
        for name in self.file.parameters.extra:
            if name in self._spring_elements:
                raise InvalidInput(
                    f"parameters.extra: {name!r} is free without that; extra is for numbers "
                    f"other than stiffnesses and dampings: {', '.join(possible)}"
                )
            if name not in possible:
                raise InvalidInput(
                    f"parameters.extra: {name!r} cannot be a parameter of this robot"
                    f"{_meant(name, possible)}; there are {', '.join(possible)}"
                )
            if self.file.parameters.extra.count(name) > 1:
                raise InvalidInput(f"parameters.extra: {name!r} is named twice")
            if not possible[name][0] > 0:
                raise InvalidInput(
                    f"parameters.extra: {name} is {possible[name][0]:g} in the robot file; "
                    "a free parameter needs a value other than zero"
                )
        cuts: dict[object, str] = {}
        for spring in self.file.springs:
            name = f"{spring.name}.at"
            if name in self.file.parameters.extra:
                other = cuts.setdefault((spring.link, spring.at), name)
                if other != name:
                    raise InvalidInput(
                        f"parameters.extra: {other} and {name} are the place of one cut; name one"
                    )
        return {name: possible[name] for name in self.file.parameters.extra}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all elements."""
        return tuple(self._table)

    @cached_property
    def values(self) -> Array:
        """Values of all elements in the file; negative ones (a centre of mass) without sign."""
        return np.array([value for value, _ in self._table.values()])

    @cached_property
    def parameters(self) -> Parameters:
        """The free parameters; a tied group has the name and value of its first member."""
        heads = [self.names.index(name) for name in self._free]
        return Parameters(
            tuple(self.names[i] for i in heads),
            self.values[heads],
            tuple(self._table[self.names[i]][1] for i in heads),
        )

    @cached_property
    def _heads(self) -> dict[str, str]:
        """The first member of the group of each element that is not fixed, by element."""
        choice = self.file.parameters
        for name in (*choice.fixed, *(n for group in choice.tied for n in group)):
            if name not in self.names:
                raise InvalidInput(f"parameters: {name!r} {self._why_not(name)}")
        head = {name: name for name in self.names}
        tied: set[str] = set()
        for group in choice.tied:
            for name in group:
                if name in tied or name in choice.fixed:
                    also = "fixed too" if name in choice.fixed else "tied twice"
                    raise InvalidInput(f"parameters.tied: {name!r} is {also}; choose one")
                tied.add(name)
            head |= dict.fromkeys(group[1:], group[0])
        heads = {element: h for element, h in head.items() if element not in choice.fixed}
        if not heads:
            raise InvalidInput("parameters: every parameter is fixed; at least one must be free")
        return heads

    def _why_not(self, name: str) -> str:
        """Say why `name` can be neither fixed nor tied, and what would be right."""
        if name in extra_elements(self.file):
            return "is fixed unless parameters.extra names it"
        other = _meant(name, self.names) or f"; there are {', '.join(self.names)}"
        return f"is not a parameter of this robot{other}"

    @cached_property
    def _free(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(name for name in self.names if self._heads.get(name) == name)

    @cached_property
    def ties(self) -> Array:
        """Which free parameter scales which element, (elements, p) of zeros and ones."""
        return np.array(
            [[float(self._heads.get(n) == free) for free in self._free] for n in self.names]
        )

    def at(self, theta: Array) -> Array:
        """Return all elements where the free parameters are `theta` (p,)."""
        return np.asarray(self.values * np.exp(self.ties @ np.log(theta / self.parameters.values)))

    def file_at(self, theta: Array) -> RobotFile:
        """Return the robot file with the extra elements of `theta`."""
        elements = dict(zip(self.names, self.at(theta), strict=True))
        return apply_extra(self.file, {name: elements[name] for name in self._extra})

    def check_fitted(self) -> None:
        """Refuse standard deviations of what the robot does not have.

        Raises
        ------
        InvalidInput
            Naming the entry.
        """
        fitted = self.file.fitted
        possible = {*self.names, *extra_elements(self.file)}
        named = {"fitted.relative_std": fitted.relative_std if fitted else {}}
        for key, names in (named | {"guessed": self.file.guessed}).items():
            for name in names:
                if name not in (possible if key == "guessed" else self.names):
                    raise InvalidInput(
                        f"{key}: {name!r} is not a parameter of this robot{nearest(name, possible)}"
                    )

    def whole_file_at(self, theta: Array) -> RobotFile:
        """Return the robot file with all elements of `theta`; a free one is exactly its value."""
        elements = dict(zip(self.names, self.at(theta).tolist(), strict=True))
        elements |= dict(zip(self.parameters.names, np.asarray(theta).tolist(), strict=True))
        file = apply_extra(self.file, {name: elements[name] for name in self._extra})
        springs = [spring.model_copy(update=_values(spring, elements)) for spring in file.springs]
        return file.model_copy(update={"springs": springs})

    @cached_property
    def extra_columns(self) -> list[int]:
        """Free parameters that scale something other than a spring, a damper or a motor's inertia.

        A motor's inertia includes its viscous friction here.
        """
        rows = [self.names.index(n) for n in self._extra if n not in self._of_motors]
        return np.flatnonzero(self.ties[rows].any(axis=0)).tolist()

    @cached_property
    def _inertial(self) -> list[Motor | JointFriction]:
        """Motors and joints whose inertia or viscous friction is free."""
        free = {n for n in self._of_motors if self.ties[self.names.index(n)].any()}
        return [x for x in self.file.frictional if free & {f"{x.name}.{e}" for e in _INERTIAL}]

    @property
    def inertial_names(self) -> tuple[str, ...]:
        """Names of the motors and frictions of joints that are inertances."""
        return tuple(item.name for item in self._inertial)

    def inertances(self, theta: Array, coordinate_of: Mapping[str, int]) -> Inertances | None:
        """Return the inertances on the arm side, of motors and of joints with free friction."""
        if not self._inertial:
            return None
        values, none = self.at(theta), np.zeros(len(theta))
        coefficients: dict[str, list[float]] = {e: [] for e in _INERTIAL}
        exponents: dict[str, list[Array]] = {e: [] for e in _INERTIAL}
        for item, element in product(self._inertial, _INERTIAL):
            free = (name := f"{item.name}.{element}") in self._extra
            row = self.names.index(name) if free else -1
            value = values[row] if free else getattr(item, element, 0.0)
            scale = item.gear_ratio**2 if isinstance(item, Motor) else 1.0
            coefficients[element].append(value * scale)
            exponents[element].append(self.ties[row] if free else none)
        return Inertances(
            coordinates=np.array([coordinate_of[n] for n in self.inertial_names], dtype=np.int64),
            friction=np.array(coefficients["viscous"]),
            inertia=np.array(coefficients["inertia"]),
            exponents=np.array(exponents["viscous"] + exponents["inertia"]),
        )

    @cached_property
    def _of_motors(self) -> set[str]:
        """The extras that are a motor's inertia, or viscous friction of a motor or joint."""
        return {
            f"{item.name}.{element}" for item in self.file.frictional for element in _INERTIAL
        } & set(self._extra)

    def laws(self, theta: Array) -> SpringLaws:
        """Return the springs' characteristics."""
        elements = self.at(theta)
        torque = [
            s.stiffness.torque if isinstance(s.stiffness, Hardening) else np.inf
            for s in self.file.springs
        ]
        return SpringLaws(elements[self._low], elements[self._high], np.array(torque))

    def dampings(self, theta: Array) -> Array:
        """Return the springs' dampings, (s,)."""
        return self.at(theta)[self._damping]

    def exponents(self, theta: Array, elongations: Array) -> Array:
        """Return d ln(stiffnesses, dampings) / d ln theta, (Q, 2 s, p), at fixed torques.

        A nonlinear spring's stiffness is its slope at the `elongations` (Q, s).
        """
        law = self.laws(theta)
        count = len(elongations)
        if law.linear:  # alike at every elongation
            both = np.concatenate([self.ties[self._low], self.ties[self._damping]])
            return np.broadcast_to(both, (count, *both.shape))
        slope = law(elongations)[1]

        def change(elements: list[int], partial: tuple[Array, Array]) -> Array:
            # At fixed torque the elongation deflects by -torque / slope.
            torque, direct = partial
            relative = (direct - law.stiffening(elongations) * torque / slope) / slope
            return np.asarray(relative[..., None] * self.ties[elements])

        by_stiffness = change(self._low, law.by_low(elongations)) + change(
            self._high, law.by_high(elongations)
        )
        by_damping = np.broadcast_to(
            self.ties[self._damping], (count, *self.ties[self._damping].shape)
        )
        return np.concatenate([by_stiffness, by_damping], axis=1)

    def torque_derivatives(self, theta: Array, elongations: Array) -> Array:
        """Return d (spring torques) / d ln theta at fixed elongations, (Q, s, p)."""
        law = self.laws(theta)
        by_low = law.by_low(elongations)[0][..., None] * self.ties[self._low]
        by_high = law.by_high(elongations)[0][..., None] * self.ties[self._high]
        return np.asarray(by_low + by_high)

    @cached_property
    def _low(self) -> list[int]:
        return [self._row(s.name, "stiffness", "stiffness.low") for s in self.file.springs]

    @cached_property
    def _high(self) -> list[int]:
        return [self._row(s.name, "stiffness", "stiffness.high") for s in self.file.springs]

    @cached_property
    def _damping(self) -> list[int]:
        return [self._row(s.name, "damping") for s in self.file.springs]

    def _row(self, spring: str, *endings: str) -> int:
        return next(
            self.names.index(f"{spring}.{e}") for e in endings if f"{spring}.{e}" in self.names
        )


def _values(spring: Spring, elements: dict[str, float]) -> dict[str, object]:
    """Return stiffness and damping of a spring among all elements."""
    k, damping = spring.stiffness, elements[f"{spring.name}.damping"]
    if not isinstance(k, Hardening):
        return {"stiffness": elements[f"{spring.name}.stiffness"], "damping": damping}
    slopes = {e: elements[f"{spring.name}.stiffness.{e}"] for e in ("low", "high")}
    return {"stiffness": k.model_copy(update=slopes), "damping": damping}


def _meant(name: str, names: Collection[str]) -> str:
    """Return what `name` may stand for: entries below it, or one spelt like it; or nothing."""
    below = [entry for entry in names if entry.startswith(f"{name}.")]
    if below:
        return f" (did you mean {' or '.join(map(repr, below))}?)"
    return nearest(name, names)
