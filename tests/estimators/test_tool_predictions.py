"""Bands of compliances, responses and modes: Monte Carlo coverage, draws, closed forms."""

import numpy as np
import pytest
import yaml
from robots import HERE, PENDULUM, built, changed

import estimators
from estimators import DampingRatios, Resonances, ToolCompliance, ToolResponse, predict
from estimators.validation import predict_workspace
from estimators.validation.predict_tool import predict_tool
from estimators.validation.quantities import free_modes
from robotmodels import Frame, InvalidInput, RelativeNoise, save_robot
from robotmodels.elastic.robot import ElasticRobot

ROBOT = built(yaml.safe_load((HERE / "two_joints.yaml").read_text()))
OMEGA = 2 * np.pi * np.geomspace(3.0, 60.0, 25)
MEASURED = np.array([[-1.2, 0.9], [-0.4, 1.4]])
ELSEWHERE = np.array([[-0.8, 0.4], [-1.5, -1.0]])
NOISE = RelativeNoise(relative=0.03, floor=0.02)
TIP = Frame("tool0", (0.0, 0.05, 0.1))
QUANTITIES = (
    ToolCompliance(TIP, (0.0, 0.0, 1.0)),
    ToolResponse(2 * np.pi * np.array([5.0, 14.0]), TIP),
    Resonances(1),
    Resonances(1, "free"),
    DampingRatios(1),
)


def fitted(seed: int, robot: ElasticRobot = ROBOT) -> estimators.Fit:
    data = estimators.simulate_frf(robot, MEASURED, OMEGA, NOISE, np.random.default_rng(seed))
    return estimators.fit(robot, data, residual="nls", weights="optimal")


def coverages(seeds: range) -> np.ndarray:
    """Return how often bands of each quantity hold the truth and of their quarters."""
    truths = [_first(q(ROBOT, ELSEWHERE, ROBOT.parameters.values)) for q in QUANTITIES]
    hits = []
    for seed in seeds:
        fit = fitted(seed)
        spread = estimators.covariance(fit)
        bands = [predict(fit, q, ELSEWHERE, spread=spread) for q in QUANTITIES]
        for share in (1.0, 0.25):
            hits.append([_hits(b, t, share) for b, t in zip(bands, truths, strict=True)])
    return np.array(hits).reshape(len(seeds), 2, -1).mean(axis=0)


def _first(values: np.ndarray) -> np.ndarray:
    """Return the size of the first value in each position, which is not zero."""
    return np.abs(values).reshape(len(values), -1)[:, 0]


def _hits(band: estimators.Prediction, truth: np.ndarray, share: float) -> float:
    """Return how many of the first values are within a share of their bands, in logarithms."""
    values = _first(band.values)
    width = share * np.log(_first(band.upper) / values)
    return float(np.mean(np.abs(np.log(truth / values)) <= width))


def test_bands_hold_the_truth_as_often_as_they_say_few() -> None:
    whole, part = coverages(range(8)).mean(axis=-1)
    assert whole > 0.8
    assert part < 0.65


@pytest.mark.slow
def test_bands_hold_the_truth_as_often_as_they_say() -> None:
    whole, part = coverages(range(1000))
    assert ((whole > 0.93) & (whole < 0.97)).all()
    assert (part < 0.5).all()


def test_bands_by_draws_are_those_of_the_delta_method() -> None:
    fit = fitted(3)
    known = estimators.covariance(fit)
    rng = np.random.default_rng(1)
    draws = rng.multivariate_normal(np.log(fit.parameters.values), known.covariance, 80)
    for quantity in (ToolCompliance(TIP), ToolResponse(2 * np.pi * np.array([5.0]), TIP)):
        delta, drawn = (predict(fit, quantity, ELSEWHERE, spread=s) for s in (known, draws))
        seen = delta.std > 0.1 * delta.std.max()
        assert np.abs(drawn.std[seen] / delta.std[seen] - 1).max() < 0.35  # some 8 % each
        np.testing.assert_allclose(drawn.values, delta.values)


def test_compliance_of_one_gear_is_as_certain_as_its_stiffness() -> None:
    """Without gravity C = r^2 / k, so that ln C has the deviation of ln k, with t ends."""
    robot = built(changed(PENDULUM, gravity=[0.0, 0.0, 0.0]))
    names, p = robot.parameters.names, len(robot.parameters)
    covariance = np.diag(np.arange(1.0, p + 1)) * 0.01**2
    spread = estimators.Uncertainty(names, covariance, "declared", 5.0)
    tip = ToolCompliance(Frame("rod", (0.8, 0.0, 0.0)), (0.0, 0.0, 1.0))
    band = predict(robot, tip, np.array([[0.0]]), spread=spread)
    np.testing.assert_allclose(band.values, 0.8**2 / 5e3)
    np.testing.assert_allclose(band.std, 0.01, rtol=1e-6)
    np.testing.assert_allclose(band.upper / band.values, np.exp(2.5705818 * 0.01), rtol=1e-7)
    # sqrt(k) of a resonance, c / sqrt(k) of a damping ratio: half, and both independent ones.
    modes = predict(robot, "resonances", np.array([[0.0]]), spread=spread)
    np.testing.assert_allclose(modes.std, 0.005, rtol=1e-6)
    damping = predict(robot, "damping_ratios", np.array([[0.0]]), spread=spread)
    np.testing.assert_allclose(damping.values, 4.0 / (2 * np.sqrt(5e3 * 1.2)))
    np.testing.assert_allclose(damping.std, 0.01 * np.sqrt(2 + 0.25), rtol=1e-5)


