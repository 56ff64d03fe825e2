"""The kinds of files that are damaged: what they are when sound, and how they are read."""

from __future__ import annotations

import io
from functools import cache
from typing import TYPE_CHECKING

import pyarrow as pa
from pyarrow import parquet
from scipy.io import savemat

from tests.fuzz import mat, results, text, values

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Sound = tuple[bytes, Callable[[bytes, Path], str]]

KINDS = ("mat", "csv", "parquet", "experiment", "manifest", "results", "values")
"""Their names."""


@cache
def sounds_of(kind: str) -> list[Sound]:
    """Return sound contents of a kind, each with what tells what escapes of a damaged one."""
    if kind == "results":
        return results.sounds()
    contents, escapes = {
        "mat": lambda: (_mats(), mat.escapes),
        "csv": lambda: (text.CSV, text.csv_escapes),
        "parquet": lambda: (_parquets(), mat.parquet_escapes),
        "experiment": lambda: (text.EXPERIMENTS, text.experiment_escapes),
        "manifest": lambda: (text.MANIFESTS, text.manifest_escapes),
        "values": lambda: ([bytes(range(32))], values.escapes),
    }[kind]()
    return [(content, escapes) for content in contents]


def _mats() -> list[bytes]:
    return [_mat(each, packed=packed) for each in mat.CONTENTS.values() for packed in (False, True)]


def _mat(content: dict[str, object], *, packed: bool) -> bytes:
    file = io.BytesIO()
    savemat(file, content, do_compression=packed)
    return file.getvalue()


def _parquets() -> list[bytes]:
    t, u, q, dq = mat.MATRIX.T
    columns = {"time": t, "input": u, "angle": q}
    tables = [pa.table(columns), pa.table(columns | {"velocity": dq, "note": ["x"] * t.size})]
    return [_parquet(table, how) for table in tables for how in ("zstd", "snappy", "none")]


def _parquet(table: pa.Table, compression: str) -> bytes:
    file = io.BytesIO()
    parquet.write_table(table, file, compression=compression, row_group_size=16)
    return file.getvalue()
