"""What ``oed chains`` says at the end, and the file of its numbers."""

import json
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from estimators.chain_dampers.chains_from_records import MeasuredChains
from estimators.chains.chain_estimate import ChainEstimate
from estimators.trust.intervals import Interval, Verdict, interval_document
from reports import text
from reports.summaries.columns import WIDTH, number, plain, plural, table
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text

_UNITS = {"m": ("kg m²", "kg"), "K": ("N m/rad", "N/m")}


def chains_summary(shown: MeasuredChains, files: list[Path]) -> str:
    """Return the summary of identified chains, about a screen."""
    identification, e, verdict = shown.identification, shown.recommended, verdict_of(shown)
    count, length = identification.masses.shape
    proposed = " (proposed)" if identification.order is not None else ""
    modes = identification.modes
    words = f"{verdict}: {verdict.reason}"
    head = [
        f"{plural(count, 'chain')} of {length} masses{proposed}",
        f"  lines    {len(modes.data.omega)} from {_hertz(modes.data.omega[0])} to "
        f"{_hertz(modes.data.omega[-1])}",
        f"  modes    {', '.join(number(w / (2 * np.pi), 4) for w in modes.omega)} Hz",
        *textwrap.wrap(f"  verdict  {words}", WIDTH, subsequent_indent=" " * 11),
        *textwrap.wrap(f"  method   {method_of(shown)}", WIDTH, subsequent_indent=" " * 11),
    ]
    rows = [
        (i.name, _shown(i.value, refused(i)), *_ends(i), _shown(float(inverse), refused(i)))
        for i, inverse in zip(e.intervals, identification.inverse.values, strict=True)
    ]
    header = ("", "\nvalue", "95 %\nfrom", "interval\nto", "inverse\nproblem")
    body = table(header, rows, right=(1, 2, 3, 4))
    return "\n".join([*head, *body, *(f"  written  {path}" for path in files)])


def refused(interval: Interval) -> bool:
    """Tell that the verdict gives no interval: the value is not to be quoted."""
    return interval.low is None and interval.high is None


def verdict_of(shown: MeasuredChains) -> Verdict:
    """Return the verdict on the recommended estimate."""
    verdict = shown.recommended.verdict
    assert verdict is not None  # records are never exact, so that there is one
    return verdict


def method_of(shown: MeasuredChains) -> str:
    """Return what the recommended intervals come from."""
    methods = [i.method for i in shown.recommended.intervals if i.method != "given"]
    return f"{shown.recommended.method}; {methods[0]}" if methods else shown.recommended.method


def _shown(value: float, hidden: bool) -> str:
    return "-" if hidden else number(value, 5)


def _ends(interval: Interval) -> tuple[str, str]:
    if interval.method == "given":
        return "given", ""
    low, high = ("-" if v is None else number(v, 6) for v in (interval.low, interval.high))
    return low, high


def chains_json(shown: MeasuredChains, files: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts, in SI units."""
    return {**_contents(shown), "files": [str(path) for path in files]}


def write_chains(shown: MeasuredChains, path: Path) -> None:
    """Write the chains, their covariance and their modes as JSON, in SI units."""
    contents = _contents(shown)
    e = shown.recommended
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.nan_to_num(e.std / np.sqrt(np.diag(e.covariance)), nan=0.0, posinf=0.0)
    contents["covariance"] = (
        None if any(map(refused, e.intervals)) else (e.covariance * np.outer(scale, scale)).tolist()
    )
    write_text(path, json.dumps(contents, indent=1, allow_nan=False))


def _contents(shown: MeasuredChains) -> dict[str, Any]:
    identification, modes, e = shown.identification, shown.identification.modes, shown.recommended
    dampers = None
    if shown.dampers is not None:
        d = shown.dampers
        dampers = {
            "dampers": d.dampers.tolist(),
            "dampers_std": d.dampers_std.tolist(),
            "friction": d.model.friction.tolist(),
            "friction_std": d.friction_std.tolist(),
            "delay": d.model.delay,
            **_estimate(d.estimate),
        }
    verdict = verdict_of(shown)
    evidence = {} if e.trust is None else e.trust.document()
    return {
        "schema": "chains/1",
        "verdict": str(verdict),
        "reason": verdict.reason,
        "method": method_of(shown),
        "intervals": [interval_document(i) for i in e.intervals],
        "chains": len(identification.masses),
        "masses_per_chain": identification.n_masses,
        "proposed": identification.order is not None,
        "names": list(identification.names),
        "values": e.values.tolist(),
        "std": _std(e),
        "damping_free": _estimate(identification.structured),
        "with_dampers": dampers,
        "inverse_values": identification.inverse.values.tolist(),
        "inverse_std": identification.inverse.std.tolist(),
        "condition": identification.inverse.condition,
        "resonances": modes.omega.tolist(),
        "resonances_std": modes.omega_std.tolist(),
        "anti_resonances": modes.zeros.tolist(),
        "anti_resonances_std": modes.zeros_std.tolist(),
        "damping_ratios": modes.damping.tolist(),
        "delay": modes.delay,
        "misfit": finite_or_none(identification.misfit),
        "structure_p_value": finite_or_none(identification.structure_p_value),
        "residuals": evidence.get("residuals"),
        "directions": evidence.get("directions"),
        "warnings": list(shown.warnings),
    }


def _estimate(e: ChainEstimate) -> dict[str, Any]:
    """Return an estimate with its verdict."""
    return {
        "values": e.values.tolist(),
        "std": _std(e),
        "verdict": None if e.verdict is None else str(e.verdict),
        "reason": None if e.verdict is None else e.verdict.reason,
    }


def _std(e: ChainEstimate) -> list[float | None]:
    """Return standard deviations, none where the verdict gives no interval."""
    hidden = [refused(i) for i in e.intervals] or [False] * len(e.names)
    return [
        None if none else finite_or_none(float(s)) for none, s in zip(hidden, e.std, strict=True)
    ]


def finite_or_none(value: float) -> float | None:
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
