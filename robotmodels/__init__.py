"""What the robot is: elastic models, their equilibria, FRFs and sensitivities.

Names are loaded when used, so that ``import robotmodels`` stays fast.
"""

from typing import TYPE_CHECKING

from robotmodels.errors import (
    IdentificationError,
    IdentificationWarning,
    InvalidInput,
    NoEquilibrium,
    NotIdentifiable,
    SolverFailed,
)
from robotmodels.lazy_names import loaded_when_used

if TYPE_CHECKING:
    from robotmodels.at_values import AtValues
    from robotmodels.chain_responses import (
        chain_response,
        constrained_response,
        modally_damped,
        position_controlled,
    )
    from robotmodels.chains import CoupledChains
    from robotmodels.collision.obstacles import Box, Plane, Sphere
    from robotmodels.collision.surroundings import Surroundings, surroundings
    from robotmodels.description.parameters import Parameters
    from robotmodels.elastic.robot import ElasticRobot
    from robotmodels.elastic.spring_network import SpringNetwork
    from robotmodels.library import builtin_robots, load_robot
    from robotmodels.linear_model import LinearModel
    from robotmodels.modes import anti_resonances, clamped, damped_modes, resonances, rigid_modes
    from robotmodels.noise import RelativeNoise
    from robotmodels.plant.closed_loop import ClosedLoopNoise
    from robotmodels.plant.controller import Controller, default_controller
    from robotmodels.plant.linear import simulate_linear
    from robotmodels.plant.simulation import Imperfections, simulate
    from robotmodels.process_pool import ProcessPool
    from robotmodels.record_files import iterate_records, save_records
    from robotmodels.records import Records
    from robotmodels.response import frequency_response, linearize, sensitivity

_HOMES = {
    "AtValues": "at_values",
    "Box": "collision.obstacles",
    "ClosedLoopNoise": "plant.closed_loop",
    "Controller": "plant.controller",
    "CoupledChains": "chains",
    "ElasticRobot": "elastic.robot",
    "Imperfections": "plant.simulation",
    "LinearModel": "linear_model",
    "Parameters": "description.parameters",
    "Plane": "collision.obstacles",
    "ProcessPool": "process_pool",
    "Records": "records",
    "RelativeNoise": "noise",
    "Sphere": "collision.obstacles",
    "SpringNetwork": "elastic.spring_network",
    "Surroundings": "collision.surroundings",
    "anti_resonances": "modes",
    "builtin_robots": "library",
    "chain_response": "chain_responses",
    "clamped": "modes",
    "constrained_response": "chain_responses",
    "damped_modes": "modes",
    "default_controller": "plant.controller",
    "frequency_response": "response",
    "iterate_records": "record_files",
    "linearize": "response",
    "load_robot": "library",
    "modally_damped": "chain_responses",
    "position_controlled": "chain_responses",
    "resonances": "modes",
    "rigid_modes": "modes",
    "save_records": "record_files",
    "sensitivity": "response",
    "simulate": "plant.simulation",
    "simulate_linear": "plant.linear",
    "surroundings": "collision.surroundings",
}

__all__ = [
    "AtValues",
    "Box",
    "ClosedLoopNoise",
    "Controller",
    "CoupledChains",
    "ElasticRobot",
    "IdentificationError",
    "IdentificationWarning",
    "Imperfections",
    "InvalidInput",
    "LinearModel",
    "NoEquilibrium",
    "NotIdentifiable",
    "Parameters",
    "Plane",
    "ProcessPool",
    "Records",
    "RelativeNoise",
    "SolverFailed",
    "Sphere",
    "SpringNetwork",
    "Surroundings",
    "anti_resonances",
    "builtin_robots",
    "chain_response",
    "clamped",
    "constrained_response",
    "damped_modes",
    "default_controller",
    "frequency_response",
    "iterate_records",
    "linearize",
    "load_robot",
    "modally_damped",
    "position_controlled",
    "resonances",
    "rigid_modes",
    "save_records",
    "sensitivity",
    "simulate",
    "simulate_linear",
    "surroundings",
]

__getattr__, __dir__ = loaded_when_used(__name__, _HOMES)
