"""Commands that look at recorded logs: inspect, manifest, fetch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import butterfly as bf
from butterfly.cli.options import (
    SILENT,
    Data,
    DataOptions,
    LogNumbers,
    Out,
    Page,
    parse_numbers,
)
from butterfly.cli.output import ExitCode, say, show, show_progress
from butterfly.errors import InputError


def inspect(
    data: Data,
    /,
    *,
    log: LogNumbers = None,
    plot: Page = None,
    added_mass: Annotated[float, Parameter(metavar="kg")] = 0.0,
    options: DataOptions = SILENT,
) -> ExitCode:
    """Check logs, or tell the robot of an experiment or a saved result.

    Clock, gaps, saturation, clipping, turns, and the dominant frequency: one log is told in full,
    several in a line each, the worst first; of several, --log N tells and draws one. A folder needs
    no manifest. Of an experiment, and of a saved identification, it prints the robot's physical and
    lumped parameters.

    Example: butterfly inspect Data_52__8__002.mat --plot log.html

    Parameters
    ----------
    data
        A log, a folder of logs, a manifest, a saved result or a shipped data set's name; or an
        experiment.
    plot
        Draw the log to this file (HTML).
    added_mass
        Of the robot of an experiment or a saved result, at --arm (0.104 m if that is not given).
    """
    found = bf.inspect(
        data,
        logs=parse_numbers(log),
        added_mass=added_mass,
        track=show_progress,
        root=options.root,
        **options.description(),
    )
    if isinstance(found, bf.Inspection) and plot is not None and len(found.logs) > 1:
        raise InputError(data, "--plot", f"{len(found.logs)} logs", "one log (--log N)")
    ended = show(found)
    if isinstance(found, bf.Inspection):
        if plot is not None:
            found.plot(plot)
            say(f"Plot: {plot}")
        found.require_usable()
    return ended


def manifest(
    folder: Annotated[Path, Parameter(name="FOLDER")],
    /,
    *,
    out: Out = None,
    options: DataOptions = SILENT,
) -> None:
    """Draft a data-set manifest of the logs in a folder, to edit and keep.

    File names like Data_52__8__002.mat tell added mass, frequency and amplitude. What no file
    tells stands in the draft as a question, "To settle", above the value that was taken for it.

    Example: butterfly manifest logs --units time=ms,angle=deg

    Parameters
    ----------
    folder
        Folder of logs.
    out
        Manifest to write; FOLDER/manifest.yaml if not given.
    """
    from butterfly.files import write_file  # noqa: PLC0415 - slow to import, as all of these
    from butterfly.logs import manifest_draft as drafts  # noqa: PLC0415
    from butterfly.logs.manifest import MANIFEST_NAME, checked_options  # noqa: PLC0415

    path = out or folder / MANIFEST_NAME
    if out is None and path.exists():
        raise InputError(path, "path", "a manifest that is there", "--out with another file")
    named = drafts.has_thesis_names(folder)
    if named and options.arm is None:
        raise InputError(folder, "--arm", "nothing", "the arm in m, of the masses in the names")
    drafted = drafts.with_columns(drafts.draft(folder, checked_options(options.description())))
    drafted = drafted.piece(options.begin, options.end)
    root = options.root or ("." if out is None else None)
    if root is not None:
        drafted = drafted.model_copy(update={"root": str(root)})
    asked = drafts.open_questions(drafted, options.description().keys(), named=named)
    write_file(path, drafts.draft_text(drafted, asked))
    say(f"Manifest of {len(drafted.logs)} logs: {path}")
    if asked:
        say("Settle in it, before it is used:")
    for key, question in asked.items():
        taken = getattr(drafted, key)
        say(f"- {key}: {question}" + (f" Taken for {taken}." if isinstance(taken, str) else ""))


def fetch(
    *,
    source: Annotated[str | None, Parameter(name="--from", metavar="DIR_OR_URL")] = None,
    out: Out = None,
) -> None:
    """Fetch the thesis's 41 public logs, 40 MB, and check each by its SHA-256.

    Afterwards `butterfly identify real-logs` finds them. Logs that are there already are not
    fetched again.

    Parameters
    ----------
    source
        Folder, or beginning of an address, that holds 52gmat, 120_5gmat and 154gmat; the repository
        of the thesis if not given.
    out
        Folder to fetch them to; one in which real-logs looks for them if not given.
    """
    from butterfly.logs import thesis_logs  # noqa: PLC0415 - slow to import

    folder = out or thesis_logs.own_folder()
    fetched = thesis_logs.fetch(folder, source or thesis_logs.PUBLISHED, show_progress)
    say(f"{len(thesis_logs.pins())} logs, {fetched} of them fetched: {folder}")
    found = thesis_logs.found_folder()
    same = found is not None and found.resolve() == folder.resolve()
    root = "" if same else f' --root "{folder}"'
    say(f"Next: butterfly identify real-logs{root}")
