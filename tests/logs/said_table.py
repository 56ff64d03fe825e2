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

    @property
    def rows(self):
        return np.column_stack([*self.columns.values()]).tolist()

    @property
    def named(self):
        return dict(zip(self.names, self.columns.values(), strict=True))

    @property
    def keys(self):
        """What is said beside the columns, by key."""
        place = self.place.removeprefix("schema ").removeprefix("pandas ")
        ways = IN_KEYS | {"meta": lambda told: {"meta": told}, "top": dict}
        return ways[place](self.told) if place in ways else {}

    @property
    def texts(self):
        """The same as texts."""
        return {k: v if isinstance(v, str) else json.dumps(v) for k, v in self.keys.items()}


OWN = {"time": "s", "input": "V", "angle": "rad", "velocity": "rad/s"}
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
ALONE = {  # which are read where no word of the name is beside them
    "time": {"S": 1, "MS": 1e-3, "minutes": 60, "h": 3600, "hours": 3600},
    "voltage": {"v": 1, "volts": 1, "KV": 1e3, "kilovolts": 1e3, "µV": 1e-6, "MV": 1e6},
    "angle": {"Radians": 1, "DEG": DEGREE, "Degrees": DEGREE, "degree": DEGREE}
    | {"mdeg": DEGREE / 1e3, "gon": math.pi / 200, "arcsec": DEGREE / 3600, "Turns": 2 * math.pi}
    | {"ticks/1000": 2 * math.pi / 1000, "2048 counts/rev": 2 * math.pi / 2048},
    "torque": {"NM": 1, "N cm": 1e-2, "kgf cm": 0.0980665, "kg·cm": 0.0980665}
    | {"A": 1, "mA": 1e-3, "amps": 1, "%": 0.01, "percent": 0.01},
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


IN_NAMES = {"bracket": "{} [{}]", "parenthesis": "{} ({})", "tight": "{}[{}]", "blank": "{} {}"}
IN_NAMES |= {"curly": "{} {{{}}}", "unclosed": "{} [{}", "unclosed parenthesis": "{}({}"}
IN_NAMES |= {"full width": "{}（{}）", "lenticular": "{}【{}】", "colon": "{}:{}"}
IN_NAMES |= {"underscore": "{}_{}", "slash": "{} / {}"}
GLUED = {"glued": "{}{}"}  # inputMilliVolt
COMMENTS = {"key: value": "# {}: {}", "key = value": "# {} = {}", "cells": "# {}_unit;{}"}
COMMENTS |= {"comment in brackets": "# {} [{}]", "comment in parentheses": "# {} ({})"}
COMMENTS |= {"unit of": "# unit of {}: {}", "unit after": "# {} unit: {}", "percent": "% {}: {}"}
COMMENTS |= {"units =": "# units: {}={}", "clause": "# column 2: {}, in {}", "in": "# {} in {}"}
COMMENTS |= {"no mark": "{} unit: {}", "description": "# {}: the measured value in {}"}
ROWS = ("row", "row in brackets", "commented row above", "commented row below", "units: a, b")


def _text(ending, mark):
    def write(folder, cell):
        path = folder / f"log{ending}"
        body = [mark.join(map(repr, row)) for row in cell.rows]
        head, row = mark.join(cell.names), [cell.units.get(name, "-") for name in cell.columns]
        lines = {
            "row": [head, mark.join(row)],
            "row in brackets": [head, mark.join(f"[{each}]" for each in row)],
            "commented row above": ["# " + mark.join(row), head],
            "commented row below": [head, "# " + mark.join(row)],
            "units: a, b": ["# units: " + ", ".join(row), head],
            "prose": [*cell.told, head],
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
    content = {name: each.tolist() for name, each in cell.named.items()}
    if cell.place.startswith("beside"):
        key = cell.place.split()[1]
        content |= {k: {key: v, "values": content[k]} for k, v in cell.told.items()}
    path.write_text(json.dumps(content | cell.keys))
    return path


def _records(ending):
    def write(folder, cell):
        path = folder / f"log{ending}"
        more = {
            "per row": {f"{k}_unit": v for k, v in cell.told.items()},
            "units per row": {"units": dict(cell.told)},
        }.get(cell.place, cell.keys)
        records = [dict(zip(cell.names, row, strict=True)) | more for row in cell.rows]
        lines = [json.dumps(each) for each in records]
        path.write_text("\n".join(lines) + "\n" if ending == ".jsonl" else f"[{','.join(lines)}]")
        return path

    return write


IN_FIELD = ("unit", "units", "UNIT", "uom", "astropy:unit", "description", "long description")


def _parquet(folder, cell):
    path = folder / "log.parquet"
    if cell.place.startswith("pandas"):
        _frame(folder, cell).to_parquet(path)
        return path
    key, long = cell.place.split()[-1], cell.place == "long description"
    said = {k: {key: f"filtered, in {v}" if long else v} for k, v in cell.told.items()}
    said = said if cell.place in IN_FIELD else cell.told if cell.place == "each field" else {}
    pairs = zip(cell.names, cell.columns, strict=True)
    fields = [pa.field(name, pa.float64(), metadata=said.get(k)) for name, k in pairs]
    meta = cell.texts if cell.place not in IN_FIELD else {}
    table = pa.table([*cell.columns.values()], schema=pa.schema(fields, metadata=meta))
    parquet.write_table(table, path)
    return path


def _frame(_, cell):
    frame = pd.DataFrame(cell.named)
    frame.attrs = cell.keys
    return frame


def _mat(folder, cell):
    path, told = folder / "log.mat", dict(cell.told)
    data = {k: np.asarray(v) for k, v in cell.columns.items()}
    if cell.place == "struct.units":
        data |= {k: {"values": data[k], "units": unit} for k, unit in told.items()}
    elif cell.place == "DataInfo":
        data |= {k: {"Data": data[k], "DataInfo": {"Units": unit}} for k, unit in told.items()}
    elif cell.place == "key_unit":
        data |= IN_KEYS["key_unit"](told)
    elif cell.place == "top-level units":
        data |= {"units": told}
    elif cell.place == "data.units":
        data = {"data": data | {"units": told}}
    elif cell.place == "top":
        data |= told
    savemat(path, data)
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
    np.savez(folder / "log.npz", **cell.named, **cell.texts)
    return folder / "log.npz"


def _xlsx(folder, cell):
    lines = _text(".tsv", "\t")(folder, cell).read_text().splitlines()
    rows = [[float(x) if is_number(x) else x for x in line.split("\t")] for line in lines]
    write_sheets(folder / "log.xlsx", {"Sheet1": rows})
    return folder / "log.xlsx"


TEXTS = (*IN_NAMES, *GLUED, *COMMENTS, *ROWS)
OF_TABLE = [f"{whose} {each}" for whose in ("schema", "pandas") for each in IN_KEYS]
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
    "parquet": (_parquet, (*IN_NAMES, *GLUED, *IN_FIELD, *OF_TABLE)),
    "frame": (_frame, (*IN_NAMES, *GLUED, *IN_KEYS)),
    "mat": (_mat, ("struct.units", "top-level units", "key_unit", "data.units", "DataInfo")),
    "mat 7.3": (_hdf5, IN_HDF5),
}
CELLS = [(form, place) for form, (_, places) in WRITERS.items() for place in places]


def ambiguous(form, place, spelling):
    """Whether nobody can tell, as inputs or inputmin, or the table cannot hold the spelling."""
    in_words = place in {"glued", "underscore", "blank"} and spelling in {"s", "min"}
    return in_words or (form == "blanks" and " " in spelling) or (form, place) == ("tsv", ROWS[1])


def written(folder, where, columns, told):
    """Write columns, of some of which a unit is told; return what to read, and their names."""
    form, place = where
    pattern = (IN_NAMES | GLUED).get(place, "{}")
    words = {k: _capital(unit) if place == "glued" else unit for k, unit in told.items()}
    names = [pattern.format(k, words[k]) if k in told else k for k in columns]
    units = {k: OWN[k] for k in columns} | told
    source = WRITERS[form][0](folder, Cell(columns, names, units, place, told))
    if place == "data.units":
        return source, {k: f"data.{k}" for k in columns}
    inside = {"struct.units": ".values", "DataInfo": ".Data"}.get(place, "")
    inside = ".values" if place.startswith("beside") else inside
    chosen = {k: f"{name}{inside * (k in told)}" for k, name in zip(columns, names, strict=True)}
    return source, chosen


def _capital(unit):
    """As inputMilliVolt has it, where it is a word."""
    return unit[:1].upper() + unit[1:] if unit.isalpha() and len(unit) > 4 else unit


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


INNOCENT = ("csv", "tsv", "json", "jsonl", "parquet", "field", "frame", "mat", "mat 7.3")
FIELD = ("description", "comment")


def innocent(folder, number):
    """Write a file with a few such lines; return what to read, and its columns."""
    rng = np.random.default_rng(number)
    lines = [str(each) for each in rng.choice(PROSE, 4, replace=False)]
    columns = {k: v for k, v in signals().items() if k != "velocity"}
    keyed = {f"note {k}": each for k, each in enumerate(lines)}
    keyed |= dict(each.split(": ", 1) for each in lines if ": " in each)
    form, mark = INNOCENT[number % len(INNOCENT)], ("# ", "% ", "// ")[number % 3]
    place, told = {
        "csv": ("prose", [mark + each for each in lines]),
        "tsv": ("prose", [mark + each for each in lines]),
        "json": ("meta", keyed),
        "jsonl": ("top", {"note": lines[0]}),
        "field": ("each field", {k: dict(zip(FIELD, lines, strict=False)) for k in columns}),
        "mat": ("top", {"note": "\n".join(lines), "info": {"by": lines[0], "axis": "m"}}),
        "mat 7.3": ("comment", {"angle": lines[0], "input": lines[1]}),
    }.get(form, ("top", keyed))
    write, _ = WRITERS["parquet" if form == "field" else form]
    return write(folder, Cell(columns, [*columns], {}, place, told)), columns
