"""What a fit of deflections takes for granted, and by how much each of it may be wrong."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.robot import ElasticRobot


@dataclass(frozen=True)
class DeflectionAssumptions:
    """Assumptions of a fit to deflections.

    Attributes
    ----------
    low_pass : float, Hz
        Cut-off frequency of all signals. Twice-differentiated angles bias stiffnesses above 10 Hz.
    least_speed : float, rad/s
        Joints slower than that are left out: at rest, stiction holds an unknown part of the load.
    averaging : float, s
        Duration of the means that covariances come from.
    delays : bool
        Whether the encoders' delay is estimated, or zero.
    eccentric : bool
        Whether the encoders' eccentricity is estimated.
    torque_scale, link_mass, counterbalance : float
        Factors of the motor torques, of what the links weigh, and of the counterbalances.
    load_shift : float, m
        How much farther out the payload is than the robot file says.
    """

    low_pass: float = 5.0
    least_speed: float = 0.02
    averaging: float = 0.1
    delays: bool = True
    eccentric: bool = False
    torque_scale: float = 1.0
    link_mass: float = 1.0
    counterbalance: float = 1.0
    load_shift: float = 0.0

    def __post_init__(self) -> None:
        for name in ("low_pass", "averaging", "torque_scale", "link_mass"):
            if not 0 < getattr(self, name) < np.inf:
                raise InvalidInput(f"{name}: {getattr(self, name)} is not a positive number")
        if not 0 <= self.least_speed < np.inf:
            raise InvalidInput(f"least_speed: {self.least_speed} is not a number >= 0")

    def robot(self, robot: ElasticRobot) -> ElasticRobot:
        """Return the robot with its payload shifted away from the joint that carries it."""
        payload = robot.file.payload
        if payload is None or not self.load_shift:
            return robot
        com = np.array(payload.com)
        length = float(np.linalg.norm(com))
        outwards = com / length if length else np.array([0.0, 0.0, 1.0])
        shifted = tuple(float(x) for x in com + self.load_shift * outwards)
        moved = payload.model_copy(update={"com": shifted})
        return ElasticRobot(robot.file.model_copy(update={"payload": moved}), robot.folder)


@dataclass(frozen=True)
class SystematicTerm:
    """A systematic term: other assumptions, each as likely as those of the fit.

    Attributes
    ----------
    name : str
        What people call it.
    alternatives : tuple of DeflectionAssumptions
        Of several, the one that shifts a result most counts.
    """

    name: str
    alternatives: tuple[DeflectionAssumptions, ...]


def systematic_terms(
    nominal: DeflectionAssumptions,
    *,
    torque_scale: float = 0.05,
    link_mass: float = 0.03,
    counterbalance: float = 0.05,
    load_shift: float = 0.2,
) -> tuple[SystematicTerm, ...]:
    """Return the systematic terms.

    Half-widths are those of torque scale, masses and counterbalances, and the payload's place [m];
    other terms are filters of half and double the cut-off, and eccentricity of encoders.
    """
    one: dict[str, dict[str, Any]] = {
        f"torque scale {torque_scale:.0%}": {"torque_scale": nominal.torque_scale + torque_scale},
        f"masses of links {link_mass:.0%}": {"link_mass": nominal.link_mass + link_mass},
        f"counterbalances {counterbalance:.0%}": {
            "counterbalance": nominal.counterbalance + counterbalance
        },
        f"place of payload {load_shift:g} m": {"load_shift": nominal.load_shift + load_shift},
        "eccentricity of encoders": {"eccentric": not nominal.eccentric},
    }
    filters = tuple(replace(nominal, low_pass=f * nominal.low_pass) for f in (0.5, 2.0))
    return (
        *(SystematicTerm(name, (replace(nominal, **change),)) for name, change in one.items()),
        SystematicTerm("low-pass, half and double", filters),
    )
