"""Verbs of experiments: simulate, run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from butterfly.api.identification import Identification
from butterfly.api.saved import answer_of, read_saved
from butterfly.api.sources import Named
from butterfly.arguments import checked
from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.record import OK, REFUSED, EstimateRecord, Outcome, RunRecord
from butterfly.experiment.run import data_set_of, file_of, perform, write_logs
from butterfly.experiment.run import simulate as simulated_logs
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source, keep_experiment, read_experiment
from butterfly.experiment.store import ResultStore, digests
from butterfly.experiment.sweep import (
    DaskEngine,
    Engine,
    LocalEngine,
    SweepPlan,
    chosen_of,
    plan_sweep,
    run_sweep,
    sweep_record,
)
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.files import locate
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimate import Estimate
from butterfly.identification.trust import lumped_numbers
from butterfly.logs.manifest import read_manifest
from butterfly.logs.mat import write_mat
from butterfly.outputs import call
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_sentences, estimate_verdict
from butterfly.report.format import field_label, fit_text
from butterfly.report.numbers import estimate_numbers
from butterfly.report.orbit_page import degrees_said, orbit_headline, orbit_page
from butterfly.report.page import Page, PageTable, views, write_page
from butterfly.report.parameter_table import values_table
from butterfly.report.sweep_page import runs_table, sweep_page
from butterfly.result import Answer
from butterfly.verdict import Level, Verdict

RESULT = "result.json"
"""File of a single run's results: what its `to_dict` returns."""

_ORBIT_REPORT = "orbit.html"


def run_answer(
    record: RunRecord,
    title: str,
    *,
    identifications: Mapping[str, Identification] = MappingProxyType({}),
    orbit: Page | None = None,
    **about: Any,  # noqa: ANN401 - of the experiment
) -> Answer:
    """Tabulate the record of a run: its estimates beside the true parameters, and its orbit.

    ``identifications`` and the page of the ``orbit`` are known of a single run; a run of a sweep
    saves its estimates alone.
    """
    content, held = json.loads(record.to_json()), record.orbit is not None
    for unsaid in ("schema", "digest", "versions"):
        del content[unsaid]
    judged, of_orbit, shown = _verdict(record), list[str](), list[PageTable]()
    if orbit is not None:
        judged, of_orbit, shown = orbit.verdict, [*orbit.summary], orbit.tables
        content["orbit"] = orbit.numbers | {"tables": [table.plain() for table in shown]}
    alone = bool(identifications or shown)
    notes, estimates = dict[str, list[str]](), list[dict[str, Any]]()
    for entry in record.estimates:
        if entry.estimate is None:
            continue
        identification = identifications.get(entry.estimator)
        if identification is None:
            estimates.append(_numbers(entry, entry.estimate))
            shown.append(values_table(entry.estimator, entry.parameters))
            sentences = estimate_sentences(entry.estimate)
        else:
            estimates.append(identification.to_dict())
            shown += identification.tables()
            sentences = identification.paragraphs()
        lines = () if held else estimate_verdict(entry.estimate).lines  # they are the run's
        notes[entry.estimator] = [text for text in sentences if text not in lines]
    several = len([*filter(None, notes.values())]) + bool(of_orbit) > 1
    columns = ("value", "standard_error", "lower", "upper", "unit")
    rows = [
        {"estimator": estimate["estimator"], "parameter": name} | {key: row[key] for key in columns}
        for estimate in estimates
        for name, row in estimate["parameters"].items()
    ]
    content |= {"made_with": record.versions, "estimates": estimates, "rows": rows}
    settings = PageTable("", (), _settings(content), detail=alone)
    values = [PageTable.of(title, rows, detail=True)] if rows else []
    return Answer(
        kind="run",
        title=title,
        judged=judged,
        summary=(
            *(() if record.orbit is None else orbit_headline(record.orbit)),
            *(judged.lines if judged else ()),
            *of_orbit,
            *(f"{entry.estimator}: {entry.error}" for entry in record.estimates if entry.error),
            *(
                f"{name}: " * several + text
                for name, sentences in notes.items()
                for text in sentences
            ),
            *(
                f"{entry.estimator}: held-out logs, median FIT{fit.over} "
                f"{fit_text(fit.median)} % (worst {fit_text(fit.worst)} %)."
                for entry in record.estimates
                if (fit := entry.held_out) is not None
            ),
        ),
        content={
            **about,
            **content,
            "refused": [
                {"estimator": entry.estimator, "error": entry.error}
                for entry in record.estimates
                if entry.estimate is None
            ],
            **views([*values, *shown, settings]),
        },
        units={"seconds": "s", "estimates.fit": "%", "estimates.held_out": "%"},
        identifications=identifications,
    )


