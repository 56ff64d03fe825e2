"""The programs of docs/site, as modules."""

import sys
from importlib import import_module

from tests.pages.blocks import ROOT


def script(name):
    """Return a program of docs/site, which finds those beside it."""
    folder = str(ROOT / "docs/site")
    if folder not in sys.path:
        sys.path.append(folder)
    return import_module(name)
