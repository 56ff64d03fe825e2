"""Commands that look at recorded logs: inspect, manifest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from butterfly.cli.console import CONSOLE, new_table, show_pairs
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.options import (
    DataArgument,
    InputOption,
    IntersampleOption,
    PlotOption,
)
from butterfly.errors import InputError
from butterfly.logs.formats import FORMATS
from butterfly.logs.health import Repair, examine
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    manifest_from_names,
    write_manifest,
)
from butterfly.logs.pieces import piece_name, read_pieces, with_parts
from butterfly.report.inspection import health_rows, write_inspection

if TYPE_CHECKING:
    from butterfly.logs.health import Health
    from butterfly.logs.log import Log
    from butterfly.logs.manifest import LogEntry, Manifest


@takes_data_options
def inspect_command(
    *,
    data: DataArgument,
    number: Annotated[
        int | None,
        typer.Option("--log", min=0, help="Which log, from 0 on.", show_default="all"),
    ] = None,
    repair: Annotated[
        list[Repair] | None,
        typer.Option(
            help="Fault to repair by dropping samples; may be repeated.", show_default=False
        ),
    ] = None,
    plot: PlotOption = None,
    options: DataOptions,
) -> None:
    """Check logs: clock, gaps, saturation, clipping, and the dominant frequency.

    One log is told in full, several in a line each; of several, --log N tells and draws one.

    Example: `butterfly inspect Data_52__8__002.mat --plot log.html`
    """
    manifest = options.manifest(data)
    repairs = manifest.repair | frozenset(repair or ())
    manifest = manifest.model_copy(update={"repair": repairs})
    manifest = with_parts(manifest)
    count = len(manifest.logs)
    if number is None and count > 1:
        if plot is not None:
            raise InputError(data, "--plot", f"{count} logs", "one log (--log N)")
        _show_all(data, manifest)
        return
    if number is not None and number >= count:
        raise InputError(data, "--log", number, f"less than {count}")
    entry = manifest.logs[number or 0]
    log, health = _examined(manifest, entry)
    is_log = data.suffix.lower() in FORMATS
    typer.echo(data if is_log and count == 1 else Path(manifest.root) / piece_name(entry))
    show_pairs(health_rows(log, health))
    _say_zeros([log], manifest)
    if plot is not None:
        write_inspection(log, health, plot)
        typer.echo(f"Plot: {plot}")


def manifest_command(
    folder: Annotated[Path, typer.Argument(help="Folder of logs named like Data_52__8__002.mat.")],
    arm: Annotated[float, typer.Option(help="Pivot to added mass in m.")],
    input_kind: InputOption = InputKind.VOLTAGE,
    intersample: IntersampleOption = Intersample.ZERO_ORDER_HOLD,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Manifest to write; FOLDER/manifest.yaml if not given.", show_default=False
        ),
    ] = None,
) -> None:
    """Generate a data-set manifest from the names of the log files, to edit and keep."""
    path = out or folder / MANIFEST_NAME
    manifest = manifest_from_names(folder, arm=arm, input_kind=input_kind, intersample=intersample)
    if out is None:
        manifest = manifest.model_copy(update={"root": "."})
    write_manifest(manifest, path)
    typer.echo(f"Manifest of {len(manifest.logs)} logs: {path}")


def _examined(manifest: Manifest, entry: LogEntry) -> tuple[Log, Health]:
    ((_, log),) = read_pieces(manifest, entry)
    return examine(log, manifest.repair)


def _say_zeros(logs: list[Log], manifest: Manifest) -> None:
    from butterfly.report.zeros import zeros_said  # noqa: PLC0415 - slow to import

    for said in zeros_said(logs, manifest.knowledge):
        typer.echo(said)


def _show_all(data: Path, manifest: Manifest) -> None:
    """Print a line for each log; one that cannot be used says why, and is bad input in the end."""
    table = new_table(str(data), "log", "samples", "duration in s", "interval in ms")
    table.add_column("findings", overflow="fold")
    refused, logs = 0, []
    for entry in manifest.logs:
        try:
            log, health = _examined(manifest, entry)
        except InputError as error:
            refused += 1
            why = f"{error.field}: got {error.value}; expected {error.expected}"
            table.add_row(piece_name(entry), "–", "–", "–", why)
            continue
        logs.append(log)
        findings = "; ".join(health.findings) or "none"
        numbers = (f"{health.samples}", f"{health.duration:.3f}", f"{1e3 * health.step:.3f}")
        table.add_row(piece_name(entry), *numbers, findings)
    CONSOLE.print(table)
    _say_zeros(logs, manifest)
    if refused:
        raise InputError(data, "logs", f"{refused} that cannot be used", "logs without such faults")
