"""Commands that look at recorded logs: inspect, manifest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from butterfly.cli.console import CONSOLE, new_table, show_pairs
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    ColumnsOption,
    DataArgument,
    InputOption,
    IntersampleOption,
    PlotOption,
    RepairOption,
    UnitsOption,
    parse_pairs,
)
from butterfly.cli.show_progress import show_progress
from butterfly.errors import InputError
from butterfly.logs.drafted import has_thesis_names, manifest_from_names, manifest_of_files
from butterfly.logs.formats import FORMATS
from butterfly.logs.health import DEFAULT_REPAIRS, examine
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import MANIFEST_NAME, write_manifest
from butterfly.logs.pieces import piece_name, read_pieces, with_parts
from butterfly.logs.remarks import Condition
from butterfly.report.inspection import health_rows, hints, inspect_logs, write_inspection
from butterfly.report.numbers.other_numbers import told_inspection

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
    number: Annotated[
        int | None,
        typer.Option("--log", min=0, help="Which log, from 0 on.", show_default="all"),
    ] = None,
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
    if number is not None and number >= count:
        raise InputError(data, "--log", number, f"less than {count}")
    chosen = manifest.logs if number is None else [manifest.logs[number]]
    if plot is not None and len(chosen) > 1:
        raise InputError(data, "--plot", f"{count} logs", "one log (--log N)")
    part = manifest.model_copy(update={"logs": chosen})
    several = len(chosen) > 1
    seen = inspect_logs(part, show_progress) if several or answer.wanted else []
    answer.give(lambda: told_inspection(part, seen, _said(seen, manifest)))
    if several:
        _show_all(data, seen)
        for sentence in _said(seen, manifest):
            typer.echo(sentence)
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
    for sentence in (*_zeros_said([log], manifest), *hints(health.remarks)):
        typer.echo(sentence)
    if plot is not None:
        write_inspection(log, health, plot)
        typer.echo(f"Plot: {plot}")


def manifest_command(
    folder: Annotated[Path, typer.Argument(help="Folder of logs.")],
    *,
    arm: Annotated[
        float | None,
        typer.Option(
            help="Pivot to added mass in m, of logs named like Data_52__8__002.mat.",
            show_default=False,
        ),
    ] = None,
    input_kind: InputOption = InputKind.VOLTAGE,
    intersample: IntersampleOption = Intersample.ZERO_ORDER_HOLD,
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

    File names like Data_52__8__002.mat tell added mass, frequency and amplitude.

    Example: `butterfly manifest logs --units time=ms,angle=deg`
    """
    path = out or folder / MANIFEST_NAME
    said: dict[str, Any] = {
        "arm": arm,
        "input_kind": input_kind,
        "intersample": intersample,
        "columns": None if columns is None else parse_pairs(columns, "--columns"),
        "units": {} if units is None else parse_pairs(units, "--units"),
        "repair": DEFAULT_REPAIRS | frozenset(repair or ()),
    }
    named = has_thesis_names(folder)
    if named and arm is None:
        raise InputError(folder, "--arm", "nothing", "the arm in m, of the masses in the names")
    manifest = (manifest_from_names if named else manifest_of_files)(folder, **said)
    if out is None:
        manifest = manifest.model_copy(update={"root": "."})
    write_manifest(manifest, path)
    typer.echo(f"Manifest of {len(manifest.logs)} logs: {path}")
    if not named:
        typer.echo(
            "The file names tell nothing: say in it what was added (added_mass, arm), and the "
            "omega and amplitude of sines."
        )


def _show_all(data: Path, seen: Sequence[Inspected]) -> None:
    """Print a line for each log."""
    table = new_table(str(data), "log", "state", "samples", "s", "ms")
    table.columns[1].justify = "left"
    table.add_column("findings", overflow="fold")
    for each in seen:
        health = each.health
        numbers = ("–", "–", "–")
        if health is not None:
            numbers = (f"{health.samples}", f"{health.duration:.3f}", f"{1e3 * health.step:.3f}")
        table.add_row(each.name, each.condition, *numbers, each.findings)
    CONSOLE.print(table)


def _said(seen: Sequence[Inspected], manifest: Manifest) -> list[str]:
    """Say where the hand hangs, and what to do about what was found."""
    logs = [each.log for each in seen if each.log is not None]
    return [
        *_zeros_said(logs, manifest),
        *hints(remark for each in seen for remark in each.remarks),
    ]


def _zeros_said(logs: list[Log], manifest: Manifest) -> list[str]:
    from butterfly.report.zeros import zeros_said  # noqa: PLC0415 - slow to import

    return zeros_said(logs, manifest.knowledge)


def _refuse_unusable(data: Path, seen: Sequence[Inspected]) -> None:
    """Raise InputError if there are logs that cannot be used: all were told by now."""
    refused = sum(each.condition is Condition.UNUSABLE for each in seen)
    if refused:
        raise InputError(data, "logs", f"{refused} that cannot be used", "logs without such faults")
