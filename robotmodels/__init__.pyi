from .collision.obstacles import Box as Box, Plane as Plane, Sphere as Sphere
from .collision.surroundings import Surroundings as Surroundings, surroundings as surroundings
from .common.errors import (
    IdentificationError as IdentificationError,
    IdentificationWarning as IdentificationWarning,
    InvalidInput as InvalidInput,
    NoEquilibrium as NoEquilibrium,
    NotIdentifiable as NotIdentifiable,
    SolverFailed as SolverFailed,
)
from .common.process_pool import ProcessPool as ProcessPool
from .description.parameters import Parameters as Parameters
from .elastic.hammer_test import HammerTest as HammerTest
from .elastic.possible_springs import (
    possible_springs as possible_springs,
    with_springs as with_springs,
)
from .elastic.robot import ElasticRobot as ElasticRobot
from .elastic.tool_response import (
    ComplianceEllipsoid as ComplianceEllipsoid,
    Frame as Frame,
    ToolModel as ToolModel,
    compliance_ellipsoid as compliance_ellipsoid,
    tool_frame as tool_frame,
    tool_model as tool_model,
)
from .exports.export import export as export
from .exports.modes import modal_parameters as modal_parameters
from .exports.robot_files import (
    at_recorded_speeds as at_recorded_speeds,
    save_robot as save_robot,
    with_speeds as with_speeds,
    with_values as with_values,
)
from .exports.state_space import StateSpaceModel as StateSpaceModel, state_space as state_space
from .library import builtin_robots as builtin_robots, load_robot as load_robot
from .linear.chain_responses import (
    chain_response as chain_response,
    constrained_response as constrained_response,
    modally_damped as modally_damped,
    position_controlled as position_controlled,
)
from .linear.coupled_chains import CoupledChains as CoupledChains
from .linear.derived_models import WithParameters as WithParameters
from .linear.linear_model import LinearModel as LinearModel
from .linear.modes import (
    anti_resonances as anti_resonances,
    clamped as clamped,
    damped_modes as damped_modes,
    resonances as resonances,
    rigid_modes as rigid_modes,
)
from .linear.noise import (
    ErrorCovariance as ErrorCovariance,
    ExcitationNoise as ExcitationNoise,
    InputOutputNoise as InputOutputNoise,
    NoiseLaw as NoiseLaw,
    RelativeNoise as RelativeNoise,
    RunNoise as RunNoise,
)
from .linear.residuals import ResidualForm as ResidualForm
from .linear.response import (
    frequency_response as frequency_response,
    linearize as linearize,
    sensitivity as sensitivity,
)
from .linear.spring_network import SpringNetwork as SpringNetwork
from .logs.importing import import_movements as import_movements
from .logs.open_log import open_log as open_log
from .logs.periodic import import_records as import_records
from .records.movement import (
    Movement as Movement,
    iterate_movements as iterate_movements,
    save_movements as save_movements,
)
from .records.records import (
    Records as Records,
    iterate_records as iterate_records,
    save_records as save_records,
)
from .simulation.controller import (
    Controller as Controller,
    default_controller as default_controller,
)
from .simulation.determinant_locus import (
    DeterminantLocus as DeterminantLocus,
    determinant_loci as determinant_loci,
)
from .simulation.imperfections import Imperfections as Imperfections
from .simulation.linear_feedback import (
    LinearFeedback as LinearFeedback,
    Notch as Notch,
    linear_feedback as linear_feedback,
)
from .simulation.linear_simulation import simulate_linear as simulate_linear
from .simulation.loop_margins import (
    LoopMargins as LoopMargins,
    loop_margins as loop_margins,
)
from .simulation.loop_noise import ClosedLoopNoise as ClosedLoopNoise
from .simulation.simulate import simulate as simulate
