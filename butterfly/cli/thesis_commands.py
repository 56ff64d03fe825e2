"""`butterfly reproduce`: the thesis's figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.cli.console import say, show_table
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.errors import InputError
from butterfly.experiment.source import thesis_robot
from butterfly.report.numbers.other_numbers import told_reproduction
from butterfly.thesis.figure_data import write_figure_data
from butterfly.thesis.tables import has_real_logs, reproduce


@answers_in_json("reproduction")
def reproduce_command(
    *,
    what: Annotated[str, typer.Argument(help="What to reproduce: thesis.")],
    root: Annotated[
        Path | None,
        typer.Option(help="Folder of the 41 real logs, if not fetched.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the data of Figures 3-12 to this folder.", show_default=False),
    ] = None,
    answer: JsonAnswer,
) -> None:
    """Print the thesis's figures beside those obtained the same way, and the right ones.

    Example: `butterfly reproduce thesis --out figures`
    """
    if what != "thesis":
        raise InputError("butterfly reproduce", "what", what, "thesis")
    synthetic = thesis_robot()
    rows = reproduce(synthetic, root)
    show_table(
        "The thesis, published against obtained",
        ("figures", "published", "obtained", "same", "right"),
        [
            (row.what, row.published, row.obtained, "yes" if row.agrees else "no", row.corrected)
            for row in rows
        ],
    )
    for row in rows:
        if row.note:
            say(f"{row.what}: {row.note}")
    if not has_real_logs(root):
        say("Tables 4 and 5 need the real logs: run `butterfly logs fetch`, or give --root.")
    if out is not None:
        for path in write_figure_data(out, synthetic, root):
            typer.echo(f"Figure data: {path}")
    answer.give(lambda: told_reproduction(rows))
