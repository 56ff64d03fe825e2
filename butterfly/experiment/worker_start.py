"""Imported by the process that is forked for workers: its message if one cannot start.

There is none if the parent was stopped meanwhile, which removes the shared semaphores or the pipe.
"""

from __future__ import annotations

import sys
from types import TracebackType


def _told(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if not isinstance(error, FileNotFoundError | EOFError | ConnectionError):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _told
