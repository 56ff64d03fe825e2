"""Simulate, identify and control the first degree of freedom of the Butterfly robot.

`import butterfly as bf`; then `bf.read`, `bf.identify`, `bf.simulate`, `bf.validate`, `bf.design`,
`bf.compare`, `bf.predict`, `bf.draws`, `bf.changed` and `bf.load` do what their names say. What is
used is loaded when it is used.
"""

import lazy_loader

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
