"""What the simulated studies of a cell show, beside what is asked of them."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from trust_cells import Cell, Outcome
from trust_systems import OUTLIER

from estimators.trust.rule import LEVEL, OUTLIER_LEVEL

MEAN = (0.93, 0.97)
EACH = (0.91, 0.985)
FEW = 20.0
"""Degrees of freedom below which intervals may cover up to `EACH_FEW`."""
EACH_FEW = 0.998
WIDTH = {2: 1.5, 3: 1.25, 4: 1.15, 20: 1.05}
"""By blocks, with diagonal weights: largest width over that with known noise."""
FALSE_ALARMS = 0.03
FALSE_MODEL_ERRORS = 0.05
FLAGGED = 0.95
UNFLAGGED = 0.90
REFUSED = ("not converged", "model error")


def summary(cell: Cell, outcomes: Sequence[Outcome], known_std: np.ndarray) -> dict[str, Any]:
    """Return the figures of a cell, as plain numbers."""
    error, std, quantile, dof, shift = (
        np.array([getattr(o, name) for o in outcomes])
        for name in ("error", "std", "quantile", "dof", "shift")
    )
    given = np.array([[v not in REFUSED for v in o.verdicts] for o in outcomes])
    half = quantile * std
    count = np.maximum(given.sum(axis=0), 1)
    verdicts = Counter(o.verdict for o in outcomes)
    own = np.array([o.own for o in outcomes])
    moved = np.abs(error.mean(axis=0)) / np.median(std, axis=0)
    result = {
        "cell": cell.name,
        "runs": len(outcomes),
        "verdicts": {k: v / len(outcomes) for k, v in verdicts.most_common()},
        "intervals": float(given.mean()),
        "coverage": ((np.abs(error) < half) & given).sum(axis=0) / count,
        "quarter": ((np.abs(error) < half / 4) & given).sum(axis=0) / count,
        "all_coverage": (np.abs(error) < half).mean(axis=0),
        "width": np.median(half, axis=0) / (1.959964 * known_std),
        "dof": np.median(dof, axis=0),
        "scatter_over_std": error.std(axis=0) / np.sqrt((std**2).mean(axis=0)),
        "bias": error.mean(axis=0) / error.std(axis=0),
        "moved": moved,
        "stated_shift": np.median(shift, axis=0),
        "reasons": dict(
            Counter(o.reason[:40] for o in outcomes if o.verdict == "model error").most_common(3)
        ),
    }
    if np.isfinite(own).any():
        result |= _own_direction(own)
    if cell.wrong == "outliers":
        result |= {"noncentrality": OUTLIER, "power": _outlier_power(cell)}
    return result


def _own_direction(own: np.ndarray) -> dict[str, float]:
    """Return the power of the test of the error's own direction, and the z that has it.

    By each study's own standard deviation and t quantile; z is that of 38 tests with known noise,
    of which 5.3 have a power of 95 %.
    """
    from scipy.stats import norm, t as student

    own = own[np.isfinite(own[:, 0])]
    estimates, std, dof, tests, _, shift = own.T
    tail = LEVEL / np.median(tests) / 2
    limit = np.where(dof < 1e6, student.isf(tail, np.minimum(dof, 1e6)), norm.isf(tail))
    excess = abs(estimates.mean()) - limit * std
    power = float(norm.cdf(excess / estimates.std()).mean())
    z = norm.isf(LEVEL / 38 / 2) + norm.ppf(np.clip(power, 1e-3, 1 - 1e-12))
    return {"noncentrality": float(z), "power": power, "own_shift": float(np.median(shift))}


def _outlier_power(cell: Cell) -> float:
    """Return the probability that the exact law of a single line sees an outlier."""
    from scipy.stats import f as f_law, ncf
    from trust_systems import system

    plant = system(cell.system)
    lines, elements = len(plant.omega), plant.elements**2
    nu = float(cell.blocks - 1) if cell.blocks else 1e6
    data = len(plant.positions) * lines * elements
    single = float(ncf.sf(f_law.isf(OUTLIER_LEVEL / data, 2, 2 * nu), 2, 2 * nu, 2 * OUTLIER**2))
    return 1 - (1 - single) ** (len(plant.positions) * max(1, lines // 20))


def failures(cell: Cell, result: dict[str, Any]) -> list[str]:
    """Return what a cell falls short of, one line each."""
    if cell.rule == "former":
        return [] if _right(cell, result) else ["the former rule passes"]
    lines = []
    if np.mean(result["quarter"]) > 0.8:
        lines.append(f"a quarter of the interval covers {_percent(result['quarter'])}")
    return lines + (_wrong(cell, result) if cell.wrong else _right(cell, result))


def _right(cell: Cell, result: dict[str, Any]) -> list[str]:
    """Return what a cell of a right model falls short of."""
    lines = []
    coverage, few = np.array(result["coverage"]), np.array(result["dof"]) < FEW
    mean_limit = EACH_FEW if few.all() else MEAN[1]
    if not MEAN[0] <= coverage.mean() <= mean_limit:
        lines.append(f"covers {_percent(coverage)} in the mean")
    limits = np.where(few, EACH_FEW, EACH[1])
    outside = (coverage < EACH[0]) | (coverage > limits)
    if outside.any():
        listed = ", ".join(f"{100 * c:.1f}" for c in coverage[outside])
        lines.append(f"parameters covered {listed} %")
    verdicts = result["verdicts"]
    if cell.factor > 1:
        flagged = sum(verdicts.get(v, 0) for v in ("noise understated", "model error"))
        if flagged < FLAGGED:
            lines.append(f"understated noise flagged in {100 * flagged:.1f} %")
        return lines
    if cell.correlation:
        if verdicts.get("model error", 0) > FALSE_MODEL_ERRORS:
            lines.append(f"model error in {100 * verdicts['model error']:.1f} %")
        return lines
    alarms = 1 - verdicts.get("trustworthy", 0) - verdicts.get("not identifiable", 0)
    if alarms > FALSE_ALARMS + 1e-9:
        lines.append(f"false alarms in {100 * alarms:.1f} %")
    width = float(np.median(result["width"]))
    if not cell.full and width > WIDTH.get(cell.blocks, np.inf):
        lines.append(f"width {width:.2f}")
    return lines


def _wrong(cell: Cell, result: dict[str, Any]) -> list[str]:
    """Return what a cell of a wrong model falls short of."""
    flagged = sum(result["verdicts"].get(v, 0) for v in REFUSED)
    if result.get("power", 0) >= FLAGGED:
        if flagged >= FLAGGED:
            return []
        return [f"flagged in {100 * flagged:.1f} % (z = {result['noncentrality']:.1f})"]
    coverage = np.array(result["coverage"])
    if flagged > FLAGGED or coverage.min() >= UNFLAGGED:
        return []
    worst = int(np.argmin(coverage))
    stated, moved = result["stated_shift"][worst], result["moved"][worst]
    if stated >= moved:
        return []
    what = f"flagged in {100 * flagged:.1f} %, unflagged cover {_percent(coverage)}, a parameter "
    return [what + f"moved by {moved:.1f} std, {stated:.1f} stated"]


def is_reported_only(cell: Cell) -> bool:
    """Whether nothing is asked of a cell: no direction of missing springs is tested."""
    return cell.wrong.startswith("missing")


def _percent(coverage: Sequence[float]) -> str:
    values = 100 * np.array(coverage)
    return f"{values.mean():.1f} % [{values.min():.1f}]"
