"""Random whole files of every format, read by the program and by a reader that it does not use so.

python -m tests.independent.readers --files 2000 --seed 7
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet
from scipy.io import loadmat, savemat

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from tests.logs.written import mat73, put73

FIELDS = ("time", "input", "angle")
NAMES = (FIELDS, ("t", "u", "q"), ("Zeit", "Spannung_1", "Lage der Hand"), ("t_s", "cmd", "pos"))
DIALECTS = ((",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("  ", ","))
DIALECTS += ((", ", "."), (" ; ", ","))
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1")
KINDS = (np.float64, np.float32, np.int16, np.int32, np.int64, np.uint8)

Columns = Mapping[str, np.ndarray]
Second = Callable[[Path], Columns]


def columns_of(rng: np.random.Generator, *, missing: bool) -> dict[str, np.ndarray]:
    """Return three columns of numbers of any size, some with missing ones, in float64."""
    count = int(rng.integers(17, 60))
    scales = 10.0 ** rng.integers(-9, 9, 3)
    found = dict(zip(FIELDS, scales[:, None] * rng.standard_normal((3, count)), strict=True))
    if rng.random() < 0.3:
        found = {name: np.round(each) for name, each in found.items()}
    if missing and rng.random() < 0.3:
        found["angle"][rng.integers(0, count, 3)] = np.nan
    return found


def text(rng: np.random.Generator, path: Path) -> tuple[dict[str, Any] | None, Second, Path]:
    """Write a table as people and programs do, for pandas to read as it was written."""
    columns = columns_of(rng, missing=True)
    names = NAMES[rng.integers(len(NAMES))]
    separator, decimal = DIALECTS[rng.integers(len(DIALECTS))]
    sign = separator.strip(" ")
    if not sign:
        names = tuple(each.replace(" ", "_") for each in names)
    if sign != separator:  # an empty cell or NA among blanks is refused
        columns = {name: np.nan_to_num(each) for name, each in columns.items()}
    frame = pd.DataFrame(dict(zip(names, columns.values(), strict=True)))
    if rng.random() < 0.5:
        frame.insert(int(rng.integers(4)), "count", np.arange(len(frame)))
    if rng.random() < 0.3 and sign:
        frame.insert(int(rng.integers(len(frame.columns) + 1)), "note", "läuft")
    frame = frame[list(rng.permutation(frame.columns))]
    head = [f"{mark}Messung 4, 20 °C" for mark in ("# ", "% ", "// ")[: rng.integers(4)]]
    shown = [f'"{name}"' if sign and rng.random() < 0.3 else name for name in frame]
    shown = [f" {name}  " if sign and rng.random() < 0.3 else name for name in shown]
    units = dict(zip(names, ("s", "V", "rad"), strict=True))
    told = [shown, [units.get(name, "-") for name in frame]][: rng.integers(1, 3)]
    form = ("%.17g", "%.6f", "%.9e", "%r")[rng.integers(4)]
    lost = ("", "nan", "NaN", "NA")[rng.integers(4)]

    def cell(value: object) -> str:
        if not isinstance(value, float):
            return str(value)
        return lost if np.isnan(value) else (form % value).replace(".", decimal)

    rows = (map(cell, row) for row in frame.itertuples(index=False))
    lines = [*head, *map(separator.join, [*told, *rows]), ""]
    encoding = ENCODINGS[rng.integers(len(ENCODINGS))]
    path = path.with_suffix((".csv", ".txt", ".dat", ".tsv")[rng.integers(4)])
    path.write_bytes(("\n", "\r\n", "\r")[rng.integers(3)].join(lines).encode(encoding))

    def second(written: Path) -> Columns:
        how = {"skiprows": len(head) + len(told), "names": [*frame], "index_col": False}
        how |= {"encoding": encoding, "dtype": str, "keep_default_na": False}
        found = pd.read_csv(written, sep=sign or r"\s+", **how)
        texts = (found[name].str.replace(decimal, ".").str.strip() for name in names)
        numbers = ([float("nan" if x in {"", "NA"} else x) for x in own] for own in texts)
        return {field: np.array(own) for field, own in zip(FIELDS, numbers, strict=True)}

    named = None if names == FIELDS else dict(zip(FIELDS, names, strict=True))
    return named, second, path


def table(rng: np.random.Generator, path: Path) -> tuple[dict[str, Any] | None, Second, Path]:
    """Write a Parquet file of any types, for pyarrow to read whole."""
    columns = _cast(rng, columns_of(rng, missing=True))
    names = NAMES[rng.integers(len(NAMES))]
    arrays = dict(zip(names, columns.values(), strict=True))
    if rng.random() < 0.5:
        arrays = {"note": np.array(["a"] * len(columns["time"]))} | arrays
    made = pa.table({name: arrays[name] for name in rng.permutation([*arrays])})
    path = path.with_suffix(".parquet")
    how = ("none", "snappy", "gzip", "zstd", "lz4")[rng.integers(5)]
    size = int(rng.integers(5, 70))
    parquet.write_table(
        made, path, compression=how, row_group_size=size, use_dictionary=size % 2 > 0
    )
    named = dict(zip(FIELDS, names, strict=True))

    def second(written: Path) -> Columns:
        found = parquet.read_table(written).to_pandas()
        return {field: found[name].to_numpy(float) for field, name in named.items()}

    return None if names == FIELDS else named, second, path


def matlab(rng: np.random.Generator, path: Path) -> tuple[dict[str, Any] | None, Second, Path]:
    """Write a .mat of any version, for SciPy or h5py to read whole."""
    columns = _cast(rng, columns_of(rng, missing=False))
    matrix = np.column_stack([*columns.values()])
    form = ("matrix", "vectors", "struct", "nested")[rng.integers(4)]
    vectors = dict(zip("tuq", columns.values(), strict=True))
    turned = rng.random() < 0.5
    content: dict[str, Any] = {
        "matrix": {"D": matrix.T if turned else matrix},
        "vectors": {name: each[:, None] if turned else each for name, each in vectors.items()},
        "struct": {"log": vectors},
        "nested": {"out": {"log": {"x": vectors}, "name": "a"}},
    }[form]
    where = {"struct": ("log",), "nested": ("out", "log", "x")}.get(form, ())
    named = (
        None
        if form == "matrix"
        else {f: ".".join([*where, k]) for f, k in zip(FIELDS, "tuq", strict=True)}
    )
    path = path.with_suffix(".mat")
    version = ("4", "5", "packed", "7.3")[rng.integers(4)]
    version = "5" if version == "4" and where else version
    if version == "7.3":
        with mat73(path) as root:
            put73(root, content, **({}, {"chunks": True}, {"compression": "gzip"})[rng.integers(3)])
    else:
        level = "4" if version == "4" else "5"
        savemat(path, content, format=level, do_compression=version == "packed")

    def second(written: Path) -> Columns:
        if version == "7.3":
            with h5py.File(written) as file:
                group = file["/".join(where)] if where else file
                read = {name: np.asarray(each).T for name, each in group.items() if name in "Dtuq"}
        else:
            found: Any = loadmat(written)
            for name in where:
                found = found[name][0, 0]
            read = {name: found[name] for name in (["D"] if form == "matrix" else "tuq")}
        if form == "matrix":
            whole = read["D"].T if turned else read["D"]
            return dict(zip(FIELDS, whole.T.astype(float), strict=True))
        return {
            field: read[name].ravel().astype(float)
            for field, name in zip(FIELDS, "tuq", strict=True)
        }

    return named, second, path


def records(rng: np.random.Generator, path: Path) -> tuple[dict[str, Any] | None, Second, Path]:
    """Write JSON in records or columns, flat or nested, for the standard library to read."""
    columns = columns_of(rng, missing=True)
    lists = {name: [None if np.isnan(x) else x for x in own] for name, own in columns.items()}
    rows = [dict(zip(FIELDS, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    form = ("columns", "records", "lines", "nested")[rng.integers(4)]
    if form == "nested":
        rows = [{"n": k, "joint": row} for k, row in enumerate(rows)]
    path = path.with_suffix(".jsonl" if form == "lines" else ".json")
    if form == "lines":
        path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    else:
        indent = (None, 2)[rng.integers(2)]
        path.write_text(json.dumps(lists if form == "columns" else rows, indent=indent))
    named = {field: f"joint.{field}" for field in FIELDS} if form == "nested" else None

    def second(written: Path) -> Columns:
        text = written.read_text()
        if form == "columns":
            found = json.loads(text)
        else:
            read = [*map(json.loads, text.splitlines())] if form == "lines" else json.loads(text)
            whole = [row["joint"] if form == "nested" else row for row in read]
            found = {field: [row[field] for row in whole] for field in FIELDS}
        return {field: np.array(each, dtype=float) for field, each in found.items()}

    return named, second, path


def _cast(rng: np.random.Generator, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns in a type that a logger may have chosen for them all."""
    kind = KINDS[rng.integers(len(KINDS))]
    if np.issubdtype(kind, np.floating):
        return {name: each.astype(kind) for name, each in columns.items()}
    most = min(np.iinfo(kind).max, 2**53)
    least = max(np.iinfo(kind).min, -(2**53))
    return {
        name: rng.integers(least, most, each.size, dtype=kind, endpoint=True)
        for name, each in columns.items()
    }


WRITERS = {"csv": text, "parquet": table, "mat": matlab, "json": records}


def difference(kind: str, seed: int, folder: Path) -> str:
    """Write one random file, read it twice, and tell how both differ; nothing if they do not."""
    rng = np.random.default_rng([list(WRITERS).index(kind), seed])
    named, second, path = WRITERS[kind](rng, folder / f"{kind}{seed}")
    expected = second(path)
    try:
        log = read_log(path, named)
    except InputError as error:
        return f"{kind} {seed}: {error}"
    finally:
        path.unlink()
    wrong = [
        field
        for field, each in expected.items()
        if not np.array_equal(getattr(log, field), each, equal_nan=True)
    ]
    return f"{kind} {seed}: {', '.join(wrong)} differ" if wrong else ""


def main() -> int:
    """Compare so many files of each format; the exit code says whether any differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=2000, help="of each format")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in WRITERS:
            seeds = range(asked.seed * 1_000_000, asked.seed * 1_000_000 + asked.files)
            own = [*filter(None, (difference(kind, seed, Path(folder)) for seed in seeds))]
            print(f"{kind}: {asked.files} files, {len(own)} differ", *own[:5], sep="\n  ")
            found += own
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
