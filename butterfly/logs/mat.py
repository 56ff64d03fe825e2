"""The thesis's .mat form: one matrix ``D`` with the columns t, u, q, dq."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.io import loadmat, savemat

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs.log import SAMPLED, Log

if TYPE_CHECKING:
    from pathlib import Path


def read_mat(path: Path, **properties: Any) -> Log:  # noqa: ANN401 - the fields of Log that a file cannot know
    """Read the matrix ``D`` of a MATLAB v4 to v7 file; other variables are ignored.

    Parameters
    ----------
    path
        The file.
    properties
        Fields of `Log` that the file does not hold (``input_kind``, ``added_mass``, ...).

    Raises
    ------
    InputError
        If the file is missing, is not a (whole) .mat file, holds no ``D``, or ``D`` is not a real
        matrix of three or four columns.
    """
    matrix = _load_matrix(path)
    columns = dict(zip(SAMPLED, np.ascontiguousarray(matrix.T, dtype=np.float64), strict=False))
    return Log(**columns, source=str(path), **properties)


def write_mat(log: Log, path: Path) -> None:
    """Write a log in the thesis's form; a missing velocity column is left out.

    Not compressed: angles and velocities hardly shrink, and to inflate them takes longer than all
    else that is done with a log of a minute.
    """
    matrix = np.column_stack(list(log.columns().values()))
    with replacing(path) as draft:
        savemat(draft, {"D": matrix})


def _load_matrix(path: Path) -> np.ndarray[Any, Any]:
    if not path.is_file():
        raise InputError(path, "path", "no such file", "an existing .mat file")
    try:
        matrix = loadmat(path, variable_names=["D"]).get("D")
    except NotImplementedError:
        raise InputError(
            path, "content", "MATLAB v7.3 (HDF5)", "MATLAB v7 or older: save it with '-v7'"
        ) from None
    except Exception as error:  # scipy's reader meets corrupt bytes with whatever they lead to
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "content", f"unreadable ({reason})", "a whole .mat file") from None
    if matrix is None:
        raise InputError(path, "D", "no such variable", "a matrix D with columns t, u, q[, dq]")
    if matrix.ndim != 2 or matrix.shape[1] not in (3, 4):  # noqa: PLR2004 - t, u, q[, dq]
        raise InputError(
            path, "D", f"shape {matrix.shape}", "shape (n, 3) or (n, 4): t, u, q[, dq]"
        )
    if matrix.dtype.kind not in "fiu":
        raise InputError(path, "D", f"type {matrix.dtype}", "real numbers")
    return np.asarray(matrix)
