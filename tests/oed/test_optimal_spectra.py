"""Which motor shakes on which line, against one convex problem and random spectra."""

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import OptimizeResult, linprog

import oed
from oed.design import spectral_oracle
from oed.design.spectral_oracle import SpectralOracle
from robotmodels import (
    ElasticRobot,
    ExcitationNoise,
    InputOutputNoise,
    InvalidInput,
    SolverFailed,
    WithParameters,
    frequency_response,
    load_robot,
    sensitivity,
)
from robotmodels.description.robot_file import Fitted

ROBOT = load_robot("manutec_r3")
TORQUE = np.array([9.0, 9.0, 9.0, 1.9, 2.0, 0.65])
LINES = 10
OMEGA = 2 * np.pi * np.linspace(4.0, 40.0, LINES)
POSITIONS = np.random.default_rng(2).uniform(-1, 1, (2, 6))
NOISE = InputOutputNoise.of_levels(TORQUE, LINES, 0.05, speed=2e-3)
CAP = 2.0
UNITS = np.outer(TORQUE, TORQUE)


def designed(**options):
    arguments = {"line_cap": CAP} | options
    robot = arguments.pop("robot", ROBOT)
    return oed.optimal_spectra(robot, POSITIONS, OMEGA, NOISE, TORQUE, **arguments)


def white_sensitivities(robot=ROBOT):
    G, J = sensitivity(robot, POSITIONS, OMEGA, equilibrium_shift=False)
    L = np.linalg.cholesky(NOISE.output_error(robot.network(POSITIONS), G, OMEGA))
    A = np.linalg.solve(L, J.reshape(*J.shape[:3], -1)).reshape(J.shape)
    return G, A * TORQUE[:, None]


def one_problem(full, speed=None, order=1):
    """log det over shares times spectral matrices of all positions and lines at once."""
    G, A = white_sensitivities()
    flat = np.einsum("qfmip,qfmir->pr", A.conj(), A).real
    root = np.linalg.cholesky(flat)
    A = A @ np.linalg.inv(root).T
    M, rules, shares = 0, [], cp.Variable(len(POSITIONS), nonneg=True)
    use = fast = None
    for q, k in np.ndindex(len(POSITIONS), LINES):
        s = np.zeros((0, 6)) if speed is None else G[q, k] * TORQUE / OMEGA[k] ** order / speed
        if full:
            X = cp.Variable((6, 6), hermitian=True)
            products = np.einsum("mia,mjb->abji", A[q, k].conj(), A[q, k]).reshape(36, 36)
            part, power = cp.real(products @ cp.vec(X, order="C")), cp.real(cp.diag(X))
            moved = cp.real(cp.diag(s @ X @ s.conj().T)) if len(s) else None
            rules.append(X >> 0)
        else:
            power = cp.Variable(6, nonneg=True)
            part = np.einsum("mia,mib->abi", A[q, k].conj(), A[q, k]).real.reshape(36, 6) @ power
            moved = np.abs(s) ** 2 @ power if len(s) else None
        M = M + 2 * cp.reshape(part, (6, 6), order="C")
        rules.append(cp.sum(power) <= CAP * 6 / LINES * shares[q])
        use = power if k == 0 else use + power
        fast = moved if k == 0 or moved is None else fast + moved
        if k == LINES - 1:
            rules.append(use <= shares[q])
            rules += [] if fast is None else [fast <= shares[q]]
    rules.append(cp.sum(shares) == 1)
    value = cp.Problem(cp.Maximize(cp.log_det(0.5 * (M + M.T))), rules).solve(cp.CLARABEL)
    return value + 2 * np.log(np.diag(root)).sum()


