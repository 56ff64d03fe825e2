"""An identification as it is printed, fresh or from its record."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.cli.console import say, say_verdict, show_table
from butterfly.report.finding_texts import estimate_sentences
from butterfly.report.format import fit_text
from butterfly.report.parameter_table import parameter_rows
from butterfly.report.physical import HEADERS, TITLE, physical_rows, physical_sentences
from butterfly.report.summary import summary

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.experiment.record import RunRecord
    from butterfly.identification.identification import Identification
    from butterfly.model.parameters import LumpedParameters
    from butterfly.report.parameter_table import ParameterRow


def show_identification(result: Identification, truth: LumpedParameters | None = None) -> None:
    """Print parameters (beside the true ones if known), verdict, and FIT of other parameters."""
    title = f"{result.data.name}: {result.estimate.method}"
    verdict, *others = summary(result)
    say_verdict(verdict)
    for sentence in others:
        say(sentence)
    if result.data.known.physical:
        for sentence in physical_sentences(result.separated()):
            say(sentence)
    _show_parameters(title, parameter_rows(result.estimate.table(truth)))
    if rows := physical_rows(result.separated()):
        show_table(TITLE, HEADERS, rows)
    for mass, omega in result.estimate.resonances.items():
        say(f"Resonance with {mass}, as this method finds it: {omega:.4f} rad/s.")
    if result.comparisons:
        _show_comparisons(result)


def _show_parameters(title: str, rows: Sequence[ParameterRow]) -> None:
    headers = ("", "true", "deviation", "estimate", "std error", "95 % interval", "unit")
    show_table(
        title,
        (*headers, "one mass left out"),
        [
            (
                *(row.symbol, row.true, row.deviation, row.value, row.error, row.interval),
                *(row.unit, row.left_out),
            )
            for row in rows
        ],
    )


def show_record(record: RunRecord) -> None:
    """Print what is kept of a run that was done before."""
    for estimate in record.estimates:
        said = (
            ["The estimator gave no values."]
            if estimate.estimate is None
            else estimate_sentences(estimate.estimate)
        )
        if estimate.estimate is not None:
            say_verdict(said[0])
        if estimate.fit is not None:
            fit = estimate.fit
            say(
                f"Median FIT{fit.over} {fit_text(fit.median)} % (mean {fit_text(fit.mean)} %, "
                f"worst {fit_text(fit.worst)} %)."
            )
        for sentence in said[1:]:
            say(sentence)
        if estimate.parameters:
            _show_parameters(estimate.estimator, parameter_rows(estimate.parameters))
    show_estimates(record)


def show_estimates(record: RunRecord) -> None:
    """Print what is to be known of estimates besides their parameters."""
    for estimate in record.estimates:
        if estimate.error:
            say(f"{estimate.estimator}: {estimate.error}")
        if estimate.holdout is not None:
            held = estimate.holdout
            say(
                f"{estimate.estimator}: held out, not used for the fit: median FIT "
                f"{fit_text(held.median)} % (worst {fit_text(held.worst)} %)."
            )
        if estimate.held_out is not None:
            held = estimate.held_out
            say(
                f"{estimate.estimator}: logs that were left out are followed with a median "
                f"FIT{held.over} of {fit_text(held.median)} % (worst {fit_text(held.worst)} %)."
            )


def _show_comparisons(result: Identification) -> None:
    fits = [(f"{result.estimate.method}, this identification", result.fit)]
    for other in result.comparisons:
        gain = f" (best p4: {other.parameters.p4:.4g})" if other.gain_fitted else ""
        fits.append((other.name + gain, other.summary))
    show_table(
        f"FIT in %{result.fit.over} on the same logs",
        ("parameters", "median", "mean", "worst"),
        [(name, *map(fit_text, (fit.median, fit.mean, fit.worst))) for name, fit in fits],
    )
