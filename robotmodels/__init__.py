"""What the robot is: elastic models, their equilibria, FRFs and sensitivities."""

from robotmodels.chains import CoupledChains
from robotmodels.elastic import ElasticRobot
from robotmodels.errors import (
    IdentificationError,
    IdentificationWarning,
    InvalidInput,
    NoEquilibrium,
    NotIdentifiable,
    SolverFailed,
)
from robotmodels.library import builtin_robots, load_robot
from robotmodels.linear_model import LinearModel
from robotmodels.modes import (
    anti_resonances,
    clamped,
    damped_modes,
    resonances,
    rigid_modes,
)
from robotmodels.noise import RelativeNoise
from robotmodels.parameters import Parameters
from robotmodels.response import frequency_response, linearize, sensitivity
from robotmodels.spring_network import SpringNetwork

__all__ = [
    "CoupledChains",
    "ElasticRobot",
    "IdentificationError",
    "IdentificationWarning",
    "InvalidInput",
    "LinearModel",
    "NoEquilibrium",
    "NotIdentifiable",
    "Parameters",
    "RelativeNoise",
    "SolverFailed",
    "SpringNetwork",
    "anti_resonances",
    "builtin_robots",
    "clamped",
    "damped_modes",
    "frequency_response",
    "linearize",
    "load_robot",
    "resonances",
    "rigid_modes",
    "sensitivity",
]
