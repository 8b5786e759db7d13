"""Maximum likelihood with noisy inputs and outputs, against closed forms and simulation."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loop import Bench, bench_records, references, truth
from derivatives import check_gradient, circular
from mass_springs import OMEGA, POSITIONS
from noisy_runs import MODEL, RESPONSE, TRUTH, F, Q, noise_root, noisy_runs

import estimators
from estimators import Prior, RunSpectra, covariance, fit, run_spectra
from estimators.fitting.run_problem import RunProblem
from estimators.frf.spectra import Spectra, spectra
from estimators.input_output.likelihood import RunLikelihood
from estimators.input_output.run_noise import _from_blocks
from estimators.input_output.run_scatter import input_scatter, products, square_spread
from robotmodels import IdentificationWarning, InvalidInput

BOUNDS = np.outer([1e-3, 1e3], TRUTH)
OFF = TRUTH * np.exp(0.1 * np.cos(np.arange(6)))


def problem(data: RunSpectra, row_wise: bool = False) -> RunProblem:
    weighting = "row_wise" if row_wise else "joint"
    return RunProblem(model=MODEL, data=data, weighting=weighting, bounds=BOUNDS)


def cost(one: RunProblem, values: np.ndarray) -> float:
    return float(np.sum(one.evaluate(values)[0] ** 2))


def singular(data: RunSpectra) -> RunSpectra:
    """The same with a covariance of rank 2, as of a loop with exact torques."""
    root = noise_root(0.1, 0.1)[:, :, :2]
    C = root @ np.conj(root.swapaxes(1, 2))
    return replace(data, covariance=np.broadcast_to(C, data.covariance.shape))


@pytest.mark.parametrize("row_wise", [False, True])
@pytest.mark.parametrize("rank", ["full", "singular"])
@pytest.mark.parametrize("runs", [1, 2, 5])
def test_gradients_are_those_of_the_cost(runs: int, rank: str, row_wise: bool) -> None:
    data = noisy_runs(np.random.default_rng(runs), runs, 0.3)
    check_gradient(problem(singular(data) if rank == "singular" else data, row_wise), OFF)


@pytest.mark.parametrize("row_wise", [False, True])
def test_spectra_of_other_numbers_of_runs_are_joined_run_by_run(row_wise: bool) -> None:
    parts = [noisy_runs(np.random.default_rng(runs), runs, 0.3) for runs in (1, 3)]
    joined = RunSpectra.join(parts)
    assert joined.inputs.shape[:2] == (4 * Q, 1)
    np.testing.assert_array_equal(joined.positions[Q : Q + 3], np.repeat(POSITIONS[:1], 3, axis=0))
    one, both = problem(joined, row_wise), [problem(part, row_wise) for part in parts]
    assert cost(one, OFF) == pytest.approx(sum(cost(part, OFF) for part in both), rel=1e-12)
    total = sum(part.information(OFF).sum(axis=0) for part in both)
    information = one.information(OFF).sum(axis=0)
    np.testing.assert_allclose(information, total, rtol=1e-9, atol=1e-9 * total.max())
    alike = [parts[1], parts[1]]
    assert RunSpectra.join(alike).inputs.shape[:2] == (2 * Q, 3)
    with pytest.raises(InvalidInput, match="run spectra 1: other lines than those before"):
        RunSpectra.join([parts[0], replace(parts[1], omega=2 * parts[1].omega)])


def test_the_cost_is_the_likelihood_without_the_true_inputs() -> None:
    """V is the least over U0 of what [Y; U] deviates from [G U0; U0], by its covariance."""
    data = noisy_runs(np.random.default_rng(3), 2, 0.4)
    one = problem(data)
    G, _ = one.derived(OFF)
    total = 0.0
    for q in range(Q):
        for f in range(F):
            root = np.linalg.inv(np.linalg.cholesky(data.covariance[q, f]))
            tall = root @ np.vstack([G[q, f], np.eye(2)])
            for e in range(2):
                z = root @ np.concatenate([data.outputs[q, e, f], data.inputs[q, e, f]])
                U0 = np.linalg.lstsq(tall, z)[0]
                total += np.sum(np.abs(z - tall @ U0) ** 2)
                estimated = one.errors(OFF).inputs[q, f, :, e]
                np.testing.assert_allclose(estimated, U0, rtol=1e-9, atol=1e-9)
    assert cost(one, OFF) == pytest.approx(total, rel=1e-11)


def test_with_exact_inputs_and_n_runs_it_is_optimally_weighted_nls() -> None:
    data = noisy_runs(np.random.default_rng(4), 2, input_noise=0.0)
    U, Y = (np.moveaxis(x, 1, 3) for x in (data.inputs, data.outputs))
    inverse = np.linalg.inv(U)
    sigma = data.covariance[..., :2, :2]
    spread = inverse.swapaxes(-1, -2) @ np.conj(inverse)  # Cov(vec(Y U^-1)) = (U U^H)^-T kron Sigma
    full = np.einsum("qfij,qfkl->qfikjl", spread, sigma).reshape(Q, F, 4, 4)
    frf = estimators.FrfEstimate(POSITIONS, OMEGA, Y @ inverse, full, np.ones(Q, dtype=int))
    expected = estimators.fit(MODEL, frf, residual="nls", weights="optimal", tolerance=1e-14)
    fitted = fit(MODEL, data, tolerance=1e-14)
    costs = [cost(one.problem, OFF) for one in (fitted, expected)]
    assert costs[0] == pytest.approx(costs[1], rel=1e-12)
    assert fitted.cost == pytest.approx(expected.cost, rel=1e-12)
    # A Gauss-Newton step from the one estimate to the other.
    values = expected.parameters.values
    steps = [
        -np.linalg.lstsq(J, r)[0]
        for r, J in (f.problem.evaluate(values) for f in (fitted, expected))
    ]
    np.testing.assert_allclose(steps[0], steps[1], rtol=0, atol=1e-10)
    at_once = replace(fitted, parameters=expected.parameters)
    covariances = [covariance(one) for one in (at_once, expected)]
    size = np.outer(covariances[1].std, covariances[1].std)
    difference = covariances[0].covariance - covariances[1].covariance
    assert np.abs(difference / size).max() < 1e-10
    assert fitted.verdict == expected.verdict


def coverage(draw, fit_to, count: int, seed: int):
    """Whether quoted intervals cover, (count, 6), mean cost over its expectation, verdicts."""
    rng = np.random.default_rng(seed)
    covers, costs, verdicts = [], [], []
    for _ in range(count):
        fitted = fit_to(draw(rng))
        ends = np.array([(one.low, one.high) for one in fitted.intervals()], dtype=float)
        if np.isfinite(ends).all():  # questioned fits quote none
            covers.append((ends[:, 0] <= TRUTH) & (ends[:, 1] >= TRUTH))
        costs.append(fitted.cost / fitted.expected_cost)
        verdicts.append(str(fitted.verdict))
    return np.array(covers), np.mean(costs), verdicts


CELLS = [
    (1, 0.3, np.inf, "joint"),
    (2, 0.1, np.inf, "joint"),
    (4, 0.3, np.inf, "row_wise"),
    (1, 0.3, 10, "joint"),
    (4, 0.3, 5, "row_wise"),
]


def check_coverage(cell, count: int, slack: float) -> None:
    runs, noise, freedom, rows = cell
    covers, ratio, verdicts = coverage(
        lambda rng: noisy_runs(rng, runs, noise, freedom=freedom),
        lambda data: fit(MODEL, data, weights=rows),
        count,
        seed=11,
    )
    upper = 0.97 if np.isinf(freedom) else 0.995
    assert 0.93 - slack < covers.mean() < upper + slack
    assert abs(ratio - 1) < 0.02 + slack
    assert np.mean([v == "trustworthy" for v in verdicts]) > 0.95 - slack


@pytest.mark.parametrize("cell", CELLS)
def test_intervals_cover(cell) -> None:
    check_coverage(cell, 25, slack=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS)
def test_intervals_cover_in_400_studies(cell) -> None:
    check_coverage(cell, 400, slack=0.0)


def frozen(data: RunSpectra) -> RunSpectra:
    """The same with Sigma of the true FRF as output noise, torques taken as exact."""
    wide = np.concatenate([np.broadcast_to(np.eye(2), RESPONSE.shape), -RESPONSE], axis=3)
    sigma = wide @ data.covariance @ np.conj(np.swapaxes(wide, -1, -2))
    covariance = np.zeros_like(data.covariance)
    covariance[..., :2, :2] = sigma
    return replace(data, covariance=covariance)


def test_inputs_taken_as_exact_cover_less() -> None:
    """The negative control: noise of the torques biases a fit that does not know of it."""
    rng, shares = np.random.default_rng(12), {"likelihood": [], "frozen": []}
    for _ in range(25):
        data = noisy_runs(rng, 4, 0.3)
        for name, one in (("likelihood", data), ("frozen", frozen(data))):
            fitted = fit(MODEL, one)
            z = np.log(fitted.parameters.values / TRUTH) / covariance(fitted).std
            shares[name].append(np.abs(z) < 1.96)
    assert np.mean(shares["frozen"]) < 0.85
    assert np.mean(shares["likelihood"]) > 0.88


def test_the_covariance_of_outputs_enters_row_by_row() -> None:
    """Correlated rows: the scatter over draws is that of the sandwich."""
    rng = np.random.default_rng(8)
    z = []
    for _ in range(60):
        fitted = fit(MODEL, noisy_runs(rng, 2, 0.1), weights="row_wise")
        z.append(np.log(fitted.parameters.values / TRUTH) / covariance(fitted).std)
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.12)


def test_noise_of_inputs_adds_to_the_scatter() -> None:
    """The information of estimated inputs is H + D on average."""
    rng = np.random.default_rng(9)
    one = problem(noisy_runs(rng, 1, 1.0))
    columns = input_scatter(one.likelihood, one.errors(TRUTH), one.derived(TRUTH)[1])
    D = products(columns, columns)
    U = circular(rng, Q, 1, F, 2)
    Y = np.einsum("qfmn,qefn->qefm", RESPONSE, U)
    root = noise_root(1.0, 0.1)
    normal = np.zeros((400, 6, 6))
    for i in range(400):
        N = np.einsum("fij,qefj->qefi", root, circular(rng, Q, 1, F, 4))
        data = replace(one.data, inputs=U + N[..., 2:], outputs=Y + N[..., :2])
        _, jacobian = problem(data).evaluate(TRUTH)
        normal[i] = 2 * jacobian.T @ jacobian
    exact = replace(one.data, inputs=U, outputs=Y)
    _, jacobian = problem(exact).evaluate(TRUTH)
    H = 2 * jacobian.T @ jacobian
    size = np.sqrt(np.diag(H + D))
    difference = (normal.mean(axis=0) - H - D) / np.outer(size, size)
    assert np.abs(difference).max() < 0.006
    assert np.abs(D / np.outer(size, size)).max() > 0.03


@pytest.mark.parametrize(("setup", "noise"), [
    (Bench(blocks=6, periods=2, noise=3e-6, feedback=40.0), "blocks"),
    (Bench(blocks=1, periods=6, noise=3e-6, feedback=40.0), "periods"),
    (Bench(blocks=1, experiments=1, periods=5, noise=3e-6, feedback=40.0), "periods"),
    (Bench(blocks=2, periods=1, noise=3e-6, feedback=40.0), "detection"),
])  # fmt: skip
def test_spectra_of_records_have_the_noise_that_is_in_them(setup: Bench, noise: str) -> None:
    ratios = []
    for seed in range(12):
        data = run_spectra(bench_records(replace(setup, seed=seed)), delay=setup.delay)
        assert data.noise == noise
        errors = RunLikelihood(data, False).errors(truth(data.omega)[None])
        m, nu = 2, data.degrees_of_freedom[0]
        ratios.append(np.mean(np.abs(errors.whitened) ** 2) * (nu - m) / nu)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("kind", ["amplitudes", "any"])
def test_blocks_have_the_same_noise_in_all_runs_by_any_references(kind: str) -> None:
    """Whitened errors of each column, against the truth: motors are shaken by 1 and by 10."""
    rng = np.random.default_rng(6)
    blocks, F, m, n = 10, 300, 2, 2
    R = np.array([1.0, 10.0])[:, None] * references((blocks, F), rng)
    if kind == "any":
        R = R @ (np.array([[1.0, 0.6], [0.0, 1.0]]) + 0.3 * circular(rng, 2, 2))
    G = circular(rng, F, m, n)
    N = 0.1 * circular(rng, blocks, F, m + n, n)
    Z = np.concatenate([G @ R, R], axis=2) + N
    omega, ones = np.arange(1.0, F + 1), np.ones((blocks, n), dtype=bool)
    U, Y = Z[:, None, :, m:], Z[:, None, :, :m]
    measured = Spectra(omega, R[:, None], U, Y, U[:, :0], Y[:, :0], 0.0, ones)
    noise = _from_blocks(  # reads no records
        measured,
        None,  # type: ignore[arg-type]
        spectra,
        "position 1",
    )
    each = noise.inputs[None], noise.outputs[None], noise.covariance[None]
    nu = noise.degrees_of_freedom
    data = RunSpectra(np.zeros((1, n)), omega, *each, np.array(nu))
    whitened = RunLikelihood(data, False).errors(G[None]).whitened
    size = (np.abs(whitened) ** 2).mean(axis=(0, 1, 2)) * (nu - m) / nu
    np.testing.assert_allclose(size, 1.0, atol=0.2)  # each of 600 complex numbers


def test_what_cannot_be_fitted_is_said() -> None:
    data = noisy_runs(np.random.default_rng(1), 1, freedom=3)
    with pytest.raises(InvalidInput, match="'joint' needs covariances of at least 4 degrees"):
        fit(MODEL, data, weights="joint")
    assert fit(MODEL, data).row_wise
    with pytest.raises(InvalidInput, match="tolerance: nan"):
        fit(MODEL, data, tolerance=np.nan)
    with pytest.raises(InvalidInput, match="weights: 'both' is none of"):
        fit(MODEL, data, weights="both")
    C = data.covariance[..., 1:, 1:]
    fewer = RunSpectra(POSITIONS, OMEGA, data.inputs, data.outputs[..., 1:], C)
    with pytest.raises(
        InvalidInput, match="1 outputs of 2 inputs, not of the model, which has 2 of 2"
    ):
        fit(MODEL, fewer)
    with pytest.raises(InvalidInput, match="degrees_of_freedom: 2; 3 at least"):
        replace(data, degrees_of_freedom=2)
    with pytest.raises(InvalidInput, match="omega: positive rising"):
        replace(data, omega=OMEGA[::-1])
    with pytest.raises(InvalidInput, match="not Hermitian"):
        replace(data, covariance=data.covariance + 1j)
    with pytest.raises(InvalidInput, match="negative eigenvalues at 11 Hz"):
        replace(data, covariance=data.covariance * np.where(np.eye(4), 1.0, 3.0))
    with pytest.raises(InvalidInput, match=r"inputs, outputs: shapes"):
        replace(data, inputs=data.inputs[:, :, :-1])
    with pytest.raises(InvalidInput, match=r"covariance: shape"):
        replace(data, covariance=data.covariance[..., :3, :3])
    with pytest.raises(InvalidInput, match="outputs: finite numbers"):
        replace(data, outputs=data.outputs * np.nan)


def test_records_that_cannot_show_their_noise_are_refused() -> None:
    records = bench_records(Bench(blocks=1, experiments=1, periods=1, noise=1e-6))
    with pytest.raises(InvalidInput, match="position 1: noise 'periods' needs two periods"):
        run_spectra(records, "periods")
    with pytest.raises(InvalidInput, match="position 1: noise 'blocks' needs 2 runs a block"):
        run_spectra(records, "blocks")
    with pytest.raises(InvalidInput, match="noise 'none' is unknown"):
        run_spectra(records, "none")
    missing = records.torque * np.nan, records.angle * np.nan
    with pytest.raises(InvalidInput, match="position 1: run 1 of block 1 is missing; leave the"):
        run_spectra(replace(records, torque=missing[0], angle=missing[1]))
    idle = replace(records, torque=records.torque * [1.0, 0.0])
    with pytest.warns(IdentificationWarning, match="position 1: the torque of motor 2 is constant"):
        run_spectra(idle)


def test_a_prior_counts_as_data() -> None:
    data = noisy_runs(np.random.default_rng(2), 1)
    prior = Prior(("k1",), TRUTH[:1], np.array([1e-6]))
    fitted = fit(MODEL, data, prior=prior)
    assert fitted.parameters.values[0] == pytest.approx(TRUTH[0], rel=1e-5)
    assert covariance(fitted).std[0] == pytest.approx(1e-6, rel=1e-2)
    assert "sml fit: converged" in str(fitted)


@pytest.mark.parametrize("row_wise", [False, True])
def test_the_information_of_positions_is_that_of_the_true_inputs(row_wise: bool) -> None:
    """On average over noise, whatever the model's distance from the fit; E = 2, 50 % noise."""
    clean = noisy_runs(np.random.default_rng(0), 2, 0.0, 1e-9, correlated=False)
    noise = noisy_runs(np.random.default_rng(0), 2, 0.5).covariance
    expected = problem(replace(clean, covariance=noise), row_wise)
    H = expected.information(OFF)
    _, J = expected.derived(OFF)
    root = np.linalg.cholesky(noise)
    drawn = []
    rng = np.random.default_rng(1)
    for _ in range(60):
        N = np.einsum("qfij,qefj->qefi", root, circular(rng, Q, 2, F, 4))
        noisy = replace(
            clean,
            covariance=noise,
            inputs=clean.inputs + N[..., 2:],
            outputs=clean.outputs + N[..., :2],
        )
        drawn.append(problem(noisy, row_wise).information(OFF))
    mean, std = np.mean(drawn, axis=0), np.std(drawn, axis=0) / np.sqrt(len(drawn))
    truth = H + _noise_share(expected, J)
    size = np.sqrt(np.einsum("qi,qj->qij", *[np.einsum("qii->qi", truth)] * 2))
    std = np.maximum(std, 1e-9 * size)  # of a spring and its own damper it is zero
    assert np.abs((mean - truth) / std).max() < 5
    assert np.abs((mean - 1.3 * truth) / std).max() > 5  # so narrow is the test


