"""What to measure: candidate positions, their information, and optimal designs.

Its public names stand in ``__init__.pyi`` and are loaded when used: ``import oed`` is fast.
"""

import lazy_loader

from robotmodels.common.deprecation import renamed_names

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = renamed_names(
    __name__, __getattr__, "0.2", PlanTrial="SimulatedPlan", Needed="RequiredExperiments"
)
