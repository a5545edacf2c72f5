"""obsdesign: can my sensors see the state, how should I move, which sensors when, and does it hold in a filter?

The public names stand in `__init__.pyi`; each loads its module when first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
