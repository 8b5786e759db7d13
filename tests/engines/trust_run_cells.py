"""Cells of studies of fits to runs: systems, sensors, noise, and how often intervals cover.

Two systems: a small one of two motors, three springs and dampers, with its motors' or other
outputs; and the Manutec r3, six motors, three springs and dampers, its equilibria fixed.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "estimators"))

import numpy as np
import sampled_runs
from noisy_runs import SMALL, NoisySystem
from sensed_springs import SensedSprings

import robotmodels
from estimators import RunSpectra, covariance, fit, run_spectra
from robotmodels import Records
from robotmodels.linear.derived_models import FixedEquilibriumModel

MOTORS, SIX = "motor", "motor, six"
SEEN = {MOTORS: (0, 1), "link": (2, 3), "angles": (0, 2, 3)}
"""Coordinates whose angles are sampled."""
SAMPLES = 512
LINES = np.array([k for k in range(7, 100, 2) if k % 10 != 5])
JUDGED = 20
"""Studies of six motors whose verdicts are asked for: they take longer than their fits."""
FEEDBACK = {"detection": 20.0, "loop": 100.0}
"""Gains of the loops; the noise that a strong one feeds back shows in the states."""
TOGETHER = 50
"""Studies whose samples are simulated at once."""


@dataclass(frozen=True)
class Cell:
    """Studies of one kind.

    Attributes
    ----------
    kind : str
        "periodic" spectra; samples of "random" torques, or of one period in a loop with noise from
        "detection" lines or stated ("loop").
    runs : int
        In each position.
    noise : float
        Of torques, relative; of samples as `sampled_runs` has it.
    weights : str
        "joint" or "row_wise".
    outputs : str
        What is measured: motors, or one of `sensed_springs.SENSORS`.
    freedom : float
        Degrees of freedom of the covariances.
    control : bool
        Torques taken as exact, or no states: this must fail.
    """

    kind: str
    runs: int
    noise: float
    weights: str = "joint"
    outputs: str = MOTORS
    freedom: float = np.inf
    control: bool = False

    @property
    def slow(self) -> bool:
        """Whether a study takes so long that half of them must do."""
        return self.kind == "random" and self.runs * len(SEEN[self.outputs]) > 2

    @property
    def sampled(self) -> bool:
        """Whether covariances come from data."""
        return np.isfinite(self.freedom) or self.kind == "detection"


def cells() -> list[Cell]:
    """Return all cells."""
    both = "joint", "row_wise"
    listed = [
        Cell("periodic", runs, noise, weights)
        for runs in (1, 2, 4)
        for noise in (0.1, 0.3)
        for weights in both
    ]
    listed += [Cell("periodic", runs, 0.3, "joint", freedom=10) for runs in (1, 2, 4)]
    listed += [Cell("periodic", runs, 0.3, "row_wise", freedom=5) for runs in (1, 2, 4)]
    listed += [Cell("detection", runs, 0.0, weights) for weights in both for runs in (1, 2, 4)]
    listed += [Cell("random", runs, 0.05, weights) for weights in both for runs in (1, 2, 4)]
    listed += [Cell("loop", runs, 0.0) for runs in (1, 2)]
    for outputs in ("link", "torque", "accelerometer", "mixed", "one"):
        listed += [Cell("periodic", runs, 0.3, outputs=outputs) for runs in (1, 4)]
    listed += [Cell("periodic", runs, 0.3, "row_wise", "mixed") for runs in (1, 4)]
    listed += [Cell("periodic", 2, 0.3, "row_wise", "mixed", freedom=5)]
    listed += [Cell("random", 1, 0.05, outputs=outputs) for outputs in ("link", "angles")]
    listed += [Cell("periodic", runs, 0.3, outputs=SIX) for runs in (1, 2, 6, 12)]
    listed += [Cell("periodic", runs, 0.1, outputs=SIX) for runs in (1, 12)]
    listed += [Cell("periodic", 2, 0.3, "row_wise", SIX, freedom=5)]
    for outputs, counts in ((MOTORS, (2, 4)), (SIX, (6, 12))):
        listed += [Cell("periodic", runs, 0.3, outputs=outputs, control=True) for runs in counts]
    return [*listed, *(Cell(kind, 1, 0.05, control=True) for kind in ("random", "loop"))]


@cache
def system(outputs: str) -> NoisySystem:
    """Return the model in its positions, at its lines."""
    if outputs == MOTORS:
        return SMALL
    if outputs == SIX:
        robot = robotmodels.load_robot("manutec_r3")
        positions = np.random.default_rng(1).uniform(-0.6, 0.6, (3, 6))
        fixed = FixedEquilibriumModel(robot.network(positions))
        return NoisySystem(fixed, positions, 2 * np.pi * np.linspace(4.0, 60.0, 40))
    return NoisySystem(SensedSprings(outputs=outputs))


def frozen(data: RunSpectra, response: np.ndarray) -> RunSpectra:
    """Return the same with Sigma of the true FRF as output noise, torques taken as exact."""
    m = response.shape[2]
    wide = np.concatenate([np.broadcast_to(np.eye(m), (*response.shape[:2], m, m)), -response], 3)
    exact = np.zeros_like(data.covariance)
    exact[..., :m, :m] = wide @ data.covariance @ np.conj(np.swapaxes(wide, -1, -2))
    return replace(data, covariance=exact)


def periodic(cell: Cell, count: int, rng: np.random.Generator) -> Iterator[RunSpectra]:
    """Spectra of random-phase runs."""
    measured = system(cell.outputs)
    for _ in range(count):
        data = measured.runs(rng, cell.runs, cell.noise, freedom=cell.freedom)
        yield frozen(data, measured.response) if cell.control else data


def sampled(cell: Cell, count: int, rng: np.random.Generator) -> Iterator[RunSpectra]:
    """Random torques from any state; or one block of one period in a loop that feeds noise back."""
    loop: dict[str, Any] = {}
    if cell.kind in FEEDBACK:
        loop = {"feedback": FEEDBACK[cell.kind], "lines": LINES}
    stated = (0.0 if loop else sampled_runs.TORQUE), sampled_runs.ANGLE
    seen = SEEN[cell.outputs]
    orders = np.full(len(seen), 2 if cell.outputs == MOTORS else 0)
    while count > 0:
        now = min(count, TOGETHER)
        records = sampled_runs.sampled_records(rng, now * cell.runs, SAMPLES, seen=seen, **loop)
        for first in range(0, now * cell.runs, cell.runs):
            some = _runs(replace(records, derivatives=orders), slice(first, first + cell.runs))
            data = run_spectra(some, "detection" if cell.kind == "detection" else stated)
            yield replace(data, sample_time=None) if cell.control else data
        count -= now


def _runs(records: Records, some: slice) -> Records:
    names = "reference", "torque", "angle", "saturated"
    return replace(records, **{name: getattr(records, name)[:, :, some] for name in names})


DRAWS: dict[str, Callable[[Cell, int, np.random.Generator], Iterator[RunSpectra]]] = {
    "periodic": periodic,
    "detection": sampled,
    "random": sampled,
    "loop": sampled,
}


def run_cell(cell: Cell, count: int) -> dict[str, Any]:
    """Return the figures of a cell: coverage of each parameter, cost beside its mean, verdicts."""
    rng, model = np.random.default_rng(17), system(cell.outputs).model
    truth, judged = model.parameters.values, JUDGED if cell.outputs == SIX else count
    covers, quoted, costs = [], [], []
    for i, data in enumerate(DRAWS[cell.kind](cell, count, rng)):
        fitted = fit(model, data, weights=cell.weights)
        likely = covariance(fitted)
        z = np.log(fitted.parameters.values / truth) / likely.std
        covers.append(np.abs(z) < likely.quantile(0.95))
        costs.append(fitted.cost / fitted.expected_cost)
        if i >= judged:
            continue
        ends = np.array([(one.low, one.high) for one in fitted.intervals()], dtype=float)
        if np.isfinite(ends).all():
            quoted.append((ends[:, 0] <= truth) & (ends[:, 1] >= truth))
    each = np.mean(covers, axis=0)
    result = {
        **asdict(cell),
        "studies": count,
        "freedom": None if np.isinf(cell.freedom) else cell.freedom,
        "coverage": float(each.mean()),
        "worst": float(each.min()),
        "best": float(each.max()),
        "cost": float(np.mean(costs)),
        "quoted": len(quoted) / min(judged, count),
        "quoted_coverage": float(np.mean(quoted)) if quoted else None,
    }
    return result | {"short": shortfall(cell, result)}


def shortfall(cell: Cell, result: dict[str, Any]) -> str:
    """Return what a cell falls short of."""
    if cell.control:
        most = 0.78 if cell.kind == "periodic" and cell.runs in (4, 12) else 0.85
        return "" if result["coverage"] <= most else f"control covers more than {most:.0%}"
    upper, single = (0.995, 0.995) if cell.sampled else (0.97, 0.985)
    if not 0.93 <= result["coverage"] <= upper:
        return f"coverage {result['coverage']:.3f}"
    if result["worst"] < 0.91:
        return f"one covers {result['worst']:.3f}"
    if result["best"] > single:
        return f"one covers {result['best']:.3f}"
    if cell.kind != "detection" and abs(result["cost"] - 1) > 0.02:
        return f"cost {result['cost']:.3f}"
    return ""
