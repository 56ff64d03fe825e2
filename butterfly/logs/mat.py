"""Logs in MATLAB's files: the thesis's matrix ``D`` of columns t, u, q, dq, or named variables."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest
from butterfly.files import replacing
from butterfly.logs.formats import (
    NAMING,
    ColumnMap,
    NoColumnError,
    checked_map,
    chosen_columns,
    components,
)
from butterfly.logs.log import MIN_SAMPLES, SAMPLED, Log
from butterfly.logs.matlab_variables import MatlabObject, load_variables
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.units import Units

_MATRIX = "D"


def read_mat(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a MATLAB file (see `read_log`); v7.3 needs the extra ``hdf5``, objects ``matlab``.

    A column is a vector (``t``), a field of a struct (``data.t``; ``out.1.x`` in the second of an
    array) or a column of a matrix (``M.0``, or ``0`` of ``D``; a row, if samples are columns). By
    default: ``D``; else variables named like the fields of `Log`, or the only table with them.
    """
    at, metadata = about.pop("at", None), dict[str, Mapping[str, Any]]()
    if columns is None:
        parts = _parts(at or _MATRIX)
        variables, names = load_variables(path, {parts[0]}, metadata)
        value = _found(path, variables, names, parts) if at or _MATRIX in variables else {}
        if isinstance(value, dict | MatlabObject):
            fields = _columns_in(path, at, value, about) if at else None
            columns = fields or _columns_of_table(path, names, about)
    elif at is not None:
        columns = {field: f"{at}.{name}" for field, name in columns.items()}
    if columns is None:
        least = 3 if about.get("interval") is None else 2
        matrix = _matrix(path, at or _MATRIX, value, names, least)
        timed = matrix.shape[1] > 2  # noqa: PLR2004 - u, q
        arrays: dict[str, Any] = dict(zip(SAMPLED[not timed :], matrix.T, strict=False))
        named = dict.fromkeys(arrays, at or _MATRIX)
    else:
        wanted = checked_map(path, columns, about)
        mapping = {field: _parts(name) for field, name in wanted.items()}
        wanted_names = {parts[0] for parts in mapping.values()} | NAMING
        variables, names = load_variables(path, wanted_names, metadata)
        arrays = {f: _vector(path, variables, names, keys, f) for f, keys in mapping.items()}
        named = {field: ".".join(keys) for field, keys in mapping.items()}
    sayings = UnitHints(path, [*named.values()])
    sayings.metadata(variables)
    for name, attributes in metadata.items():
        sayings.metadata(attributes, "attribute", tuple(filter(None, name.split("."))))
    headings = sayings.headings({field: k for k, field in enumerate(named)})
    if columns is not None:
        headings = {field: replace(heading, number=None) for field, heading in headings.items()}
    return Log.of_columns(arrays, headings, units, source=str(path), **about)


def write_mat(log: Log, path: Path) -> None:
    """Write a log in the thesis's form, uncompressed, which is hardly larger and fast to read."""
    if log.integrated:
        raise InputError(path, "angle", "only a velocity", "an angle, or another format")
    with replacing(path) as draft:
        savemat(draft, {_MATRIX: np.column_stack(list(log.columns().values()))})


def _parts(name: str | int) -> list[str]:
    """Split the name of a variable, field or column; a number alone is a column of ``D``."""
    parts = str(name).split(".")
    return [_MATRIX, *parts] if parts[0].isdecimal() else parts


def _columns_in(path: Path, name: str, table: Any, about: Mapping[str, Any]) -> ColumnMap:  # noqa: ANN401 - whatever the file holds
    """Return the columns of a struct or table that are read by default."""
    if isinstance(table, MatlabObject):
        raise table.refused(path, name)
    keys = [*_below(table)]
    places, unasked = chosen_columns(path, [key.lower() for key in keys], None, about)
    columns = {field: keys[k] for field, k in places.items()}
    columns = {f: key for f, key in columns.items() if f not in unasked or _is_vector(table[key])}
    return {field: f"{name}.{key}".lstrip(".") for field, key in columns.items()}


