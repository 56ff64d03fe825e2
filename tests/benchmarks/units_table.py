"""Places in files of every format that may say the input's unit, by spellings of units.

Each cell is a file of a known joint. What it says is read, refused, or named beside a unit that was
assumed; a unit that is misread, unnamed, must not occur. Files without such words, and files with
words that say something else, are read as they are, and nothing is named. `python -m
tests.benchmarks.units_table` prints the counts and every cell that is wrong; factors are those of
the SI brochure.
"""

import argparse
import json
import sys
import tempfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import openpyxl
import pandas as pd
import pyarrow as pa
from openpyxl.comments import Comment
from pyarrow import parquet
from scipy.io import savemat

import butterfly as bf
from tests.independent.integrator import Joint, motion

JOINT = Joint(inertia=0.00325, viscous=0.00145, gravity=0.04905, gain=0.25)
SPELLINGS = dict.fromkeys(("V", "volts"), ("voltage", 1.0))
SPELLINGS |= dict.fromkeys(("mV", "millivolts", "Millivolt"), ("voltage", 1e-3))
SPELLINGS |= {"kV": ("voltage", 1e3), "mA": ("current", 1e-3)}
SPELLINGS |= dict.fromkeys(("mNm", "N mm"), ("torque", 1e-3))
SPELLINGS |= dict.fromkeys(("%", "PWM %"), ("duty", 1e-2))
"""The kind of input, and the factor to V, A, N m or a share."""

OTHER_KINDS = {"voltage": "torque", "current": "voltage", "torque": "voltage", "duty": "voltage"}
NAMES = ("time", "input", "angle")


@cache
def signals(samples=60):
    """Time, input and angle of the joint in SI units."""
    time = 0.02 * np.arange(samples)
    command = 0.03 * np.sin(3 * time) + 0.02 * np.sin(7 * time)
    return time, command, motion(JOINT, time, command)[0]


class Cell(NamedTuple):
    """The unit's words, and the columns as the file holds them."""

    unit: str
    time: np.ndarray
    input: np.ndarray
    angle: np.ndarray

    @property
    def columns(self):
        return {name: getattr(self, name) for name in NAMES}

    @property
    def matrix(self):
        return np.column_stack([self.time, self.input, self.angle])

    def filled(self, text):
        return text.replace("§", self.unit)


def text(*above, head="time,input,angle", mark=",", ending=".csv", below=(), more="", first=()):
    """Write a text table below some lines; ``first`` stand between header and rows."""

    def write(folder, cell):
        rows = [mark.join(map(repr, row)) + cell.filled(more) for row in cell.matrix.tolist()]
        lines = [*above, head, *first, *rows, *below]
        path = folder / f"log{ending}"
        path.write_text("\n".join(cell.filled(line) for line in lines) + "\n", encoding="utf-8")
        return path

    return write


def named(head, **how):
    """Write a text table whose second column is called so."""
    return text(head=f"time,{head},angle", **how)


def documents(make, ending=".json"):
    """Write what is made of a cell as JSON; its texts are filled."""

    def write(folder, cell):
        path = folder / f"log{ending}"
        content = make({name: each.tolist() for name, each in cell.columns.items()})
        path.write_text(cell.filled(json.dumps(content, ensure_ascii=False)), encoding="utf-8")
        return path

    return write


def lines(make):
    """Write records, each with what is made beside it, as JSON lines."""

    def write(folder, cell):
        path = folder / "log.jsonl"
        rows = [dict(zip(NAMES, row, strict=True)) for row in cell.matrix.tolist()]
        texts = (cell.filled(json.dumps(make(row), ensure_ascii=False)) for row in rows)
        path.write_text("".join(f"{each}\n" for each in texts), encoding="utf-8")
        return path

    return write


