"""Commands beside the verbs: manifest, fetch, reproduce, schema, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from butterfly.cli.options import OUT, SILENT, WRITTEN, DataOptions, Facts, OutFolder
from butterfly.cli.output import put, say, show_progress, show_table, write_json
from butterfly.cli.written import OutputFile
from butterfly.errors import InputError
from butterfly.files import shipped, write_file

if TYPE_CHECKING:
    from butterfly.thesis.tables import Synthetic


_NEEDED = (
    "Tables 4 and 5 and Figures 9 to 12 need the real logs: run `butterfly fetch`, or pass --root "
    "FOLDER."
)


def manifest(
    folder: Path,
    /,
    *,
    out: Annotated[Path | None, OUT, OutputFile((".yaml", ".yml"))] = None,
    options: Facts = SILENT,
) -> None:
    """Write a draft manifest for the logs in a folder, or in one file.

    Open questions are comments in the draft ("To settle"), each above its assumed value; columns
    without a clear name are left out. Names like Data_52__8__002.mat give added mass, frequency and
    amplitude; with --arm, 100g_a.csv its mass.

    Parameters
    ----------
    folder
        Folder of logs, or a file; of several logs in one (as from SysId) each is listed.
    out
        Manifest to write. Default: manifest.yaml in the folder.
    """
    from butterfly.logs import manifest_draft as drafts  # noqa: PLC0415 - slow to import
    from butterfly.logs.manifest import MANIFEST_NAME, checked_options  # noqa: PLC0415

    path = out or (folder.parent if folder.is_file() else folder) / MANIFEST_NAME
    named = not folder.is_file() and drafts.has_thesis_names(folder)
    if named and options.arm is None:
        raise InputError(folder, "--arm", "missing", "m from pivot to the masses in the file names")
    given = checked_options(options.description())
    drafted = drafts.with_columns(drafts.draft(folder, given), given)
    asked = drafts.open_questions(drafted, given.keys(), named=named)
    root = options.root or ("." if out is None else None)
    if root is not None:
        drafted = drafted.model_copy(update={"root": str(root)})
    write_file(path, drafts.draft_text(drafted, asked))
    say(f"Manifest of {len(drafted.logs)} logs: {path}")
    if asked:
        say("Answer these in the manifest before you use it:")
    for key, question in asked.items():
        taken = getattr(drafted, key)
        say(f"- {key}: {question}" + (f" Assumed: {taken}." if isinstance(taken, str) else ""))


def report(
    data: Path | None = None,
    /,
    *,
    result: Annotated[Path | None, Parameter(name="--with", metavar="RESULT")] = None,
    bundle: Annotated[
        Path | None, Parameter(group=WRITTEN, metavar="FILE"), OutputFile((".zip",))
    ] = None,
    logs: bool = False,
    facts: DataOptions = SILENT,
) -> None:
    """Collect what to attach to a report of an error: versions, health of logs, a result.

    It contains no names, paths or texts of yours; read it before you attach it. Data that cannot
    be read are no error here: it says where reading them ended. Nothing is fitted.

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest or a saved result. Default: versions only.
    result
        Saved result.
    bundle
        Zip file to write. Default: print what would be in it.
    logs
        Add the samples of the logs, as columns of numbers, each clock from 0.
    """
    from butterfly.api.bundled import bundle as collect  # noqa: PLC0415 - slow to import
    from butterfly.report.bundle import TEXT  # noqa: PLC0415

    described = {"root": facts.root, **facts.description()}
    files = collect(data, bundle, result=result, logs=logs, track=show_progress, **described)
    put(files[TEXT].rstrip())
    if bundle is not None:
        say(f"Bundle: {bundle} ({', '.join(files)})")


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
    location = thesis_logs.found_folder()
    same = location is not None and location.resolve() == folder.resolve()
    root = "" if same else f' --root "{folder}"'
    say(f"Next: butterfly identify real-logs{root}")


def reproduce(
    what: Literal["thesis"],  # noqa: ARG001 - there is no other
    /,
    *,
    root: Annotated[Path | None, Parameter(metavar="FOLDER")] = None,
    out: OutFolder = None,
) -> None:
    """Reproduce the thesis's numbers, with its mistakes and without.

    Parameters
    ----------
    what
        What to reproduce.
    root
        Folder of the 41 real logs. Default: where `butterfly fetch` puts them.
    out
        Write a page with Figures 3-12 and more, and each as CSV, PNG and SVG, to this folder.
    """
    from butterfly.result import document  # noqa: PLC0415 - slow to import
    from butterfly.thesis import figures, invariant_fit, tables  # noqa: PLC0415

    synthetic, real = thesis_robot(), tables.has_real_logs(root)
    rows, drawn = tables.reproduce(synthetic, root), []
    title = "The thesis: published and reproduced values"
    alike = f"{sum(row.agrees for row in rows)} of {len(rows)} published values are reproduced."
    needed = () if real else (_NEEDED,)
    for sentence in (alike, *needed):
        say(sentence)
    compared = tables.compared(rows)
    show_table(title, tables.HEADERS, compared, lead=2)
    for row in rows:
        if row.note:
            say(f"{row.what}: {row.note}")
    if out is not None:
        drawn = figures.synthetic_figures(synthetic)
        drawn += figures.real_figures(root) if real else []
        table_1 = next(row for row in rows if row.published == tables.TABLE_1_PRINTED[1])
        robot, biases = synthetic.rig.robot.lumped, figures.regression_figure(synthetic, table_1)
        drawn += [figures.resonance_figure(robot), biases]
        drawn += [invariant_fit.scale_figure(robot), invariant_fit.cases_figure(robot)]
    for figure in drawn:
        say(f"{figure.title}. {figure.sentence}")
    content = {
        "rows": [{**row._asdict(), "same": row.agrees} for row in rows],
        "figures": [{k: getattr(f, k) for k in ("name", "title", "sentence")} for f in drawn],
    }
    numbers = document("reproduction", title, content, summary=(alike, *needed))
    if out is not None:
        from butterfly.report.page import PageTable  # noqa: PLC0415
        from butterfly.report.thesis_page import write_thesis  # noqa: PLC0415

        table = PageTable(title=title, headers=tables.HEADERS, rows=compared, words=(1, 2))
        notes = [f"{row.what}: {row.note}" for row in rows if row.note]
        say(f"Report: {write_thesis(out, drawn, table, notes, numbers)}")
    write_json(numbers)


def thesis_robot() -> Synthetic:
    """Return the simulated robot and experiment of Tables 1 and 2 and Figures 3 to 8."""
    from butterfly.experiment.source import read_experiment  # noqa: PLC0415
    from butterfly.thesis.tables import Synthetic  # noqa: PLC0415

    experiment = read_experiment(shipped("experiments/thesis/synthetic.yaml"))
    return Synthetic(
        experiment.plant.rig, experiment.added_masses, experiment.excitations, experiment.duration
    )


def schema(
    what: Annotated[Literal["experiment", "manifest"], Parameter(name="FILE")] = "experiment",
    /,
    *,
    out: Annotated[Path | None, OUT, OutputFile((".json",))] = None,
) -> None:
    """Print the JSON Schema of experiment or manifest files.

    Editors then complete the keys of a YAML file that starts with
    `# yaml-language-server: $schema=experiment.schema.json`.

    Parameters
    ----------
    what
        Kind of file to describe.
    out
        File to write. Default: print it.
    """
    from butterfly.experiment.schema import Experiment as ExperimentFile  # noqa: PLC0415 - slow
    from butterfly.logs.manifest import Manifest  # noqa: PLC0415

    model = ExperimentFile if what == "experiment" else Manifest
    text = json.dumps(model.model_json_schema(), indent=2, default=str) + "\n"
    if out is None:
        put(text.rstrip())
        return
    write_file(out, text)
    say(f"Schema: {out}")
