"""What the robot is: elastic models, their equilibria, FRFs and sensitivities.

Names are loaded when used, so that ``import robotmodels`` stays fast.
"""

from typing import TYPE_CHECKING

from robotmodels.common.errors import (
    IdentificationError,
    IdentificationWarning,
    InvalidInput,
    NoEquilibrium,
    NotIdentifiable,
    SolverFailed,
)
from robotmodels.common.lazy_exports import loaded_when_used

if TYPE_CHECKING:
    from robotmodels.collision.obstacles import Box, Plane, Sphere
    from robotmodels.collision.surroundings import Surroundings, surroundings
    from robotmodels.common.process_pool import ProcessPool
    from robotmodels.description.parameters import Parameters
    from robotmodels.elastic.robot import ElasticRobot
    from robotmodels.library import builtin_robots, load_robot
    from robotmodels.linear.chain_responses import (
        chain_response,
        constrained_response,
        modally_damped,
        position_controlled,
    )
    from robotmodels.linear.coupled_chains import CoupledChains
    from robotmodels.linear.derived_models import AtValues
    from robotmodels.linear.linear_model import LinearModel
    from robotmodels.linear.modes import (
        anti_resonances,
        clamped,
        damped_modes,
        resonances,
        rigid_modes,
    )
    from robotmodels.linear.noise import NoiseLaw, RelativeNoise
    from robotmodels.linear.residuals import ResidualForm
    from robotmodels.linear.response import frequency_response, linearize, sensitivity
    from robotmodels.linear.spring_network import SpringNetwork
    from robotmodels.records.records import Records, iterate_records, save_records
    from robotmodels.simulation.controller import Controller, default_controller
    from robotmodels.simulation.imperfections import Imperfections
    from robotmodels.simulation.linear_simulation import simulate_linear
    from robotmodels.simulation.loop_noise import ClosedLoopNoise
    from robotmodels.simulation.simulate import simulate

_HOMES = {
    "AtValues": "linear.derived_models",
    "Box": "collision.obstacles",
    "ClosedLoopNoise": "simulation.loop_noise",
    "Controller": "simulation.controller",
    "CoupledChains": "linear.coupled_chains",
    "ElasticRobot": "elastic.robot",
    "Imperfections": "simulation.imperfections",
    "LinearModel": "linear.linear_model",
    "NoiseLaw": "linear.noise",
    "Parameters": "description.parameters",
    "Plane": "collision.obstacles",
    "ProcessPool": "common.process_pool",
    "Records": "records.records",
    "RelativeNoise": "linear.noise",
    "ResidualForm": "linear.residuals",
    "Sphere": "collision.obstacles",
    "SpringNetwork": "linear.spring_network",
    "Surroundings": "collision.surroundings",
    "anti_resonances": "linear.modes",
    "builtin_robots": "library",
    "chain_response": "linear.chain_responses",
    "clamped": "linear.modes",
    "constrained_response": "linear.chain_responses",
    "damped_modes": "linear.modes",
    "default_controller": "simulation.controller",
    "frequency_response": "linear.response",
    "iterate_records": "records.records",
    "linearize": "linear.response",
    "load_robot": "library",
    "modally_damped": "linear.chain_responses",
    "position_controlled": "linear.chain_responses",
    "resonances": "linear.modes",
    "rigid_modes": "linear.modes",
    "save_records": "records.records",
    "sensitivity": "linear.response",
    "simulate": "simulation.simulate",
    "simulate_linear": "simulation.linear_simulation",
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
    "NoiseLaw",
    "NotIdentifiable",
    "Parameters",
    "Plane",
    "ProcessPool",
    "Records",
    "RelativeNoise",
    "ResidualForm",
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
