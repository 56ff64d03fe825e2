"""Rows of a sweep's tables as options name them and as they are printed, and its runs compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from butterfly.cli.options import parse_pairs
from butterfly.cli.output import ExitCode, asked, say, show_table, write_json
from butterfly.errors import InputError, nearest
from butterfly.experiment.record import RunRecord
from butterfly.experiment.source import EXPERIMENT, read_experiment
from butterfly.experiment.store import SWEEP, ResultStore
from butterfly.identification.parameter import Parameter, or_nan
from butterfly.logs.log import InputKind
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import field_label, field_name, field_unit, with_error
from butterfly.report.records import runs_document

_NAMES = ("number", "estimator", "parameter")
"""Columns that name a row."""
_ASKED = (
    *("key", "seed", "repetition", "findings", "condition", "standard_error"),
    *("least_left_out", "largest_left_out", "fit_mean", "held_out_worst", "holdout_worst"),
)
"""Columns that are shown where they are asked for, so that the others can be read."""

_FITS = ("fit_", "held_out_", "holdout_")
"""How columns of FIT begin."""

_NOTHING = {"", "–"}


def show_rows(title: str, table: pa.Table, count: int, *, asked: bool) -> None:
    """Print the first ``count`` rows of a sweep's table; all columns if they were ``asked`` for."""
    rows = table.slice(0, count).to_pylist()
    if not rows:
        say(f"{title}: no rows.")
        return
    shown = [name for name in table.column_names if asked or name not in _ASKED]
    cells = {name: [shown_text(row[name]) for row in rows] for name in shown}
    if len(rows) == 1:
        pairs = [(_header(name), text) for name, (text,) in cells.items() if text not in _NOTHING]
        show_table("", (), pairs, lead=2)
        return
    same = [] if asked else [name for name in shown if len({*cells[name]}) == 1]
    named = [name for name in _NAMES if name in cells and name not in same]
    others = [name for name in shown if name not in {*same, *named}]
    told = [
        f"{field_name(name)} {cells[name][0]} {_unit(name)}".rstrip()
        for name in same
        if cells[name][0] not in _NOTHING
    ]
    if told:
        say(f"The same in all rows: {', '.join(told)}.")
    if not asked:
        left = [
            name
            for name in table.column_names
            if name in _ASKED and table[name].null_count < table.num_rows
        ]
        say(f"Not shown: {', '.join(left)}; --columns NAME,… shows what it names.")
    columns = [*named, *others]
    show_table(
        title,
        [_header(name) for name in columns],
        list(zip(*(cells[name] for name in columns), strict=True)),
        lead=max(len(named), 1),
    )


def _header(name: str) -> str:
    if "." in name or not _unit(name):
        return field_label(name)
    return f"{field_name(name)}, {_unit(name)}"


def _unit(name: str) -> str:
    """Return the unit of a column; a deviation is told as a share of the true value."""
    if name == "deviation":
        return "share of true"
    return "%" if name.startswith(_FITS) else field_unit(name)


def shown_text(value: Any) -> str:  # noqa: ANN401 - a cell of any table
    """Write a cell of a table; what is not known is a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def chosen_rows(table: pa.Table, where: str | None, columns: str | None) -> pa.Table:
    """Return rows (``where`` COLUMN=VALUE, by commas) and columns (names, by commas) of a table."""
    for name, text in (parse_pairs(where, "--filter") if where else {}).items():
        column = table[_known(name, table.column_names, "--filter")]
        if pa.types.is_integer(column.type) and text.isdigit():
            table = table.filter(pc.equal(column, int(text)))
        elif pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            try:
                value = float(text)
            except ValueError:
                raise InputError("--filter", name, text, "a number") from None
            near = pc.abs(pc.subtract(column.cast("double", safe=False), value))
            table = table.filter(pc.less_equal(near, 1e-9 * max(abs(value), 1e-300)))
        else:
            table = table.filter(pc.equal(column.cast("string"), text))
    if columns is None:
        return table
    names = [part.strip() for part in columns.split(",")]
    return table.select([_known(name, table.column_names, "--columns") for name in names])


def _known(name: str, names: Sequence[str], option: str) -> str:
    meant = matching(name, names)
    if len(meant) != 1:
        expected = ", or ".join(meant) or nearest(name, names)
        raise InputError(option, name, "an unknown column", expected)
    return meant[0]


def matching(name: str, names: Sequence[str]) -> list[str]:
    """Return the columns that a user may mean: by name, its last part, or a header's words."""
    exact = [each for each in names if each == name]
    return exact or [
        each for each in names if each.endswith(f".{name}") or field_name(each) == name
    ]