def columnar(of_field=None, of_table=None, name="input", more=None):
    """Write Parquet with metadata of the column and the table."""

    def write(folder, cell):
        own = {k: cell.filled(v) for k, v in (of_field or {}).items()}
        fields = [pa.field("time", pa.float64())]
        fields += [pa.field(cell.filled(name), pa.float64(), metadata=own or None)]
        fields += [pa.field("angle", pa.float64())]
        arrays = [cell.time, cell.input, cell.angle]
        for key, value in (more or {}).items():
            fields.append(pa.field(key, pa.string()))
            arrays.append([cell.filled(value)] * cell.time.size)
        meta = {k: cell.filled(v) for k, v in (of_table or {}).items()}
        parquet.write_table(pa.table(arrays, pa.schema(fields, meta or None)), folder / "a.parquet")
        return folder / "a.parquet"

    return write


def packed(make):
    """Write arrays that are made of a cell as NumPy's."""

    def write(folder, cell):
        np.savez(folder / "log.npz", **make(cell))
        return folder / "log.npz"

    return write


def matlab(make, **how):
    """Write variables that are made of a cell as MATLAB's level 5."""

    def write(folder, cell):
        savemat(folder / "log.mat", make(cell), **how)
        return folder / "log.mat"

    return write


def cells_of(*texts):
    """A cell array of texts."""
    found = np.empty(len(texts), dtype=object)
    found[:] = texts
    return found


def hdf5(attributes=None, of_file=None, more=None):
    """Write MATLAB's level 7.3: attributes of the input and the file, and texts beside."""

    def write(folder, cell):
        path = folder / "log.mat"
        with h5py.File(path, "w", userblock_size=512) as root:
            for name, each in cell.columns.items():
                root.create_dataset(name, data=each[None, :])
                root[name].attrs["MATLAB_class"] = np.bytes_("double")
            for key, value in (attributes or {}).items():
                root["input"].attrs[key] = cell.filled(value)
            for key, value in (of_file or {}).items():
                root.attrs[key] = cell.filled(value)
            for key, value in (more or {}).items():
                codes = [[ord(each)] for each in cell.filled(value)]
                root.create_dataset(key, data=np.array(codes, np.uint16))
                root[key].attrs["MATLAB_class"] = np.bytes_("char")
                root[key].attrs["MATLAB_int_decode"] = 2
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
        return path

    return write


def book(*above, head=NAMES, form=None, note=None, sheets=None, title="Log"):
    """Write a sheet below some rows; a number format, a comment and other sheets."""

    def write(folder, cell):
        made = openpyxl.Workbook()
        sheet = made.active
        sheet.title = cell.filled(title).replace("/", " ")
        for row in [*above, head]:
            sheet.append([cell.filled(each) for each in row])
        for row in cell.matrix.tolist():
            sheet.append(row)
        first = len(above) + 1
        if form:
            for row in range(first + 1, first + 1 + cell.time.size):
                sheet.cell(row, 2).number_format = cell.filled(form)
        if note:
            sheet.cell(first, 2).comment = Comment(cell.filled(note), "bench")
        for name, rows in (sheets or {}).items():
            other = made.create_sheet(name)
            for row in rows:
                other.append([cell.filled(each) for each in row])
        made.save(folder / "log.xlsx")
        return folder / "log.xlsx"

    return write


def frame(attrs=None, name="input"):
    """A pandas frame with attributes."""

    def write(_, cell):
        table = pd.DataFrame(dict(zip(("time", cell.filled(name), "angle"), cell[1:], strict=True)))
        filled = json.loads(cell.filled(json.dumps(attrs or {}, ensure_ascii=False)))
        table.attrs = filled
        return table

    return write


