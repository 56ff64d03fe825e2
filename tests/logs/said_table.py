"""Files that say the unit of one column: every format and place, many spellings, fitting or not.

Factors are written anew, from the SI brochure's tables 4, 7 and 8.
"""

import json
import math
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet
from scipy.io import savemat

from butterfly.logs.text_table import is_number
from tests.logs.written import mat73, write_sheets

DEGREE = math.pi / 180


class Cell(NamedTuple):
    """What a file is to hold: values, their names, a row of units, and what is said where."""

    columns: dict
    names: list
    units: dict
    place: str
    told: dict


OWN = {"time": "s", "input": "V", "angle": "rad"}
SPELLINGS = {  # by kind of quantity
    "time": {"s": 1, "sec": 1, "seconds": 1, "ms": 1e-3, "milliseconds": 1e-3, "msec": 1e-3}
    | {"us": 1e-6, "µs": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "min": 60, "millisecond": 1e-3},
    "voltage": {"V": 1, "volt": 1, "Volts": 1, "mV": 1e-3, "mv": 1e-3, "millivolt": 1e-3}
    | {"millivolts": 1e-3, "MilliVolt": 1e-3, "kV": 1e3, "uV": 1e-6, "microvolt": 1e-6},
    "current": {"A": 1, "amp": 1, "ampere": 1, "mA": 1e-3, "milliampere": 1e-3, "milliamps": 1e-3},
    "torque": {"Nm": 1, "N m": 1, "N.m": 1, "N*m": 1, "N·m": 1, "newton meter": 1, "mNm": 1e-3}
    | {"mN m": 1e-3, "mN.m": 1e-3, "newton * meter": 1, "millinewton meter": 1e-3, "Ncm": 0.01}
    | {"milliNm": 1e-3, "meter * newton": 1, "N-m": 1},
    "angle": {"rad": 1, "radians": 1, "mrad": 1e-3, "milliradian": 1e-3, "deg": DEGREE}
    | {"degrees": DEGREE, "Degree": DEGREE, "°": DEGREE, "rev": 2 * math.pi, "turns": 2 * math.pi}
    | {"arcmin": DEGREE / 60, "counts/4096": 2 * math.pi / 4096, "counts": None},
    "rate": {"rad/s": 1, "rad s-1": 1, "rad s^-1": 1, "rpm": math.pi / 30, "deg/s": DEGREE}
    | {"deg s-1": DEGREE, "degrees per second": DEGREE, "rad.s-1": 1, "1/min": math.pi / 30}
    | {"radian / second": 1, "rev/min": math.pi / 30, "mrad/s": 1e-3},
    "length": {"mm": 1e-3, "millimeter": 1e-3},
}
KINDS = {"time": "time", "input": "voltage", "angle": "angle", "velocity": "rate"}
CASES = [("voltage", field, own, kind) for field, own in KINDS.items() for kind in SPELLINGS]
CASES += [("torque", "input", "torque", kind) for kind in ("torque", "voltage", "angle", "time")]
CASES += [("current", "input", "current", kind) for kind in ("current", "voltage", "torque")]


def signals(samples=60):
    """Columns in the project's own units."""
    time = 0.02 * np.arange(samples)
    columns = {"time": time, "input": 0.3 * np.sin(7 * time), "angle": np.cos(3 * time)}
    return columns | {"velocity": -3 * np.sin(3 * time)}


IN_NAMES = {
    "bracket": "{} [{}]",
    "parenthesis": "{} ({})",
    "tight": "{}[{}]",
    "curly": "{} {{{}}}",
    "unclosed": "{} [{}",
    "unclosed parenthesis": "{}({}",
    "full width": "{}（{}）",
    "lenticular": "{}【{}】",
    "colon": "{}:{}",
    "underscore": "{}_{}",
    "slash": "{} / {}",
    "blank": "{} {}",
}
GLUED = {"glued": "{}{}"}  # inputMilliVolt
COMMENTS = {
    "key: value": "# {}: {}",
    "key = value": "# {} = {}",
    "comment in brackets": "# {} [{}]",
    "comment in parentheses": "# {} ({})",
    "unit of": "# unit of {}: {}",
    "unit after": "# {} unit: {}",
    "units =": "# units: {}={}",
    "cells": "# {}_unit;{}",
    "clause": "# column 2: {}, in {}",
    "in": "# {} in {}",
    "percent": "% {}: {}",
    "no mark": "{} unit: {}",
    "description": "# {}: the measured value in {}",
}
ROWS = ("row", "row in brackets", "commented row above", "commented row below", "units: a, b")


