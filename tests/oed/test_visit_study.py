"""Visits as they are written: what their torques are, and what they promise."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from oed.campaign.visit_plan import visit_plan, visit_spectrum, with_relative_phases
from oed.experiment.prepare import controller_of, imperfections_of
from oed.experiment.run_experiment import SimulatedPlant
from oed.visit_study.run_visit_study import run_visit_study
from oed.visit_study.study_file import load_visit_study
from robotmodels import load_robot, sensitivity

TORQUE = [9.0, 9.0, 9.0, 1.9, 2.0, 0.65]
STUDY = {
    "schema": "study/1",
    "robot": "manutec_r3",
    "candidates": {"positions": [[0.2, 0.3, -1.2, 0.4, 0.8, 0.1], [0.5, 0.8, -0.5, 0.4, -0.7, 0]]},
    "noise": {"torque": 0.05, "speed": 0.02},
    "design": {"minutes": 1.5, "curve": [1.5]},
    "multisine": {"band": [4.0, 40.0], "sample_time": 0.002, "period": 1.0},
    "limits": {"torque": TORQUE, "swing": 2e-3},
    "imperfections": {"friction": 0.0, "nonlinear_gears": False},
    "output": "out",
}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY))
    return load_visit_study(path)


@pytest.fixture(scope="module")
def results(study):
    return run_visit_study(study)


@pytest.mark.parametrize("runs", [1, 6])
def test_spectra_of_visits_are_those_of_simulated_torques(study, runs):
    """MuJoCo's records without friction against the linear loop, of one run and orthogonal ones."""
    robot = load_robot("manutec_r3")
    motors = [motor.model_copy(update={"coulomb": 0.0}) for motor in robot.file.motors]
    robot = replace(robot, file=robot.file.model_copy(update={"motors": motors}))
    controller = controller_of(study, robot)
    rng = np.random.default_rng(runs)
    position = np.array(STUDY["candidates"]["positions"][0])
    lines = len(np.arange(4, 41)[np.arange(4, 41) % 2 == 1])
    size = np.array(TORQUE) * np.sqrt(2 / lines)
    torques = size * np.exp(2j * np.pi * rng.uniform(size=(lines, 6)))
    plan = visit_plan(study, robot, position, torques, 1, None, runs=runs).plan
    Phi = visit_spectrum(plan, robot, controller)
    plant = SimulatedPlant(robot, controller, imperfections_of(study, robot), rng)
    torque = plant.measure(plan, 0).torque[0, 0, :, 0]  # (E, N, n)
    U = np.fft.rfft(torque, axis=1)[:, plan.multisine.lines] * np.sqrt(2) / torque.shape[1]
    simulated = np.einsum("efi,efj->fij", U, U.conj())
    scale = np.sqrt(np.einsum("fii,fjj->fij", Phi, Phi).real)
    assert np.median(np.abs(simulated - Phi) / scale) < 0.02
    # Of one run the powers are in the ratios that were requested, of orthogonal ones nearly so.
    ratio = np.einsum("fii->fi", Phi).real / size**2
    spread = np.exp(np.std(np.log(ratio)))
    assert spread < (1 + 1e-9 if runs == 1 else 2.0)


def test_promised_deviations_are_those_of_the_written_visits(results):
    """The sum of 2 Re tr(J_a^H L^-1 J_b Phi) over lines, visits and periods, without the kernel."""
    robot, noise, p = results.robot, results.noise, len(results.names)
    total = np.zeros((p, p))
    for one in results.visits:
        G, J = sensitivity(robot, one.plan.positions, results.omega, equilibrium_shift=False)
        errors = np.einsum("qfmi,i,qfki->qfmk", G, noise.torque**2, G.conj())
        errors += (results.omega * noise.speed)[:, None, None] ** 2 * np.eye(6)
        inverse = np.linalg.inv(errors)
        parts = np.einsum(
            "qfmia,qfmk,qfkjb,fji->ab", J.conj(), inverse, J, one.spectrum, optimize=True
        )
        total += 2 * one.plan.periods * parts.real
    np.testing.assert_allclose(results.std[0], np.sqrt(np.diag(np.linalg.inv(total))), rtol=1e-6)
    assert results.seconds.sum() <= 90
    assert results.seconds.sum() == pytest.approx(results.plan.duration, rel=0.2)


def test_phases_between_motors_are_those_of_a_spectral_matrix():
    rng = np.random.default_rng(0)
    U = rng.standard_normal((5, 3)) + 1j * rng.standard_normal((5, 3))
    Phi = U[:, :, None] * U[:, None, :].conj()
    independent = np.abs(U) * np.exp(2j * np.pi * rng.uniform(size=U.shape))
    related = with_relative_phases(independent, Phi)
    np.testing.assert_allclose(related[:, :, None] * related[:, None, :].conj(), Phi, atol=1e-12)
    diagonal = Phi * np.eye(3)
    assert with_relative_phases(independent, diagonal) is independent
