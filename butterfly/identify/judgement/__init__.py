"""How far to trust an estimate: covariance, intervals, identifiability, findings, validation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
