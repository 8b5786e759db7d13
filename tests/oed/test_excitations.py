"""Information of positions and excitations, against derivatives of FRFs and against fits."""

import numpy as np
import pytest

import oed
from estimators import RunSpectra, covariance, fit
from robotmodels import (
    ElasticRobot,
    ErrorCovariance,
    ExcitationNoise,
    InputOutputNoise,
    InvalidInput,
    RelativeNoise,
    load_robot,
    sensitivity,
)
from robotmodels.kernel import rank_one_sensitivity

TORQUE = np.array([9.0, 9.0, 9.0, 1.9, 2.0, 0.65])
LINES = 24
OMEGA = 2 * np.pi * np.linspace(3.1, 47.3, LINES)
ROBOT = load_robot("manutec_r3")
POSITIONS = np.random.default_rng(1).uniform(-1, 1, (3, 6))
NOISE = InputOutputNoise.of_levels(TORQUE, LINES, 0.05, speed=2e-2)
FAMILIES = ["orthogonal", "zippered", "random_phase", "single_motors"]


def some_candidates(excitations=FAMILIES, **options):
    return oed.experiment_candidates(
        ROBOT, POSITIONS, excitations, OMEGA, NOISE, torque=TORQUE, **options
    )


def far(matrices, expected):
    """Return the largest difference of entries, in units of the roots of the diagonals."""
    d = np.sqrt(np.einsum("...aa->...a", expected))
    return np.abs((matrices - expected) / (d[..., :, None] * d[..., None, :])).max()


def hermitian(rng, rank=2):
    U = rng.standard_normal((LINES, 6, rank)) + 1j * rng.standard_normal((LINES, 6, rank))
    U *= TORQUE[:, None] / np.sqrt(2 * rank * LINES)
    return U @ np.conj(np.swapaxes(U, 1, 2))


@pytest.mark.parametrize("seed", range(3))
def test_information_against_derivatives_of_frfs(seed):
    """H_ab = 2 sum_k Re tr(J_a^H inv(Lambda_y) J_b Phi), errors of torques in Lambda_y."""
    user = oed.UserSpectrum(hermitian(np.random.default_rng(seed)), run_count=2)
    table = some_candidates([*FAMILIES, user], periods=3)
    G, J = sensitivity(ROBOT, POSITIONS, OMEGA, equilibrium_shift=False)
    spread = np.zeros((len(G), LINES, 6, 6), dtype=complex)
    spread[..., range(6), range(6)] = (OMEGA[:, None] * 2e-2) ** 2
    spread += np.einsum("qfij,j,qflj->qfil", G, (0.05 * TORQUE) ** 2 / LINES, G.conj())
    inverse = np.linalg.inv(spread)
    spectra = [one.spectrum(TORQUE, LINES) for one in table.excitations]
    expected = 2 * np.einsum(
        "qfmia,qfml,qfljb,efji->eqab", J.conj(), inverse, J, spectra, optimize=True
    )
    matrices = table.information.matrices.reshape(len(spectra), 3, 6, 6)
    assert far(matrices, 3 * expected.real) < 1e-12
    single = [oed.information(ROBOT, POSITIONS, OMEGA, ExcitationNoise(P, NOISE)) for P in spectra]
    assert far(matrices, 3 * np.array([one.matrices for one in single])) < 1e-12


def test_families_have_their_torque_and_their_runs():
    table = some_candidates()
    assert [one.name for one in table.excitations] == FAMILIES[:3] + [
        f"motor {i}" for i in range(1, 7)
    ]
    for one in table.excitations:
        Phi = one.spectrum(TORQUE, LINES)
        power = np.einsum("fii->i", Phi).real / one.runs(6)
        shaken = power > 0
        np.testing.assert_allclose(power[shaken], TORQUE[shaken] ** 2)
        ranks = np.linalg.matrix_rank(Phi, hermitian=True)
        assert ranks.max() <= one.runs(6)
        assert shaken.sum() == (1 if one.name.startswith("motor") else 6)
    owners = oed.Zippered(first=2).owners(6, LINES)
    assert (owners.sum(axis=1) == 1).all()
    assert owners[0, 2]
    assert owners[4, 0]