YAML = ("# columns:", "#   - name: time", "#     unit: s", "#   - name: input", "#     unit: §")
YAML += ("#   - name: angle", "#     unit: rad")
TABLE = ("# column  name  unit", "# 1  time  s", "# 2  input  §", "# 3  angle  rad")
ECSV = ("# %ECSV 1.0", "# ---", "# datatype:", "# - {name: time, unit: s, datatype: float64}")
ECSV += ("# - {name: input, unit: §, datatype: float64}",)
ECSV += ("# - {name: angle, unit: rad, datatype: float64}", "# schema: astropy-2.0")
PLACES = {
    "name [u]": named("input [§]"),
    "name (u)": named("input (§)"),
    "name {u}": named("input {§}"),
    "name <u>": named("input <§>"),
    "name u": named("input §"),
    "name_u": named("input_§"),
    "name.u": named("input.§"),
    "name / u": named("input / §"),
    "name: u": named("input: §"),
    "name - u": named("input - §"),
    "name in u": named("input in §"),
    "u_name": named("§_input"),
    "u name": named("§ input"),
    "[u] name": named("[§] input"),
    "u.name": named("§.input"),
    "name_u_raw": named("input_§_raw"),
    "name (note, u)": named('"input (motor, §)"'),
    "name [note] (u)": named("input [ch 1] (§)"),
    "name, semicolons": text(head="time;input [§];angle", mark=";"),
    "name, tabs": text(head="time\tinput (§)\tangle", mark="\t", ending=".tsv"),
    "row of units": named("input", first=("s,§,rad",)),
    "row of units in brackets": named("input", first=("[s],[§],[rad]",)),
    "row of units with gaps": named("input", first=("-,§,-",)),
    "row of units, rest blank": named("input", first=(",§,",)),
    "row of units above": text("s,§,rad"),
    "comment key: u": text("# bench 2", "# input: §"),
    "comment key = u": text("# input = §"),
    "comment key [u]": text("# input [§]"),
    "comment key (u)": text("# time (s), input (§), angle (rad)"),
    "comment key in u": text("# input in §"),
    "comment key u": text("# input §"),
    "comment units: a, b": text("# units: s, §, rad"),
    "comment units a b": text("# units s § rad"),
    "comment a, b": text("# s, §, rad"),
    "comment [a] [b]": text("# [s] [§] [rad]"),
    "comment unit of key": text("# unit of input: §"),
    "comment key unit is": text("# the unit of input is §"),
    "comment table": text(*TABLE),
    "comment table, pipes": text(
        "# | column | meaning | unit |", "# | time | clock | s |", "# | input | command | § |"
    ),
    "comment table, tabs": text("# name\tunit\tmeaning", "# input\t§\tcommand of the motor"),
    "comment table, meanings": text("# input  command of the motor  §"),
    "comment column number": text("# column 2: §"),
    "comment col number = name": text("# col 2 = input [§]"),
    "comment number: u": text("# 1: s", "# 2: §", "# 3: rad"),
    "comment ECSV": text(*ECSV),
    "comment YAML list": text(*YAML),
    "comment YAML mapping": text("# units:", "#   time: s", "#   input: §", "#   angle: rad"),
    "comment YAML key": text("# input:", "#   unit: §", "#   sensor: none"),
    "comment INI": text("# [input]", "# unit = §", "# [angle]", "# unit = rad"),
    "comment INI units": text("# [units]", "# time = s", "# input = §"),
    "comment JSON": text('# {"input": {"unit": "§"}, "angle": {"unit": "rad"}}'),
    "comment JSON lines": text("# {", '#  "units": {', '#   "input": "§"', "#  }", "# }"),
    "comment XML": text('# <column name="input" unit="§"/>'),
    "comment prose": text("# The input was recorded in §."),
    "comment prose of both": text("# Recorded with angle in rad and input in §"),
    "comment prose given": text("# Input is given in § (angle: rad)"),
    "comment prose all": text("# all commands are in §, angles in rad"),
    "comment slashes": text("# time/input/angle: s/§/rad"),
    "comment name / u": text("# t = time / s, u = input / §"),
    "comment units semicolons": text("# Units: time s; input §; angle rad"),
    "comment at the end": text(below=("# input in §",)),
    "comment below the header": text(first=("# input: §",)),
    "comment %": text("% input: §"),
    "comment //": text("// input: §"),
    "preamble key: u": text("Bench 2", "Input unit: §"),
    "preamble cells": text("Bench;2", "Input unit;§", head="time;input;angle", mark=";"),
    "preamble prose": text("Motor bench, input in §"),
    "preamble LabVIEW": text(
        "LabVIEW Measurement", "Separator,Comma", "Y_Unit_Label,s,§,rad", "***End_of_Header***"
    ),
    "preamble LVM": text(
        *(
            "LabVIEW Measurement\t",
            "Channels\t2\t",
            "Y_Unit_Label\t§\trad",
            "X_Dimension\tTime\tTime",
        ),
        *("Delta_X\t0.02\t0.02", "***End_of_Header***\t\t"),
        head="time\tinput\tangle",
        mark="\t",
        ending=".txt",
    ),
    "column of units": text(head="time,input,angle,unit", more=",§"),
    "column of the input's unit": text(head="time,input,angle,input_unit", more=",§"),
    "blanks, comment table": text(*TABLE, head="time input angle", mark=" ", ending=".txt"),
    "json units": documents(lambda c: c | {"units": {"input": "§"}}),
    "json meta.units": documents(lambda c: c | {"meta": {"units": {"input": "§"}}}),
    "json fields": documents(lambda c: c | {"fields": [{"name": "input", "unit": "§"}]}),
    "json key_unit": documents(lambda c: c | {"input_unit": "§"}),
    "json beside": documents(lambda c: c | {"input": {"unit": "§", "values": c["input"]}}),
    "json note": documents(lambda c: c | {"note": "input in §"}),
    "json prefix": documents(
        lambda c: {"time": c["time"], "§_input": c["input"], "angle": c["angle"]}
    ),
    "json list of units": documents(lambda c: c | {"units": ["s", "§", "rad"]}),
    "json labels of rows": documents(
        lambda c: {
            "columns": ["time [s]", "input [§]", "angle [rad]"],
            "data": [list(row) for row in zip(*c.values(), strict=True)],
        }
    ),
    "json tags": documents(lambda c: c | {"setup": {"input": {"sensor": "none", "in": "§"}}}),
    "jsonl key_unit": lines(lambda row: row | {"input_unit": "§"}),
    "jsonl units": lines(lambda row: row | {"units": {"input": "§"}}),
    "jsonl unit": lines(lambda row: row | {"unit": "§"}),
    "parquet field unit": columnar({"unit": "§"}),
    "parquet field description": columnar({"description": "command in §"}),
    "parquet table units": columnar(of_table={"units": '{"input": "§"}'}),
    "parquet table note": columnar(of_table={"note": "input in §"}),
    "parquet name": columnar(name="input [§]"),
    "parquet prefix": columnar(name="§_input"),
    "parquet column of units": columnar(more={"input_unit": "§"}),
    "npz header of a matrix": packed(
        lambda c: {"data": c.matrix, "header": np.array(["time", f"input [{c.unit}]", "angle"])}
    ),
    "npz units of a matrix": packed(
        lambda c: {"data": c.matrix, "units": np.array(["s", c.unit, "rad"])}
    ),
    "npz names and units": packed(
        lambda c: {
            "data": c.matrix,
            "names": np.array(NAMES),
            "unit": np.array(["s", c.unit, "rad"]),
        }
    ),
    "npz key_unit": packed(lambda c: c.columns | {"input_unit": np.array(c.unit)}),
    "npz units": packed(lambda c: c.columns | {"units": np.array(["s", c.unit, "rad"])}),
    "npz note": packed(lambda c: c.columns | {"note": np.array(f"input in {c.unit}")}),
    "npz fields": packed(
        lambda c: {
            "log": np.array(
                [*map(tuple, c.matrix)],
                [("time", "f8"), (f"input_{c.unit}", "f8"), ("angle", "f8")],
            )
        }
    ),
    "mat labels of a matrix": matlab(
        lambda c: {
            "D": c.matrix,
            "labels": cells_of("time (s)", f"input ({c.unit})", "angle (rad)"),
        }
    ),
    "mat units of a matrix": matlab(
        lambda c: {"D": c.matrix, "units": cells_of("s", c.unit, "rad")}
    ),
    "mat units as characters": matlab(
        lambda c: {"D": c.matrix, "units": np.array(["s", c.unit, "rad"])}
    ),
    "mat names and units": matlab(
        lambda c: {"D": c.matrix, "names": cells_of(*NAMES), "unit": cells_of("s", c.unit, "rad")}
    ),
    "mat key_unit": matlab(lambda c: c.columns | {"input_unit": c.unit}),
    "mat struct": matlab(lambda c: c.columns | {"input": {"values": c.input, "unit": c.unit}}),
    "mat note": matlab(lambda c: c.columns | {"note": f"input in {c.unit}"}),
    "mat level 4 note": matlab(lambda c: c.columns | {"note": f"input in {c.unit}"}, format="4"),
    "mat 7.3 attribute": hdf5({"units": "§"}),
    "mat 7.3 long name": hdf5({"long_name": "command in §"}),
    "mat 7.3 of the file": hdf5(of_file={"units": '{"input": "§"}'}),
    "mat 7.3 key_unit": hdf5(more={"input_unit": "§"}),
    "mat 7.3 note": hdf5(more={"note": "input in §"}),
    "xlsx name": book(head=("time", "input (§)", "angle")),
    "xlsx name on two lines": book(head=("time", "input\n[§]", "angle")),
    "xlsx row of units": book(NAMES, head=("s", "§", "rad")),
    "xlsx row above": book(("Bench 2",), ("Input unit", "§")),
    "xlsx number format": book(form='0.00 "§"'),
    "xlsx number format, brackets": book(form='0.000\\ "[§]"'),
    "xlsx comment": book(note="in §"),
    "xlsx comment of the name": book(note="Command of the motor, §"),
    "xlsx sheet Units": book(sheets={"Units": [("time", "s"), ("input", "§"), ("angle", "rad")]}),
    "xlsx sheet of notes": book(sheets={"Notes": [("Input was logged in §",)]}),
    "xlsx title": book(title="Log in §"),
    "frame units": frame({"units": {"input": "§"}}),
    "frame note": frame({"note": "input in §"}),
    "frame name": frame(name="input [§]"),
    "frame prefix": frame(name="§_input"),
}
INSIDE = {"json beside": "input.values", "mat struct": "input.values"}
MATRICES = {place: "{}" for place in PLACES if "of a matrix" in place or "names and" in place}
MATRICES |= {"json labels of rows": "data.{}", "mat units as characters": "{}"}

