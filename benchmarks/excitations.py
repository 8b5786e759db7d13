"""What published remarks on excitations are worth here, in the information of springs and dampers.

``python benchmarks/excitations.py [ROBOT ...]`` writes `benchmarks/results/excitations.json`. All
figures are D-efficiencies or ratios of root mean squares; none depends on the machine.
"""

import json
import sys
from functools import partial
from typing import Any

import numpy as np
from linearisation import HERE
from scipy.stats import qmc

import oed
import robotmodels
from oed.experiment.draw_plan import reduced_crest
from robotmodels.common.arrays import Array, ComplexArray

TORQUE = {
    "manutec_r3": np.array([9.0, 9.0, 9.0, 1.9, 2.0, 0.65]),
    "ur10": np.array([3.3, 3.3, 1.5, 0.55, 0.55, 0.55]),
}
POSITIONS, FULL_LINES = 8, 40
CAP = 3.0


class Setting:
    """A robot, a few positions, the noise of a period and lines."""

    def __init__(self, name: str, lines: int) -> None:
        self.robot, self.torque = robotmodels.load_robot(name), TORQUE[name]
        low, high = self.robot.position_limits.T
        points = qmc.Sobol(len(low), rng=np.random.default_rng(1)).random(POSITIONS)
        self.positions = low + points * (high - low)
        self.omega = 2 * np.pi * np.linspace(2.0, 80.0, lines)
        self.noise = robotmodels.InputOutputNoise.of_levels(self.torque, lines, speed=0.02)

    def information(self, spectrum: ComplexArray) -> Array:
        """Return the information of a spectrum (Q, F, n, n) in each position, (Q, p, p)."""
        law = robotmodels.ExcitationNoise(spectrum, self.noise)
        return np.asarray(oed.information(self.robot, self.positions, self.omega, law).matrices)

    def best(self, matrices: Array) -> float:
        """Return log det / p of the best shares of these positions."""
        info = oed.InformationSet(self.positions, matrices, self.robot.parameters.names)
        return oed.optimal_design(info, "D", solver="newton").value / len(info.names)


def one_run_against_all(setting: Setting) -> dict[str, float]:
    """Zimmermann and Moberg, arXiv 2312.06276: one experiment for n, per measured second."""
    table = oed.experiment_candidates(
        setting.robot,
        setting.positions,
        ["orthogonal", "zippered", "random_phase"],
        setting.omega,
        setting.noise,
        torque=setting.torque,
        periods=1,
    )
    n = len(setting.torque)
    sets = np.split(table.information.take(np.arange(len(table))), 3)
    values = [setting.best(one) for one in (sets[0], n * sets[1], n * sets[2])]
    ratios = np.exp(np.array(values) - values[0])
    return {"zippered": float(ratios[1]), "random_phase": float(ratios[2])}


def spectral_matrices(setting: Setting) -> dict[str, float]:
    """Dirkx, van de Wijdeven and Oomen 2020: directions matter, full against diagonal matrices."""
    design = partial(
        oed.optimal_spectra,
        setting.robot,
        setting.positions,
        setting.omega,
        setting.noise,
        setting.torque,
        tolerance=1e-3,
    )
    p, gains = len(setting.robot.parameters), {}
    for cap in (1.0, CAP):
        diagonal, full = design(line_cap=cap), design(line_cap=cap, full=True)
        gains[f"diagonal over flat, cap {cap:g}"] = 1 / diagonal.flat_efficiency
        gains[f"full over diagonal, cap {cap:g}"] = np.exp((full.value - diagonal.value) / p)
        gains[f"single runs of full, cap {cap:g}"] = full.run_efficiency
    return {name: float(gain) for name, gain in gains.items()}


def largest_root_mean_square(setting: Setting) -> dict[str, float]:
    """Tantau et al.: multisines of the largest root mean square within limits of peaks."""
    n, rng = len(setting.torque), np.random.default_rng(1)
    sine = oed.band_multisine(4000, 0.002, (4 * np.pi, 120 * np.pi), inputs=n)
    phases = oed.random_phases(sine, 20, rng=rng)
    lowered = reduced_crest(sine, phases, 200)
    before, after = (oed.crest_factor(sine.reference(p)[:, 0], axis=1) for p in (phases, lowered))
    return {
        "crest, random": float(np.median(before)),
        "crest, lowered": float(np.median(after)),
        "root mean square": float(np.median(before / after)),
    }


def limited_outputs(setting: Setting) -> dict[str, float]:
    """[WM]: an orthogonal multisine in closed loop is optimal given output amplitude constraints.

    Speeds of flat spectra and orthogonal phases against the best spectral matrices with the same
    root mean square speeds, torques and largest line.
    """
    f, n = len(setting.omega), len(setting.torque)
    G = robotmodels.frequency_response(setting.robot, setting.positions, setting.omega)
    inverse = np.linalg.inv(G / (1j * setting.omega[:, None, None]))
    Phi = inverse @ np.conj(np.swapaxes(inverse, -1, -2)) / f  # speeds of one rad/s each
    tracked = setting.best(setting.information(Phi))
    torque = np.sqrt(np.einsum("qfii->qi", Phi).real.max(axis=0))
    cap = np.einsum("qfii,i->qf", Phi, 1 / torque**2).real.max() * f / n
    limits = {"speed": 1.0, "line_cap": float(cap), "tolerance": 1e-2}
    p, values = len(setting.robot.parameters), {}
    for name, full in (("diagonal", False), ("full", True)):
        design = oed.optimal_spectra(
            setting.robot,
            setting.positions,
            setting.omega,
            setting.noise,
            torque,
            full=full,
            **limits,
        )
        values[f"orthogonal speeds, {name}"] = np.exp(tracked - design.value / p)
        values[f"flat torques, {name}"] = design.flat_efficiency
        values[f"single runs, {name}"] = design.run_efficiency
    return {name: float(value) for name, value in values.items()}


PARTS = {
    "one run against n, per measured second": (one_run_against_all, 390),
    "spectral matrices": (spectral_matrices, FULL_LINES),
    "root mean square within limits of peaks": (largest_root_mean_square, FULL_LINES),
    "orthogonal speeds against the best spectra": (limited_outputs, FULL_LINES),
}


def main() -> None:
    """Print and write all figures."""
    results: dict[str, dict[str, Any]] = {}
    for robot in sys.argv[1:] or list(TORQUE):
        for name, (part, lines) in PARTS.items():
            results.setdefault(robot, {})[name] = part(Setting(robot, lines))
            print(robot, name, results[robot][name], flush=True)
    target = HERE / "results" / "excitations.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
