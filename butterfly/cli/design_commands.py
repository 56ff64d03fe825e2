"""`butterfly design`: what to measure next."""

from __future__ import annotations

from typing import Annotated

import typer

from butterfly.api.usable import require_possible
from butterfly.cli.console import CONSOLE, new_table
from butterfly.cli.data_options import DataOptions, takes_data_options
from butterfly.cli.estimator_options import takes_estimator
from butterfly.cli.exit_codes import end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.loudness import say_verdict
from butterfly.cli.options import DataArgument
from butterfly.cli.show_progress import show_progress
from butterfly.identify.design import LARGEST_SWING, next_experiments
from butterfly.identify.estimators import Estimator
from butterfly.identify.identification import judged
from butterfly.report.numbers.table_numbers import told_design


@answers_in_json("design")
@takes_data_options
@takes_estimator()
def design_command(
    *,
    data: DataArgument,
    estimator: Estimator,
    swing: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Largest swing allowed, in rad; on a slide in m.",
            show_default=f"{LARGEST_SWING:g}, or what a slide's logs have shown",
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="How many candidates to print.")] = 12,
    answer: JsonAnswer,
    options: DataOptions,
) -> None:
    """Rank candidate next experiments by how much they would tell.

    Sines, multisines and free decays with each added mass of the data set and with none; each is
    simulated with the estimate, of which the verdict stands first. Values that no joint has are
    refused.
    """
    logs = options.read(data)
    chosen = estimator.suited(logs)
    found = judged(logs, chosen)
    say_verdict(require_possible(found).sentence)
    ranked = next_experiments(logs, found, largest_swing=swing, track=show_progress)
    table = new_table(
        f"{logs.name}: standard errors after one more run, over those now",
        *("added mass", "input", f"swing in {logs.joint.way}", "mean", *found.names, "warning"),
    )
    for candidate in ranked[:count]:
        table.add_row(
            str(candidate.added_mass),
            candidate.what,
            f"{candidate.swing:.2f}",
            f"{candidate.score:.2f}",
            *(f"{error:.2f}" for error in candidate.errors),
            candidate.warning,
        )
    CONSOLE.print(table)
    answer.give(lambda: told_design(logs, chosen, found, ranked))
    end_with(found.verdict.standing)