HARMLESS = (
    *("supply 24 V", "limit 3 A", "Volt-Ampere curve motor A", "Motor A", "run m", "bus voltage"),
    *("max current", "max torque 1.2 Nm", "supply: 12000 mV", "friction compensated", "V2.1"),
    *("torque constant 53 mNm/A", "measured with 5 mV/V", "operator: A. Volta", "phase: A"),
    *("PWM frequency 20 kHz", "a heavy duty gearbox", "gain 100 mV/A", "sensitivity: 2 mV per rad"),
    *(
        "Motor: 24 V, 150 W, 6 A",
        "run 12: 80 % of the speed",
        "us and them, ma and pa",
        "MA thesis",
    ),
    *("current limit: 3000 mA", "max. current in mA: 3000", "supply voltage in mV: 24000", "m = 3"),
    *("amplifier: 4 A peak", "rated torque (mNm): 120", "version V", "series A, board V"),
    *("ambient 21 C, 40 % humidity", "voltage divider 1:10", "battery at 80 percent", "axis: m"),
)


def wrong_places(place, unit):
    """Whether a place cannot hold a unit: blanks divide its columns."""
    return place.startswith("blanks") and " " in unit


def mapped(place, unit):
    """Return the columns of a place, as its user names them."""
    if place in MATRICES:
        return {name: MATRICES[place].format(k) for k, name in enumerate(NAMES)}
    own = {"time": "time", "input": INSIDE.get(place, 1), "angle": "angle"}
    if place == "npz fields" or (isinstance(own["input"], int) and not place.startswith("mat")):
        columns = {"json prefix": f"{unit}_input", "json note": "input"}
        numbered = {"time": 0, "input": 1, "angle": 2}
        return (
            numbered
            if not place.startswith("json")
            else own | {"input": columns.get(place, "input")}
        )
    return own | {"input": own["input"] if isinstance(own["input"], str) else "input"}


