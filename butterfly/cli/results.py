"""`butterfly results clean`, and `butterfly compare` of two runs of sweeps."""

from __future__ import annotations

import math
from itertools import chain
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter as Option

from butterfly.cli.output import ExitCode, say, show_table, write_json
from butterfly.experiment.store import ResultStore
from butterfly.identification.trust import Parameter, or_nan
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import cell_text, field_label, with_error
from butterfly.report.parameter_table import value_text
from butterfly.result import document

Folder = Annotated[Path, Option(help="A sweep's results, such as results/NAME.")]
Failed = Annotated[bool, Option(help="Remove failed runs too, to repeat them.")]


def clean(folder: Folder, /, *, failed: Failed = False) -> None:
    """Remove outdated records and unfinished files."""
    removed = ResultStore(folder).clean(failed=failed)
    for path in removed:
        say(f"Removed {path}")
    say(f"{len(removed)} removed.")


def compare_runs(one: Path, other: Path) -> ExitCode:
    """Print the differences between the settings and estimates of two runs."""
    from butterfly.api.experiments import run_answer  # noqa: PLC0415 - slow to import
    from butterfly.api.result_folders import run_record  # noqa: PLC0415

    runs = [run_record(path.parent, path.name) for path in (one, other)]
    names = [path.name if one.parent == other.parent else str(path) for path in (one, other)]
    others = {entry.estimator: entry for entry in runs[1].estimates}
    for entry in runs[0].estimates:
        for name, of in zip(names, (entry, others.get(entry.estimator)), strict=True):
            if of is not None and of.estimate is not None:
                say(f"{entry.estimator}, {name}: {estimate_verdict(of.estimate).lines[0]}")
    settings = [run.overrides | {"seed": run.seed, "status": run.status} for run in runs]
    both = {
        name: [setting.get(name) for setting in settings]
        for name in dict.fromkeys(chain(*settings))
    }
    pairs = [(field_label(name), *pair) for name, pair in both.items() if pair[0] != pair[1]]
    if unlike := [(name, *map(cell_text, pair)) for name, *pair in pairs]:
        show_table("Settings that differ", ("", *names), unlike)
    else:
        say("The settings are the same.")
    for entry in [record for record in runs[0].estimates if record.estimator in others]:
        twins = {row.name: row for row in others[entry.estimator].parameters}
        show_table(
            entry.estimator,
            ("parameter", *names, "difference", "standard errors"),
            [
                (row.name, *_difference(row, twins[row.name]))
                for row in entry.parameters
                if row.name in twins
            ],
        )
    answers = [run_answer(run, f"Run {run.key}").to_dict() for run in runs]
    title = " beside ".join(answer["title"] for answer in answers)
    first = [
        f"{answer['title']}: {answer['summary'][0]}" for answer in answers if answer["summary"]
    ]
    write_json(document("runs", title, {"runs": answers}, summary=first))
    return ExitCode.DONE


def _difference(row: Parameter, twin: Parameter) -> tuple[str, ...]:
    if row.value is None or twin.value is None:
        return *map(value_text, (row, twin)), "–", "–"
    change, errors = twin.value - row.value, [or_nan(entry.standard_error) for entry in (row, twin)]
    spread = math.hypot(*errors)
    values = map(with_error, (row.value, twin.value), errors)
    return *values, f"{change:.3g}", f"{change / spread:.2g}" if spread > 0 else "–"
