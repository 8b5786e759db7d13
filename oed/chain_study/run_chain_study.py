"""The case study of [HBH], or one like it: records simulated, gains read off, chains identified."""

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from estimators.chain_dampers.chains_from_records import MeasuredChains, measured_chains
from estimators.chain_dampers.held_responses import HeldResponses, held_responses
from estimators.chains.chain_estimate import ChainEstimate
from estimators.chains.inverse_eigenvalue import LanczosStep, coupled_inertia, lanczos_step
from estimators.chains.inverse_estimate import inverse_estimate
from estimators.chains.modal_model import modal_response
from estimators.chains.pole_zero_spectra import first_components
from estimators.chains.stepwise import masses_in_steps
from oed.chain_study.study_file import ChainStudy, study_chains, study_controller
from oed.experiment.loop_settings import per_motor
from oed.experiment.multisine import band_multisine, random_phases
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.progress import StageProgress, tell
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.records.records import Records
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.linear_simulation import simulate_linear
from robotmodels.simulation.loop_noise import hold_response


@dataclass(frozen=True, eq=False)
class ChainSteps:
    """What [HBH] sections 3.1 and 3.3 get of one chain.

    Attributes
    ----------
    anti_resonances : ndarray, (n,), rad/s
        Square roots of lambda_0, (6).
    first : ndarray, (n + 1,)
        u1 of (13).
    step : LanczosStep
        (14) to (16).
    """

    anti_resonances: Array
    first: Array
    step: LanczosStep


@dataclass(frozen=True, eq=False)
class ChainStudyResults:
    """What a study of coupled chains comes to.

    Attributes
    ----------
    study : ChainStudy
        Its file.
    truth : CoupledChains
        Chains that were simulated.
    controller : Controller
        Position controllers of the motors.
    measured : MeasuredChains
        Identification from the records.
    responses : HeldResponses
        Responses with the other chains locked, and the gains read off them.
    steps : tuple of ChainSteps
        Steps of the paper, chain by chain.
    read_off : ndarray, (k,)
        Masses, springs and couplings by (13) to (22), (7) and (8), from measured poles and zeros
        and the gains read off.
    stepwise : ChainEstimate
        The same from the gains of the fitted modes, no chain locked, with its covariance.
    """

    study: ChainStudy
    truth: CoupledChains
    controller: Controller
    measured: MeasuredChains
    responses: HeldResponses
    steps: tuple[ChainSteps, ...]
    read_off: Array
    stepwise: ChainEstimate

    @property
    def true_values(self) -> Array:
        """Masses, springs and couplings that were simulated, (k,), in the order of the names."""
        t = self.truth
        return self.stepwise.layout.join(t.masses, t.springs, t.couplings)


def run_chain_study(
    study: ChainStudy, folder: Path, progress: StageProgress | None = None
) -> ChainStudyResults:
    """Simulate a study's records into `folder` and identify its chains from them.

    Raises
    ------
    InvalidInput
        If entries of the study do not fit each other, or the data show other modes.
    SolverFailed
        If the position controllers are unstable.
    NotIdentifiable
        If the data leave parameters open.
    """
    truth = study_chains(study.chains)
    motors = tuple(f"motor {i + 1}" for i in range(len(truth.masses)))
    controller = study_controller(study.experiment, motors)
    tell(progress, "records", 0, 0)
    records = simulated_records(study, truth, controller, motors)
    path = folder / "records.h5"
    records.save(path)
    tell(progress, "records", 1, 1)
    measured = measured_chains(path, truth.masses.shape[1], progress=progress)
    modes = measured.identification.modes
    responses = held_responses(records, modes)
    steps = tuple(_steps(modes.omega, zeros) for zeros in modes.zeros)
    stepwise = inverse_estimate(modes, measured.identification.inverse.layout, None, stepwise=True)
    return ChainStudyResults(
        study,
        truth,
        controller,
        measured,
        responses,
        steps,
        _read_off(modes.omega, steps, responses, stepwise),
        stepwise,
    )


def simulated_records(
    study: ChainStudy, truth: CoupledChains, controller: Controller, motors: tuple[str, ...]
) -> Records:
    """Return records of runs that each move one motor, position controllers holding the others."""
    experiment, choice = study.experiment, study.experiment.multisine
    rng = np.random.default_rng(study.seed)
    multisine = band_multisine(
        choice.samples,
        choice.sample_time,
        (2 * np.pi * choice.band[0], 2 * np.pi * choice.band[1]),
        inputs=1,
        count=choice.count,
        spacing=choice.spacing,
        odd=choice.odd,
        detection_group=choice.detection,
        amplitude=lambda omega: (omega / omega[0]) ** choice.slope,
        rng=rng,
    )
    phases = random_phases(multisine, experiment.blocks, rng=rng)
    period = multisine.reference(phases)[:, 0]
    amplitude = per_motor("experiment.amplitude", experiment.amplitude, motors)
    # (blocks, samples, 1) to run i of motor i: (blocks, runs, samples, motors)
    signals = period[:, None] * np.diag(amplitude)[:, None]
    return simulate_linear(
        truth.linear_model(),
        signals,
        controller,
        lines=multisine.lines,
        detection=multisine.detection,
        angle_noise=per_motor("experiment.angle_noise", experiment.angle_noise, motors),
        rng=rng,
        periods=experiment.periods,
        transient=experiment.transient_periods,
    )


def controlled_response(
    results: ChainStudyResults, omega: Array, free: tuple[int, ...]
) -> ComplexArray:
    """Return FRFs (F, M, M) of the fitted modes, all motors but those `free` locked.

    The other motors have the study's sampled controllers, their torque held over a sample.
    """
    modes = results.measured.identification.modes
    G = modal_response(modes.x, modes.layout, omega)
    T = results.controller.sample_time
    feedback = results.controller.feedback(omega) * hold_response(omega, T)[:, None]
    feedback[:, list(free)] = 0.0
    loop = np.eye(G.shape[1]) - G * feedback[:, None, :] / omega[:, None, None] ** 2
    return np.asarray(np.linalg.solve(loop, G))


def _steps(resonances: Array, zeros: Array) -> ChainSteps:
    poles = np.concatenate([[0.0], resonances**2])
    first = first_components(poles, zeros**2)
    return ChainSteps(zeros, first, lanczos_step(poles, first))


def _read_off(
    resonances: Array, steps: tuple[ChainSteps, ...], responses: HeldResponses, like: ChainEstimate
) -> Array:
    """Return theta as in the paper: from poles, zeros, and gains with other chains locked."""
    poles, count = np.concatenate([[0.0], resonances**2]), like.layout.masses
    chains = [
        masses_in_steps(poles, one.first, 1 / high, count, 1 / low, 2)
        for one, high, low in zip(steps, responses.high, responses.low, strict=True)
    ]
    couplings = np.zeros((len(steps), len(steps)))
    for (i, j), gain in zip(combinations(range(len(steps)), 2), responses.cross_low, strict=True):
        couplings[i, j] = coupled_inertia(gain, responses.low[i], responses.low[j])
    masses, springs = (np.array(part) for part in zip(*chains, strict=True))
    return like.layout.join(masses, springs, couplings)
