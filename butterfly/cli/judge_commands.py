"""Commands that judge an identification: validate, select, residual."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from butterfly.cli.console import CONSOLE, new_table
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.estimator_options import takes_estimator
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.loudness import say_verdict
from butterfly.cli.options import (
    SPLITS,
    DataArgument,
    HoldoutOption,
    PlotOption,
    parse_names,
    parse_terms,
)
from butterfly.cli.show_progress import show_progress
from butterfly.errors import InputError
from butterfly.identify.estimators import Estimator
from butterfly.identify.identification import held_out_fits, judged
from butterfly.identify.judgement.bootstrap import bootstrap
from butterfly.identify.judgement.left_over import LeftOver
from butterfly.identify.judgement.misfit import judge_misfit
from butterfly.identify.judgement.residual_torque import residual_torques
from butterfly.identify.judgement.splits import Split
from butterfly.identify.judgement.term_selection import select_terms
from butterfly.identify.judgement.validation import hold_out
from butterfly.identify.predict import FitSummary, Predictor
from butterfly.model.terms import TERMS
from butterfly.report.numbers.table_numbers import (
    told_residual,
    told_selection,
    told_validation,
)
from butterfly.report.words import held_out_sentences, verdict_on


@answers_in_json("validation")
@takes_data_options
@takes_estimator()
def validate_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    split: Annotated[Split, typer.Option(help=SPLITS)] = Split.AUTO,
    folds: Annotated[
        int | None,
        typer.Option(
            min=2, help="Parts, of frequency, log and time.", show_default="5, or as many as can be"
        ),
    ] = None,
    holdout: HoldoutOption = None,
    repetitions: Annotated[
        int,
        typer.Option(
            "--bootstrap", min=0, help="Also estimate so often from logs drawn with replacement."
        ),
    ] = 0,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Predict logs that the estimator has not seen, and compare with those it has.

    Example: `butterfly validate results/quickstart --method output-error`
    """
    logs = options.read(data).holding_out(parse_names(holdout))
    chosen = estimator.suited(logs)
    quick = chosen.unchecked()
    whole = judged(logs, quick)
    say_verdict(verdict_on(whole).sentence)
    held = hold_out(logs, quick, split, folds=folds, track=show_progress)
    typer.echo(held.division.said)
    predictor = Predictor(logs)
    seen = FitSummary.of(predictor.fits(whole), predictor.horizon(whole))
    unused = held_out_fits(logs, whole)
    table = new_table(f"{logs.name}: FIT in %{seen.over}", "", "median", "mean", "worst")
    for name, fit in (("in sample", seen), (held.division.left_out, held.summary)):
        table.add_row(name, *_fit(fit))
    if unused:
        table.add_row("held out by name", *_fit(FitSummary.of(np.array(list(unused.values())))))
    CONSOLE.print(table)
    for sentence in held_out_sentences(unused):
        typer.echo(sentence)
    counted = held.fits[~np.isnan(held.fits)]
    typer.echo(f"{int(np.sum(counted > 90))} of {counted.size} logs left out are above 90 %.")  # noqa: PLR2004
    for name, found in held.estimates.items():
        values = ", ".join(
            f"{key} {value:.4g}" for key, value in zip(found.names, found.values, strict=True)
        )
        typer.echo(f"Without {name}: {values}")
    drawn = None
    if repetitions:
        drawn = bootstrap(logs, quick, whole, repetitions=repetitions, track=show_progress)
        table = new_table("95 % intervals by bootstrap over logs", "", "estimate", "lower", "upper")
        rows = zip(whole.names, whole.values, drawn.lower, drawn.upper, strict=True)
        for name, *numbers in rows:
            table.add_row(str(name), *(f"{number:.4g}" for number in numbers))
        CONSOLE.print(table)
    answer.give(lambda: told_validation(logs, chosen, held, whole, drawn))
    end_with(whole.verdict.standing)


