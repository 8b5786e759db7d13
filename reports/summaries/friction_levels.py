"""Levels of the motors' Coulomb friction by fits to runs, in words and for scripts."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from estimators.fitting.run_fit import FrictionLevel
from reports import text
from reports.summaries.columns import number, plain
from robotmodels.common.plain_data import json_data


def level_words(one: FrictionLevel) -> str:
    """Return ``1.420 N m (std 0.010; 1.400 to 1.450 over positions; robot file 1.2)``."""
    in_file = [] if one.in_file is None else [f"robot file {one.in_file:g}"]
    if math.isnan(one.level):
        return "; ".join(["not seen, the motor is at rest", *in_file])
    decimals = text.decimals_for(one.std)
    level, low, high = (text.fixed(x, decimals) for x in (one.level, one.lowest, one.highest))
    parts = [f"std {number(one.std, 2)}"]
    parts += [f"{low} to {high} over positions"] if one.lowest < one.highest else []
    return plain(f"{level} N m ({'; '.join(parts + in_file)})")


def levels_json(levels: Sequence[FrictionLevel]) -> list[dict[str, Any]]:
    """Return the levels for scripts [N m]."""
    return [json_data(asdict(one)) for one in levels]
