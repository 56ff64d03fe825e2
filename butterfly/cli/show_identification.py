"""An identification as it is printed, fresh or from its record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from butterfly.cli.console import CONSOLE, new_table
from butterfly.cli.loudness import say_verdict
from butterfly.report.parameter_rows import parameter_rows, rows_of
from butterfly.report.physical import HEADERS, TITLE, physical_rows, physical_sentences
from butterfly.report.words import fit_said, sentences_of, summary

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.experiment.record import RunRecord
    from butterfly.identify.identification import Identification
    from butterfly.logs.log import InputKind
    from butterfly.model.parameters import LumpedParameters
    from butterfly.report.parameter_rows import ParameterRow


def show_identification(result: Identification, truth: LumpedParameters | None = None) -> None:
    """Print parameters (beside the true ones if known), verdict, and FIT of other parameters."""
    title = f"{result.data.name}: {result.estimate.method}"
    verdict, *others = summary(result)
    say_verdict(verdict)
    _show_parameters(title, parameter_rows(result, truth), with_truth=truth is not None)
    if result.data.known.physical and (rows := physical_rows(result.physical)):
        table = new_table(TITLE, *HEADERS)
        for row in rows:
            table.add_row(*row)
        CONSOLE.print(table)
    for mass, omega in result.estimate.resonances.items():
        typer.echo(f"Resonance by (100) with {mass}: {omega:.4f} rad/s")
    for sentence in others:
        typer.echo(sentence)
    if result.data.known.physical:
        for sentence in physical_sentences(result.physical):
            typer.echo(sentence)
    if result.comparisons:
        CONSOLE.print(_comparison_table(result))


def _show_parameters(title: str, rows: Sequence[ParameterRow], *, with_truth: bool) -> None:
    table = Table(title=title, box=SIMPLE_HEAD)
    headers = ["", "estimate", "std error", "95 % interval", "unit"]
    if checked := any(row.left_out for row in rows):
        headers.insert(-1, "one mass left out")
    if with_truth:
        headers[1:1] = ["true", "deviation"]
    for index, header in enumerate(headers):
        table.add_column(
            header, justify="left" if index in {0, len(headers) - 1} else "right", overflow="fold"
        )
    for row in rows:
        known = [row.true, row.deviation] if with_truth else []
        left_out = [row.left_out] if checked else []
        table.add_row(row.symbol, *known, row.value, row.error, row.interval, *left_out, row.unit)
    CONSOLE.print(table)


def show_record(record: RunRecord, input_kind: InputKind) -> None:
    """Print what is kept of a run that was done before."""
    for estimate in record.estimates:
        values = {row.parameter: row.value for row in estimate.parameters}
        said = sentences_of(estimate.verdict, estimate.findings, values)
        if estimate.parameters:
            say_verdict(said[0])
            rows = rows_of(estimate.parameters, input_kind)
            _show_parameters(estimate.estimator, rows, with_truth=True)
        if estimate.fit is not None:
            fit = estimate.fit
            typer.echo(
                f"Median FIT{fit.over} {fit_said(fit.median)} % (mean {fit_said(fit.mean)} %, "
                f"worst {fit_said(fit.worst)} %)."
            )
        for sentence in said[1:]:
            typer.echo(sentence)
    show_estimates(record)


def show_estimates(record: RunRecord) -> None:
    """Print what is to be known of estimates besides their parameters."""
    for estimate in record.estimates:
        if estimate.error:
            typer.echo(f"{estimate.estimator}: {estimate.error}")
        if estimate.holdout is not None:
            held = estimate.holdout
            typer.echo(
                f"{estimate.estimator}: held out, not used for the fit: median FIT "
                f"{fit_said(held.median)} % (worst {fit_said(held.worst)} %)."
            )
        if estimate.held_out is not None:
            held = estimate.held_out
            typer.echo(
                f"{estimate.estimator}: logs that were left out are followed with a median "
                f"FIT{held.over} of {fit_said(held.median)} % (worst {fit_said(held.worst)} %)."
            )


def _comparison_table(result: Identification) -> Table:
    title = f"FIT in %{result.summary.over} on the same logs"
    table = Table(title=title, box=SIMPLE_HEAD)
    table.add_column("parameters")
    for header in ("median", "mean", "worst"):
        table.add_column(header, justify="right")
    rows = [(f"{result.estimate.method}, this identification", result.summary)]
    for other in result.comparisons:
        gain = f" (best p4: {other.parameters.p4:.4g})" if other.gain_fitted else ""
        rows.append((other.name + gain, other.summary))
    for name, fit in rows:
        table.add_row(name, fit_said(fit.median), fit_said(fit.mean), fit_said(fit.worst))
    return table