def _settings(run: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the settings, times and versions of a run, as pairs of texts."""
    names = ("key", "status", "seed", "error")
    pairs = {name: str(run[name]) for name in names if run[name] != ""}
    pairs |= {field_label(name): str(value) for name, value in run["overrides"].items()}
    pairs |= {f"seconds, {name}": f"{s:.3g}" for name, s in run["seconds"].items()}
    pairs |= {f"version, {name}": text for name, text in run["made_with"].items()}
    return [*pairs.items()]


@checked
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


@checked
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
) -> Answer:
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
        record = None if force else ResultStore(folder).latest(tasks[0].key)
        if record is not None and record.status == REFUSED:
            raise ButterflyError(record.reason)
        if record is not None and record.status == OK:
            note = "This run was already done; --force repeats it."
            return answer_of(
                read_saved(folder / RESULT), note=note, reports=_reports(folder, record)
            )
        with call(folder=folder):
            return _run_once(plan, source, folder, jobs=jobs, figures=figures, track=track)
    workers: Engine = LocalEngine(jobs) if engine == "local" else DaskEngine(scheduler, jobs)
    with call(folder=folder):
        keep_experiment(source, folder)
        summary = run_sweep(plan, folder, workers, force=force, only=only, track=track)
        counts = (
            f"{summary.runs} runs: {summary.done} done now, {summary.reused} already done, "
            f"{summary.unsuccessful} failed."
        )
        report, store = folder / "report.html", ResultStore(folder)
        answer = sweep_answer(store, summary.unsuccessful, note=counts, reports=(report,))
        answer.report(report, figures=figures)
    return answer


def sweep_answer(
    store: ResultStore,
    unsuccessful: int = 0,
    **about: Any,  # noqa: ANN401 - not saved
) -> Answer:
    """Tabulate a sweep; ``unsuccessful``: number of runs that were asked for and have no result."""
    sweep, tables = store.sweep(), store.tables()
    plain = sweep_page(sweep, tables[RUNS], tables[ESTIMATES])
    recovery, runs = plain.numbers["recovery"], runs_table(tables[RUNS], sweep.fields)
    rows = [PageTable.of(plain.numbers["title"], recovery, detail=True)] if recovery else []
    shown = views([*rows, *plain.tables, runs], plain.facts)
    page = replace(plain, numbers=plain.numbers | {"unsuccessful": unsuccessful, **shown})
    return answer_of(page.numbers, live=lambda _: page, **about)


def _run_once(
    plan: SweepPlan, source: Source, folder: Path, *, jobs: int | None, figures: bool, track: Track
) -> Answer:
    """Do a single run in this process, on all cores, and write its results."""
    store, experiment, (task,) = ResultStore(folder), plan.experiment, plan.tasks
    names = keep_experiment(source, folder)
    store.begin_sweep(sweep_record(plan))
    result = perform(experiment, task=task, threads=jobs, track=track)
    written = _write_logs(experiment, result, folder)
    store.write(result)
    record, identified = result.record, result.identifications
    truth, reports = experiment.plant.robot.lumped, _reports(folder, record)
    answers = {
        name: Identification.of(identification) for name, identification in identified.items()
    }
    for path, answer in zip(reports, answers.values(), strict=False):
        answer.report(path, figures=figures)
    orbit = None
    if result.orbit is not None:
        carried = result.orbit.calibration.rounds[0].logs[0].added_mass
        orbit = orbit_page(result.orbit, truth.with_added_mass(carried))
        write_page(orbit, folder / _ORBIT_REPORT, figures=figures)
    done = run_answer(
        record,
        f"Run of {experiment.name!r}",
        identifications=answers,
        orbit=orbit,
        data={
            "name": experiment.name,
            "description": experiment.description,
            "input": str(experiment.input_kind),
            "logs": record.logs,
        },
        experiment=source.content,
        truth=lumped_numbers(truth, experiment.input_kind),
    )
    done.save(folder / RESULT)
    hashes = digests(folder, [*names, RESULT, *written, *(path.name for path in reports)])
    store.end_sweep(replace(sweep_record(plan), output_digests=hashes))
    if result.error is not None:
        raise result.error
    return replace(done, reports=reports)


def _write_logs(experiment: Experiment, result: Outcome, folder: Path) -> list[str]:
    """Write logs and their manifest, and those of an orbit; return the names of their files."""
    written = []
    if result.logs:
        manifest = write_logs(experiment, result.logs, folder)
        written += [*map(file_of, result.logs), manifest.name]
    study = result.orbit
    held = {} if study is None else {"": study.calibration, "also_": study.also}
    for prefix, calibration in held.items():
        for number, iteration in enumerate(calibration.rounds if calibration else ()):
            for part, log in enumerate(iteration.logs):
                written.append(f"{prefix}round{number}_run{part}.mat")
                write_mat(log, folder / written[-1])
    return written


def _reports(folder: Path, record: RunRecord) -> tuple[Path, ...]:
    """Return the paths of the reports of a run: of its estimators in order, and of its orbit."""
    written = sum(bool(estimate.parameters) for estimate in record.estimates)
    names = ["report.html", *(f"report-{number}.html" for number in range(2, written + 1))]
    names = names[:written] + [_ORBIT_REPORT] * (record.orbit is not None)
    return tuple(folder / name for name in names)


def _verdict(record: RunRecord) -> Verdict | None:
    """Return the verdict near a run's orbit, or the worst on its estimates; None without one."""
    if record.orbit is not None and record.orbit.verdict is not None:
        errors = record.orbit.free_run_rms_rad
        reason = ", ".join(f"{degrees_said(rms)}° {name}" for name, rms in errors.items())
        text = f"error of a free run near the orbit, by its model: {reason}."
        return Verdict(Level.of_verdict(record.orbit.verdict), (text,))
    verdicts = {e.estimator: estimate_verdict(e.estimate) for e in record.estimates if e.estimate}
    if len(verdicts) == 1:
        return next(iter(verdicts.values()))
    return Verdict.of_several(verdicts) if verdicts else None


def _numbers(record: EstimateRecord, estimate: Estimate) -> dict[str, Any]:
    """Return the estimate of a record, and the FITs that are kept with it."""
    fits = {name: getattr(record, name) for name in ("fit", "held_out", "holdout")}
    return {
        "estimator": record.estimator,
        **estimate_verdict(estimate).numbers(),
        **estimate_numbers(estimate, record.truth),
        **{name: fit and fit.numbers() for name, fit in fits.items()},
    }