def _row(names, units):
    return [units.get(name, "-") for name in names]


def _text(ending, mark):
    def write(folder, cell):
        path = folder / f"log{ending}"
        body = [
            mark.join(map(repr, row))
            for row in np.column_stack(list(cell.columns.values())).tolist()
        ]
        head, row = mark.join(cell.names), _row(cell.columns, cell.units)
        lines = {
            "row": [head, mark.join(row)],
            "row in brackets": [head, mark.join(f"[{each}]" for each in row)],
            "commented row above": ["# " + mark.join(row), head],
            "commented row below": [head, "# " + mark.join(row)],
            "units: a, b": ["# units: " + ", ".join(row), head],
        }.get(cell.place, [head])
        if cell.place in COMMENTS:
            own = [COMMENTS[cell.place].format(*pair) for pair in cell.told.items()]
            lines = ["# bench 2"] * (cell.place != "no mark") + [*own, *lines]
        path.write_text("\n".join([*lines, *body, ""]))
        return path

    return write


IN_KEYS = {
    **{key: lambda told, key=key: {key: told} for key in ("units", "Units", "unit", "UNITS")},
    "meta.units": lambda told: {"meta": {"units": told}},
    "meta.columns": lambda told: {"meta": {"columns": {k: {"unit": v} for k, v in told.items()}}},
    "fields": lambda told: {"fields": [{"name": k, "unit": v} for k, v in told.items()]},
    "key_unit": lambda told: {f"{k}_unit": v for k, v in told.items()},
    "keyUnits": lambda told: {"info": {f"{k}Units": v for k, v in told.items()}},
    "attrs": lambda told: {"attrs": dict(told)},
    "description": lambda told: {"description": "; ".join(f"{k} in {v}" for k, v in told.items())},
    "comment": lambda told: {"comment": "\n".join(f"{k}: {v}" for k, v in told.items())},
}


def _json(folder, cell):
    path = folder / "log.json"
    content = dict(zip(cell.names, (each.tolist() for each in cell.columns.values()), strict=True))
    if cell.place.startswith("beside"):
        key = cell.place.split()[1]
        content |= {k: {key: v, "values": content[k]} for k, v in cell.told.items()}
    path.write_text(
        json.dumps(content | (IN_KEYS[cell.place](cell.told) if cell.place in IN_KEYS else {}))
    )
    return path


def _records(ending):
    def write(folder, cell):
        path = folder / f"log{ending}"
        rows = np.column_stack(list(cell.columns.values())).tolist()
        more = {
            "per row": {f"{k}_unit": v for k, v in cell.told.items()},
            "units per row": {"units": dict(cell.told)},
        }.get(cell.place, {})
        records = [dict(zip(cell.names, row, strict=True)) | more for row in rows]
        lines = [json.dumps(each) for each in records]
        path.write_text("\n".join(lines) + "\n" if ending == ".jsonl" else f"[{','.join(lines)}]")
        return path

    return write


IN_FIELD = ("unit", "units", "UNIT", "uom", "astropy:unit", "description", "long description")


def _parquet(folder, cell):
    path = folder / "log.parquet"
    if cell.place.startswith("pandas"):
        frame = _frame(folder, cell._replace(place=cell.place.removeprefix("pandas ")))
        frame.to_parquet(path)
        return path
    key, many = cell.place.split()[-1], cell.place == "long description"
    own = {k: f"filtered, in {v}" if many else v for k, v in cell.told.items()}
    fields = [
        pa.field(
            n, pa.float64(), metadata={key: own[c]} if cell.place in IN_FIELD and c in own else None
        )
        for n, c in zip(cell.names, cell.columns, strict=True)
    ]
    meta = IN_KEYS.get(cell.place.removeprefix("schema "), lambda _: {})(cell.told)
    meta = {k: v if isinstance(v, str) else json.dumps(v) for k, v in meta.items()}
    table = pa.table(list(cell.columns.values()), schema=pa.schema(fields, metadata=meta))
    parquet.write_table(table, path)
    return path


def _frame(_, cell):
    frame = pd.DataFrame(dict(zip(cell.names, cell.columns.values(), strict=True)))
    frame.attrs = IN_KEYS[cell.place](cell.told) if cell.place in IN_KEYS else {}
    return frame