def outcome(place, unit, factor, kind, folder):
    """Return what comes of a cell: read, refused, named or MISREAD."""
    time, command, angle = signals()
    cell = Cell(unit, time, command / factor, angle)
    source = PLACES[place](Path(folder), cell)
    try:
        data = bf.read(source, columns=mapped(place, unit), input=kind, known={"p3": 0.04905})
    except bf.InputError as error:
        return "refused", str(error)
    read = data.logs[0].reading.columns["input"]
    if np.allclose(data.logs[0].input, command, rtol=1e-9) and kind == SPELLINGS[unit][0]:
        return "read", read.text
    if read.unread:
        return "named", read.unread.text
    return "MISREAD", read.text


def table(kinds=("own", "other")):
    """Yield place, unit, kind and outcome of every cell."""
    for place in PLACES:
        for unit, (kind, factor) in SPELLINGS.items():
            if wrong_places(place, unit):
                continue
            for which in kinds:
                told = kind if which == "own" else OTHER_KINDS[kind]
                with tempfile.TemporaryDirectory() as folder:
                    yield place, unit, told, *outcome(place, unit, factor, told, folder)


def harmless(number, kind):
    """Return what is said of a file with words that say something else: nothing."""
    words = [HARMLESS[(number + k * 7) % len(HARMLESS)] for k in range(3)]
    one, two, three = words
    time, command, angle = signals()
    cell = Cell("", time, command, angle)
    places = [
        text(f"# {one}", f"# {two}", f"# {three}"),
        text(one, two, three, head="time;input;angle", mark=";"),
        documents(lambda c: c | {"note": one, "info": {"about": two}, "remarks": words}),
        columnar({"comment": one}, {"note": two, "more": three}),
        packed(lambda c: c.columns | {"note": np.array(one), "notes": np.array(words)}),
        matlab(lambda c: c.columns | {"note": one, "info": {"about": two}}),
        book((one,), (two,), sheets={"Notes": [(three,)]}),
        frame({"note": one, "about": words}),
    ]
    with tempfile.TemporaryDirectory() as folder:
        source = places[number % len(places)](Path(folder), cell)
        columns = {name: name for name in NAMES}
        try:
            data = bf.read(source, columns=columns, input=kind, known={"p3": 0.04905})
        except bf.InputError as error:
            return f"refused {words}: {error}"
    read = data.logs[0].reading.columns["input"]
    same = np.allclose(data.logs[0].input, command, rtol=1e-12)
    return "" if same and not read.unread else f"{words}: {read.text} {read.unread}"


def main():
    """Print the counts, and every cell that is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--show", default="MISREAD", help="outcomes that are listed")
    parser.add_argument("--place", default="", help="only the places whose names hold this")
    options = parser.parse_args()
    counts = {"own": Counter(), "other": Counter()}
    for place in [each for each in PLACES if options.place not in each]:
        del PLACES[place]
    for place, unit, kind, found, why in table():
        counts["own" if SPELLINGS[unit][0] == kind else "other"][found] += 1
        if found in options.show.split(","):
            print(f"{found}: {place}, {unit}, input={kind}: {why}")
    said = [harmless(k, kind) for k in range(100) for kind in ("voltage", "torque", "current")]
    for each in filter(None, said):
        print(f"harmless: {each}")
    print(f"{len(PLACES)} places, {len(SPELLINGS)} spellings: {dict(counts['own'])}")
    print(f"declared as another input: {dict(counts['other'])}")
    print(f"{len(said)} harmless, {sum(map(bool, said))} of them not taken so")
    # of another kind than the file's word: a word that nothing ties to the input is no doubt then
    return int(counts["own"]["MISREAD"] > 0 or any(said))


if __name__ == "__main__":
    sys.exit(main())
