"""Python imports it as it starts, where its folder is on the path: it notes what numba compiles."""

import atexit
import inspect
import json
import os
import time
from pathlib import Path

from numba.core import event


class _Watch(event.Listener):
    """Notes of each function its seconds of CPU, less those of what it calls, and who needs it."""

    def __init__(self):
        self.rows, self._open = [], []

    def on_start(self, event):  # noqa: ARG002
        self._open.append([time.process_time(), 0.0])

    def on_end(self, event):
        begun, within = self._open.pop()
        spent = time.process_time() - begun
        if self._open:
            self._open[-1][1] += spent
        function = event.data["dispatcher"].py_func
        said = (function.__doc__ or "").strip().split("\n")[0]
        row = {"function": f"{function.__module__}.{function.__name__}", "said": said}
        self.rows.append(row | {"seconds": spent - within, "caller": _caller()})


def _caller():
    """Return the nearest function on the stack that is not compiled, of the package."""
    frame = inspect.currentframe()
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        if name.startswith("butterfly.") and name != "butterfly.compiled":
            return f"{name}.{frame.f_code.co_name}"
        frame = frame.f_back
    return ""


_watch = _Watch()
event.register("numba:compile", _watch)


@atexit.register
def _write():
    """Write the notes of this process, if it compiled anything."""
    if _watch.rows:
        path = Path(os.environ["BUTTERFLY_COMPILED"]) / f"{os.getpid()}.json"
        path.write_text(json.dumps(_watch.rows))