def _noise_share(one: RunProblem, jacobian: np.ndarray) -> np.ndarray:
    """What `information` takes off for noise of inputs that, here, are clean."""
    errors = one.errors(OFF)
    still = replace(errors, gain=np.zeros_like(errors.gain))
    noise = input_scatter(one.likelihood, still, jacobian)
    return np.stack([products(a, a) for a in noise])


def test_without_noise_of_inputs_the_information_is_the_bread() -> None:
    data = noisy_runs(np.random.default_rng(2), 3, 0.0, 0.1, correlated=False)
    one = problem(data)
    bread = one.sandwich_parts(OFF)[0]
    size = np.sqrt(np.outer(np.diag(bread), np.diag(bread)))
    np.testing.assert_allclose(one.information(OFF).sum(axis=0) / size, bread / size, atol=1e-10)


@pytest.mark.parametrize(("m", "runs", "freedom"), [(1, 1, 10), (1, 4, 10), (2, 2, 12), (3, 1, 14)])
def test_sampled_covariances_widen_sums_of_squares(m: int, runs: int, freedom: int) -> None:
    """tr(A B^-1) of drawn complex Wishart matrices, against known B; 40 000 draws."""
    rng = np.random.default_rng(m + runs)
    errors, noise = circular(rng, 40_000, m, runs), circular(rng, 40_000, m, freedom)
    B = noise @ np.conj(noise.swapaxes(1, 2))
    sums = (np.conj(errors) * np.linalg.solve(B, errors)).real.sum(axis=(1, 2))
    spread = sums.var() / sums.mean() ** 2 * m * runs
    expected = float(square_spread(np.array(freedom), m, runs))
    assert spread == pytest.approx(expected, rel=0.15)
    assert spread > 1.12  # known noise would give one
    assert float(square_spread(np.array(np.inf), m, runs)) == 1.0
