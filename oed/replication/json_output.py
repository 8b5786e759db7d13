"""``published.json``: what a study that repeats [WM] section 6 found, for other programs.

``estimators``: for each its ``cost`` with user-defined weights and its ``optimal_cost``, both
normalised and sorted by the first (null: no FRF), ``start`` numbers, and the parts of reasonable
models by ``reasonable`` criterion; ``table_1``: per parameter, relative to the best LLS15U model;
``conclusions``: text, ``verdict``, ``evidence``; ``paper``: the published numbers; ``rival``:
fits in time and of FRFs, see `TimeDomainComparison` in `oed.replication.time_domain_comparison`
(null where the study has none).
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from oed.replication.paper import REASONABLE_BY_COST, REASONABLE_BY_SPRINGS, TABLE_1
from oed.replication.replicate import Replication
from oed.replication.time_domain_comparison import TimeDomainComparison
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text


def write_published_json(replication: Replication, path: Path) -> None:
    """Write the file."""
    text = json.dumps(published_document(replication), indent=1, allow_nan=False) + "\n"
    write_text(path, text)


def published_document(replication: Replication) -> dict[str, Any]:
    """Return its content."""
    e, t = replication.evaluation, replication.table
    statistics = ("minimum", "median", "maximum", "mean", "std", "theory")
    return {
        "schema": "published/1",
        "estimators": {
            name: {
                "cost": _numbers(e.user_normalised[i]),
                "optimal_cost": _numbers(e.optimal_normalised[i]),
                "start": e.start[i].tolist(),
                "reasonable": {
                    "cost": replication.by_cost[name],
                    "springs": replication.by_springs[name],
                    "all_springs": replication.by_all_springs[name],
                },
            }
            for i, name in enumerate(e.estimators)
        },
        "left_out": replication.hardest,
        "table_1": {
            "models": t.count,
            "within": t.within,
            "parameters": list(t.names),
            **{name: _numbers(getattr(t, name)) for name in statistics},
        },
        "conclusions": [
            {"conclusion": j.conclusion, "verdict": j.verdict, "evidence": j.evidence}
            for j in replication.conclusions
        ],
        "paper": {
            "reasonable_cost": REASONABLE_BY_COST,
            "reasonable_springs": REASONABLE_BY_SPRINGS,
            "table_1": {
                name: dict(zip(statistics, row, strict=True)) for name, row in TABLE_1.items()
            },
        },
        "rival": None if replication.rivalry is None else rivalry_document(replication.rivalry),
    }


def rivalry_document(comparison: TimeDomainComparison) -> dict[str, Any]:
    """Return what both ways of fitting came to, as plain data."""
    misfit = comparison.misfit if np.isfinite(comparison.misfit) else None
    return asdict(comparison) | {"misfit": misfit}


def _numbers(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
