"""Logs in NumPy's files: arrays by name (.npz), or one array (.npy)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.files import read_file, unpacked, whole
from butterfly.logs.formats import ColumnMap, components, log_of_table, part_at
from butterfly.logs.log import MIN_SAMPLES, Log
from butterfly.logs.units import Units

_WHOLE = "a whole file of NumPy's"
_PLAIN = "numbers and texts: np.savez(FILE, **{k: v for k, v in d.items() if v.dtype != object})"


def read_npz(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`) from vectors, columns of matrices (``M.0``), or one array."""
    if path.suffix.lower() == ".npy":
        contents = {"": read_file(path, "an existing file of NumPy's")}
    else:
        with unpacked(path, _WHOLE) as parts:
            contents = {name.removesuffix(".npy"): parts.read(name) for name in parts.namelist()}
    with whole(path, _WHOLE, trusting=True):
        arrays = {name: _array(path, name, content) for name, content in contents.items()}
    short = [name for name, values in arrays.items() if values.dtype.kind in "SU"]
    texts = {name: arrays.pop(name) for name in short if arrays[name].size < MIN_SAMPLES}
    if (at := about.pop("at", None)) is not None:
        arrays = {at: part_at(path, arrays, at, at)}
    table: Any = {}
    listed = components(arrays | texts)
    for name, array in arrays.items():
        wide = array.ndim == 2 and 1 not in array.shape  # noqa: PLR2004 - a matrix
        numbered = {k: part for k, part in listed.items() if part.column == name} if wide else {}
        vectors = {k: part.of(arrays) for k, part in numbered.items()} or {name: array.ravel()}
        table = array if len(arrays) == 1 and (wide or array.dtype.names) else table | vectors
    return log_of_table(table, columns, units, metadata=texts, **about | {"source": str(path)})


def _array(path: Path, name: str, content: bytes) -> NDArray[Any]:
    """Return an array, with samples along its first dimension."""
    if b"'|O'" in content[:1000]:
        raise InputError(path, name or "content", "a pickle, which may run any code", _PLAIN)
    array = np.asarray(np.lib.format.read_array(io.BytesIO(content), allow_pickle=False))
    return array.T if array.ndim > 1 and array.shape[0] < MIN_SAMPLES <= array.shape[1] else array
