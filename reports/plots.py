"""Figures for notebooks and papers: each function returns a matplotlib figure.

They are the drawings of the pages, in the pages' light colours.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from estimators import (
    Fit,
    FrfEstimate,
    Posterior,
    Profile,
    RunFit,
    Uncertainty,
    Validation,
    predict_frf,
)
from estimators.uncertainty.standardised_residuals import standardised_residuals
from estimators.validation.predict_tool import ToolPrediction
from oed import Design, ExactDesign, ExperimentCurve, TimeCurve
from reports.figures import (
    bode,
    corner_figure,
    design_map as maps,
    excitation_figures,
    mode_figures,
    plan_figures,
    posterior_figures,
    profile_figures,
    residual_figures,
    study_figures,
    uncertainty_figures,
)
from reports.figures.response_data import between
from reports.figures.svg import in_light
from robotmodels import ElasticRobot, InvalidInput, Records, frequency_response
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import check_word

_SHOWN = 6  # parameters of a corner plot


def frf(
    estimate: FrfEstimate,
    model: ElasticRobot | Fit | None = None,
    position: int = 0,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    rows: Sequence[int] | None = None,
    columns: Sequence[int] | None = None,
    spread: Uncertainty | Array | None = None,
) -> Figure:
    """Return Bode plots of all elements in one position, with one standard deviation.

    Parameters
    ----------
    estimate : FrfEstimate
        Measured or simulated FRFs.
    model : ElasticRobot or Fit, optional
        Drawn between the lines too.
    position : int
        Which of the estimate's positions.
    inputs, outputs : sequence of str, optional
        Names of columns and rows; the model's, or numbers.
    rows, columns : sequence of int, optional
        Outputs and inputs to draw, counted from zero; all by default.
    spread : Uncertainty or ndarray, (N, p), optional
        Covariance of ln theta or draws of it; the model has a band of one standard deviation by it.

    Raises
    ------
    InvalidInput
        If there is no such position, row or column, or a spread without a model.
    """
    if not 0 <= position < len(estimate.positions):
        raise InvalidInput(
            f"position: {position}; 0 to {len(estimate.positions) - 1} are in the estimate"
        )
    if model is None and spread is not None:
        raise InvalidInput("spread: a band needs a model; give one")
    robot = model.model if isinstance(model, Fit) else model
    m, n = estimate.response.shape[2:]
    omega, at = between(estimate.omega), estimate.positions[[position]]
    columns_of = inputs or getattr(robot, "motor_names", [f"motor {j + 1}" for j in range(n)])
    rows_of = outputs or getattr(robot, "output_names", [f"output {i + 1}" for i in range(m)])
    i, j = _indices("rows", rows, m), _indices("columns", columns, n)
    shown = np.ix_(range(len(estimate.omega)), i, j)
    drawing = bode.bode(
        estimate.omega,
        estimate.response[position][shown],
        np.sqrt(estimate.variance[position][shown]),
        [columns_of[k] for k in j],
        [rows_of[k] for k in i],
        None
        if model is None
        else _curve(model, at, omega, spread, np.ix_(range(len(omega)), i, j)),
    )
    return in_light(drawing)


def _indices(key: str, indices: Sequence[int] | None, count: int) -> list[int]:
    """Return the indices to draw, all by default.

    Raises
    ------
    InvalidInput
        If there is no such one, or none.
    """
    shown = list(range(count)) if indices is None else list(indices)
    if not shown or not all(0 <= k < count for k in shown):
        raise InvalidInput(f"{key}: {shown}; some of 0 to {count - 1} are needed")
    return shown


def _curve(
    model: ElasticRobot | Fit,
    at: Array,
    omega: Array,
    spread: Uncertainty | Array | None,
    elements: tuple[IntArray, ...],
) -> tuple[Array, ComplexArray, Array | None]:
    """Return angular frequencies, elements of the model's FRFs, and stds of ln |G|."""
    robot = model.model if isinstance(model, Fit) else model
    values = model.parameters.values
    if spread is None:
        return omega, frequency_response(robot, at, omega, values)[0][elements], None
    band = predict_frf(robot, values, at, omega, spread)
    return omega, band.response[0][elements], band.magnitude_std[0][elements]


_TAG = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.0}


