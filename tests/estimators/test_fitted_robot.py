"""The robot of a fit: a file with its values, its standard deviations, and a prior for the next."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from robots import SENSED, built

import estimators
import robotmodels
from estimators import Prior
from robotmodels import InvalidInput, WithParameters

OMEGA = 2 * np.pi * np.geomspace(3.0, 60.0, 20)
NOISE = robotmodels.RelativeNoise(relative=0.03, floor=0.01)


@pytest.fixture(scope="module")
def fit() -> estimators.Fit:
    robot = robotmodels.load_robot("manutec_r3")
    positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])
    rng = np.random.default_rng(3)
    data = estimators.simulate_frf(robot, positions, OMEGA, NOISE, rng)
    return estimators.fit(robot, data, residual="nls", weights="optimal")


def test_a_fit_is_a_robot_file_and_the_next_fits_prior(fit: estimators.Fit, tmp_path: Path) -> None:
    robotmodels.save_robot(fit.robot(), tmp_path / "fitted.yaml")
    robot = robotmodels.load_robot(tmp_path / "fitted.yaml")
    np.testing.assert_array_equal(robot.parameters.values, fit.parameters.values)
    assert robot.file.fitted is not None
    assert robot.file.fitted.verdict == str(fit.verdict)
    assert "2 positions and 20 lines" in robot.file.fitted.provenance["data"]
    prior = estimators.robot_prior(robot)
    assert prior.names == fit.parameters.names
    np.testing.assert_array_equal(prior.values, fit.parameters.values)
    np.testing.assert_array_equal(prior.std, fit.trust.std)
    again = estimators.fit(robot, fit.estimate, residual="nls", weights="optimal", prior=prior)
    np.testing.assert_array_equal(again.start, fit.parameters.values)
    twice = estimators.covariance(again).std / estimators.covariance(fit).std
    np.testing.assert_allclose(twice, np.sqrt(0.5), atol=0.2)


def test_correlations_go_along(fit: estimators.Fit, tmp_path: Path) -> None:
    covariance = estimators.covariance(fit).covariance
    robotmodels.save_robot(fit.robot(covariance=covariance), tmp_path / "fitted.yaml")
    robot = robotmodels.load_robot(tmp_path / "fitted.yaml")
    prior = estimators.robot_prior(robot)
    size = np.sqrt(np.diag(covariance))
    shape = covariance / np.outer(size, size) * np.outer(prior.std, prior.std)
    expected = np.linalg.inv(shape)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(
        prior.information(prior.names), expected, rtol=1e-8, atol=1e-8 * scale
    )
    x = 0.01 * np.arange(6)
    cost = prior.cost(prior.names, fit.parameters.values * np.exp(x))
    np.testing.assert_allclose(cost, x @ expected @ x / 2, rtol=1e-8)
    again = estimators.fit(robot, fit.estimate, residual="nls", weights="optimal", prior=prior)
    estimators.write_fits(tmp_path / "fits.h5", [again])
    (stored,) = estimators.read_fits(tmp_path / "fits.h5", robot, fit.estimate)
    assert stored.prior is not None
    np.testing.assert_array_equal(stored.prior.correlation, prior.correlation)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), r"shape \(3, 3\); finite numbers of shape \(2, 2\)"),
        (np.array([[1.0, 0.2], [0.3, 1.0]]), "a symmetric matrix with ones"),
        (np.array([[1.0, -1.1], [-1.1, 1.0]]), "not positive definite"),
    ],
)
def test_what_is_no_correlation_matrix_is_refused(matrix: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        Prior(("a", "b"), np.ones(2), np.ones(2), matrix)


def test_a_file_with_other_rows_of_correlations_is_refused(
    fit: estimators.Fit, tmp_path: Path
) -> None:
    covariance = estimators.covariance(fit).covariance
    path = tmp_path / "fitted.yaml"
    robotmodels.save_robot(fit.robot(covariance=covariance), path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("  - []\n", "", 1), encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"6 rows with 0 to 5 numbers are needed"):
        robotmodels.load_robot(path)


def test_robots_drawn_from_a_fit(fit: estimators.Fit, tmp_path: Path) -> None:
    covariance = estimators.covariance(fit).covariance
    rng = np.random.default_rng(2)
    files = estimators.export_draws(
        fit, tmp_path / "r3.yaml", "robot", count=40, rng=rng, covariance=covariance
    )
    assert [file.name for file in files[:2]] == ["r3-01.yaml", "r3-02.yaml"]
    values = np.array([robotmodels.load_robot(file).parameters.values for file in files])
    z = np.log(values / fit.parameters.values)
    squares = np.einsum("ij,jk,ik->i", z, np.linalg.inv(covariance), z)
    assert abs(squares.mean() - 6) < 4 * np.sqrt(12 / 40)  # chi^2 of 6 degrees of freedom
    draws = np.log(values)
    (file,) = estimators.export_draws(
        fit, tmp_path / "one.xml", "mjcf", count=1, rng=rng, draws=draws
    )
    mujoco.MjModel.from_xml_path(str(file))
    with pytest.raises(InvalidInput, match="count: 50; there are 40 draws"):
        estimators.export_draws(fit, file, count=50, rng=rng, draws=draws)
    with pytest.raises(InvalidInput, match="one of covariance and draws is needed"):
        estimators.export_draws(fit, file, count=1, rng=rng, covariance=covariance, draws=draws)
    with pytest.raises(InvalidInput, match=r"the variance of g1\.stiffness is -"):
        estimators.export_draws(fit, file, count=1, rng=rng, covariance=-covariance)
    with pytest.raises(InvalidInput, match=r"covariance: shape \(2, 2\)"):
        estimators.export_draws(fit, file, count=1, rng=rng, covariance=np.eye(2))


def test_draws_are_a_table_too_the_same_for_a_seed(fit: estimators.Fit, tmp_path: Path) -> None:
    """Jointly drawn, by what is recommended, as the files beside the table have them."""
    for folder in ("a", "b"):
        files = estimators.export_draws(
            fit, tmp_path / folder / "r3.yaml", "robot", count=3, rng=np.random.default_rng(7),
            table=True,
        )  # fmt: skip
    assert [file.name for file in files] == [
        "r3-1.yaml", "r3-2.yaml", "r3-3.yaml", "r3-draws.csv",
    ]  # fmt: skip
    assert files[-1].read_text() == (tmp_path / "a" / "r3-draws.csv").read_text()
    header, *rows = (line.split(",") for line in files[-1].read_text().splitlines())
    assert header[1].startswith(f"{fit.parameters.names[0]} [")
    values = np.array(rows, dtype=float)[:, 1:]
    stored = [robotmodels.load_robot(file).parameters.values for file in files[:-1]]
    np.testing.assert_allclose(values, stored, rtol=1e-9)
    (alone,) = estimators.export_draws(
        fit,
        tmp_path / "many.xml",
        count=2000,
        rng=np.random.default_rng(7),
        models=False,
        table=True,
    )
    drawn = np.log(np.loadtxt(alone, delimiter=",", skiprows=1)[:, 1:])
    known = estimators.recommended_uncertainty(fit)
    std = drawn.std(axis=0, ddof=1)
    np.testing.assert_allclose(std, known.std, rtol=0.08)
    shape = np.corrcoef(drawn.T)
    np.testing.assert_allclose(shape, known.correlation, atol=0.1)
    assert np.abs(known.correlation - np.eye(6)).max() > 0.15  # independent ranges would not do


def test_parameters_without_an_interval_have_no_standard_deviation(fit: estimators.Fit) -> None:
    trust = fit.trust.not_identifiable({1: "flat"})
    robot = fit.robot(trust)
    names = fit.parameters.names
    assert robot.file.fitted is not None
    assert set(robot.file.fitted.relative_std) == {*names} - {names[1]}
    assert estimators.robot_prior(robot).names == (names[0], *names[2:])


def test_every_kind_of_parameter_goes_into_the_file() -> None:
    robot = built(SENSED)
    values = robot.parameters.values * np.linspace(0.97, 1.03, len(robot.parameters))
    positions = np.array([[0.3, -1.0, 0.8, 0.4, -0.6, 0.2]])
    other = robotmodels.with_values(robot, values)
    expected = robotmodels.frequency_response(robot, positions, OMEGA, values)
    response = robotmodels.frequency_response(other, positions, OMEGA)
    assert np.abs(response - expected).max() < 1e-10 * np.abs(expected).max()
    assert other.file.payload is not None
    assert other.file.payload.mass == values[robot.parameters.index("payload.mass")]
    with pytest.raises(InvalidInput, match="is not a positive number"):
        robotmodels.with_values(robot, -values)


def test_a_fit_of_no_robot_has_none(fit: estimators.Fit) -> None:
    from dataclasses import replace

    start = WithParameters(fit.model, fit.parameters.values * 1.1)
    assert replace(fit, model=start).robot(fit.trust).name == "manutec_r3"
    with pytest.raises(InvalidInput, match="a robot of a robot file is needed"):
        replace(fit, model=object()).robot(fit.trust)


def test_a_robot_file_without_a_fit_is_no_prior() -> None:
    with pytest.raises(InvalidInput, match=r"prior: robot file 'manutec_r3' has no standard dev"):
        estimators.robot_prior(robotmodels.load_robot("manutec_r3"))
