"""The report: one self-contained HTML page."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

import robotmodels
from estimators.posterior import ESS, R_HAT, TIMES
from oed.criteria import criterion, sensitivities
from oed.study import Progress, StudyResults
from reports import figures, response_panels, robot_pictures, tables, text, uncertainty_figures
from reports.svg import inline
from reports.template import filled
from robotmodels.arrays import Array, ComplexArray

CORNER_PARAMETERS = 6
CORNER_DRAWS = 40_000


@dataclass(frozen=True)
class Picture:
    """A figure of one position."""

    number: int
    caption: str
    figure: Markup


def write_report(results: StudyResults, path: Path, progress: Progress | None = None) -> None:
    """Write the report of a study as one HTML file that needs nothing else."""
    path.write_text(render(results, progress), encoding="utf-8")


def render(results: StudyResults, progress: Progress | None = None) -> str:
    """Return the report of a study as HTML."""
    return filled("report.html.j2", page=Page(results, progress), results=results)


@dataclass(frozen=True, eq=False)
class Page:
    """What the template shows, each part made when it is asked for."""

    results: StudyResults
    progress: Progress | None = None

    @cached_property
    def facts(self) -> Mapping[str, Any]:
        """Numbers that appear in sentences."""
        r = self.results
        std, order = r.theorem1.std, np.argsort(r.theorem1.std)
        ratio = std / r.posterior.uncertainty().std
        return {
            "n_candidates": len(r.information.positions),
            "n_positions": len(r.used),
            "n_experiments": int(r.exact.repetitions.sum()),
            "gap": text.significant(r.design.gap, 2),
            "efficiency": text.efficiency(r.exact.efficiency),
            "best": r.theorem1.names[order[0]],
            "best_std": text.percent(float(std[order[0]])),
            "worst": r.theorem1.names[order[-1]],
            "worst_std": text.percent(float(std[order[-1]])),
            "r_hat": text.fixed(float(np.max(r.posterior.r_hat)), 3),
            "ess": text.count(round(float(np.min(r.posterior.ess)))),
            "tau": text.significant(float(np.max(r.posterior.autocorrelation_time)), 2),
            "r_hat_limit": text.fixed(R_HAT, 2),
            "ess_limit": text.count(int(ESS)),
            "tau_limit": text.count(int(TIMES)),
            "acceptance": text.percent(float(np.mean(r.posterior.acceptance))),
            "ratio_low": text.fixed(float(ratio.min()), 2),
            "ratio_high": text.fixed(float(ratio.max()), 2),
            "z_rms": text.fixed(float(np.sqrt(np.mean(r.z_scores**2))), 2),
            "seconds": text.duration(sum(r.seconds.values())),
            "low": text.hertz(r.omega[0]),
            "high": text.hertz(r.omega[-1]),
            "expected_cost": text.count(r.estimate.response.size - len(r.truth) // 2),
        }

    @cached_property
    def parameter_groups(self) -> dict[str, list[tables.ParameterRow]]:
        """Rows of the parameter table under springs, dampers, others."""
        groups: dict[str, list[tables.ParameterRow]] = {}
        for row in tables.parameter_rows(self.results):
            groups.setdefault(row.kind, []).append(row)
        return groups

    @property
    def motor_rows(self) -> list[tables.MotorRow]:
        """Rows of the table of motors."""
        return tables.motor_rows(self.results)

    @property
    def position_rows(self) -> list[tables.PositionRow]:
        """Rows of the table of positions."""
        return tables.position_rows(self.results)

    @property
    def convergence_rows(self) -> list[tables.ConvergenceRow]:
        """Rows of the table of emcee's convergence."""
        return tables.convergence_rows(self.results)

    @property
    def run_rows(self) -> list[tables.RunRow]:
        """Rows of the table of fits."""
        return tables.run_rows(self.results)

    @property
    def reached(self) -> list[tuple[str, int, int]]:
        """How many starts of each residual reached its best cost."""
        return tables.reached(self.results)

    @property
    def distances(self) -> list[tuple[str, str]]:
        """How far the estimates of other residuals lie."""
        return tables.distances(self.results)

    @property
    def strongest_correlation(self) -> tuple[str, str, str]:
        """Two parameters, and their correlation."""
        t = self.results.theorem1
        size = np.abs(np.triu(t.correlation, 1))
        i, j = np.unravel_index(np.argmax(size), size.shape)
        return t.names[i], t.names[j], text.fixed(float(t.correlation[i, j]), 2)

    @property
    def robot_pictures(self) -> list[Picture]:
        """The robot in each position of the plan."""
        r = self.results
        positions = r.information.positions[r.used]
        skeletons = [r.robot.skeleton_points(position) for position in positions]
        frame = robot_pictures.frame_of(skeletons)
        pictures = []
        for row, skeleton in zip(self.position_rows, skeletons, strict=True):
            alt = f"Stick figure of the robot in position {row.number}: {', '.join(row.angles)}"
            drawing = robot_pictures.stick_figure(skeleton, frame)
            caption = text.plural(row.repetitions, "experiment")
            pictures.append(Picture(row.number, caption, inline(drawing, f"pose{row.number}", alt)))
        return pictures

    @property
    def sensitivity_figure(self) -> Markup:
        """The certificate as a figure."""
        r = self.results
        gradient = criterion(r.design.criterion).gradient(r.design.information)
        value = sensitivities(gradient, r.information.matrices) / len(r.information.names)
        alt = (
            "Sensitivity of every candidate position in falling order; none exceeds one, "
            "and the positions of the design reach it"
        )
        return inline(figures.sensitivity_function(value, r.design.support), "sensitivity", alt)

    @property
    def responses(self) -> list[Picture]:
        """Measured and fitted FRFs, one figure per position."""
        r = self.results
        fitted = robotmodels.frequency_response(
            r.robot, r.estimate.positions, r.omega, r.fit.parameters.values
        )
        std = np.sqrt(r.estimate.variance)
        pictures = []
        for q, row in enumerate(self.position_rows):
            pictures.append(self._response(row, r.estimate.response[q], std[q], fitted[q]))
            if self.progress is not None:
                self.progress("report", q + 1, len(std))
        return pictures

    def _response(
        self, row: tables.PositionRow, measured: ComplexArray, std: Array, fitted: ComplexArray
    ) -> Picture:
        r = self.results
        alt = (
            f"Magnitudes of the {measured.shape[1]} by {measured.shape[2]} measured and fitted "
            f"frequency responses in position {row.number}"
        )
        drawing = response_panels.response_panels(
            r.omega, measured, std, fitted, r.robot.motor_names, outputs=r.robot.output_names
        )
        caption = f"{', '.join(row.angles)}; {text.plural(row.repetitions, 'experiment')}"
        return Picture(row.number, caption, inline(drawing, f"frf{row.number}", alt))

    @property
    def costs_figure(self) -> Markup:
        """Costs over starts."""
        r = self.results
        costs = {
            name: [run.cost for run in search.runs if np.isfinite(run.cost)]
            for name, search in r.searches.items()
        }
        best = {name: tables.best_cost(r, name) for name in costs}
        alt = "Final cost of every fit over the best cost of its residual, a dot per start"
        return inline(figures.costs_over_starts(costs, best), "costs", alt)

    @property
    def intervals_figure(self) -> Markup:
        """Estimates against the truth."""
        r = self.results
        theorem = np.log(r.fit.parameters.values / r.truth)
        sampled = self._draws.mean(axis=0) - np.log(r.truth)
        stds = (r.theorem1.std, r.posterior.uncertainty().std)
        alt = "Estimates against the truth with one standard deviation by Theorem 1 and by emcee"
        drawing = uncertainty_figures.intervals(r.theorem1.names, (theorem, sampled), stds)
        return inline(drawing, "intervals", alt)

    @property
    def correlation_figure(self) -> Markup:
        """Correlations of all parameters."""
        t = self.results.theorem1
        alt = "Heat map of the correlations between all estimated parameters"
        drawing = uncertainty_figures.correlation_map(t.names, t.correlation)
        return inline(drawing, "correlation", alt)

    @cached_property
    def corner_names(self) -> list[str]:
        """The least certain parameters, in the order of all."""
        t = self.results.theorem1
        chosen = np.sort(np.argsort(-t.std)[:CORNER_PARAMETERS])
        return [t.names[i] for i in chosen]

    @property
    def corner_figure(self) -> Markup:
        """Corner plot of the least certain parameters."""
        r = self.results
        i = [r.theorem1.names.index(name) for name in self.corner_names]
        every = max(len(self._draws) // CORNER_DRAWS, 1)
        estimate = np.log(r.fit.parameters.values)
        draws = 100 * (self._draws[::every] - estimate)[:, i]
        truth = 100 * (np.log(r.truth) - estimate)[i]
        covariance = 1e4 * r.theorem1.covariance[np.ix_(i, i)]
        alt = f"Corner plot of the posterior of {text.listed(self.corner_names)}"
        drawing = uncertainty_figures.corner_plot(self.corner_names, draws, covariance, truth)
        return inline(drawing, "corner", alt)

    @property
    def _draws(self) -> Array:
        chains = self.results.posterior.chains
        return chains.reshape(-1, chains.shape[-1])