def test_zippered_lines_leave_detection_lines_free():
    grid = oed.band_multisine(
        1000, 1e-3, (20.0, 600.0), inputs=6, detection_group=4, rng=np.random.default_rng(3)
    )
    assert (grid.lines % 2 == 1).all()
    assert len(grid.detection)
    owners = oed.Zippered().owners(6, len(grid.lines))
    counts = owners.sum(axis=0)
    assert counts.max() - counts.min() <= 1


def test_runs_of_orthogonal_phases_add_up_to_the_orthogonal_matrix():
    """The multisines that are sent: their spectra, run by run, sum to Phi."""
    grid = oed.Multisine(200, 1e-3, np.arange(1, 2 * LINES, 2), 6)
    grid = grid.with_amplitudes(np.sqrt(2 / LINES) * TORQUE[None])
    phases = oed.random_phases(grid, 1, rng=np.random.default_rng(0))[0]
    U = grid.spectrum(phases) * np.sqrt(2) / grid.samples
    Phi = U @ np.conj(np.swapaxes(U, 1, 2))
    np.testing.assert_allclose(Phi, oed.Orthogonal().spectrum(TORQUE, LINES), atol=1e-12)


def test_a_second_measured_with_all_lines_is_worth_the_same():
    """Published rates: one run of a zipper or of random phases against one of n orthogonal ones."""
    lines = 360
    omega = 2 * np.pi * (2 + 0.2 * np.arange(lines))
    noise = InputOutputNoise.of_levels(TORQUE, lines, 0.05, speed=2e-2)
    table = oed.experiment_candidates(
        ROBOT, POSITIONS, FAMILIES[:2], omega, noise, torque=TORQUE, periods=1
    )
    orthogonal, zippered = table.information.matrices.reshape(2, 3, 6, 6)
    ratio = np.linalg.det(6 * zippered / orthogonal.max()) / np.linalg.det(
        orthogonal / orthogonal.max()
    )
    np.testing.assert_allclose(ratio ** (1 / 6), 1.0, atol=0.1)


def test_candidates_are_visits_with_durations(tmp_path):
    timing = oed.VisitTiming(period=2.0, transient=1.0, settle=3.0, move=4.0)
    table = some_candidates(FAMILIES[:2], periods=(1, 4), timing=timing)
    assert len(table) == len(table.information) == 2 * 2 * 3
    assert table.duration.tolist() == [25.0] * 3 + [10.0] * 3 + [61.0] * 3 + [16.0] * 3
    q, excitation, periods = table.visit(3 * 3 + 1)
    assert (q, excitation.name, periods) == (1, "zippered", 4)
    stored = some_candidates(FAMILIES[:2], periods=(1, 4), store=tmp_path / "store", chunk=2)
    one = some_candidates(FAMILIES[:2], periods=1)
    assert isinstance(one.information, oed.InformationSet)
    expected = np.concatenate([one.information.matrices, 4 * one.information.matrices])
    W = hermitian(np.random.default_rng(0), 6)[0].real
    weights = np.random.default_rng(1).uniform(0, 1, 12)
    for info in (table.information, stored.information):
        assert info.names == ROBOT.parameters.names
        assert info.samples == 1
        np.testing.assert_allclose(info.take(np.arange(12)), expected, rtol=1e-12)
        traces = np.einsum("qab,ab->q", expected, W)
        np.testing.assert_allclose(info.directional_derivatives(W), traces, rtol=1e-9)
        total = np.einsum("q,qab->ab", weights, expected)
        np.testing.assert_allclose(info.combined(weights), total, rtol=1e-9)
    assert str(table) == "12 visits: 3 positions, orthogonal, zippered, 1, 4 periods, 10 to 61 s"


