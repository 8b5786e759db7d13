"""What a plan's files hold, from and to the plan."""

from typing import TYPE_CHECKING, Any

import numpy as np

from oed.experiment.carrier import Carrier
from oed.experiment.moves import MoveLimits
from oed.experiment.multisine import Multisine
from oed.experiment.plan_files import OrderSection, PlanFile
from oed.experiment.visiting_order import VisitingOrder
from robotmodels.common.arrays import read_only
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from oed.experiment.experiment_plan import ExperimentPlan


def plan_arguments(file: PlanFile, arrays: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of the `ExperimentPlan` that a file and its arrays hold."""
    carrier = file.carrier
    return {
        "robot": file.robot,
        "positions": _matrix("positions", file.positions),
        "repetitions": np.array(file.repetitions, dtype=np.int64),
        "multisine": Multisine(
            samples=file.multisine.samples,
            sample_time=file.multisine.sample_time,
            lines=np.array(file.multisine.lines, dtype=np.int64),
            inputs=len(file.motors),
            amplitudes=arrays["amplitudes"],
            detection=np.array(file.multisine.detection, dtype=np.int64),
            odd=file.multisine.odd,
        ),
        "phases": arrays["phases"],
        "periods": file.periods,
        "transient_periods": file.transient_periods,
        "moves": MoveLimits(
            motors=tuple(file.motors),
            positions=np.array(file.moves.positions),
            speed=np.array(file.moves.speed),
            acceleration=np.array(file.moves.acceleration),
        ),
        "scale": arrays["scale"],
        "start": np.array(file.moves.start),
        "order": _order(file.order, len(file.positions)),
        "ramp": file.ramp,
        "runs": file.runs,
        "settle": file.settle,
        "carrier": carrier
        and Carrier(
            carrier.line,
            _matrix("carrier.amplitudes", carrier.amplitudes),
            _matrix("carrier.phases", carrier.phases),
        ),
    }


def plan_document(plan: "ExperimentPlan") -> dict[str, Any]:
    """Return what the file of a plan holds beside its arrays."""
    sine, moves = plan.multisine, plan.moves
    start = plan.positions[0] if plan.start is None else plan.start
    return {
        "schema": "plan/1",
        "robot": plan.robot,
        "motors": list(plan.motors),
        "duration": plan.duration,
        "blocks": plan.blocks,
        "runs": plan.runs,
        "periods": plan.periods,
        "transient_periods": plan.transient_periods,
        "ramp": plan.ramp,
        "settle": plan.settle,
        **_carrier_document(plan.carrier),
        "repetitions": plan.repetitions.tolist(),
        "positions": plan.positions.tolist(),
        **_order_document(plan.order),
        "moves": {
            "positions": moves.positions.tolist(),
            "speed": moves.speed.tolist(),
            "acceleration": moves.acceleration.tolist(),
            "start": start.tolist(),
        },
        "multisine": {
            "samples": sine.samples,
            "sample_time": float(sine.sample_time),
            "odd": bool(sine.odd),
            "lines": sine.lines.tolist(),
            "detection": sine.detection.tolist(),
        },
    }


def _carrier_document(carrier: Carrier | None) -> dict[str, Any]:
    """Return the carrier; an empty mapping if there is none."""
    if carrier is None:
        return {}
    lists = {"amplitudes": carrier.amplitudes.tolist(), "phases": carrier.phases.tolist()}
    return {"carrier": {"line": carrier.line, **lists}}


def _order_document(order: VisitingOrder | None) -> dict[str, Any]:
    """Return the reordering of the positions; an empty mapping if there is none."""
    if order is None:
        return {}
    times = {"duration": order.duration, "unordered_duration": order.unordered_duration}
    return {"order": {"order": order.order.tolist(), **times, "optimal": order.optimal}}


def _order(section: OrderSection | None, count: int) -> VisitingOrder | None:
    if section is None:
        return None
    if sorted(section.order) != list(range(count)):
        raise InvalidInput(
            f"order: {section.order[:8]} ...; each of the numbers 0 to {count - 1} once is needed"
        )
    order = read_only(np.array(section.order, dtype=np.int64))
    return VisitingOrder(order, section.duration, section.unordered_duration, section.optimal)


def _matrix(name: str, rows: list[list[float]]) -> Any:
    if len({len(row) for row in rows}) != 1:
        raise InvalidInput(f"{name}: rows of equal length are needed, one number per motor")
    return np.array(rows)