def without_formulas(table: pa.Table) -> pa.Table:
    """Return a table none of whose texts a spreadsheet takes for a formula."""
    for k, field in enumerate(table.schema):
        if not pa.types.is_string(field.type):
            continue
        texts = table.column(k)
        taken = pc.match_substring_regex(texts, r"^[=+\-@\t\r]")
        quoted = pc.binary_join_element_wise("'", texts, "")
        table = table.set_column(k, field, pc.if_else(taken, quoted, texts))
    return table


def is_run(path: Path) -> bool:
    """Whether a path names a run of a sweep: RESULTS/NUMBER, or RESULTS/KEY."""
    return (path.parent / SWEEP).exists() and not path.suffix


def run_record(folder: Path, run: str) -> RunRecord:
    """Return the record of a run of a sweep, by its number or the start of its key."""
    store = ResultStore(folder)
    runs = store.sweep().runs
    keys = [each.key for each in runs if str(each.number) == run] or [
        each.key for each in runs if each.key.startswith(run)
    ]
    if len(set(keys)) != 1:
        expected = f"a number from 0 to {len(runs) - 1}, or a key's beginning that is one run's"
        raise InputError(store.folder, "run", run, expected)
    record = store.read(keys[0])
    if record is None:
        raise InputError(store.folder, "run", run, "one that was done (butterfly run does it)")
    return record


def input_kind_of(folder: Path) -> InputKind:
    """Return what the input of results commands, as the experiment beside them says."""
    path = folder / EXPERIMENT
    return read_experiment(path).input_kind if path.exists() else InputKind.TORQUE


def compare_runs(one: Path, other: Path) -> ExitCode:
    """Print what two runs of sweeps set and found otherwise."""
    paths = (one, other)
    runs = [run_record(path.parent, path.name) for path in paths]
    names = [path.name if one.parent == other.parent else str(path) for path in paths]
    others = {each.estimator: each for each in runs[1].estimates}
    for each in runs[0].estimates:
        for name, of in zip(names, (each, others.get(each.estimator)), strict=True):
            if of is not None and of.estimate is not None:
                say(f"{each.estimator}, {name}: {estimate_verdict(of.estimate).lines[0]}")
    said = [run.overrides | {"seed": run.seed, "status": run.status} for run in runs]
    pairs = {name: [each.get(name) for each in said] for name in dict.fromkeys(chain(*said))}
    unlike = [
        (field_label(name), *map(shown_text, pair))
        for name, pair in pairs.items()
        if pair[0] != pair[1]
    ]
    if unlike:
        show_table("What was set", ("", *names), unlike)
    else:
        say("Nothing was set otherwise.")
    for each in runs[0].estimates:
        if each.estimator not in others:
            continue
        twins = {row.name: row for row in others[each.estimator].parameters}
        show_table(
            each.estimator,
            ("parameter", *names, "difference", "in std. errors"),
            [
                (row.name, *_difference(row, twins[row.name]))
                for row in each.parameters
                if row.name in twins
            ],
        )
    if asked.json is not None:
        write_json(runs_document(runs))
    return ExitCode.DONE


def _difference(row: Parameter, twin: Parameter) -> tuple[str, ...]:
    change = twin.value - row.value
    errors = [each.standard_error for each in (row, twin) if each.standard_error is not None]
    spread = math.hypot(*errors)
    in_errors = f"{change / spread:.2g}" if len(errors) == 2 and spread > 0 else "–"  # noqa: PLR2004 - both
    values = (with_error(each.value, or_nan(each.standard_error)) for each in (row, twin))
    return *values, f"{change:.3g}", in_errors