def test_minutes_are_a_budget_of_the_relaxed_design():
    """A minute in one motor alone tells less: under equal torques such visits get no weight."""
    table = some_candidates(["orthogonal", "single_motors"], periods=2)
    limits = oed.Constraints(time=600.0, durations=table.duration)
    design = oed.optimal_design(table.information, "D", limits, solver="newton")
    assert design.gap <= 1e-6
    assert design.weights @ table.duration == pytest.approx(600.0)
    assert {table.visit(i)[1].name for i in design.support} == {"orthogonal"}


@pytest.mark.parametrize("quantity", ["velocity", "position"])
def test_information_is_that_of_what_the_same_motion_is_measured_as(quantity):
    """The noise is a speed's, whether angles, speeds or accelerations are what is measured."""
    file = ROBOT.file.model_copy(update={"output": quantity})
    other = ElasticRobot(file, ROBOT.folder)
    expected = some_candidates(["zippered"]).information.matrices
    table = oed.experiment_candidates(other, POSITIONS, ["zippered"], OMEGA, NOISE, torque=TORQUE)
    assert far(table.information.matrices, expected) < 1e-11


def test_estimated_covariances_are_a_noise_too():
    declared = NOISE.covariance(OMEGA, 6, 6)
    table = oed.experiment_candidates(
        ROBOT, POSITIONS, ["random_phase"], OMEGA, ErrorCovariance(declared), torque=TORQUE
    )
    expected = some_candidates(["random_phase"]).information.matrices
    assert far(table.information.matrices, expected) < 1e-12


@pytest.mark.parametrize("name", ["manutec_r3", "ur10"])
def test_rank_one_factors_are_the_derivatives(name):
    robot = load_robot(name)
    network = robot.network(POSITIONS[:2])
    G, J = network.sensitivity(OMEGA)
    for factors in (network.rank_one_sensitivity(OMEGA), rank_one_sensitivity(network, OMEGA)):
        response, y, v, w = factors
        np.testing.assert_allclose(response, G, rtol=1e-9, atol=1e-12 * np.abs(G).max())
        product = np.einsum("qfmt,qfnt,qftp->qfmnp", y, v, w)
        scale = np.abs(J).max(axis=(0, 2, 3), keepdims=True)
        assert np.abs((product - J) / scale).max() < 1e-9


def fitted(excitation, runs, seed):
    """Return standardised errors of a fit to simulated runs, and its claimed deviations."""
    rng = np.random.default_rng(seed)
    positions = POSITIONS[:2]
    G, _ = sensitivity(ROBOT, positions, OMEGA)
    values, vectors = np.linalg.eigh(excitation.spectrum(TORQUE, LINES))
    U = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None])[:, :, -runs:]
    truth = np.concatenate([G @ U, np.broadcast_to(U, (2, *U.shape))], axis=2)
    C = NOISE.covariance(OMEGA, 6, 6)
    spread = np.sqrt(np.einsum("fii->fi", C).real / 2)[:, :, None]
    noise = rng.standard_normal(truth.shape) + 1j * rng.standard_normal(truth.shape)
    data = np.moveaxis(truth + spread * noise, 3, 1)
    runs = RunSpectra(
        positions, OMEGA, data[..., 6:], data[..., :6], np.broadcast_to(C, (2, *C.shape))
    )
    estimate = fit(ROBOT, runs)
    return np.log(estimate.parameters.values / ROBOT.parameters.values), covariance(
        estimate
    ).covariance


def scatter(excitation, runs, count):
    table = oed.experiment_candidates(
        ROBOT, POSITIONS[:2], [excitation], OMEGA, NOISE, torque=TORQUE, periods=1
    )
    information = table.information.matrices.sum(axis=0)
    errors, claimed = zip(*(fitted(excitation, runs, seed) for seed in range(count)), strict=True)
    distances = np.einsum("ka,ab,kb->k", errors, information, errors) / len(information)
    return distances, information, np.array(claimed)


