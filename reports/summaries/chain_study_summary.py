"""What ``oed run`` says of a study of coupled chains, and its numbers as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from oed.chain_study.run_chain_study import ChainStudyResults
from reports.summaries.chains_summary import chains_json, chains_summary
from reports.summaries.columns import plain
from reports.text import percent
from robotmodels.common.atomic_files import write_text

_WAYS = {
    "read_off": "gains read off",
    "stepwise": "step by step",
    "likely": "most likely",
}


def largest_errors(results: ChainStudyResults) -> dict[str, tuple[float, str]]:
    """Return, for each way of identification, the largest relative error and its parameter."""
    truth = results.true_values
    # A coupling may be zero: its error counts in units of the masses that it couples.
    layout = results.stepwise.layout
    last = results.truth.masses[:, -1]
    i, j = np.triu_indices(layout.chains, 1)
    scale = np.concatenate([truth[: layout.positive], np.sqrt(last[i] * last[j])])
    errors = {}
    for way, values in (
        ("read_off", results.read_off),
        ("stepwise", results.stepwise.values),
        ("likely", results.measured.recommended.values),
    ):
        relative = np.abs(values - truth) / scale
        worst = int(np.argmax(relative))
        errors[way] = (float(relative[worst]), layout.names[worst])
    return errors


def chain_study_summary(results: ChainStudyResults, files: list[Path]) -> str:
    """Return the summary, about a screen: the chains, and how far from those simulated."""
    *lines, _ = chains_summary(results.measured, files[:1]).split("\n")
    errors = [
        f"  error    {_WAYS[way]}: at most {plain(percent(error))} ({name})"
        for way, (error, name) in largest_errors(results).items()
    ]
    return "\n".join([*lines, *errors, *(f"  written  {path}" for path in files)])


def chain_study_json(results: ChainStudyResults, files: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts, in SI units."""
    responses = results.responses
    return {
        **chains_json(results.measured, files),
        "schema": "chain_study_results/1",
        "simulated": results.true_values.tolist(),
        "read_off": results.read_off.tolist(),
        "stepwise": results.stepwise.values.tolist(),
        "stepwise_std": results.stepwise.std.tolist(),
        "gains": {
            "low": responses.low.tolist(),
            "low_std": responses.low_std.tolist(),
            "high": responses.high.tolist(),
            "high_std": responses.high_std.tolist(),
            "cross": responses.cross_low.tolist(),
            "cross_std": responses.cross_std.tolist(),
        },
        "steps": [
            {
                "first": one.first.tolist(),
                "b11": one.step.b11,
                "b12": one.step.b12,
                "b22": one.step.b22,
                "d2": one.step.d2.tolist(),
                "second": one.step.u2.tolist(),
            }
            for one in results.steps
        ],
        "largest_errors": {
            way: {"error": error, "parameter": name}
            for way, (error, name) in largest_errors(results).items()
        },
    }


def write_chain_study(results: ChainStudyResults, path: Path) -> None:
    """Write the numbers of a study of coupled chains as JSON, in SI units."""
    document = {k: v for k, v in chain_study_json(results, []).items() if k != "files"}
    write_text(path, json.dumps(document, indent=1, allow_nan=False))
