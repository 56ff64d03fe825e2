"""Damaged .mat files, as `read_mat` takes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.logs.log import InputKind
from butterfly.logs.mat import read_mat
from butterfly.model.parameters import AddedMass
from tests.fuzz.escape import escape_of

if TYPE_CHECKING:
    from pathlib import Path

_TIME = np.arange(40) * 0.01
_MATRIX = np.column_stack([_TIME, np.sin(_TIME), np.cos(_TIME), np.sin(2 * _TIME)])
CONTENTS: dict[str, dict[str, Any]] = {
    "matrix": {"D": _MATRIX},
    "single": {"D": _MATRIX.astype(np.float32)},
    "integers": {"D": (1000 * _MATRIX).astype(np.int16)},
    "complex": {"D": _MATRIX + 1j},
    "three dimensions": {"D": np.zeros((2, 2, 2))},
    "vectors": {"t": _TIME, "u": np.sin(_TIME), "q": np.cos(_TIME), "c": np.array(["a"], "O")},
    "struct": {"data": {"t": _TIME, "u": np.sin(_TIME), "q": np.cos(_TIME), "x": {"y": "z"}}},
}
_COLUMNS = (
    None,
    {"time": "t", "input": "u", "angle": "q"},
    {"time": "data.t", "input": "data.u", "angle": "data.q"},
)


def escapes(content: bytes, path: Path) -> str:
    """Read a file by every way, and tell what is neither a log nor a line; nothing if all are."""
    path = path.with_suffix(".mat")
    path.write_bytes(content)
    kind = {"input_kind": InputKind.VOLTAGE, "added_mass": AddedMass()}
    found = (escape_of(lambda c=columns: read_mat(path, c, **kind)) for columns in _COLUMNS)
    return next(filter(None, found), "")