@pytest.mark.parametrize("excitation", [oed.Zippered(), oed.RandomPhase()])
def test_fits_of_a_single_run_claim_the_designed_information(excitation):
    distances, information, claimed = scatter(excitation, 1, 2)
    assert (distances < 8).all()
    assert far(np.linalg.inv(claimed), information).max() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("excitation", [oed.Zippered(), oed.RandomPhase()])
def test_scatter_of_fits_is_the_designed_one(excitation):
    """Errors have the designed covariance: mean distance 1 +- .06; half the noise must fail."""
    distances, _, _ = scatter(excitation, 1, 200)
    error = np.sqrt(2 / (6 * 200))
    assert abs(distances.mean() - 1) < 4 * error
    assert abs(4 * distances.mean() - 1) > 4 * error


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"excitations": []}, "excitations: none given"),
        ({"excitations": ["ortogonal"]}, "'ortogonal' is unknown.*orthogonal"),
        ({"excitations": [3]}, "3 is neither a name nor an `Excitation`"),
        ({"excitations": [oed.SingleMotor(6)]}, "motor 7: the robot has 6 motors"),
        ({"noise": RelativeNoise()}, "RelativeNoise does not separate errors of torques"),
        ({"noise": InputOutputNoise(np.ones(3))}, r"noise.speed: shape \(3,\)"),
        ({"torque": [1.0, 2.0]}, r"torque: shape \(2,\)"),
        ({"torque": 0.0}, "torque \\[N m\\]: 0.0"),
        ({"periods": 0}, "periods: 0"),
        ({"positions": np.zeros((0, 6))}, "positions: none given"),
        ({"omega": OMEGA[:4], "excitations": ["zippered"]}, "4 lines for 6 motors"),
        (
            {"excitations": [oed.UserSpectrum(np.eye(6)[None] + 0j, 6)]},
            r"user: shape \(1, 6, 6\); \(24, 6, 6\)",
        ),
        ({"chunk": 0}, "chunk: 0 positions"),
    ],
)
def test_candidates_that_do_not_fit(change, message):
    options = {
        "positions": POSITIONS,
        "excitations": ["orthogonal"],
        "omega": OMEGA,
        "noise": NOISE,
    } | change
    with pytest.raises(InvalidInput, match=message):
        oed.experiment_candidates(ROBOT, **options)


def test_spectra_and_noise_that_are_none():
    eye = np.eye(2)[None].astype(complex)
    whole = np.broadcast_to(np.eye(6, dtype=complex), (LINES, 6, 6))
    with pytest.raises(InvalidInput, match="line 0 is not Hermitian"):
        oed.UserSpectrum(np.array([[[1.0, 1j], [1j, 1.0]]]))
    with pytest.raises(InvalidInput, match="line 0 is not positive semidefinite"):
        oed.UserSpectrum(-eye, 2)
    with pytest.raises(InvalidInput, match="line 0 takes more runs than 1"):
        oed.UserSpectrum(eye)
    with pytest.raises(InvalidInput, match="shape"):
        oed.UserSpectrum(eye[0])
    with pytest.raises(InvalidInput, match="speed"):
        InputOutputNoise(0.0)
    with pytest.raises(InvalidInput, match="torque"):
        InputOutputNoise(1.0, -1.0)
    with pytest.raises(InvalidInput, match=r"timing: period \[s\]"):
        oed.VisitTiming(period=0.0)
    with pytest.raises(InvalidInput, match=r"spectrum: shape \(1, 2, 2\)"):
        oed.information(ROBOT, POSITIONS, OMEGA, ExcitationNoise(eye, NOISE))
    with pytest.raises(InvalidInput, match=r"a covariance of shape \(1, 2, 2\)"):
        oed.information(ROBOT, POSITIONS, OMEGA, ExcitationNoise(whole, ErrorCovariance(eye)))
