"""``published.json``: results of a study that repeats [WM] section 6, for other programs.

``estimators``: for each its ``cost`` with user-defined weights and its ``optimal_cost``, both
normalised and sorted by the first (null: no FRF), ``start`` numbers, and the parts of reasonable
models by ``reasonable`` criterion; ``table_1``: per parameter, relative to the best LLS15U model;
``conclusions``: text, ``verdict``, ``evidence``; ``paper``: the published numbers; ``time_domain``:
fits in time and of FRFs, see `TimeDomainComparison` in `oed.replication.time_domain_comparison`
(null where the study has none); ``minima``: see `LocalMinima` in `oed.replication.local_minima`
(likewise);
``as_published``: ``estimators`` and ``conclusions`` of the paper's choices (null: not asked for).
"""

from pathlib import Path
from typing import Any

from oed.replication.paper import REASONABLE_BY_COST, REASONABLE_BY_SPRINGS, TABLE_1
from oed.replication.replicate import Replication
from robotmodels.common.plain_data import write_json


def write_published_json(replication: Replication, path: Path) -> None:
    """Write the file."""
    write_json(path, published_document(replication))


def published_document(replication: Replication) -> dict[str, Any]:
    """Return its content."""
    t, other = replication.table, replication.as_published
    statistics = ("minimum", "median", "maximum", "mean", "std", "theory")
    return {
        "schema": "published/1",
        "estimators": _estimators(replication),
        "left_out": replication.hardest,
        "table_1": {
            "models": t.count,
            "within": t.within,
            "parameters": list(t.names),
            **{name: getattr(t, name) for name in statistics},
        },
        "conclusions": replication.conclusions,
        "paper": {
            "reasonable_cost": REASONABLE_BY_COST,
            "reasonable_springs": REASONABLE_BY_SPRINGS,
            "table_1": {
                name: dict(zip(statistics, row, strict=True)) for name, row in TABLE_1.items()
            },
        },
        "time_domain": replication.time_domain,
        "minima": replication.minima,
        "as_published": None
        if other is None
        else {"estimators": _estimators(other), "conclusions": other.conclusions},
    }


def _estimators(replication: Replication) -> dict[str, Any]:
    e = replication.evaluation
    return {
        name: {
            "cost": e.user_normalised[i],
            "optimal_cost": e.optimal_normalised[i],
            "start": e.start[i],
            "reasonable": {
                "cost": replication.by_cost[name],
                "springs": replication.by_springs[name],
                "all_springs": replication.by_all_springs[name],
            },
        }
        for i, name in enumerate(e.estimators)
    }