def design_map(
    positions: Array,
    design: Design,
    joints: tuple[int, int] = (0, 1),
    *,
    plan: ExactDesign | None = None,
    names: Sequence[str] | None = None,
) -> Figure:
    """Return what candidates would add over two joints, the largest in each cell.

    The positions used are numbered in the order of the candidates.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad
        The candidates; angles are shown in degrees.
    design : Design
        Relaxed design on them; its support is marked unless there is a plan.
    joints : tuple of int
        The two joints, counted from zero.
    plan : ExactDesign, optional
        Marked instead of the support.
    names : sequence of str, optional
        Names of the joints.

    Raises
    ------
    InvalidInput
        If positions and weights do not fit, or there is no such joint.
    """
    shape = np.shape(positions)
    if len(shape) != 2 or shape[0] != len(design.weights):
        raise InvalidInput(
            f"positions: shape {shape}; one row for each of the design's {len(design.weights)} "
            "candidates is needed"
        )
    if not all(0 <= j < shape[1] for j in joints):
        raise InvalidInput(f"joints: {joints}; 0 to {shape[1] - 1} are in the positions")
    labels = [f"{names[j] if names else f'joint {j + 1}'} [°]" for j in joints]
    weights = design.weights if plan is None else plan.repetitions
    shown = np.degrees(np.asarray(positions)[:, list(joints)])
    figure = in_light(maps.design_map(shown, design.sensitivity, weights, labels))
    numbered: dict[tuple[float, float], list[int]] = {}
    for number, (across, up) in enumerate(shown[weights > 0].round(6).tolist(), start=1):
        numbered.setdefault((across, up), []).append(number)
    for point, numbers in numbered.items():
        words = ", ".join(map(str, numbers))
        figure.axes[0].annotate(
            words, point, xytext=(6, 5), textcoords="offset points", fontsize=7, bbox=_TAG
        )
    return figure


def sensitivity_function(design: Design) -> Figure:
    """Return the sensitivities of all candidates in falling order, the support marked."""
    sensitivity = design.sensitivity * design.weights.sum()
    return in_light(study_figures.sensitivity_function(sensitivity, design.support))


def convergence(design: Design) -> Figure:
    """Return the certified gap after each round of the solver, that of the design dashed."""
    return in_light(study_figures.convergence(design.gaps, design.gap))


def trade_off(curve: ExperimentCurve | TimeCurve, names: Sequence[str] | None = None) -> Figure:
    """Return standard deviations over experiments or minutes, with certified efficiencies.

    Parameters
    ----------
    curve : ExperimentCurve or TimeCurve
        Plans of growing numbers of experiments, or of growing times.
    names : sequence of str, optional
        Parameters of a `TimeCurve`, whose other sort has its own.
    """
    if isinstance(curve, ExperimentCurve):
        return in_light(
            plan_figures.trade_off(curve.counts, curve.std, curve.names, bound=curve.efficiency)
        )
    bound = np.array([plan.efficiency for plan in curve.plans])
    labels = [f"parameter {i + 1}" for i in range(curve.std.shape[1])] if names is None else names
    minutes = curve.times / 60
    return in_light(
        plan_figures.trade_off(minutes, curve.std, labels, bound=bound, label="robot time [min]")
    )


def residuals(fit: Fit | RunFit, validation: Validation | None = None) -> Figure:
    """Return mean squared standardised residuals by position and line.

    Parameters
    ----------
    fit : Fit or RunFit
        A fit.
    validation : Validation, optional
        Of positions that were not fitted, measured at the same lines; in rows below the others.

    Raises
    ------
    InvalidInput
        If these have other lines.
    """
    omega = fit.problem.omega
    held_out = None if validation is None else validation.mean_squares
    if held_out is not None and held_out.shape[1] != len(omega):
        raise InvalidInput(
            f"validation: {held_out.shape[1]} lines, the fit has {len(omega)}; the same are needed"
        )
    drawing = residual_figures.residual_map(standardised_residuals(fit), omega, held_out)
    return in_light(drawing)


def residual_laws(fit: Fit | RunFit, lags: int = 5) -> Figure:
    """Return a normal quantile plot of the residuals, and their autocorrelation."""
    from estimators import residual_analysis

    autocorrelation = residual_analysis(fit, lags).autocorrelation
    return in_light(residual_figures.residual_laws(standardised_residuals(fit), autocorrelation))


