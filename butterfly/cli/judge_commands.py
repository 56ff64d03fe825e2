"""Commands that judge an identification: validate, select, residual."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from butterfly.cli.console import say, say_verdict, show_table
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.estimator_options import takes_estimator
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    SPLITS,
    DataArgument,
    FiguresOption,
    HoldoutOption,
    LogOption,
    PlotOption,
    ReportOption,
    parse_names,
    parse_terms,
    picked,
    require_report,
)
from butterfly.cli.show_progress import show_progress
from butterfly.identification.diagnostics.misfit import judge_misfit
from butterfly.identification.diagnostics.residual_torque import residual_torques
from butterfly.identification.diagnostics.residuals import ResidualSummary
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import held_out_fits, judged
from butterfly.identification.parameter import unit_of
from butterfly.identification.splits import Split
from butterfly.identification.validate import bootstrap, hold_out, select_terms
from butterfly.model.terms import TERMS
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.numbers.table_numbers import (
    told_residual,
    told_selection,
    told_validation,
)
from butterfly.report.summary import chosen_terms_text, held_out_sentences

if TYPE_CHECKING:
    from collections.abc import Mapping

    from butterfly.identification.data import DataSet
    from butterfly.identification.estimate import Estimate

_WELL = 90  # FIT in per cent above which a log that was left out is followed well


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
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Predict logs that the estimator has not seen, and compare with those it has.

    Example: `butterfly validate results/quickstart --method output-error`
    """
    require_report(figures, report)
    logs = options.read(data).holding_out(parse_names(holdout))
    chosen = estimator.suited(logs)
    quick = chosen.unchecked()
    whole = judged(logs, quick)
    say_verdict(estimate_verdict(whole).sentence)
    held = hold_out(logs, quick, split, folds=folds, track=show_progress)
    say(held.division.said)
    predictor = logs.simulations
    seen = FitSummary.of(predictor.fits(whole), predictor.horizon(whole))
    unused = held_out_fits(logs, whole)
    counted = held.fits[~np.isnan(held.fits)]
    say(
        f"{int(np.sum(counted > _WELL))} of {counted.size} logs left out are followed with a FIT "
        f"above {_WELL} %."
    )
    for sentence in held_out_sentences(unused):
        say(sentence)
    fits = {"in sample": seen, held.division.left_out: held.summary}
    if unused:
        fits["held out by name"] = FitSummary.of(np.array(list(unused.values())))
    show_table(
        f"{logs.name}: FIT in %{seen.over}",
        ("", "median", "mean", "worst"),
        [(name, *_fit(fit)) for name, fit in fits.items()],
    )
    _show_estimates({"nothing": whole, **held.estimates}, logs)
    drawn = None
    if repetitions:
        drawn = bootstrap(logs, quick, whole, repetitions=repetitions, track=show_progress)
        rows = zip(whole.names, whole.values, drawn.lower, drawn.upper, strict=True)
        show_table(
            "95 % intervals by bootstrap over logs",
            ("", "estimate", "lower", "upper", "unit"),
            [
                (
                    name,
                    *(f"{number:.4g}" for number in numbers),
                    unit_of(name, logs.input_kind, logs.joint),
                )
                for name, *numbers in rows
            ],
        )
    tell = cache(partial(told_validation, logs, chosen, held, whole, drawn))
    if report is not None:
        from butterfly.api.tabulated import Validated  # noqa: PLC0415 - slow to import

        Validated.of_told(tell()).report(report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.give(tell)
    end_with(whole.level)


@answers_in_json("selection")
@takes_data_options
@takes_estimator("output-error", leave_out=("terms",))
def select_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    candidates: Annotated[
        str, typer.Option(help="Terms to choose from, by commas.")
    ] = "drag, load, bias, p3_offset, stribeck",
    holdout: HoldoutOption = None,
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Choose friction terms by how well they predict what was left out: added masses, or logs.

    Terms are added one by one, the most helpful first, until none helps. With output-error and
    forty logs this takes minutes. The verdict is on the estimate with the terms chosen.
    """
    from butterfly.report.ranking_pages import (  # noqa: PLC0415 - slow to import
        selection_page,
        structures_table,
    )

    require_report(figures, report)
    logs = options.read(data).holding_out(parse_names(holdout))
    terms, quick = parse_terms(candidates) or (), estimator.unchecked()
    passed = select_terms(logs, quick, terms, track=show_progress)
    chosen = quick.with_terms(passed[-1].terms)
    found = judged(logs, chosen)
    say_verdict(estimate_verdict(found).sentence)
    say(chosen_terms_text(passed))
    table = structures_table(passed)
    show_table(f"{logs.name}: FIT in %, in sample and left out", table.headers, table.rows)
    tell = cache(partial(told_selection, logs, chosen, terms, passed, found))
    if report is not None:
        from butterfly.report.page import write_page  # noqa: PLC0415 - slow to import

        write_page(selection_page(logs, passed, tell()), report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.give(tell)
    end_with(found.level)


@answers_in_json("residual")
@takes_data_options
@takes_estimator()
def residual_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    which: LogOption = None,
    holdout: HoldoutOption = None,
    plot: PlotOption = None,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Show what the identified model, all its terms, leaves over of the logs.

    Errors of the free runs, beside what encoder and noise explain; whether their correlations stay
    inside the bands that such sensors allow; and the missing term that they look like. With --log
    also the torque that is left over in those logs. --plot draws the one with the largest error.

    Example: `butterfly residual results/quickstart --method output-error --log 2 --plot left.html`
    """
    from butterfly.report.residual import (  # noqa: PLC0415 - slow to import
        HEADERS,
        misfit_sentences,
        misfit_table,
    )

    logs = options.read(data).holding_out(parse_names(holdout))
    chosen = picked(which, len(logs.logs))
    suited = estimator.suited(logs)
    estimate = judged(logs, suited.unchecked())
    verdict = estimate_verdict(estimate)
    say_verdict(verdict.sentence)
    misfit = judge_misfit(logs, estimate)
    shown = [misfit.logs[k] for k in chosen]
    for sentence in misfit_sentences(misfit):
        say(sentence)
    show_table(
        f"{logs.name}: what {estimate.method} leaves over", HEADERS, misfit_table(shown).rows
    )
    if which is not None or plot is not None:
        torques = residual_torques(logs, estimate).logs
        worst = max(chosen, key=lambda k: misfit.logs[k].relative)
        for k in [worst] if which is None else chosen:
            looks = torques[k].left_over.words("the motor's torque")
            say(f"{torques[k].label}: the torque left over looks like {looks}.")
            _show_shares(torques[k].left_over)
        if plot is not None:
            from butterfly.report.page import write_html  # noqa: PLC0415 - slow to import
            from butterfly.report.residual import residual_page  # noqa: PLC0415 - slow to import

            left = torques[worst], misfit.logs[worst]
            write_html(residual_page(*left, verdict, joint=logs.joint), plot)
            typer.echo(f"Plot: {plot}")
    answer.give(lambda: told_residual(logs, suited, estimate, misfit, misfit_sentences(misfit)))
    end_with(verdict.level)


def _show_shares(left_over: ResidualSummary) -> None:
    if left_over.shares:
        show_table(
            "Share of its variance that each missing term alone explains",
            ("term", "%"),
            [
                (TERMS[name].looks_like, f"{100 * each:.1f}")
                for name, each in left_over.shares.items()
            ],
        )


def _show_estimates(estimates: Mapping[str, Estimate], logs: DataSet) -> None:
    """Print what each estimate found, by what was left out of it."""
    names = dict.fromkeys(name for each in estimates.values() for name in each.names)
    found = [dict(zip(each.names, each.values, strict=True)) for each in estimates.values()]
    show_table(
        "Estimates, by what was left out",
        ("", *estimates, "unit"),
        [
            (
                name,
                *(f"{own[name]:#.4g}".rstrip(".") if name in own else "–" for own in found),
                unit_of(name, logs.input_kind, logs.joint),
            )
            for name in names
        ],
    )


def _fit(fit: FitSummary) -> list[str]:
    return [f"{value:.1f}" for value in (fit.median, fit.mean, fit.worst)]
