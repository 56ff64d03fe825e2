"""Verbs of experiments: simulate, run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from butterfly.api.identification import Identification
from butterfly.api.sources import Named
from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.perform import RunResult, outcome_of, perform
from butterfly.experiment.record import OK, REFUSED, RunRecord
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import data_set_of, file_of, write_logs
from butterfly.experiment.simulate import simulate as simulated_logs
from butterfly.experiment.source import Source, keep_experiment, read_experiment
from butterfly.experiment.store import ResultStore, digests
from butterfly.experiment.sweep import SweepPlan, chosen_of, plan_sweep, run_sweep, sweep_record
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.experiment.workers import DaskEngine, Engine, LocalEngine
from butterfly.files import locate, write_document
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.parameter import lumped_numbers
from butterfly.logs.manifest import read_manifest
from butterfly.logs.mat import write_mat
from butterfly.model.parameters import LumpedParameters
from butterfly.outputs import call
from butterfly.progress import Track, untracked
from butterfly.report.format import fit_text
from butterfly.report.numbers import NEAR_ORBIT, run_verdict
from butterfly.report.orbit_page import orbit_page
from butterfly.report.page import write_page
from butterfly.report.sweep_page import sweep_page
from butterfly.result import Answer, TextTable, document

RESULT = "result.json"
"""File of a single run's results: what its `to_dict` returns."""

_ORBIT_REPORT = "orbit.html"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class _Done(Answer):
    """Results of an experiment."""

    brief: ClassVar[bool] = True

    note: str = ""
    """What was done and what was done before."""

    reports: tuple[Path, ...] = ()
    """The written reports."""

    def paragraphs(self) -> list[str]:
        """Return the note, then the summary."""
        return [*([self.note] if self.note else []), *self.summary]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Run(_Done):
    """Results of one run: identifications with the true parameters, and its orbit."""

    kind: ClassVar[str] = "run"
    table: ClassVar[str] = "estimates"

    record: RunRecord | None = None
    """The stored record; None for a result that was loaded."""

    identifications: Mapping[str, Identification]
    """By estimator; loaded from the saved files if the run was already done."""

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return the result of `to_dict`'s values (see `Answer.from_dict` for what is raised)."""
        if "identifications" not in more:
            found = map(Identification.from_dict, content["estimates"])
            more["identifications"] = {each.estimator: each for each in found}
        return super().from_dict(content, **more)

    def rows(self) -> list[dict[str, Any]]:
        """Return the parameters of each identification."""
        found = self.identifications.items()
        return [{"estimator": name, **row} for name, each in found for row in each.rows()]

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the parameters of each identification, rounded to their errors."""
        found = self.identifications.items()
        return [{"estimator": name, **row} for name, each in found for row in each.shown_rows()]

    def further(self) -> list[TextTable]:
        """Return the tables of each identification beside the truth, then those of an orbit."""
        true = {name: each["value"] for name, each in self.content["truth"].items()}
        named = (each.tables(LumpedParameters(**true)) for each in self.identifications.values())
        orbit = (self.content["orbit"] or {}).get("tables", [])
        return [*chain(*named), *(TextTable(**each) for each in orbit)]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sweep(_Done):
    """Results of a sweep."""

    kind: ClassVar[str] = "sweep"
    table: ClassVar[str] = "recovery"

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return the result of `to_dict`'s values (see `Answer.from_dict`)."""
        said = f"{content['ok']} runs done, {content['unsuccessful']} failed."
        return super().from_dict(content, **{"note": said, **more})

    @property
    def unsuccessful(self) -> int:
        """Number of runs of the last call without a result."""
        return int(self.content["unsuccessful"])

    def further(self) -> list[TextTable]:
        """Return the tables of its report."""
        return [TextTable(**each) for each in self.content["tables"]]


