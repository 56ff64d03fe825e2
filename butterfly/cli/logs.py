"""Commands that look at recorded logs: inspect, manifest, fetch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import butterfly as bf
from butterfly.cli.options import (
    NO_REPORT,
    OUT,
    SILENT,
    Data,
    DataOptions,
    Facts,
    LogNumbers,
    OutFolder,
    Report,
    parse_numbers,
)
from butterfly.cli.output import ExitCode, say, show, show_progress
from butterfly.cli.written import OutputFile
from butterfly.errors import InputError


def inspect(
    data: Data,
    /,
    *,
    log: LogNumbers = None,
    page: Report = NO_REPORT,
    added_mass: Annotated[float, Parameter(metavar="kg")] = 0.0,
    options: DataOptions = SILENT,
) -> ExitCode:
    """Check logs for faults, or print a robot's parameters.

    Checks clock, gaps, saturation and clipping. Several logs: one line each, worst first. An
    experiment or a saved result: prints the robot's parameters instead.

    Examples: butterfly inspect logs/ --units time=ms; butterfly inspect Data_52__8__002.mat
    --report log.html

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest, a saved result, an experiment, or a shipped name.
    added_mass
        Added mass of the robot of an experiment or saved result, at --arm (default 0.104 m).
    """
    found = bf.inspect(
        data,
        logs=parse_numbers(log),
        added_mass=added_mass,
        track=show_progress,
        root=options.root,
        **options.description(),
    )
    ended = show(found, report=page.report, figures=page.figures)
    if isinstance(found, bf.Inspection):
        found.require_usable()
    return ended


def manifest(
    folder: Annotated[Path, Parameter(name="FOLDER")],
    /,
    *,
    out: Annotated[Path | None, OUT, OutputFile((".yaml", ".yml"))] = None,
    options: Facts = SILENT,
) -> None:
    """Write a draft manifest for the logs in a folder, or in one file.

    Open questions are comments in the draft ("To settle"), each above its assumed value. Names like
    Data_52__8__002.mat give added mass, frequency and amplitude; with --arm, 100g_a.csv its mass.

    Example: butterfly manifest logs --units time=ms,angle=deg

    Parameters
    ----------
    folder
        Folder of logs, or a file; of several logs in one (as from SysId) each is listed.
    out
        Manifest to write. Default: manifest.yaml in the folder.
    """
    from butterfly.files import write_file  # noqa: PLC0415 - slow to import, as all of these
    from butterfly.logs import manifest_draft as drafts  # noqa: PLC0415
    from butterfly.logs.manifest import MANIFEST_NAME, checked_options  # noqa: PLC0415

    path = out or (folder.parent if folder.is_file() else folder) / MANIFEST_NAME
    named = not folder.is_file() and drafts.has_thesis_names(folder)
    if named and options.arm is None:
        raise InputError(folder, "--arm", "missing", "m from pivot to the masses in the file names")
    drafted = drafts.with_columns(drafts.draft(folder, checked_options(options.description())))
    root = options.root or ("." if out is None else None)
    if root is not None:
        drafted = drafted.model_copy(update={"root": str(root)})
    asked = drafts.open_questions(drafted, options.description().keys(), named=named)
    write_file(path, drafts.draft_text(drafted, asked))
    say(f"Manifest of {len(drafted.logs)} logs: {path}")
    if asked:
        say("Answer these in the manifest before you use it:")
    for key, question in asked.items():
        taken = getattr(drafted, key)
        say(f"- {key}: {question}" + (f" Assumed: {taken}." if isinstance(taken, str) else ""))


def fetch(
    *,
    source: Annotated[str | None, Parameter(name="--from", metavar="DIR_OR_URL")] = None,
    out: OutFolder = None,
) -> None:
    """Download the 41 public logs of the thesis (40 MB).

    Each file is checked by its SHA-256; existing files are skipped. Then: butterfly identify
    real-logs

    Parameters
    ----------
    source
        Folder or base URL of 52gmat, 120_5gmat and 154gmat. Default: the thesis's repository.
    out
        Destination folder. Default: the folder where `real-logs` looks for them.
    """
    from butterfly.logs import thesis_logs  # noqa: PLC0415 - slow to import

    folder = out or thesis_logs.own_folder()
    fetched = thesis_logs.fetch(folder, source or thesis_logs.PUBLISHED, show_progress)
    say(f"{len(thesis_logs.pins())} logs, {fetched} downloaded: {folder}")
    found = thesis_logs.found_folder()
    same = found is not None and found.resolve() == folder.resolve()
    root = "" if same else f' --root "{folder}"'
    say(f"Next: butterfly identify real-logs{root}")
