"""The `butterfly logs` commands: fetch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.cli.show_progress import show_progress
from butterfly.logs import thesis_logs


def fetch_command(
    *,
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="DIR_OR_URL",
            help="Folder, or beginning of an address, that holds 52gmat, 120_5gmat and 154gmat.",
            show_default="the repository of the thesis",
        ),
    ] = thesis_logs.PUBLISHED,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder to fetch them to.", show_default="one in which real-logs looks for them"
        ),
    ] = None,
) -> None:
    """Fetch the thesis's 41 public logs, 40 MB, and check each by its SHA-256.

    Afterwards `butterfly identify real-logs` finds them. Logs that are there already are not
    fetched again.

    Example: `butterfly logs fetch`
    """
    folder = out or thesis_logs.own_folder()
    fetched = thesis_logs.fetch(folder, source, show_progress)
    there = len(thesis_logs.digests())
    typer.echo(f"{there} logs, {fetched} of them fetched: {folder}")
    found = thesis_logs.found_folder()
    same = found is not None and found.resolve() == folder.resolve()
    root = "" if same else f' --root "{folder}"'
    typer.echo(f"Next: butterfly identify real-logs{root}")
