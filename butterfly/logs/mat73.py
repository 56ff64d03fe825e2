"""MATLAB's files of v7.3, which are HDF5."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.errors import InputError
from butterfly.sizes import most_in, said

_VERSION = slice(124, 126)  # of the header, whose bytes tell the version
_HDF5 = b"\x00\x02"
_OWN = "#"  # begins what MATLAB keeps for itself
_PLAIN = {"double", "single", "logical", "char", "struct"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_OF_NODE = 1 << 14  # bytes that count for a node besides its own: of nodes in a ring is no end


class MatlabObject:
    """Stands for an object of MATLAB's, which nobody else can read."""


def is_mat73(path: Path) -> bool:
    """Whether a file says of itself that it is one of v7.3."""
    with path.open("rb") as file:
        return file.read(128)[_VERSION] == _HDF5


def names73(path: Path) -> list[str]:
    """Return the names of a file's variables.

    Raises
    ------
    InputError
        If h5py is not installed, or the file is not whole.
    """
    with _opened(path) as file:
        try:
            return [str(name) for name in file if not name.startswith(_OWN)]
        except Exception as error:  # as in `load73`
            raise _damaged(path, error) from None


def load73(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Return the variables of some names that there are: arrays, or mappings of a struct's fields.

    Raises
    ------
    InputError
        If h5py is not installed, or the file is not whole.
    """
    room = _Room(most_in(path.stat().st_size))
    with _opened(path) as file:
        try:
            return {name: _value(file[name], room) for name in names if name in file}
        except Exception as error:  # HDF5's reader meets corrupt bytes with whatever they lead to
            raise _damaged(path, error) from None


def _opened(path: Path) -> Any:  # noqa: ANN401 - h5py is an extra
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        expected = "h5py (pip install 'butterfly-testbed[hdf5]'), or a file saved with '-v7'"
        raise InputError(path, "content", "MATLAB v7.3 (HDF5)", expected) from None
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> InputError:
    reason = " ".join(str(error).split())
    return InputError(path, "content", f"unreadable ({reason})", "a whole .mat file")


@dataclass
class _Room:
    """Bytes that a file may still hold."""

    left: int

    def take(self, size: int) -> None:
        """Raise ValueError if there are not as many: the sizes of arrays are but told."""
        if not 0 <= size <= self.left:
            raise ValueError(f"arrays of {said(size)} more than there may be")
        self.left -= size


def _value(node: Any, room: _Room) -> Any:  # noqa: ANN401 - h5py is an extra
    """Return a variable as MATLAB has it: HDF5 keeps its dimensions the other way round."""
    room.take(_OF_NODE)
    kind = node.attrs.get("MATLAB_class", b"")
    if "MATLAB_object_decode" in node.attrs or (kind and kind.decode() not in _PLAIN):
        return MatlabObject()
    if hasattr(node, "items"):
        return {key: _value(below, room) for key, below in node.items()}
    room.take(node.nbytes)
    values = np.asarray(node[()])
    return np.asarray("".join(map(chr, values.ravel()))) if kind == b"char" else values.T
