"""How far chains can be trusted: the rule of `estimators.trust`, on modes of a chain."""

from dataclasses import replace

import numpy as np

from estimators.chains.modal_model import ModalLayout, modal_sensitivity
from estimators.chains.whitened_frf import Data
from estimators.trust.directed_tests import Directions
from estimators.trust.intervals import Interval, Verdict
from estimators.trust.line_scatter import Scatter
from estimators.trust.linearised_fit import LinearisedFit, Lines
from estimators.trust.rule import gather_evidence, judge, variance_scale
from estimators.trust.trust import LEVEL, Trust
from robotmodels.common.arrays import Array, ComplexArray, read_only

ABOVE = ".above"
"""Ends the names of what is counted from an offset."""


def chain_trust(
    data: Data,
    names: tuple[str, ...],
    values: Array,
    scale: Array,
    fitted: ComplexArray,
    jacobian: ComplexArray,
    modal: tuple[Array, ModalLayout],
    positive: int,
) -> Trust:
    """Return recommended intervals of chains whose damping is free mode by mode.

    Parameters
    ----------
    data : Data
        Data that were fitted; where their noise was guessed, of the size of the misfit.
    names : tuple of str
        Names of all that was fitted.
    values : ndarray
        Fitted values.
    scale : ndarray, (p,)
        Change of the values per unit of what the Jacobian is by.
    fitted, jacobian : ndarray of complex, (F, M, M) and (F, M, M, p)
        Fitted response and its Jacobian.
    modal : tuple of (ndarray, ModalLayout)
        Vector and layout of the modes at the fit.
    positive : int
        How many of the first values are fitted in their logarithms.
    """
    fit = data.linearised(names, fitted, jacobian)
    evidence = gather_evidence(
        fit,
        _directions(fit, data, fitted, modal),
        has_degrees_of_freedom=data.estimate.has_degrees_of_freedom,
    )
    verdicts = judge(evidence)
    scatter = evidence.scatter.scaled(variance_scale(evidence))
    std = np.sqrt(scatter.variance) * scale
    reach = scatter.quantile(LEVEL) * std
    ends = np.stack([values - reach, values + reach], axis=1)
    factor = np.exp(reach[:positive] / values[:positive])
    ends[:positive] = np.stack([values[:positive] / factor, values[:positive] * factor], axis=1)
    ends[[not v.gives_interval for v in verdicts]] = np.nan
    relative = std / np.maximum(np.abs(values), 1e-300)
    correlated = "" if evidence.correlation.white else ", correlated along lines"
    estimated = np.isfinite(fit.degrees_of_freedom).any()
    origin = "scatter of the lines over blocks" if estimated else "Theorem 1, stated noise"
    too_large = ", scaled by the residuals" if evidence.too_large else ""
    return Trust(
        names=names,
        values=values,
        scatter=Scatter(relative**2, scatter.degrees_of_freedom),
        ends=read_only(ends),
        method=f"damping free mode by mode, {origin}{correlated}{too_large}",
        verdicts=tuple(str(v) for v in verdicts),
        reasons=tuple(v.reason for v in verdicts),
        size=evidence.size,
        whiteness=evidence.correlation.probability,
        lag_one=float(evidence.correlation.coefficients[1:2].sum()),
        tests=evidence.tests,
    )


def _directions(
    fit: LinearisedFit, data: Data, fitted: ComplexArray, modal: tuple[Array, ModalLayout]
) -> Directions:
    """Return the gain of each motor's torque, dampers that couple modes, and half of the lines."""
    x, layout = modal
    m = data.chains
    names, columns = [], []
    for j in range(m if m > 1 else 0):  # one chain's masses and springs take its gain
        column = np.zeros_like(fitted)
        column[..., j] = fitted[..., j]
        names.append(f"gain of motor {j + 1}")
        columns.append(column)
    if layout.losses and not layout.turned:
        turned = ModalLayout(m, layout.modes, turned=True)
        zero = np.concatenate([x, np.zeros(turned.sizes[-1])])
        J = modal_sensitivity(zero, turned, data.omega)[1][..., layout.size :]
        names += [f"dampers that {name}" for name in turned.names[layout.size :]]
        columns += list(np.moveaxis(J, -1, 0))
    lines = len(data.omega)
    half = lines // 2 if lines > 3 else 0
    limit = data.omega[half] / (2 * np.pi)
    names += [f"{name} below {limit:.3g} Hz" for name in fit.names] if half else []
    shape = (1, lines, m * m, len(columns))
    stacked: Lines = np.zeros(shape, dtype=complex)
    for k, column in enumerate(columns):
        stacked[0, ..., k] = np.swapaxes(column, 1, 2).reshape(lines, m * m)
    return Directions(tuple(names), ("relative",) * len(names), stacked, fit.jacobian, half=half)


def chain_intervals(trust: Trust, names: tuple[str, ...], values: Array) -> tuple[Interval, ...]:
    """Return the intervals of masses, springs and couplings from those of all that was fitted.

    Couplings may have been counted from an offset; what was given has no width.
    """
    every = {i.name: i for i in trust.intervals}
    return tuple(
        _interval(every, name, float(value), trust.verdict)
        for name, value in zip(names, values, strict=True)
    )


def _interval(every: dict[str, Interval], name: str, value: float, verdict: Verdict) -> Interval:
    one = every.get(name) or every.get(name + ABOVE)
    if one is None:
        return Interval(name, value, 0.0, value, value, "given", np.inf, verdict)
    shift = value - one.value
    low, high = (None if end is None else end + shift for end in (one.low, one.high))
    return Interval(name, value, one.std, low, high, one.method, one.dof, one.verdict)


def chain_verdict(trust: Trust, intervals: tuple[Interval, ...]) -> Verdict:
    """Return the verdict on masses, springs and couplings: the gravest of their own."""
    names = {i.name for i in intervals}
    indices = [k for k, name in enumerate(trust.names) if name.removesuffix(ABOVE) in names]
    return replace(
        trust,
        names=tuple(trust.names[k] for k in indices),
        verdicts=tuple(trust.verdicts[k] for k in indices),
        reasons=tuple(trust.reasons[k] for k in indices),
    ).verdict
