"""Read by the process that workers are copies of: what is to be said if one cannot start.

Nothing is, if whoever asked for it has been stopped meanwhile: the semaphores that it was to share
are gone then, or the pipe.
"""

from __future__ import annotations

import sys
from types import TracebackType


def _told(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if not isinstance(error, FileNotFoundError | EOFError | ConnectionError):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _told