def simulate(
    experiment: Named | Experiment,
    *,
    out: Named | None = None,
    overwrite: bool = False,
    track: Track = untracked,
) -> DataSet:
    """Simulate an experiment and write its logs.

    The format is that of real logs, which identify reads.

    Parameters
    ----------
    experiment
        An experiment file (YAML), or a shipped experiment's name. Or `read_experiment`'s result.
    out
        Folder for the logs and their manifest.
    overwrite
        Whether to replace existing logs and manifests of the same names.
    track
        Progress callback.
    """
    plan = read_experiment(experiment) if isinstance(experiment, str | PathLike) else experiment
    if not isinstance(plan, Experiment):
        expected = "an experiment: a file, a name, or read_experiment's result"
        raise InputError("simulate", "experiment", type(plan).__name__, expected)
    with call(overwrite=overwrite):
        logs = simulated_logs(plan, track=track)
        if out is not None:
            return read_data_set(read_manifest(write_logs(plan, logs, Path(out))))
    return data_set_of(plan, list(logs))


def run(
    experiment: Named,
    *,
    out: Named | None = None,
    figures: bool = False,
    jobs: int | None = None,
    force: bool = False,
    only: str | None = None,
    engine: Literal["local", "dask"] = "local",
    scheduler: str | None = None,
    track: Track = untracked,
) -> Run | Sweep:
    """Simulate an experiment or a sweep, identify the joint, and write a report.

    Compares true and estimated parameters. Finished runs are reused as long as neither the
    experiment nor butterfly's code has changed. An interrupted or extended sweep resumes where it
    stopped.

    Parameters
    ----------
    experiment
        An experiment file (YAML), or a shipped experiment's name.
    out
        Folder for results and report. Default: ``results/NAME``.
    figures
        Write the report's figures as PNG and SVG too.
    jobs
        Worker processes of a sweep, or threads of a single run. Default: one per core.
    force
        Repeat finished runs.
    only
        Numbers of the runs to do, such as ``0,3,10-19``. Default: all.
    engine
        Where a sweep runs; ``dask`` needs ``butterfly-testbed[dask]``.
    scheduler
        Address of a Dask scheduler, such as tcp://HOST:8786. Default: a local cluster.
    track
        Progress callback.
    """
    if engine not in {"local", "dask"}:
        raise InputError("run", "engine", engine, "local or dask")
    if scheduler is not None and engine != "dask":
        raise InputError("run", "scheduler", scheduler, "engine dask as well (--engine dask)")
    if jobs is not None and jobs < 1:
        raise InputError("run", "jobs", jobs, "a positive number")
    source = Source(locate(Path(experiment)))
    plan = plan_sweep(source, track=track)
    folder = Path("results") / plan.experiment.name if out is None else Path(out)
    tasks = chosen_of(plan.tasks, only)  # what cannot be done leaves nothing behind
    ResultStore(folder).require_own()
    if plan.experiment.sweep is None and engine == "local":
        kept = None if force else ResultStore(folder).latest(tasks[0].key)
        if kept is not None and kept.status == REFUSED:
            raise ButterflyError(kept.reason)
        if kept is not None and kept.status == OK:
            return _kept_run(folder, kept, "This run was already done; --force repeats it.")
        with call(folder=folder):
            return _run_once(plan, source, folder, jobs=jobs, figures=figures, track=track)
    workers: Engine = LocalEngine(jobs) if engine == "local" else DaskEngine(scheduler, jobs)
    with call(folder=folder):
        keep_experiment(source, folder)
        summary = run_sweep(plan, folder, workers, force=force, only=only, track=track)
        store = ResultStore(folder)
        plain = sweep_page(store.sweep(), store.table(RUNS), store.table(ESTIMATES))
        more = {"unsuccessful": summary.unsuccessful, "tables": TextTable.of_page(plain)}
        page = replace(plain, numbers=plain.numbers | more)
        report = folder / "report.html"
        write_page(page, report, figures=figures)
    counts = (
        f"{summary.runs} runs: {summary.done} done now, {summary.reused} already done, "
        f"{summary.unsuccessful} failed."
    )
    return Sweep.from_dict(page.numbers, note=counts, reports=(report,), live=lambda _: page)


