"""mjlab, in the environment of its own that `make readback` makes: it needs an older MuJoCo."""

import json
import os
from pathlib import Path

import pytest

from tests.programs import said

HERE = Path(__file__).parent
PYTHON = HERE.parents[1] / "build/mjlab/bin/python"
MINE = "PYTHONPATH", "PYTHONHOME", "NUMBA_CACHE_DIR"

needs_mjlab = pytest.mark.skipif(not PYTHON.exists(), reason="mjlab is not here: make readback")


def said_by_mjlab(script, content):
    """What a script says, run in mjlab's environment with JSON as its input."""
    theirs = {name: value for name, value in os.environ.items() if name not in MINE}
    out = said(PYTHON, HERE / script, input=json.dumps(content), env=theirs)
    return json.loads(out.splitlines()[-1])