def corner(
    posterior: Posterior,
    uncertainty: Uncertainty,
    estimate: Array,
    truth: Array | None = None,
    parameters: Sequence[str] | None = None,
) -> Figure:
    """Return the posterior of some parameters with the ellipses of a covariance.

    Parameters
    ----------
    posterior : Posterior
        Draws.
    uncertainty : Uncertainty
        Covariance, such as Theorem 1's.
    estimate : ndarray, (p,)
        Estimated parameters [SI], from which deviations are drawn in per cent.
    truth : ndarray, (p,), optional
        True parameters, which the axes always reach.
    parameters : sequence of str, optional
        Parameters to show; the six least certain by default.
    """
    names, i = _parameters(uncertainty, parameters)
    deviations = 100 * (posterior.draws - np.log(estimate))[:, i]
    true = np.full(len(estimate), np.nan) if truth is None else np.log(truth / estimate)
    covariance = 1e4 * uncertainty.covariance[np.ix_(i, i)]
    return in_light(corner_figure.corner_plot(names, deviations, covariance, 100 * true[i]))


def traces(
    posterior: Posterior,
    uncertainty: Uncertainty,
    estimate: Array,
    parameters: Sequence[str] | None = None,
) -> Figure:
    """Return traces and ranks of the chains; arguments as of `corner`."""
    names, i = _parameters(uncertainty, parameters)
    deviations = 100 * (posterior.chains - np.log(estimate))[..., i]
    return in_light(posterior_figures.traces(names, deviations))


def profiles(curves: Sequence[Profile], uncertainty: Uncertainty, estimate: Array) -> Figure:
    """Return profile likelihoods beside the parabolas of a covariance.

    Parameters
    ----------
    curves : sequence of Profile
        Of `profile_likelihood` with `points`.
    uncertainty : Uncertainty
        Covariance, such as Theorem 1's.
    estimate : ndarray, (p,)
        Estimated parameters [SI].

    Raises
    ------
    InvalidInput
        If a profile has no curve, or a parameter is unknown.
    """
    _, i = _parameters(uncertainty, [one.name for one in curves])
    for one in curves:
        if not np.isfinite(one.curve[1:]).any():
            raise InvalidInput(
                f"curves: {one.name} has none; call `profile_likelihood` with points=9"
            )
    drawing = profile_figures.profiles(curves, estimate[i], uncertainty.std[i])
    return in_light(drawing)


def correlation(uncertainty: Uncertainty) -> Figure:
    """Return the correlations of all parameters."""
    drawing = uncertainty_figures.correlation_map(uncertainty.names, uncertainty.correlation)
    return in_light(drawing)


def excitation(
    records: Records,
    motors: Sequence[str] | None = None,
    limits: Mapping[str, Array] | None = None,
    *,
    position: int = 0,
    block: int = 0,
    run: int = 0,
) -> Figure:
    """Return torque, speed and angle of a run in time against limits, spectra and crest factors.

    Parameters
    ----------
    records : Records
        Measured or simulated runs whose first outputs are the motors' angles.
    motors : sequence of str, optional
        Names of the motors.
    limits : mapping of str to ndarray, (n,), optional
        Limits on the motor shafts: "torque" [N m], "speed" [rad/s], "swing" of the angle [rad].
    position, block, run : int
        Which run.

    Raises
    ------
    InvalidInput
        If there is no such run.
    """
    shape = records.torque.shape
    for name, index, count in zip(
        ("position", "block", "run"), (position, block, run), shape, strict=False
    ):
        if not 0 <= index < count:
            raise InvalidInput(f"{name}: {index}; 0 to {count - 1} are in the records")
    names = motors or [f"motor {j + 1}" for j in range(shape[-1])]
    shown = excitation_figures.run_of(records, position, block, run)
    return in_light(excitation_figures.excitation(shown, names, limits or {}))


def modes(prediction: ToolPrediction) -> Figure:
    """Return resonances and damping ratios over positions, with one standard deviation."""
    return in_light(mode_figures.modes(prediction))


def _parameters(
    uncertainty: Uncertainty, parameters: Sequence[str] | None
) -> tuple[list[str], list[int]]:
    """Return names and indices of the parameters to show.

    Raises
    ------
    InvalidInput
        If one is unknown.
    """
    names = uncertainty.names
    if parameters is None:
        widest = np.sort(np.argsort(-uncertainty.std)[:_SHOWN])
        return [names[i] for i in widest], widest.tolist()
    for name in parameters:
        check_word("parameters:", name, names)
    return [*parameters], [names.index(name) for name in parameters]
