"""Damaged .mat and Parquet files, as their readers take them."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from butterfly.logs.log import InputKind
from butterfly.logs.mat import read_mat
from butterfly.logs.parquet import read_parquet
from butterfly.model.parameters import AddedMass
from tests.fuzz.escape import escape_of

if TYPE_CHECKING:
    from pathlib import Path

_TIME = np.arange(40) * 0.01
MATRIX = np.column_stack([_TIME, np.sin(_TIME), np.cos(_TIME), np.sin(2 * _TIME)])
CONTENTS: dict[str, dict[str, Any]] = {
    "matrix": {"D": MATRIX},
    "single": {"D": MATRIX.astype(np.float32)},
    "integers": {"D": (1000 * MATRIX).astype(np.int16)},
    "complex": {"D": MATRIX + 1j},
    "three dimensions": {"D": np.zeros((2, 2, 2))},
    "vectors": {"t": _TIME, "u": np.sin(_TIME), "q": np.cos(_TIME), "c": np.array(["a"], "O")},
    "struct": {"data": {"t": _TIME, "u": np.sin(_TIME), "q": np.cos(_TIME), "x": {"y": "z"}}},
}
_COLUMNS = (
    None,
    {"time": "t", "input": "u", "angle": "q"},
    {"time": "data.t", "input": "data.u", "angle": "data.q"},
)


_KIND: dict[str, Any] = {"input_kind": InputKind.VOLTAGE, "added_mass": AddedMass()}


def level73() -> bytes:
    """Return a file of v7.3, which is HDF5, with a block of MATLAB's before it."""
    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=512) as root:
        root.create_dataset("D", data=MATRIX.T, compression="gzip")
        for name, column in zip("tuq", MATRIX.T, strict=False):
            root.create_dataset(name, data=column[None])
        data = root.create_group("data")
        data.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, column in zip("tuq", MATRIX.T, strict=False):
            data.create_dataset(name, data=column[None])
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    return head + file.getvalue()[len(head) :]


def escapes(content: bytes, path: Path) -> str:
    """Read a file by every way, and tell what is neither a log nor a line; nothing if all are."""
    path = path.with_suffix(".mat")
    path.write_bytes(content)
    found = (escape_of(lambda c=columns: read_mat(path, c, **_KIND)) for columns in _COLUMNS)
    return next(filter(None, found), "")


def parquet_escapes(content: bytes, path: Path) -> str:
    """Read a table, and tell what is neither a log nor a line."""
    path = path.with_suffix(".parquet")
    path.write_bytes(content)
    return escape_of(lambda: read_parquet(path, **_KIND))
