"""What to measure: candidate positions, their information, and optimal designs.

Names are loaded when used, so that ``import oed`` stays fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oed.candidates import candidate_positions
    from oed.certificate import efficiency_bound, optimality_gap
    from oed.exact import ExactDesign, exact_design
    from oed.information_set import InformationSet, information
    from oed.relaxed import Design, optimal_design

_HOMES = {
    "Design": "relaxed",
    "ExactDesign": "exact",
    "InformationSet": "information_set",
    "candidate_positions": "candidates",
    "efficiency_bound": "certificate",
    "exact_design": "exact",
    "information": "information_set",
    "optimal_design": "relaxed",
    "optimality_gap": "certificate",
}

__all__ = [
    "Design",
    "ExactDesign",
    "InformationSet",
    "candidate_positions",
    "efficiency_bound",
    "exact_design",
    "information",
    "optimal_design",
    "optimality_gap",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
