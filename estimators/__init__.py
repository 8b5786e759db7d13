"""What data say about elastic robots: FRFs, fits, covariances, posteriors.

Its public names stand in ``__init__.pyi`` and are loaded when used: ``import estimators`` is fast.
"""

import lazy_loader

from robotmodels.common.deprecation import renamed_names

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = renamed_names(
    __name__, __getattr__, "0.2", Comparison="MethodComparison", Target="StoppingCriterion"
)