def check_limits(design, speed=None, order=1):
    power = np.einsum("kfii->ki", design.spectra).real
    assert (power <= TORQUE**2 * (1 + 1e-9)).all()
    traces = np.einsum("kfii->kf", design.spectra / UNITS).real
    assert traces.max() <= CAP * 6 / LINES * (1 + 1e-9)
    if speed is not None:
        G = frequency_response(ROBOT, design.positions, OMEGA)
        moved = np.einsum("kfji,kfil,kfjl->kfj", G, design.spectra, G.conj()).real
        times = OMEGA[:, None] ** order
        assert (moved / times**2).sum(axis=1).max() <= speed**2 * (1 + 1e-9)
        run = np.abs(np.einsum("kfji,kfi->kfj", G, design.torques) / times) ** 2
        assert run.sum(axis=1).max() <= speed**2 * (1 + 1e-9)
    assert np.linalg.eigvalsh(design.spectra).min() > -1e-9


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("full", "speed"),
    [
        (False, None),
        (False, 3.0),
        pytest.param(True, None, marks=SLOW),
    ],
)
def test_spectra_are_those_of_one_convex_problem(full, speed):
    design = designed(full=full, speed=np.inf if speed is None else speed)
    assert 0 <= design.gap <= (1e-5 if full else 1e-6)
    assert design.value == pytest.approx(one_problem(full, speed), abs=2e-5 * 6)
    check_limits(design, speed)
    # Their information by the public way.
    total = sum(
        share * oed.information(ROBOT, q[None], OMEGA, ExcitationNoise(Phi, NOISE)).matrices[0]
        for share, q, Phi in zip(design.weights, design.positions, design.spectra, strict=True)
    )
    np.testing.assert_allclose(total, design.information, rtol=1e-7, atol=1e-7 * total.max())


def test_swings_are_limited_like_speeds():
    """Deflections G U/(j omega)^2 are linear in Phi as speeds are: same certificate."""
    free = designed()
    G = frequency_response(ROBOT, free.positions, OMEGA)
    moved = np.einsum("kfji,kfil,kfjl->kfj", G, free.spectra, G.conj()).real
    swing = 0.3 * np.sqrt((moved / OMEGA[:, None] ** 4).sum(axis=1).max())
    design = designed(swing=swing)
    assert 0 <= design.gap <= 1e-6
    assert design.value < free.value - 0.1
    assert design.value == pytest.approx(one_problem(False, swing, order=2), abs=2e-5 * 6)
    check_limits(design, swing, order=2)


@SLOW
def test_phases_are_chosen_within_speeds_too():
    slow, fast = (designed(full=True, speed=v, tolerance=1e-3) for v in (2.0, 3.0))
    assert 0 <= slow.gap <= 1e-3
    check_limits(slow, 2.0)
    assert slow.value < fast.value


def test_choosing_motors_and_phases_pays():
    """The order of the published gains: flat < per motor < all phases; one run loses little."""
    per_motor, full = designed(), designed(full=True, tolerance=1e-3)
    assert per_motor.flat_efficiency < 0.5
    assert full.value >= per_motor.value - 6e-3
    assert full.run_efficiency > 0.85
    assert per_motor.run_efficiency > 0.4
    assert "flat ones keep" in str(full)
    # With a trace of the flat level and one motor's price alone nothing is left to choose.
    assert designed(line_cap=1.0).value <= per_motor.value + 1e-6


def test_single_runs_are_excitations():
    design = designed()
    table = oed.experiment_candidates(
        ROBOT, design.positions, design.excitations, OMEGA, NOISE, torque=TORQUE, periods=1
    )
    k = len(design.support)
    own = table.information.matrices.reshape(k, k, 6, 6)[np.arange(k), np.arange(k)]
    reached = np.tensordot(design.weights, own, axes=1)
    gain = np.linalg.slogdet(reached).logabsdet - design.value
    assert np.exp(gain / 6) == pytest.approx(design.run_efficiency)


