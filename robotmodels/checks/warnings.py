"""What looks wrong with a robot, by rules of one line each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robotmodels.checks.diagnosis import Diagnosis
from robotmodels.description.urdf import nearest_consistent

# A parameter that changes no response by more than this, per relative change, drowns in noise.
LEAST_SENSITIVITY = 0.01
LARGEST_DEFLECTION = (np.radians(1.0), 0.005)  # [rad], [m]; real gears wind up by a tenth of that
LARGEST_SOFTENING = 0.05
MOST_PAIRS = 3
REFLECTED = 20.0  # motor inertia on the arm side and what it moves: of the same order by design


@dataclass(frozen=True)
class Suspicion:
    """Something to look into.

    Attributes
    ----------
    rule : str
        Short name of the rule.
    subjects : tuple of str
        The springs, bodies, motors or parameters at fault.
    message : str
        One line that names the fault and its size.
    """

    rule: str
    subjects: tuple[str, ...]
    message: str


def suspicions(diagnosis: Diagnosis) -> tuple[Suspicion, ...]:
    """Return what breaks a rule, modes first."""
    return tuple(s for rule in _RULES for s in rule(diagnosis))


def outside_the_band(d: Diagnosis) -> Iterator[Suspicion]:
    """Resonances above or below the band: springs that only they bend show weakly."""
    hertz = np.array(d.resonances) / (2 * np.pi)
    low, high = (w / (2 * np.pi) for w in d.band)
    for side, edge, beyond in (("above", high, hertz > high), ("below", low, hertz < low)):
        if beyond.any():
            first, last = hertz[beyond].min(), hertz[beyond].max()
            which = f"{first:.3g} Hz" if beyond.sum() == 1 else f"{first:.3g} to {last:.3g} Hz"
            yield Suspicion(
                f"mode {side} the band",
                (),
                f"{beyond.sum()} of {len(hertz)} undamped modes, at {which}, {side} {edge:.3g} Hz",
            )


def undivided_modes(d: Diagnosis) -> Iterator[Suspicion]:
    """Flexible modes so overdamped that they cannot be told from rigid ones."""
    if d.modes_failed:
        yield Suspicion("overdamped mode", (), d.modes_failed)


def unexcited(d: Diagnosis) -> Iterator[Suspicion]:
    """Free parameters whose relative sensitivity over the band is below 0.01 here."""
    excited = {p.tied_to or p.name for p in d.parameters if p.sensitivity >= LEAST_SENSITIVITY}
    names = tuple(p.name for p in d.parameters if p.state == "free" and p.name not in excited)
    if names:
        yield Suspicion(
            "nothing excites",
            names,
            f"{', '.join(names)}: a change by 1 % changes no response in the band by more than "
            f"{LEAST_SENSITIVITY:g} % of its output's largest, in this position",
        )


def inseparable(d: Diagnosis) -> Iterator[Suspicion]:
    """Pairs of free parameters that change every response alike, such as springs in series."""
    excited = {p.name for p in d.parameters if p.sensitivity >= LEAST_SENSITIVITY}
    pairs = sorted(
        (
            pair
            for pair in d.inseparable
            # Both ends of one hardening spring are alike wherever gravity does not load it.
            if excited.issuperset(pair.names)
            and len({name.removesuffix(".low").removesuffix(".high") for name in pair.names}) > 1
        ),
        key=lambda pair: -pair.inflation,
    )
    if pairs:
        named = [f"{' and '.join(p.names)} ({p.inflation:.2g} times)" for p in pairs[:MOST_PAIRS]]
        more = f", and {len(pairs) - MOST_PAIRS} pairs more" if len(pairs) > MOST_PAIRS else ""
        yield Suspicion(
            "inseparable",
            tuple(dict.fromkeys(name for pair in pairs for name in pair.names)),
            f"{', '.join(named)}{more} affect every response in the band alike; estimating "
            "both inflates their standard deviations by that factor; fix one or tie them",
        )


def large_deflection(d: Diagnosis) -> Iterator[Suspicion]:
    """Springs that give way by more than 1 degree, or 5 mm."""
    for s in d.springs:
        if abs(s.deflection) > LARGEST_DEFLECTION[s.linear]:
            deflection = (
                f"{1e3 * s.deflection:.3g} mm"
                if s.linear
                else f"{np.degrees(s.deflection):.3g} degrees"
            )
            limit = "5 mm" if s.linear else "1 degree"
            yield Suspicion(
                "large deflection",
                (s.name,),
                f"{s.name} deflects by {deflection}, more than {limit}",
            )


def softened(d: Diagnosis) -> Iterator[Suspicion]:
    """Springs of which gravity takes more than 5 % of the stiffness, directly or by its load."""
    for s in d.springs:
        share = (s.stiffness + s.gravity) / s.unloaded_stiffness
        if share < 1 - LARGEST_SOFTENING:
            yield Suspicion(
                "softened by gravity",
                (s.name,),
                f"{s.name} keeps {100 * share:.3g} % of its stiffness at rest",
            )


def inconsistent_inertia(d: Diagnosis) -> Iterator[Suspicion]:
    """Bodies that break the triangle inequality by what passes as rounding."""
    for b in d.bodies:
        first, second, third = b.moments
        if (excess := third - first - second) > 1e-6 * third:
            nearest = np.diag(nearest_consistent(np.diag(b.moments)))
            yield Suspicion(
                "inertia",
                (b.name,),
                f"{b.name}: the largest principal moment of inertia exceeds the sum of the other "
                f"two by {100 * excess / third:.2g} %; no body has that, but rounding may; the "
                f"nearest of a body are {', '.join(f'{moment:.4g}' for moment in nearest)} kg m^2",
            )


def line_mass(d: Diagnosis) -> Iterator[Suspicion]:
    """Bodies with a principal moment of zero: a point or a line of mass."""
    for b in d.bodies:
        if b.moments[0] <= 1e-6 * b.moments[2]:
            what = "line" if b.moments[2] > 0 else "point"
            yield Suspicion(
                "inertia", (b.name,), f"{b.name}: its mass lies on a {what} (a moment is zero)"
            )


def large_gyration(d: Diagnosis) -> Iterator[Suspicion]:
    """Bodies whose radius of gyration exceeds their reach (see `BodyState.extent`)."""
    for b in d.bodies:
        if b.radius_of_gyration > max(b.extent, 1e-3):
            yield Suspicion(
                "inertia",
                (b.name,),
                f"{b.name}: its radius of gyration is {b.radius_of_gyration:.2g} m, more than the "
                f"body's length, {b.extent:.2g} m",
            )


def unmatched_motor(d: Diagnosis) -> Iterator[Suspicion]:
    """Motors whose inertia on the arm side and that of what they move differ twentyfold."""
    for m in d.motors:
        ratio = m.reflected / m.load
        if not 1 / REFLECTED <= ratio <= REFLECTED:
            yield Suspicion(
                "motor inertia",
                (m.name,),
                f"{m.name}: its inertia times ratio squared is {ratio:.2g} times that of what "
                f"{m.joint} moves; {1 / REFLECTED:g} to {REFLECTED:g} is usual",
            )


_RULES = (
    outside_the_band,
    undivided_modes,
    unexcited,
    inseparable,
    large_deflection,
    softened,
    inconsistent_inertia,
    line_mass,
    large_gyration,
    unmatched_motor,
)
