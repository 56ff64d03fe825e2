"""What only reproduces the thesis: its method, formulas, tables and figures, slips included."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
