"""Commands that look at recorded logs: inspect, manifest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from butterfly.cli.console import say, show_pairs, show_table
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    ColumnsOption,
    DataArgument,
    LogOption,
    PlotOption,
    RepairOption,
    UnitsOption,
    parse_pairs,
    picked,
)
from butterfly.cli.show_progress import show_progress
from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs.formats import FORMATS
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import MANIFEST_NAME, checked_options
from butterfly.logs.manifest_draft import (
    draft,
    draft_text,
    has_thesis_names,
    open_questions,
    with_columns,
)
from butterfly.logs.pieces import piece_name, read_pieces, with_parts
from butterfly.report.inspection import STATES, conditions_text, health_rows, hints, inspect_logs
from butterfly.report.numbers.other_numbers import told_inspection
from butterfly.verdict import Level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.logs.log import Log
    from butterfly.logs.manifest import Manifest
    from butterfly.report.inspection import Inspected


@answers_in_json("inspection")
@takes_data_options
def inspect_command(
    *,
    data: DataArgument,
    which: LogOption = None,
    plot: PlotOption = None,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Check logs: clock, gaps, saturation, clipping, turns, and the dominant frequency.

    One log is told in full, several in a line each, the worst first; of several, --log N tells and
    draws one. A folder needs no manifest.

    Example: `butterfly inspect Data_52__8__002.mat --plot log.html`
    """
    manifest = with_parts(options.manifest(data, loose=True))
    count = len(manifest.logs)
    chosen = [manifest.logs[number] for number in picked(which, count)]
    if plot is not None and len(chosen) > 1:
        raise InputError(data, "--plot", f"{len(chosen)} logs", "one log (--log N)")
    part = manifest.model_copy(update={"logs": chosen})
    several = len(chosen) > 1
    seen = inspect_logs(part, show_progress) if several or answer.wanted else []
    answer.give(lambda: told_inspection(part, seen, _said(seen, manifest)))
    if several:
        for sentence in _said(seen, manifest):
            say(sentence)
        _show_all(data, seen)
        _refuse_unusable(data, seen)
        return
    ((log, health),) = (
        examine(recorded, manifest.repair)
        for entry in show_progress(chosen, "Looking at logs")
        for _, recorded in read_pieces(manifest, entry)
    )
    is_log = data.suffix.lower() in FORMATS
    typer.echo(data if is_log and count == 1 else Path(manifest.root) / piece_name(chosen[0]))
    show_pairs(health_rows(log, health))
    for sentence in (*hints(health.remarks), *_zeros_said([log], manifest)):
        say(sentence)
    if plot is not None:
        from butterfly.report.inspection_page import write_inspection  # noqa: PLC0415 - slow

        write_inspection(log, health, plot)
        typer.echo(f"Plot: {plot}")


def manifest_command(
    folder: Annotated[Path, typer.Argument(help="Folder of logs.")],
    *,
    arm: Annotated[
        float | None,
        typer.Option(
            help="Pivot to added mass, of logs named like Data_52__8__002.mat.",
            show_default=False,
        ),
    ] = None,
    input_kind: Annotated[
        InputKind | None,
        typer.Option(
            "--input", help="What the input commands, voltage or torque; asked if not said."
        ),
    ] = None,
    intersample: Annotated[
        Intersample | None,
        typer.Option(
            help="How the input goes between samples: zero_order_hold or first_order_hold; asked "
            "if not said.",
        ),
    ] = None,
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    repair: RepairOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Manifest to write; FOLDER/manifest.yaml if not given.", show_default=False
        ),
    ] = None,
) -> None:
    """Draft a data-set manifest of the logs in a folder, to edit and keep.

    File names like Data_52__8__002.mat tell added mass, frequency and amplitude. What no file
    tells stands in the draft as a question, "To settle", above the value that was taken for it.

    Example: `butterfly manifest logs --units time=ms,angle=deg`
    """
    path = out or folder / MANIFEST_NAME
    if out is None and path.exists():
        raise InputError(path, "path", "a manifest that is there", "--out with another file")
    said = {
        "arm": arm,
        "input": input_kind,
        "intersample": intersample,
        "columns": None if columns is None else parse_pairs(columns, "--columns"),
        "units": None if units is None else parse_pairs(units, "--units"),
        "repair": repair,
    }
    named = has_thesis_names(folder)
    if named and arm is None:
        raise InputError(folder, "--arm", "nothing", "the arm in m, of the masses in the names")
    manifest = with_columns(draft(folder, checked_options(said)))
    if out is None:
        manifest = manifest.model_copy(update={"root": "."})
    given = {"input": input_kind, "intersample": intersample, "columns": columns}
    told = {key for key, value in given.items() if value is not None}
    asked = open_questions(manifest, told, named=named)
    with replacing(path) as file:
        file.write_text(draft_text(manifest, asked), encoding="utf-8")
    typer.echo(f"Manifest of {len(manifest.logs)} logs: {path}")
    if asked:
        say("Settle in it, before it is used:")
    for key, question in asked.items():
        taken = getattr(manifest, key)
        say(f"- {key}: {question}" + (f" Taken for {taken}." if isinstance(taken, str) else ""))


def _show_all(data: Path, seen: Sequence[Inspected]) -> None:
    """Print a line for each log."""
    rows = []
    for each in seen:
        health = each.health
        numbers = ("–", "–", "–")
        if health is not None:
            numbers = (f"{health.samples}", f"{health.duration:.3f}", f"{1e3 * health.step:.3f}")
        rows.append((each.name, STATES[each.condition], *numbers, each.findings))
    show_table(str(data), ("log", "state", "samples", "s", "ms", "findings"), rows)


def _said(seen: Sequence[Inspected], manifest: Manifest) -> list[str]:
    """Say in which condition the logs are, what to do about it, and where the hand hangs."""
    logs = [each.log for each in seen if each.log is not None]
    return [
        conditions_text([each.condition for each in seen]),
        *hints(remark for each in seen for remark in each.remarks),
        *_zeros_said(logs, manifest),
    ]


def _zeros_said(logs: list[Log], manifest: Manifest) -> list[str]:
    from butterfly.report.summary import zero_sentences  # noqa: PLC0415 - slow to import

    return zero_sentences(logs, manifest.knowledge)


def _refuse_unusable(data: Path, seen: Sequence[Inspected]) -> None:
    """Raise InputError if there are logs that cannot be used: all were told by now."""
    refused = sum(each.condition is Level.WARNING for each in seen)
    if refused:
        raise InputError(data, "logs", f"{refused} that cannot be used", "logs without such faults")
