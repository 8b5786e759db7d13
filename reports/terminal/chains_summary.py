"""What ``oed chains`` says at the end, and the file of its numbers."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from oed.experiment.measured_chains import MeasuredChains
from reports import text
from reports.terminal.columns import number, plain, plural, table
from robotmodels.arrays import Array

_UNITS = {"m": ("kg m²", "kg"), "K": ("N m/rad", "N/m")}


def chains_summary(shown: MeasuredChains, files: list[Path]) -> str:
    """Return the summary of identified chains, about a screen."""
    found, e = shown.found, shown.found.structured
    count, length = found.masses.shape
    proposed = " (proposed)" if found.order is not None else ""
    modes = found.modes
    head = [
        f"{plural(count, 'chain')} of {length} masses{proposed}",
        f"  lines    {len(modes.data.omega)} from {_hertz(modes.data.omega[0])} to "
        f"{_hertz(modes.data.omega[-1])}",
        f"  modes    {', '.join(number(w / (2 * np.pi), 4) for w in modes.omega)} Hz",
    ]
    rows = [
        (
            name,
            number(value, 5),
            plain(text.percent(relative)),
            number(inverse, 5),
            plain(text.percent(other)),
        )
        for name, value, relative, inverse, other in zip(
            e.names,
            e.values,
            e.relative_std,
            found.inverse.values,
            found.inverse.relative_std,
            strict=True,
        )
    ]
    header = ("", "maximum\nlikelihood", "\nstd", "inverse\nproblem", "\nstd")
    body = table(header, rows, right=(1, 2, 3, 4))
    return "\n".join([*head, *body, *(f"  written  {path}" for path in files)])


def chains_json(shown: MeasuredChains, files: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts, in SI units."""
    return {**_contents(shown), "files": [str(path) for path in files]}


def write_chains(shown: MeasuredChains, path: Path) -> None:
    """Write the chains, their covariance and their modes as JSON, in SI units."""
    contents = _contents(shown)
    contents["covariance"] = shown.found.covariance.tolist()
    path.write_text(json.dumps(contents, indent=1, allow_nan=False), encoding="utf-8")


def _contents(shown: MeasuredChains) -> dict[str, Any]:
    found, modes = shown.found, shown.found.modes
    dampers = None
    if shown.dampers is not None:
        d = shown.dampers
        dampers = {
            "dampers": d.dampers.tolist(),
            "dampers_std": d.dampers_std.tolist(),
            "friction": d.model.friction.tolist(),
            "friction_std": d.friction_std.tolist(),
            "delay": d.model.delay,
            "values": d.estimate.values.tolist(),
            "std": d.estimate.std.tolist(),
        }
    return {
        "schema": "chains/1",
        "chains": len(found.masses),
        "masses_per_chain": found.n_masses,
        "proposed": found.order is not None,
        "names": list(found.names),
        "values": found.structured.values.tolist(),
        "std": found.structured.std.tolist(),
        "inverse_values": found.inverse.values.tolist(),
        "inverse_std": found.inverse.std.tolist(),
        "condition": found.inverse.condition,
        "resonances": modes.omega.tolist(),
        "resonances_std": modes.omega_std.tolist(),
        "anti_resonances": modes.zeros.tolist(),
        "anti_resonances_std": modes.zeros_std.tolist(),
        "damping_ratios": modes.damping.tolist(),
        "delay": modes.delay,
        "misfit": known(found.misfit),
        "structure_p_value": known(found.structure_p_value),
        "with_dampers": dampers,
        "warnings": list(shown.warnings),
    }


def known(value: float) -> float | None:
    """Return a number, or None for one that is not."""
    return value if np.isfinite(value) else None


def unit(name: str) -> str:
    """Return the unit of a parameter about an axis and along a line."""
    angular, linear = _UNITS[name[0]]
    return f"{angular} or {linear}"


def in_hertz(omega: Array) -> Array:
    """Return angular frequencies in Hz."""
    return np.asarray(omega / (2 * np.pi))


def _hertz(omega: float) -> str:
    return plain(text.hertz(omega))