@answers_in_json("selection")
@takes_data_options
@takes_estimator("output-error", leave_out=("terms",))
def select_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    candidates: Annotated[
        str, typer.Option(help="Terms to choose from, separated by commas.")
    ] = "drag,load,bias,p3_offset,stribeck",
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Choose friction terms by how well they predict what was left out: added masses, or logs.

    Terms are added one by one, the most helpful first, until none helps. With output-error and
    forty logs this takes minutes. The verdict is on the estimate with the terms chosen.
    """
    logs = options.read(data)
    terms, quick = parse_terms(candidates) or (), estimator.unchecked()
    passed = select_terms(logs, quick, terms, track=show_progress)
    chosen = quick.with_terms(passed[-1].terms)
    found = judged(logs, chosen)
    say_verdict(verdict_on(found).sentence)
    splits = tuple(passed[0].held_out)
    headers = [f"{kind} {what}" for kind in ("in sample", *splits) for what in ("median", "mean")]
    table = new_table(f"{logs.name}: FIT in %, in sample and left out", "terms", *headers)
    for structure in passed:
        fits = [structure.in_sample, *(structure.held_out[split] for split in splits)]
        cells = [f"{value:.1f}" for fit in fits for value in (fit.median, fit.mean)]
        table.add_row(", ".join(("p1..p4, coulomb, delay", *structure.terms)), *cells)
    CONSOLE.print(table)
    typer.echo(f"Chosen: --terms {','.join(passed[-1].terms) or '(none)'}")
    answer.give(lambda: told_selection(logs, chosen, terms, passed, found))
    end_with(found.verdict.standing)


@answers_in_json("residual")
@takes_data_options
@takes_estimator()
def residual_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    number: Annotated[
        int | None,
        typer.Option("--log", min=0, help="Which log, from 0 on.", show_default="all"),
    ] = None,
    plot: PlotOption = None,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Show what the identified model, all its terms, leaves over of the logs.

    Errors of the free runs, beside what encoder and noise explain; whether their correlations stay
    inside the bands that such sensors allow; and the missing term that they look like. With --log
    also the torque that is left over in that log. --plot draws that log, or the one with the
    largest error.

    Example: `butterfly residual results/quickstart --method output-error --log 2 --plot left.html`
    """
    from butterfly.report.misfit import (  # noqa: PLC0415 - slow to import
        HEADERS,
        misfit_sentences,
        misfit_table,
    )

    logs = options.read(data)
    if number is not None and number >= len(logs.logs):
        raise InputError(data, "--log", number, f"less than {len(logs.logs)}")
    suited = estimator.suited(logs)
    estimate = judged(logs, suited.unchecked())
    verdict = verdict_on(estimate)
    say_verdict(verdict.sentence)
    misfit = judge_misfit(logs, estimate)
    shown = misfit.logs if number is None else misfit.logs[number : number + 1]
    table = new_table(f"{logs.name}: what {estimate.method} leaves over", *HEADERS)
    for row in misfit_table(shown).rows:
        table.add_row(*map(str, row))
    CONSOLE.print(table)
    for sentence in misfit_sentences(misfit):
        typer.echo(sentence)
    if number is not None or plot is not None:
        worst = int(np.argmax([log.relative for log in misfit.logs]))
        chosen = worst if number is None else number
        residual = residual_torques(logs, estimate).logs[chosen]
        looks = residual.left_over.words("the motor's torque")
        typer.echo(f"{residual.label}: the torque left over looks like {looks}")
        _show_shares(residual.left_over)
        if plot is not None:
            from butterfly.report.residual_page import write_residual  # noqa: PLC0415 - slow

            write_residual(residual, misfit.logs[chosen], verdict, plot, joint=logs.joint)
            typer.echo(f"Plot: {plot}")
    answer.give(lambda: told_residual(logs, suited, estimate, misfit, misfit_sentences(misfit)))
    end_with(verdict.standing)


def _show_shares(left_over: LeftOver) -> None:
    table = new_table("Share of its variance that each missing term alone explains", "term", "%")
    for name, share in left_over.shares.items():
        table.add_row(TERMS[name].looks_like, f"{100 * share:.1f}")
    if left_over.shares:
        CONSOLE.print(table)


def _fit(fit: FitSummary) -> list[str]:
    return [f"{value:.1f}" for value in (fit.median, fit.mean, fit.worst)]
