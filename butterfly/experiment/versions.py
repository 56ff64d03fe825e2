"""With which versions a result was made."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import version

import numpy as np

from butterfly import __version__

_OTHERS = ("mujoco", "numba", "scipy")  # not imported for that: a simulator is slow to


@cache
def versions() -> dict[str, str]:
    """Return what the result was made with."""
    return {
        "butterfly": __version__,
        "numpy": np.__version__,
        **{name: version(name) for name in _OTHERS},
        "python": platform.python_version(),
    }
