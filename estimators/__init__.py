"""What data say about elastic robots: FRFs, fits, covariances, posteriors.

Its public names stand in ``__init__.pyi`` and are loaded when used: ``import estimators`` is fast.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
