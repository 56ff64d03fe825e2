"""Commands that run experiments: run, simulate, schema."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from butterfly.cli.console import say, show_page
from butterfly.cli.exit_codes import ExitCode, end_with
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.loudness import print_document
from butterfly.cli.options import (
    ExperimentArgument,
    FiguresOption,
    ResultsOption,
)
from butterfly.cli.show_identification import show_estimates, show_identification, show_record
from butterfly.cli.show_progress import show_progress
from butterfly.document import write_document
from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.columns import ESTIMATES, RUNS
from butterfly.experiment.perform import outcome_of, perform
from butterfly.experiment.record import FAILED, OK
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulation import file_of, simulate, write_logs
from butterfly.experiment.source import Source, keep_experiment, read_experiment
from butterfly.experiment.store import ResultStore, digests
from butterfly.experiment.sweep import chosen_of, plan_sweep, run_sweep, sweep_record
from butterfly.experiment.workers import DaskEngine, LocalEngine
from butterfly.files import locate, replacing
from butterfly.logs.manifest import Manifest
from butterfly.report.identification_page import write_report
from butterfly.report.numbers.record_numbers import told_run
from butterfly.report.orbit_page import orbit_page
from butterfly.report.page import write_page
from butterfly.report.sweep_page import sweep_page

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pydantic import BaseModel

    from butterfly.experiment.record import RunRecord
    from butterfly.experiment.sweep import SweepPlan
    from butterfly.experiment.workers import Engine
    from butterfly.logs.log import Log

_ORBIT_REPORT = "orbit.html"
RESULT = "result.json"
"""File of a single run's results: what --json tells."""


class EngineName(StrEnum):
    """Where the runs of a sweep are done."""

    LOCAL = "local"
    DASK = "dask"


class SchemaName(StrEnum):
    """Files that have a schema."""

    EXPERIMENT = "experiment"
    MANIFEST = "manifest"


_SCHEMAS: dict[SchemaName, type[BaseModel]] = {
    SchemaName.EXPERIMENT: Experiment,
    SchemaName.MANIFEST: Manifest,
}


@answers_in_json("run")
def run_command(
    *,
    experiment: ExperimentArgument,
    out: ResultsOption = None,
    figures: FiguresOption = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Worker processes of a sweep, or threads of a single run; one per core if not "
            "given.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Do runs again that are done.")] = False,
    only: Annotated[
        str | None,
        typer.Option(help="Runs of a sweep to do, by number: 0,3,10-19.", show_default="all"),
    ] = None,
    engine: Annotated[
        EngineName, typer.Option(help="Where a sweep runs; dask needs the extra of that name.")
    ] = EngineName.LOCAL,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler, as tcp://HOST:8786.",
            show_default="a cluster on this machine",
        ),
    ] = None,
    answer: JsonAnswer,
) -> None:
    """Simulate an experiment, identify the robot from its logs, and write a report.

    Prints the true parameters beside the estimated ones, for each estimator.

    An experiment with `sweep:` is run for each of its variations. Results are kept by what they
    depend on, the code of butterfly included: run again after a kill, or after the sweep has grown,
    and only what is missing is done. Exit code 1 says that some runs gave no result; the report
    says which, and why. Of an experiment without `sweep:`, exit code 3 says that an estimate is not
    to be used.

    Example: `butterfly run experiments/quickstart.yaml`
    """
    if scheduler is not None and engine is not EngineName.DASK:
        raise InputError("butterfly run", "--scheduler", scheduler, "--engine dask beside it")
    source = Source(locate(experiment))
    plan = plan_sweep(source)
    folder = out or Path("results") / plan.experiment.name
    if plan.experiment.sweep is None and engine is EngineName.LOCAL:
        asked = _Asked(plan, source, folder, answer)
        _run_here(asked, jobs=jobs, force=force, only=only, figures=figures)
        return
    chosen: Engine = LocalEngine(jobs)
    if engine is EngineName.DASK:
        chosen = DaskEngine(scheduler, jobs)
    chosen_of(plan.tasks, only)  # what cannot be done leaves nothing behind
    keep_experiment(source, folder)
    summary = run_sweep(plan, folder, chosen, force=force, only=only, track=show_progress)
    store = ResultStore(folder)
    page = sweep_page(store.sweep(), store.table(RUNS), store.table(ESTIMATES))
    write_page(page, folder / "report.html", figures=figures)
    show_page(page)
    say(
        f"{summary.runs} runs: {summary.done} done now, {summary.reused} found done, "
        f"{summary.unsuccessful} without a result."
    )
    typer.echo(f"Report: {folder / 'report.html'}")
    answer.write(page.numbers)
    if summary.unsuccessful:
        raise typer.Exit(ExitCode.NO_RESULT)