@pytest.mark.parametrize("seed", range(3))
def test_no_spectrum_exceeds_the_bounds_of_the_oracle(seed):
    rng = np.random.default_rng(seed)
    R = rng.standard_normal((LINES, 6, 8)) + 1j * rng.standard_normal((LINES, 6, 8))
    prices = R @ np.conj(np.swapaxes(R, 1, 2)) * np.exp(rng.standard_normal((LINES, 1, 1)))
    speeds = rng.standard_normal((2, LINES, 6)) + 0j
    for full in (False, True):
        oracle = SpectralOracle(1.5, full, 1e-6)
        bound, X = oracle.solve(prices, speeds)
        value = np.einsum("fij,fji->", prices, X).real
        assert value <= bound <= value * (1 + 1e-6)
        assert bound <= oracle.quick_bounds(prices[None])[0] * (1 + 1e-9)
        for _ in range(50):
            U = rng.standard_normal((LINES, 6, 6)) * rng.exponential(size=(LINES, 1, 6))
            U = U + 1j * rng.standard_normal(U.shape)
            Y = U @ np.conj(np.swapaxes(U, 1, 2))
            Y = Y if full else Y * np.eye(6)
            use = max(
                np.einsum("fii->i", Y).real.max(),
                np.einsum("fii->f", Y).real.max() / 1.5,
                np.einsum("rfi,fij,rfj->r", speeds, Y, speeds.conj()).real.max(),
            )
            assert np.einsum("fij,fji->", prices, Y).real / use <= bound * (1 + 1e-9)


def test_linear_programs_without_an_answer_are_tried_otherwise(monkeypatch):
    """HiGHS has none to its tightest tolerances at times; bounds hold by any multipliers."""
    tight = designed()

    def without_some(*args, options, **others):
        solution = linprog(*args, options=options, **others)
        if options["dual_feasibility_tolerance"] < 1e-9:
            solution.x = None
        return solution

    monkeypatch.setattr(spectral_oracle, "linprog", without_some)
    loose = designed(tolerance=1e-5)
    assert loose.value == pytest.approx(tight.value, abs=1e-4)
    assert 0 <= loose.gap <= 1e-5
    monkeypatch.setattr(
        spectral_oracle, "linprog", lambda *_, **__: OptimizeResult(x=None, message="-")
    )
    with pytest.raises(SolverFailed, match="HiGHS: -"):
        designed()


def test_spectra_averaged_over_the_prior_are_those_of_samples():
    rng = np.random.default_rng(4)
    values = ROBOT.parameters.values * np.exp(0.5 * rng.standard_normal((2, 6)))
    robots = [ROBOT, *(WithParameters(ROBOT, one) for one in values)]
    design = designed(robot=robots)
    assert design.information.shape == (3, 6, 6)
    assert 0 <= design.gap <= 1e-6
    check_limits(design)
    alone = designed()
    assert np.linalg.slogdet(design.information).logabsdet[0] <= alone.value + 1e-6
    # What a design at the guesses is worth on average is less.
    kept = []
    for robot in robots:
        parts = [
            share * oed.information(robot, q[None], OMEGA, ExcitationNoise(Phi, NOISE)).matrices[0]
            for share, q, Phi in zip(alone.weights, alone.positions, alone.spectra, strict=True)
        ]
        kept.append(np.linalg.slogdet(sum(parts)).logabsdet)
    assert np.mean(kept) <= np.linalg.slogdet(design.information).logabsdet.mean() + 1e-6


def test_spectra_at_worst_over_samples_are_those_of_one_convex_problem():
    """max_P min_k log det M_k(P) / p less that of the best spectra of sample k."""
    robots = [WithParameters(ROBOT, f * ROBOT.parameters.values) for f in (0.6, 1.5)]
    design = designed(robot=robots, kind="maximin")
    assert 0 <= design.gap <= 1e-6
    samples = [white_sensitivities(robot)[1] for robot in robots]
    power = cp.Variable((2 * LINES, 6), nonneg=True)
    shares = cp.Variable(2, nonneg=True)
    rules = [cp.sum(shares) == 1]
    for q in range(2):
        own = power[q * LINES : (q + 1) * LINES]
        rules += [
            cp.sum(own, axis=0) <= shares[q],
            cp.sum(own, axis=1) <= CAP * 6 / LINES * shares[q],
        ]
    values = []
    for A in samples:
        root = np.linalg.cholesky(np.einsum("qfmip,qfmir->pr", A.conj(), A).real)
        A = A @ np.linalg.inv(root).T
        parts = 2 * np.einsum("qfmia,qfmib->abqfi", A.conj(), A).real.reshape(36, -1)
        M = cp.reshape(parts @ cp.vec(power, order="C"), (6, 6), order="C")
        values.append(cp.log_det(0.5 * (M + M.T)) + 2 * np.log(np.diag(root)).sum())
    best = [cp.Problem(cp.Maximize(value), rules).solve(cp.CLARABEL) for value in values]
    worst = cp.minimum(*(value - one for value, one in zip(values, best, strict=True)))
    expected = cp.Problem(cp.Maximize(worst), rules).solve(cp.CLARABEL)
    reached = np.linalg.slogdet(design.information).logabsdet - best
    assert reached.min() == pytest.approx(expected, abs=1e-4)
    average = designed(robot=robots)
    assert (np.linalg.slogdet(average.information).logabsdet - best).min() <= reached.min() + 1e-5