def _is_vector(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiu"


def _columns_of_table(path: Path, names: list[str], about: Mapping[str, Any]) -> ColumnMap | None:
    """Return the columns among the variables, or of the only struct or table that has them."""
    variables, _ = load_variables(path, names)
    with suppress(InputError):
        return _columns_in(path, "", variables, about)
    tables: dict[str, ColumnMap] = {}
    for name, table in variables.items():
        with suppress(InputError):
            tables[name] = _columns_in(path, name, table, about)
    if len(tables) > 1:
        first = next(iter(tables))
        expected = f"columns of one of them: at: {first} in a manifest, or --columns time={first}.T"
        raise InputError(path, "columns", f"tables {', '.join(tables)}", expected)
    if not tables:
        _refuse_objects(path, _MATRIX, variables)
    return next(iter(tables.values()), None)


def _matrix(path: Path, name: str, value: object, names: list[str], least: int) -> Samples:
    """Return the (n, k) matrix of columns t, u, q[, dq]; refuse fewer than ``least`` columns."""
    if isinstance(value, dict) and not value:
        problem = f"no such variable (there are: {', '.join(names) or 'none'})"
        expected = "a matrix D with columns t, u, q[, dq], or --columns time=T,input=U,angle=Q"
        expected += " (without time=T: --interval S)"
        raise InputError(path, name, problem, expected)
    matrix = _upright(value)
    width = matrix.shape[-1] if isinstance(matrix, np.ndarray) and matrix.ndim == 2 else 0  # noqa: PLR2004
    if width not in range(least, 5):
        problem = matrix if isinstance(matrix, str) else type(matrix).__name__
        problem = f"shape {matrix.shape}" if isinstance(matrix, np.ndarray) else problem
        expected = "shape (n, 3) or (n, 4): t, u, q[, dq]; or (n, 2): u, q, and --interval S"
        raise InputError(path, name, problem, expected)
    return _real(path, name, matrix)


def _real(path: Path, name: str, values: NDArray[Any], kinds: str = "fiu") -> NDArray[Any]:
    """Return a copy in column order: `values` may be mapped from the file."""
    if values.dtype.kind not in kinds:
        raise InputError(path, name, f"type {values.dtype}", "real numbers")
    return np.array(values, dtype=np.float64 if values.dtype.kind == "f" else None, order="F")


def _upright(value: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Transpose a matrix with too few rows for samples but enough columns."""
    matrix = isinstance(value, np.ndarray) and value.ndim == 2  # noqa: PLR2004
    return value.T if matrix and value.shape[0] < MIN_SAMPLES <= value.shape[1] else value


def _found(path: Path, variables: dict[str, Any], names: list[str], parts: list[str]) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return what the parts of a name lead to."""
    wanted, value = ".".join(parts), variables
    if parts[0] not in variables:
        _refuse_objects(path, wanted, variables)
        expected = _listing(parts[0], names)
        raise NoColumnError.among(names, path, wanted, "no such variable", expected)
    for k, part in enumerate(parts):
        if isinstance(value, MatlabObject):
            raise value.refused(path, wanted)
        below = _below(value)
        columns = {name: _rows(column) for name, column in below.items()}
        if component := components(columns).get(".".join(parts[k:])):
            return component.of(columns)
        if part not in below:
            where = ".".join(parts[:k])
            raise InputError(path, wanted, f"no {part} in {where}", _listing(part, [*below]))
        value = below[part]
    return value


def _vector(
    path: Path, variables: dict[str, Any], names: list[str], parts: list[str], field: str
) -> NDArray[Any]:
    """Return a vector by the parts of its name."""
    value, wanted = _found(path, variables, names, parts), ".".join(parts)
    if isinstance(value, MatlabObject):
        raise value.refused(path, wanted)
    if isinstance(value, dict | list):
        expected = f"one of its fields: {', '.join(f'{wanted}.{key}' for key in _below(value))}"
        raise InputError(path, wanted, "a struct", expected)
    values = _real(path, wanted, np.asarray(value), "fiumM" if field == "time" else "fiu")
    if values.size != max(values.shape, default=0):
        expected = f"a vector, or one of its columns: {wanted}.0, ..."
        raise InputError(path, wanted, f"shape {values.shape}", expected)
    return values.ravel()


def _below(value: Any) -> dict[str, Any]:  # noqa: ANN401 - whatever the file holds
    """Return the parts of a struct, an array of structs or a matrix, by name or number."""
    if isinstance(value, dict):
        return value
    matrix = isinstance(value, np.ndarray) and value.ndim == 2  # noqa: PLR2004
    columns = _upright(value).T if matrix else value if isinstance(value, list) else []
    return {str(k): column for k, column in enumerate(columns)}


def _rows(value: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return a matrix with samples in its rows, and the texts of a cell array as they are."""
    cells = [cell for cell in value if isinstance(cell, np.ndarray)] if type(value) is list else []
    texts = [cell.item() for cell in cells if cell.dtype.kind == "U" and cell.size == 1]
    return texts or _upright(value)


def _refuse_objects(path: Path, wanted: str, variables: dict[str, Any]) -> None:
    """Raise InputError if there are objects, which are probably meant."""
    for name, variable in variables.items():
        if isinstance(variable, MatlabObject):
            raise variable.refused(path, wanted, name)


def _listing(wanted: str, valid: list[str]) -> str:
    return nearest(wanted, valid) if valid else "a file that contains it (there are no names here)"