def _mat(folder, cell):
    path = folder / "log.mat"
    data = {k: np.asarray(v) for k, v in cell.columns.items()}
    if cell.place == "struct.units":
        data = {
            k: {"values": v, "units": cell.told[k]} if k in cell.told else v
            for k, v in data.items()
        }
    more = {
        "top-level units": {"units": dict(cell.told)},
        "key_unit": {f"{k}_unit": v for k, v in cell.told.items()},
        "data.units": {"units": dict(cell.told)},
        "DataInfo": {},
    }.get(cell.place, {})
    if cell.place == "DataInfo":
        data = {
            k: {"Data": v, "DataInfo": {"Units": cell.told[k]}} if k in cell.told else v
            for k, v in data.items()
        }
    inside = cell.place == "data.units"
    savemat(path, {"data": {**data, **more}} if inside else {**data, **more})
    return path


IN_HDF5 = ("units", "Units", "UNITS", "unit", "Unit", "description", "long_name", "group")


def _hdf5(folder, cell):
    path = folder / "log.mat"
    with mat73(path) as root:
        for name, values in cell.columns.items():
            data = root.create_dataset(name, data=np.atleast_2d(values).T)
            data.attrs["MATLAB_class"] = np.bytes_("double")
            if name in cell.told and cell.place != "group":
                long = f"measured value in {cell.told[name]}"
                data.attrs[cell.place] = (
                    long if cell.place in {"description", "long_name"} else cell.told[name]
                )
        if cell.place == "group":
            root.attrs["units"] = json.dumps(cell.told)
    return path


def _npz(folder, cell):
    path = folder / "log.npz"
    told = IN_KEYS[cell.place](cell.told) if cell.place in IN_KEYS else {}
    texts = {k: v if isinstance(v, str) else json.dumps(v) for k, v in told.items()}
    np.savez(path, **dict(zip(cell.names, cell.columns.values(), strict=True)), **texts)
    return path


def _xlsx(folder, cell):
    lines = _text(".tsv", "\t")(folder, cell).read_text().splitlines()
    rows = [[float(x) if is_number(x) else x for x in line.split("\t")] for line in lines]
    write_sheets(folder / "log.xlsx", {"Sheet1": rows})
    return folder / "log.xlsx"


TEXTS = (*IN_NAMES, *GLUED, *COMMENTS, *ROWS)
WRITERS = {
    "csv": (_text(".csv", ","), TEXTS),
    "semicolons": (_text(".csv", ";"), TEXTS),
    "tsv": (_text(".tsv", "\t"), TEXTS),
    "blanks": (_text(".txt", " "), ("tight", "underscore", "key: value", "units =", "glued")),
    "xlsx": (_xlsx, TEXTS),
    "npz": (_npz, (*IN_NAMES, *GLUED, *IN_KEYS)),
    "json": (_json, (*IN_NAMES, *GLUED, *IN_KEYS, "beside unit", "beside Units", "beside uom")),
    "records": (_records(".json"), (*IN_NAMES, *GLUED, "per row", "units per row")),
    "jsonl": (_records(".jsonl"), (*IN_NAMES, *GLUED, "per row", "units per row")),
    "parquet": (
        _parquet,
        (
            *IN_NAMES,
            *GLUED,
            *IN_FIELD,
            *(f"schema {each}" for each in IN_KEYS),
            *(f"pandas {each}" for each in IN_KEYS),
        ),
    ),
    "frame": (_frame, (*IN_NAMES, *GLUED, *IN_KEYS)),
    "mat": (_mat, ("struct.units", "top-level units", "key_unit", "data.units", "DataInfo")),
    "mat 7.3": (_hdf5, IN_HDF5),
}
CELLS = [(form, place) for form, (_, places) in WRITERS.items() for place in places]


def ambiguous(form, place, spelling):
    """Whether nobody can tell, as inputs or inputmin, or the table cannot hold the spelling."""
    in_words = place in {"glued", "underscore", "blank"} and spelling in {"s", "min"}
    return in_words or (form == "blanks" and " " in spelling) or (form, place) == ("tsv", ROWS[1])


def written(folder, where, field, spelling, factor):
    """Write a file; return what to read, its columns, and the true values."""
    form, place = where
    true = signals()
    if field != "velocity":
        del true["velocity"]
    columns = dict(true)
    columns[field] = true[field] / (factor or 1)
    told = {field: spelling}
    pattern = (IN_NAMES | GLUED).get(place)
    long = place == "glued" and spelling.isalpha() and len(spelling) > 4
    word = spelling[:1].upper() + spelling[1:] if long else spelling
    names = [pattern.format(k, word) if pattern and k == field else k for k in columns]
    units = {k: {**OWN, "velocity": "rad/s"}[k] for k in columns} | told
    source = WRITERS[form][0](folder, Cell(columns, names, units, place, told))
    chosen = dict(zip(columns, names, strict=True))
    if place == "data.units":
        chosen = {k: f"data.{k}" for k in columns}
    elif place == "struct.units" or place.startswith("beside"):
        chosen[field] += ".values"
    elif place == "DataInfo":
        chosen[field] += ".Data"
    return source, chosen, true