def test_a_robot_file_of_a_fit_predicts_as_the_fit(tmp_path) -> None:
    import robotmodels

    fit = fitted(1)
    path = tmp_path / "fitted.yaml"
    save_robot(fit.robot(covariance=estimators.covariance(fit).covariance), path)
    robot = robotmodels.load_robot(path)
    for name in ("tool_compliance", "resonances"):
        by_fit, by_file = (predict(source, name, ELSEWHERE) for source in (fit, robot))
        np.testing.assert_allclose(by_file.values, by_fit.values)
        np.testing.assert_allclose(by_file.std, by_fit.std, rtol=1e-6)
    response = predict(robot, "tool_response", ELSEWHERE, OMEGA[:2])
    assert response.values.shape == (2, 2, 6, 6)


def test_mistakes_are_named() -> None:
    spread = estimators.Uncertainty(
        ROBOT.parameters.names, 1e-4 * np.eye(len(ROBOT.parameters)), "declared"
    )
    with pytest.raises(InvalidInput, match="did you mean 'tool_compliance'"):
        predict(ROBOT, "tool_complience", ELSEWHERE, spread=spread)
    with pytest.raises(InvalidInput, match="'tool_response': omega is needed"):
        predict(ROBOT, "tool_response", ELSEWHERE, spread=spread)
    with pytest.raises(InvalidInput, match="no standard deviation of a free parameter"):
        predict(ROBOT, "resonances", ELSEWHERE)
    with pytest.raises(InvalidInput, match="direction"):
        predict(ROBOT, ToolCompliance(TIP, (0.0, 0.0, 0.0)), ELSEWHERE, spread=spread)


@pytest.mark.parametrize("motors", ["clamped", "free"])
def test_a_tool_says_what_single_quantities_say(motors) -> None:
    fit = fitted(3)
    spread = estimators.covariance(fit)
    draws = np.random.default_rng(0).multivariate_normal(
        np.log(fit.parameters.values), spread.covariance, 12
    )
    for uncertain in (spread, draws):
        tool = predict_tool(
            fit, ELSEWHERE, TIP, OMEGA[:3], motors=motors, modes=1, spread=uncertain
        )
        for one, quantity in (
            (tool.compliance, ToolCompliance(TIP)),
            (tool.resonances, Resonances(1, motors)),
            (tool.damping, DampingRatios(1, motors)),
            (tool.response, ToolResponse(OMEGA[:3], TIP, motors=motors)),
        ):
            alone = predict(fit, quantity, ELSEWHERE, spread=uncertain)
            for field in ("values", "std", "lower", "upper"):
                np.testing.assert_allclose(
                    getattr(one, field), getattr(alone, field), rtol=1e-9, atol=1e-300
                )


@pytest.mark.parametrize("motors", ["clamped", "free"])
def test_a_workspace_in_parts_is_predicted_as_a_whole(motors, monkeypatch) -> None:
    fit = fitted(3)
    spread = np.log(fit.parameters.values) + 0.02 * np.random.default_rng(0).standard_normal(
        (12, len(fit.parameters.values))
    )
    positions = np.random.default_rng(1).uniform(-0.5, 0.5, (5, 2))
    words = {"spread": spread, "motors": motors, "frame": TIP, "motion": "velocity"}
    whole = predict_tool(fit, positions, omega=OMEGA[:3], **words)
    monkeypatch.setattr(predict_workspace, "_NUMBERS", 2 * 36 * 12 * 3)  # two positions at a time
    told = []
    parts = predict_workspace.predict_workspace(
        fit, positions, OMEGA[:3], progress=lambda *now: told.append(now), **words
    )
    assert told == [(0, 5), (2, 5), (4, 5), (5, 5)]
    np.testing.assert_array_equal(parts.points, whole.points)
    for name in ("compliance", "resonances", "damping", "response"):
        for field in ("positions", "values", "std", "phase_std", "lower", "upper"):
            np.testing.assert_allclose(
                getattr(getattr(parts, name), field),
                getattr(getattr(whole, name), field),
                rtol=1e-9,
                atol=1e-15,
            )


def test_free_modes_and_their_bands_are_those_of_the_poles() -> None:
    """Against the poles of the state-space matrix, and their scatter over draws."""
    fit = fitted(3)
    known = estimators.covariance(fit)
    band = predict(fit, free_modes, ELSEWHERE, spread=known)
    rng = np.random.default_rng(2)
    draws = rng.multivariate_normal(np.log(fit.parameters.values), known.covariance, 400)

    def ratios(theta: np.ndarray, position: np.ndarray) -> np.ndarray:
        one = ROBOT.network(position[None], theta).linear_model().at(0)
        A = np.linalg.solve(one.mass, np.hstack([-one.stiffness, -one.damping]))
        poles = np.linalg.eigvals(np.vstack([np.eye(len(A), 2 * len(A), len(A)), A]))
        slow_first = poles[np.argsort(np.abs(poles))][2 * one.inputs :]
        return np.array([-p.real / abs(p) for p in slow_first if p.imag > 0])

    for q, position in enumerate(ELSEWHERE):
        expected = ratios(np.asarray(fit.parameters.values), position)
        shown = band.values[q, 1, : len(expected)]
        np.testing.assert_allclose(shown, expected[: len(shown)], rtol=1e-6)
        drawn = np.log([ratios(np.exp(x), position)[0] for x in draws])
        assert band.std[q, 1, 0] == pytest.approx(drawn.std(), rel=0.2)  # 3.5 % of scatter
