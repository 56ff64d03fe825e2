"""Identify and simulate a motor-driven joint from its logs.

`import butterfly as bf`, then `bf.identify("logs/")`. All names are imported on first use.
"""

import lazy_loader

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