# Files that say nothing of units, though words and letters of theirs may be some.

PROSE = """run 3 at 5 A supply, by M. Smith, motor in box
angle(s) recorded by the encoder, input held between samples | operator: M | position: M
tags: ["a", "b", "V"]
gain: 5 V/V
mass: 120 g | bench 2 (Tuesday), run (3) | serial number: A-4711/V2 | date: 2024-03-01 10:30:12
recorded 12 min after start, 3 h after lunch | firmware rev 2.1 (rev B), board V
sampling rate: 500 Hz | supply: 12 V, limit 3 A, 25 degC in the room
the second run; each joint was moved in turn | arm = 0.104 m, disc r = 15 mm
Ms. N. Ampere, Room A, Building V | controller gains: kp=4, ki=0.5, kd=1e-3
encoder: 4096 counts per turn | motor: Maxon RE 40, 24 V, 150 W | gear ratio: 1:100
note: time starts at trigger; input is the command, angle is from the encoder
input: chirp from 0.1 to 5 Hz | input: sine, 2 V amplitude | angle: wrapped at the index pulse
angle: 0 hanging down | time: start of the run | units under test: 2 | test unit: 7 | unit: 7
units: SI | https://example.org/logs?id=7&unit=3 | data in columns, numbers in full
temperature in the lab: 21 C | position: left | file saved in s:/logs
velocity limit 300 deg/s reached once | torque constant 0.05 Nm/A
channel 1: motor A, channel 2: motor B | load (m): none added | comment: us and them, ma and pa
version: 1.2 (V) | author: H. Hour, S. Second | phase: A | axis: m | symbol: u | status: ok, V
max current: 5 A; max voltage: 24 V | input from the amplifier, angle by potentiometer
measured in May in Rome | wiring: red = V+, black = 0 V, g = ground | state: s0; mode: h""".replace(
    "\n", " | "
).split(" | ")


INNOCENT = ("csv", "above", "json", "jsonl", "parquet", "field", "frame", "mat", "hdf5")


def innocent(folder, number):
    """Write a file with a few such lines; return what to read, and its columns."""
    rng = np.random.default_rng(number)
    lines = [str(each) for each in rng.choice(PROSE, 4, replace=False)]
    columns = {k: v for k, v in signals().items() if k != "velocity"}
    keyed = {f"note {k}": each for k, each in enumerate(lines)}
    keyed |= dict(each.split(": ", 1) for each in lines if ": " in each)
    form = INNOCENT[number % len(INNOCENT)]
    if form in {"csv", "above"}:
        path = folder / "log.csv"
        mark = ("# ", "% ", "// ")[number % 3]
        rows = [",".join(map(repr, row)) for row in np.column_stack([*columns.values()]).tolist()]
        above = [mark + each for each in lines]
        path.write_text("\n".join([*above, ",".join(columns), *rows, ""]))
    elif form in {"json", "jsonl"}:
        path = folder / f"log.{form}"
        content = {k: v.tolist() for k, v in columns.items()} | {"meta": keyed}
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        texts = [json.dumps(each | {"note": lines[0]}) for each in rows]
        path.write_text(json.dumps(content) if form == "json" else "\n".join([*texts, ""]))
    elif form in {"parquet", "field"}:
        path = folder / "log.parquet"
        own = {"description": lines[0], "comment": lines[1]} if form == "field" else None
        fields = [pa.field(k, pa.float64(), metadata=own) for k in columns]
        schema = pa.schema(fields, metadata=None if form == "field" else keyed)
        parquet.write_table(pa.table([*columns.values()], schema=schema), path)
    elif form == "frame":
        path = pd.DataFrame(columns)
        path.attrs = keyed
    elif form == "mat":
        path = folder / "log.mat"
        savemat(path, {**columns, "note": "\n".join(lines), "info": {"by": lines[0], "axis": "m"}})
    else:
        path = folder / "log.mat"
        _hdf5(folder, Cell(columns, [], {}, "comment", {"angle": lines[0], "input": lines[1]}))
    return path, columns
