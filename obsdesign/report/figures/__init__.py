"""Figures of public records, for notebooks: each returns a Matplotlib Figure, and the page draws with the same functions.

One file per figure, which also returns its picture with its caption to the page. Matplotlib loads when a figure is first drawn.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
