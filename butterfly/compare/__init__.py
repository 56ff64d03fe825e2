"""MJCF, grey-box model and log side by side; estimators side by side.

Called, as `butterfly.compare(data, ...)`, it is `butterfly.api.verbs.compare`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
