"""What ``oed frf`` shows: one HTML page, one screen of text."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from estimators.compare import Comparison
from oed.measured_frf import MeasuredFrf, Progress
from reports import response_panels, text
from reports.columns import number, plain, plural, table
from reports.frf_figures import detection_panels
from reports.svg import inline
from reports.template import filled
from robotmodels.arrays import Array


@dataclass(frozen=True)
class LevelRow:
    """What one output of one position shows, as text."""

    position: int
    output: str
    std: str
    noise: str
    distortion: str
    odd: str
    even: str


@dataclass(frozen=True)
class Position:
    """Figures of one position; no detection figure without detection lines."""

    number: int
    caption: str
    responses: Markup
    detection: Markup | None


@dataclass(frozen=True)
class MethodRow:
    """How a method fared in the comparison."""

    name: str
    error: str
    bias: str


def write_frf_page(
    found: MeasuredFrf, source: Path, path: Path, progress: Progress | None = None
) -> None:
    """Write FRFs as one HTML file that needs nothing else."""
    page = FrfPage(found, source, progress)
    path.write_text(filled("frf.html.j2", page=page, found=found), encoding="utf-8")


@dataclass(frozen=True, eq=False)
class FrfPage:
    """What the template shows, each part made when it is asked for."""

    found: MeasuredFrf
    source: Path
    progress: Progress | None = None

    @property
    def title(self) -> str:
        """The robot's name, or the file's."""
        return self.found.robot.name if self.found.robot is not None else self.source.name

    @property
    def outputs(self) -> list[str]:
        """Names of the rows of FRFs."""
        return output_names(self.found)

    @cached_property
    def facts(self) -> dict[str, str]:
        """Numbers that appear in sentences."""
        r, e = self.found.first, self.found.estimate
        blocks, experiments, periods = r.torque.shape[1:4]
        return {
            "positions": text.plural(len(e.positions), "position"),
            "blocks": text.plural(blocks, "block"),
            "experiments": text.plural(experiments, "experiment"),
            "periods": text.plural(periods, "period"),
            "period": text.significant(r.samples * r.sample_time, 3) + f"{text.THIN}s",
            "lines": text.plural(len(e.omega), "line"),
            "low": text.hertz(e.omega[0]),
            "high": text.hertz(e.omega[-1]),
            "std": text.percent(float(np.median(relative_std(self.found)))),
            "excess": _ratio(excess(self.found)),
            "missing": text.plural(self.found.missing, "experiment"),
        }

    @property
    def level_rows(self) -> list[LevelRow]:
        """Rows of the table of levels."""
        return level_rows(self.found)

    @property
    def method_rows(self) -> list[MethodRow]:
        """Rows of the comparison, best first."""
        return [] if self.found.comparison is None else method_rows(self.found.comparison)

    @property
    def positions(self) -> list[Position]:
        """Figures, position by position."""
        total, shown = len(self.found.estimate.positions), []
        for q in range(total):
            shown.append(self._position(q))
            if self.progress is not None:
                self.progress("page", q + 1, total)
        return shown

    def _position(self, q: int) -> Position:
        found, e, d = self.found, self.found.estimate, self.found.distortion
        drawing = response_panels.response_panels(
            e.omega,
            e.response[q],
            np.sqrt(e.variance[q]),
            None if found.modelled is None else found.modelled[q],
            found.motors,
            noise=None if d is None else np.sqrt(d.noise[q]),
            distortion=None if d is None else mean_distortion(found)[q],
            outputs=self.outputs,
        )
        alt = (
            f"Magnitudes of the measured frequency responses in position {q + 1}, with their "
            "standard deviations and what of them is noise and distortion"
        )
        caption = ", ".join(text.places(e.positions[q], prismatic_joints(found)))
        if len(found.visits[q]) > 1:
            numbers = [str(i + 1) for i in found.visits[q]]
            caption += f"; mean of visits {text.listed(numbers)}"
        detection = None
        if d is not None and len(d.odd_omega) + len(d.even_omega):
            words = f"Motion at excited, odd and even detection lines in position {q + 1}"
            panels = detection_panels(d, q, self.outputs)
            detection = inline(panels, f"detection{q + 1}", words)
        return Position(q + 1, caption, inline(drawing, f"frf{q + 1}", alt), detection)


def prismatic_joints(found: MeasuredFrf) -> list[bool]:
    """Return which coordinates of a position are in m; in rad where no robot is known."""
    if found.robot is None:
        return [False] * found.estimate.positions.shape[1]
    return [joint in found.robot.elements.prismatic for joint in found.robot.motor_joints]


def output_names(found: MeasuredFrf) -> list[str]:
    """Return names of the rows of FRFs: motors, then other sensors by number."""
    m = found.estimate.response.shape[2]
    names = list(found.motors[:m])
    return names + [f"sensor {i + 1}" for i in range(m - len(names))]


def relative_std(found: MeasuredFrf) -> Array:
    """Return standard deviations of the FRFs over their magnitudes, (Q, F, m, n)."""
    e = found.estimate
    return np.asarray(np.sqrt(e.variance) / np.maximum(np.abs(e.response), 1e-300))


def mean_distortion(found: MeasuredFrf) -> Array:
    """Return the part of the FRFs' standard deviations that is distortion, (Q, F, m, n)."""
    d = found.distortion
    if d is None:
        return np.full(found.estimate.response.shape, np.nan)
    return np.asarray(np.sqrt(np.maximum(d.total - d.noise, 0.0)))


