"""Figures for notebooks: what they show is what they were given."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from IPython.core.formatters import PNGFormatter
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

import estimators
import oed
import robotmodels
from estimators.uncertainty.standardised_residuals import standardised_residuals
from reports import plots
from reports.figures.design_map import design_map
from reports.figures.notebook_figure import NotebookFigure
from reports.figures.residual_figures import residual_laws, residual_map
from reports.figures.svg import LIGHT, in_light

OMEGA = 2 * np.pi * np.geomspace(3, 60, 12)


@pytest.fixture(autouse=True)
def _shown_in_notebooks(monkeypatch):
    def checked(draw):
        figure = in_light(draw)
        assert isinstance(figure, NotebookFigure)
        return figure

    monkeypatch.setattr(plots, "in_light", checked)


@pytest.fixture(scope="module")
def fit():
    robot = robotmodels.load_robot(Path(__file__).parents[1] / "engines" / "two_joints.yaml")
    rng = np.random.default_rng(5)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (4, 2))
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    estimate = estimators.simulate_frf(robot, positions, OMEGA, noise, rng)
    return estimators.fit(robot, estimate, weights="optimal")


def test_standardised_residuals_are_standard_normal(fit):
    values = standardised_residuals(fit)
    assert values.shape == (2, 4, 12, 4)
    count = np.isfinite(values).sum()
    assert count >= 2 * 4 * 12 * 2
    assert np.nanmean(values**2) == pytest.approx(1, abs=4 * np.sqrt(2 / count))
    halved = 2 * values  # noise that is stated half as large
    assert np.nanmean(halved**2) != pytest.approx(1, abs=4 * np.sqrt(2 / count))


def test_notebooks_show_figures_without_pyplot(fit):
    formatter = PNGFormatter()  # knows no matplotlib: pyplot's inline backend would teach it
    assert formatter(plots.residuals(fit)).startswith(b"\x89PNG")
    assert formatter(plots.frf(fit.estimate, fit)).startswith(b"\x89PNG")
    assert formatter(Figure()) is None


def test_frfs_are_drawn_with_the_model_between_the_lines(fit):
    figure = plots.frf(fit.estimate, fit, position=1)
    level = figure.axes[0]
    measured, model = (line.get_xydata() for line in level.lines)
    size = np.abs(fit.estimate.response[1, :, 0, 0])
    np.testing.assert_allclose(measured, np.column_stack([OMEGA / (2 * np.pi), size]))
    assert len(model) == 3 * 12 - 2
    away = np.abs(np.log(model[::3, 1] / size))
    assert np.median(away) < 0.05  # a fit within the noise
    assert level.get_title() == "from m2"
    band = plots.frf(fit.estimate, fit, position=1, spread=estimators.covariance(fit))
    of_model = band.axes[0].collections[1]
    assert of_model.get_facecolor()[0, :3] == pytest.approx(to_rgb(LIGHT.second))
    height = of_model.get_paths()[0].vertices
    at = height[:, 0] == height[1, 0]  # both ends at the first line
    low, high = height[at, 1].min(), height[at, 1].max()
    draws = np.exp(
        np.random.default_rng(3).multivariate_normal(
            np.log(fit.parameters.values), estimators.covariance(fit).covariance, 400
        )
    )
    sizes = [
        np.abs(
            robotmodels.frequency_response(fit.model, fit.estimate.positions[[1]], OMEGA[:1], one)[
                0, 0, 0, 0
            ]
        )
        for one in draws
    ]
    assert np.log(high / low) / 2 == pytest.approx(np.std(np.log(sizes)), rel=0.2)
    one = plots.frf(fit.estimate, fit, position=1, rows=[1], columns=[0]).axes
    assert len(one) == 2
    np.testing.assert_allclose(
        one[0].lines[0].get_ydata(), np.abs(fit.estimate.response[1, :, 1, 0])
    )
    np.testing.assert_allclose(
        one[0].lines[1].get_ydata(), figure.axes[4].lines[1].get_ydata(), rtol=1e-12
    )
    with pytest.raises(robotmodels.InvalidInput, match=r"columns: \[2\]; some of 0 to 1"):
        plots.frf(fit.estimate, columns=[2])
    with pytest.raises(robotmodels.InvalidInput, match="spread: a band needs a model"):
        plots.frf(fit.estimate, spread=estimators.covariance(fit))
    with pytest.raises(robotmodels.InvalidInput, match="position: 4; 0 to 3"):
        plots.frf(fit.estimate, position=4)


def test_a_map_shows_where_residuals_are_large():
    values = np.ones((2, 3, 12, 4))
    values[:, 1, 5] = 2.0
    values[:, 2, 3] = np.nan  # not used
    axes = residual_map(values, OMEGA)(LIGHT).axes[0]
    (patch,) = axes.patches
    assert to_hex(patch.get_facecolor()) == LIGHT.second
    x, y = patch.get_path().vertices.T
    assert x.min() < OMEGA[5] / (2 * np.pi) < x.max()
    assert (y.min(), y.max()) == (1.5, 2.5)


def test_quantiles_of_noise_lie_on_the_line_and_others_do_not():
    rng = np.random.default_rng(2)
    for values, close in (
        (rng.standard_normal((2, 5, 40, 4)), True),
        (rng.standard_t(2, (2, 5, 40, 4)), False),
    ):
        axes = residual_laws(values, np.zeros(5))(LIGHT).axes[0]
        normal, quantile = axes.lines[1].get_xydata().T
        assert (np.abs(quantile - normal)[np.abs(normal) < 2.5].max() < 0.25) == close


def test_a_design_map_has_the_largest_of_each_cell():
    positions = np.array([[0.0, 0], [0, 1], [1, 0], [1, 1], [1, 1]])
    sensitivity = np.array([0.1, 0.4, 0.4, 0.2, 1.0])
    axes = design_map(positions, sensitivity, np.array([0, 0, 0, 0, 3]), ("a", "b"))(LIGHT).axes[0]
    darkest = max(axes.patches, key=lambda patch: patch.get_alpha())
    assert darkest.get_path().vertices.mean(axis=0) == pytest.approx([1, 1], abs=0.1)
    (dots,) = axes.collections
    np.testing.assert_array_equal(dots.get_offsets(), [[1, 1]])


def test_a_map_numbers_the_positions_of_the_plan_and_has_a_scale():
    positions = np.radians([[0.0, 0, 5], [0, 10, 5], [10, 0, 5], [10, 0, 6]])
    design = SimpleNamespace(weights=np.ones(4) / 4, sensitivity=np.array([0.5, 0.9, 1.0, 1.0]))
    plan = SimpleNamespace(repetitions=np.array([0, 1, 2, 1]))
    drawn = plots.design_map(positions, design, plan=plan)
    assert [one.get_text() for one in drawn.axes[0].texts] == ["1", "2, 3"]
    scale = drawn.axes[1]
    assert scale.get_ylim() == pytest.approx((0.5, 1.0))
    assert "sensitivity" in scale.get_ylabel()


def test_mistakes_in_maps_are_told():
    design = SimpleNamespace(weights=np.ones(3), sensitivity=np.ones(3))
    with pytest.raises(robotmodels.InvalidInput, match="one row for each of the design's 3"):
        plots.design_map(np.zeros((2, 2)), design)
    with pytest.raises(robotmodels.InvalidInput, match=r"joints: \(0, 2\); 0 to 1"):
        plots.design_map(np.zeros((3, 2)), design, (0, 2))


def test_trade_offs_have_certificates_and_gaps():
    counts = np.array([1, 2, 4])
    std = np.array([[np.inf, 0.2], [0.2, 0.1], [0.1, 0.05]])
    names, plans = ("a", "b"), ()
    curve = oed.ExperimentCurve(counts, std, np.array([0.5, 0.9, 0.99]), plans, names)
    figure = plots.trade_off(curve)
    accuracy, efficiency = figure.axes
    largest = accuracy.lines[2].get_ydata()
    np.testing.assert_allclose(largest, [np.nan, 20, 10])
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["largest, at last a", "median"]
    np.testing.assert_allclose(efficiency.lines[0].get_ydata(), [50, 90, 99])


def test_unknown_parameters_are_told():
    uncertainty = SimpleNamespace(names=("a", "b"), std=np.array([1.0, 2.0]))
    with pytest.raises(robotmodels.InvalidInput, match="'c' is unknown; there are a, b"):
        plots.traces(None, uncertainty, np.ones(2), ["c"])


def test_traces_and_corner_reach_the_truth():
    rng = np.random.default_rng(1)
    chains = 0.01 * rng.standard_normal((2, 20, 8, 2))
    posterior = SimpleNamespace(chains=chains, draws=chains.reshape(-1, 2))
    covariance = 1e-4 * np.eye(2)
    uncertainty = SimpleNamespace(
        names=("a", "b"), std=np.array([0.01, 0.01]), covariance=covariance
    )
    truth = np.array([1.4, 1.0])
    corner = plots.corner(posterior, uncertainty, np.ones(2), truth)
    assert corner.axes[0].get_xlim()[1] > 100 * np.log(1.4)
    figure = plots.traces(posterior, uncertainty, np.ones(2))
    assert [axes.get_title(loc="left") for axes in figure.axes[::2]] == ["a", "b"]
    mean = figure.axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(mean, 100 * chains[0].mean(axis=1)[:, 0])


def test_modes_have_intervals():
    def band(values, std):
        return SimpleNamespace(values=np.array(values, complex), std=np.array(std))

    resonances = band([[2 * np.pi * 5, 2 * np.pi * 8]] * 3, [[0.1, 0.2]] * 3)
    damping = band([[0.02, 0.03]] * 3, [[0.1, 0.1]] * 3)
    prediction = SimpleNamespace(resonances=resonances, damping=damping, points=np.zeros((3, 3)))
    frequency = plots.modes(prediction).axes[0]
    bars, dots = frequency.lines[2:]  # of the second mode
    np.testing.assert_allclose(bars.get_ydata().reshape(3, 3)[:, :2], [[6.4, 9.6]] * 3)
    np.testing.assert_allclose(dots.get_ydata(), 8)


def test_convergence_has_a_dot_for_each_round_and_the_gap_of_the_design():
    gaps = np.array([0.3, np.inf, 1e-3, 1e-8])
    (axes,) = plots.convergence(SimpleNamespace(gaps=gaps, gap=2e-9)).axes
    rounds, final = axes.lines
    np.testing.assert_array_equal(rounds.get_xdata(), [1, 2, 3, 4])
    np.testing.assert_allclose(rounds.get_ydata(), [0.3, np.nan, 1e-3, 1e-8])
    np.testing.assert_array_equal(final.get_ydata(), 2e-9)
    assert axes.get_yscale() == "log"
    words = [label.get_text() for label in axes.get_yticklabels()]
    assert any("10⁻" in word for word in words)  # SVG files have no mathtext


def test_profiles_of_good_data_are_the_parabolas_of_the_covariance(fit):
    uncertainty = estimators.covariance(fit)
    curves = estimators.profile_likelihood(fit, fit.parameters.names[:2], points=9)
    figure = plots.profiles(curves, uncertainty, fit.parameters.values)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in shown] == list(fit.parameters.names[:2])
    for axes in shown:
        curve, dots, parabola = (line.get_xydata().T for line in axes.lines[:3])
        low = parabola[1] < 4
        np.testing.assert_allclose(curve[1][low], parabola[1][low], atol=0.3)
        assert dots.shape == (2, 10)
    doubled = SimpleNamespace(names=uncertainty.names, std=2 * uncertainty.std)
    wide = plots.profiles(curves, doubled, fit.parameters.values).axes[0].lines
    assert np.abs(wide[0].get_ydata() - wide[2].get_ydata()).max() > 3
    without = estimators.profile_likelihood(fit, fit.parameters.names[:1])
    with pytest.raises(robotmodels.InvalidInput, match=r"stiffness has none; call `profile_lik"):
        plots.profiles(without, uncertainty, fit.parameters.values)


def test_held_out_positions_stand_below_the_fitted_ones(fit):
    robot, estimate, uncertainty = fit.model, fit.estimate, estimators.covariance(fit)
    rng = np.random.default_rng(11)
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    others = estimators.simulate_frf(robot, estimate.positions + 0.1, OMEGA, noise, rng)
    values = fit.parameters.values
    validation = estimators.validate(robot, values, others, uncertainty)
    assert validation.mean_squares.shape == (4, 12)
    assert validation.mean_squares.mean() == pytest.approx(1, abs=0.25)
    bent = estimators.validate(robot, 1.5 * values, others, uncertainty)
    assert bent.mean_squares.mean() > 2
    plain, below = (plots.residuals(fit, one).axes[0] for one in (None, bent))
    assert plain.get_ylim() == (4.5, 0.5)
    assert below.get_ylim() == (9.5, 0.5)
    assert [label.get_text() for label in below.get_yticklabels()] == [
        "1",
        "2",
        "3",
        "4",
        "held out",
    ]
    assert below.get_yticks()[-1] == 7.5
    held = [p.get_path().vertices[:, 1].max() for p in below.patches]
    assert max(held) == 9.5
    fewer = SimpleNamespace(mean_squares=np.ones((4, 6)))
    with pytest.raises(robotmodels.InvalidInput, match="validation: 6 lines, the fit has 12"):
        plots.residuals(fit, fewer)
