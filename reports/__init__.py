"""What a person types and reads: the command line, tables, figures, the report page.

Its public names stand in ``__init__.pyi`` and are loaded when used: ``import reports`` is fast.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
