"""The kinds of files that are damaged: what they are when sound, and how they are read."""

from __future__ import annotations

import io
from functools import cache
from typing import TYPE_CHECKING, Any

import pyarrow as pa
from pyarrow import parquet
from scipy.io import savemat

from tests.fuzz import mat, results, saved, text, values

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Sound = tuple[bytes, Callable[[bytes, Path], str]]

KINDS = ("mat", "csv", "parquet", "experiment", "manifest", "results", "saved", "values")
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
        "saved": lambda: ([saved.sound()], saved.escapes),
        "values": lambda: ([bytes(range(32))], values.escapes),
    }[kind]()
    return [(content, escapes) for content in contents]


def _mats() -> list[bytes]:
    contents = mat.CONTENTS.values()
    level5 = [_mat(each, do_compression=packed) for each in contents for packed in (False, True)]
    return [*level5, _mat(mat.CONTENTS["matrix"], format="4"), mat.level73()]


def _mat(content: dict[str, object], **how: Any) -> bytes:
    file = io.BytesIO()
    savemat(file, content, **how)
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