@dataclass(frozen=True)
class _Asked:
    """A single run that is asked for, and where it and its answer go."""

    plan: SweepPlan
    source: Source
    folder: Path
    answer: JsonAnswer


def _run_here(
    asked: _Asked,
    *,
    jobs: int | None,
    force: bool,
    only: str | None,
    figures: bool,
) -> None:
    """Do an experiment's one run in this process, with all cores, and report all of it."""
    plan, folder = asked.plan, asked.folder
    (task,) = chosen_of(plan.tasks, only)
    store, experiment = ResultStore(folder), plan.experiment
    _warn_of_wide_swings(experiment)
    record = None if force else store.latest(task.key)
    if record is not None and record.status != FAILED:
        show_record(record)
        say("1 run: found done; --force does it again.")
        _show_reports(folder, record)
        if record.status != OK:
            raise ButterflyError(record.reason)
        if asked.answer.wanted:
            asked.answer.write(json.loads((folder / RESULT).read_text(encoding="utf-8")))
        end_with(record.level)
        return
    kept = keep_experiment(asked.source, folder)
    store.begin()
    result = perform(experiment, threads=jobs, track=show_progress)
    logs = _written(experiment, result.logs, folder)
    outcome = outcome_of(task, experiment, result)
    store.write(outcome)
    truth = experiment.plant.robot.lumped
    for name, identification in zip(_report_names(), result.identifications.values(), strict=False):
        show_identification(identification, truth)
        write_report(identification, folder / name, truth, figures=figures)
    if result.orbit is not None:
        carried = result.orbit.calibration.rounds[0].logs[0].added_mass
        page = orbit_page(result.orbit, truth.with_added_mass(carried))
        show_page(page)
        write_page(page, folder / _ORBIT_REPORT, figures=figures)
    show_estimates(result.record)
    result = replace(result, record=outcome.record)
    told = told_run(experiment, asked.source.content, result).document()
    write_document(told, folder / RESULT)
    beside = digests(folder, [*kept, RESULT, *logs, *_reports(result.record)])
    sweep = replace(sweep_record(plan), beside=beside)
    store.end_sweep(sweep)
    _show_reports(folder, result.record)
    if result.error is not None:
        raise result.error
    asked.answer.write(told)
    end_with(result.record.level)


def _report_names() -> Iterator[str]:
    """Yield the names of the reports of an experiment's estimators, in order."""
    yield "report.html"
    yield from (f"report-{number}.html" for number in count(2))


def _written(experiment: Experiment, logs: Sequence[Log], folder: Path) -> list[str]:
    """Write logs and their manifest; return the names of their files."""
    if not logs:
        return []
    manifest = write_logs(experiment, logs, folder)
    return [*map(file_of, logs), manifest.name]


def _reports(record: RunRecord) -> list[str]:
    """Return the names of the reports of a run."""
    written = sum(bool(estimate.parameters) for estimate in record.estimates)
    names = list(islice(_report_names(), written))
    return names if record.orbit is None else [*names, _ORBIT_REPORT]


def _show_reports(folder: Path, record: RunRecord) -> None:
    for name in _reports(record):
        typer.echo(f"Report: {folder / name}")


def schema_command(
    what: Annotated[SchemaName, typer.Argument(help="Which file.")] = SchemaName.EXPERIMENT,
    out: Annotated[
        Path | None, typer.Option(help="Write it to this file.", show_default="print")
    ] = None,
) -> None:
    """Print the JSON Schema of experiment or manifest files, for editors.

    With `# yaml-language-server: $schema=experiment.schema.json` as the first line of a YAML file,
    editors complete its keys and mark slips.
    """
    text = json.dumps(_SCHEMAS[what].model_json_schema(), indent=2, default=str)
    if out is None:
        print_document(text + "\n")
        return
    with replacing(out) as draft:
        draft.write_text(text + "\n", encoding="utf-8")
    typer.echo(f"Schema: {out}")


def simulate_command(
    experiment: ExperimentArgument,
    out: Annotated[Path, typer.Option(help="Folder for the logs and their manifest.")],
) -> None:
    """Simulate an experiment in MuJoCo and write its logs.

    The logs have the form of the real ones (.mat with a matrix D of columns t, u, q, dq), so that
    `butterfly identify OUT` treats them alike.
    """
    plan = read_experiment(locate(experiment))
    _warn_of_wide_swings(plan)
    manifest = write_logs(plan, simulate(plan, track=show_progress), out)
    typer.echo(f"Logs: {manifest}")


def _warn_of_wide_swings(plan: Experiment) -> None:
    for added, sine, swing in plan.wide_swings():
        typer.secho(
            f"warning: {added}, {sine.omega:g} rad/s: predicted to swing {swing:.2g} rad; "
            "a smaller amplitude keeps to small angles",
            fg="yellow",
            err=True,
        )