def excess(found: MeasuredFrf) -> float:
    """Return the median ratio of total to noise variances; 1 without distortion."""
    d = found.distortion
    if d is None or np.isnan(d.total).all():
        return float("nan")
    return float(np.nanmedian(d.total / d.noise))


def level_rows(found: MeasuredFrf) -> list[LevelRow]:
    """Return medians over lines and inputs, for each position and output."""
    e, d = found.estimate, found.distortion
    size, rows = np.abs(e.response), []
    std, noise = (np.sqrt(v) / size for v in (e.variance, e.variance if d is None else d.noise))
    apart = mean_distortion(found) / size
    for q, i in np.ndindex(e.response.shape[0], e.response.shape[2]):
        rows.append(
            LevelRow(
                position=q + 1,
                output=output_names(found)[i],
                std=text.percent(float(np.median(std[q, :, i]))),
                noise="–" if d is None else text.percent(float(np.median(noise[q, :, i]))),
                distortion=_percent(apart[q, :, i]),
                odd="–" if d is None else _below(d.odd_level[q, :, i], d.output[q, :, i]),
                even="–" if d is None else _below(d.even_level[q, :, i], d.output[q, :, i]),
            )
        )
    return rows


def method_rows(comparison: Comparison) -> list[MethodRow]:
    """Return the methods, best first, with relative error and bias, rms over lines."""
    bias = np.sqrt(np.mean((comparison.bias / comparison.response) ** 2, axis=1))
    order = np.argsort(comparison.scores, kind="stable")
    return [
        MethodRow(
            comparison.methods[i],
            text.percent(float(comparison.scores[i])),
            text.percent(float(bias[i])),
        )
        for i in order
    ]


def frf_summary(found: MeasuredFrf, files: list[Path]) -> str:
    """Return the summary of estimated FRFs, one screen."""
    e, r = found.estimate, found.first
    blocks, experiments, periods = r.torque.shape[1:4]
    medians = relative_std(found)
    lines = [
        (
            "records",
            f"{plural(len(e.positions), 'position')}, {plural(blocks, 'block')} of "
            f"{plural(experiments, 'experiment')}, {plural(periods, 'period')}",
        ),
        (
            "FRFs",
            f"{found.method}, {e.response.shape[2]} x {e.response.shape[3]} at "
            f"{plural(len(e.omega), 'line')} from {plain(text.hertz(e.omega[0]))} to "
            f"{plain(text.hertz(e.omega[-1]))}",
        ),
        ("std", f"{plain(text.percent(float(np.median(medians))))} of the element (median)"),
    ]
    if found.distortion is not None:
        ratio = excess(found)
        if np.isfinite(ratio):
            lines.append(("", f"variance over blocks is {number(ratio)} times that of noise alone"))
    lines += [("written", str(path)) for path in files]
    shown = [f"  {key:<9}{value}" for key, value in lines]
    if found.comparison is not None:
        shown += _ranking(found.comparison)
    return "\n".join([found.robot.name if found.robot else "frequency responses", *shown])


def frf_json(found: MeasuredFrf, files: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts; frequencies in rad/s."""
    e, ratio = found.estimate, excess(found)
    ranking = {}
    if found.comparison is not None:
        ranking = dict(
            zip(found.comparison.methods, map(float, found.comparison.scores), strict=True)
        )
    return {
        "robot": found.robot.name if found.robot else None,
        "method": found.method,
        "positions": len(e.positions),
        "missing_experiments": found.missing,
        "outputs": e.response.shape[2],
        "inputs": e.response.shape[3],
        "lines": len(e.omega),
        "band": [float(e.omega[0]), float(e.omega[-1])],
        "relative_std": float(np.median(relative_std(found))),
        "variance_over_noise": ratio if np.isfinite(ratio) else None,
        "relative_error": ranking,
        "warnings": list(found.warnings),
        "files": [str(path) for path in files],
    }


def _ranking(comparison: Comparison) -> list[str]:
    """Return the table of methods."""
    rows = [(row.name, plain(row.error), plain(row.bias)) for row in method_rows(comparison)]
    header = ("methods on this loop, best first", "relative\nerror", "\nbias")
    return table(header, rows, right=(1, 2))


def _percent(values: Array) -> str:
    known = values[np.isfinite(values)]
    return text.percent(float(np.median(known))) if known.size else "–"


def _ratio(value: float) -> str:
    return text.significant(value, 2) if np.isfinite(value) else ""


def _below(level: Array, output: Array) -> str:
    """Return how far distortion lies below the excited motion, both rms over their lines."""
    if not level.size:
        return "–"
    ratio = np.sqrt(np.mean(level**2)) / np.sqrt(np.mean(output**2))
    if ratio == 0:
        return "in noise"
    return f"{text.fixed(round(20 * float(np.log10(ratio))) + 0.0, 0)}{text.THIN}dB"
