"""From frequency responses or logs to parameters, and how far to trust them.

Called, as `butterfly.identify(data, ...)`, it is `butterfly.api.verbs.identify`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