def test_guesses_are_refused_and_fitted_values_are_not():
    names = ROBOT.parameters.names
    guess = ROBOT.file.model_copy(update={"guessed": {names[0]: 0.5}})
    robot = ElasticRobot(guess, ROBOT.folder)
    with pytest.raises(InvalidInput, match=r"file has guesses of g1\.stiffness, .* fit first, or"):
        designed(robot=robot)
    samples = [WithParameters(robot, f * robot.parameters.values) for f in (0.7, 1.4)]
    assert designed(robot=samples).gap <= 1e-6
    fitted = guess.model_copy(update={"fitted": Fitted(relative_std={names[0]: 0.01})})
    assert designed(robot=ElasticRobot(fitted, ROBOT.folder)).gap <= 1e-6


def test_the_same_motion_measured_as_speeds_has_the_same_spectra():
    file = ROBOT.file.model_copy(update={"output": "velocity"})
    design = designed(robot=ElasticRobot(file, ROBOT.folder), speed=3.0)
    assert design.value == pytest.approx(designed(speed=3.0).value, abs=1e-5)


def test_targets_and_prior_information():
    targets = oed.TargetCriterion({"stiffness": 0.01, "damping": 0.05})
    design = designed(criterion=targets)
    assert 0 <= design.gap <= 1e-6
    prior = 1e3 * np.eye(6)
    informed = designed(prior=prior)
    assert informed.value > designed().value


def test_extra_parameters_take_the_general_way():
    class Hidden:
        """The same robot, whose parameters are not known to act through springs alone."""

        parameters = ROBOT.parameters

        def network(self, positions, parameters=None):
            return ROBOT.network(positions, parameters)

        def linearization(self, positions, parameters=None, *, equilibrium_shift=True):
            return ROBOT.linearization(positions, parameters, equilibrium_shift=True)

        def tangents(self, positions, parameters=None, *, equilibrium_shift=True):
            return ROBOT.tangents(positions, parameters)

    assert designed(robot=Hidden()).value == pytest.approx(designed().value, abs=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": []}, "robot: no sample given"),
        ({"line_cap": 0.5}, "line_cap: 0.5; flat spectra need 1"),
        ({"speed": -1.0}, "speed: -1.0; positive numbers"),
        ({"speed": [1.0, 2.0]}, r"speed: shape \(2,\)"),
        ({"tolerance": 0.0}, "tolerance: 0.0"),
        ({"max_rounds": 0}, "max_rounds: 0"),
        ({"swing": 0.0}, "swing: 0.0; positive numbers"),
        ({"kind": "worst"}, "kind 'worst' is unknown"),
    ],
)
def test_spectra_that_do_not_fit(change, message):
    with pytest.raises(InvalidInput, match=message):
        designed(**change)


def test_positions_and_torques_that_do_not_fit():
    with pytest.raises(InvalidInput, match="positions: none given"):
        oed.optimal_spectra(ROBOT, np.zeros((0, 6)), OMEGA, NOISE, TORQUE)
    with pytest.raises(InvalidInput, match="torque: inf; positive numbers"):
        oed.optimal_spectra(ROBOT, POSITIONS, OMEGA, NOISE, np.inf)