def _run_once(
    plan: SweepPlan, source: Source, folder: Path, *, jobs: int | None, figures: bool, track: Track
) -> Run:
    """Do a single run in this process, on all cores, and write its results."""
    store, experiment, (task,) = ResultStore(folder), plan.experiment, plan.tasks
    kept = keep_experiment(source, folder)
    store.begin_sweep(sweep_record(plan))
    result = perform(experiment, threads=jobs, track=track)
    written = _write_logs(experiment, result, folder)
    outcome = outcome_of(task, experiment, result)
    store.write(outcome)
    record, identified = outcome.record, result.identifications
    answers = {name: Identification.of(found) for name, found in identified.items()}
    truth, reports = experiment.plant.robot.lumped, _reports(record)
    for name, found in zip(reports, answers.values(), strict=False):
        found.report(folder / name, truth=truth, figures=figures)
    page = None
    if result.orbit is not None:
        carried = result.orbit.calibration.rounds[0].logs[0].added_mass
        page = orbit_page(result.orbit, truth.with_added_mass(carried))
        write_page(page, folder / _ORBIT_REPORT, figures=figures)
    verdict = run_verdict(record) if answers or page is None else page.verdict
    notes = {name: each.paragraphs()[len(each.verdict) :] for name, each in answers.items()}
    orbit: dict[str, Any] | None = None
    if page is not None:
        orbit = page.numbers | {"tables": TextTable.of_page(page)}
        notes |= {NEAR_ORBIT: orbit["summary"]}
    content = document(
        Run.kind,
        f"Run of {experiment.name!r}",
        {
            "data": {
                "name": experiment.name,
                "description": experiment.description,
                "input": str(experiment.input_kind),
                "logs": record.logs,
            },
            "key": record.key,
            "status": record.status,
            "error": record.error,
            "seed": record.seed,
            "experiment": source.content,
            "truth": lumped_numbers(truth, experiment.input_kind),
            "estimates": [each.to_dict(truth) for each in answers.values()],
            "refused": [
                {"estimator": each.estimator, "error": each.error}
                for each in record.estimates
                if each.estimate is None
            ],
            "orbit": orbit,
            "seconds": record.seconds,
        },
        verdict=verdict,
        summary=(
            *(verdict.lines if verdict else ()),
            *(f"{each.estimator}: {each.error}" for each in record.estimates if each.error),
            *(f"{f'{k}: ' * (len(notes) > 1)}{text}" for k, own in notes.items() for text in own),
            *(
                f"{each.estimator}: held-out logs, median FIT{fit.over} {fit_text(fit.median)} % "
                f"(worst {fit_text(fit.worst)} %)."
                for each in record.estimates
                if (fit := each.held_out) is not None
            ),
        ),
        units={"seconds": "s"},
    )
    write_document(content, folder / RESULT)
    beside = digests(folder, [*kept, RESULT, *written, *reports])
    store.end_sweep(replace(sweep_record(plan), beside=beside))
    if result.error is not None:
        raise result.error
    return _kept_run(folder, record, identifications=answers)


def _kept_run(folder: Path, record: RunRecord, note: str = "", **more: Any) -> Run:  # noqa: ANN401 - fields
    """Return a run from its file, with the identifications given or loaded."""
    content = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    reports = tuple(folder / name for name in _reports(record))
    return Run.from_dict(content, record=record, reports=reports, note=note, **more)


def _write_logs(experiment: Experiment, result: RunResult, folder: Path) -> list[str]:
    """Write logs and their manifest, and those of an orbit; return the names of their files."""
    written = []
    if result.logs:
        manifest = write_logs(experiment, result.logs, folder)
        written += [*map(file_of, result.logs), manifest.name]
    rounds = () if result.orbit is None else result.orbit.calibration.rounds
    for number, each in enumerate(rounds):
        for part, log in enumerate(each.logs):
            written.append(f"round{number}_run{part}.mat")
            write_mat(log, folder / written[-1])
    return written


def _reports(record: RunRecord) -> list[str]:
    """Return the names of the reports of a run: of its estimators in order, and of its orbit."""
    written = sum(bool(estimate.parameters) for estimate in record.estimates)
    names = ["report.html", *(f"report-{number}.html" for number in range(2, written + 1))]
    return names[:written] + [_ORBIT_REPORT] * (record.orbit is not None)
