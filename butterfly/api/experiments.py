"""Verbs of experiments: simulate, run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

from butterfly.api.identification import Identification
from butterfly.api.saved import read_saved
from butterfly.api.sources import Named
from butterfly.arguments import checked
from butterfly.errors import ButterflyError, InputError
from butterfly.experiment.perform import RunResult, outcome_of, perform
from butterfly.experiment.record import OK, REFUSED, EstimateRecord, RunRecord
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import data_set_of, file_of, write_logs
from butterfly.experiment.simulate import simulate as simulated_logs
from butterfly.experiment.source import Source, keep_experiment, read_experiment
from butterfly.experiment.store import ResultStore, digests
from butterfly.experiment.sweep import SweepPlan, chosen_of, plan_sweep, run_sweep, sweep_record
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.experiment.workers import DaskEngine, Engine, LocalEngine
from butterfly.files import locate
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimate import Estimate
from butterfly.identification.parameter import Parameter, lumped_numbers
from butterfly.logs.manifest import read_manifest
from butterfly.logs.mat import write_mat
from butterfly.outputs import call
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_notes, estimate_sentences, estimate_verdict
from butterfly.report.format import field_label, fit_text
from butterfly.report.numbers import estimate_numbers
from butterfly.report.orbit_page import degrees_said, orbit_headline, orbit_page
from butterfly.report.page import PageTable, write_page
from butterfly.report.summary import values_table
from butterfly.report.sweep_page import sweep_page
from butterfly.result import Answer
from butterfly.verdict import Level, Verdict

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
        """Return the summary, after its first sentence the note."""
        return [*self.summary[:1], *([self.note] if self.note else []), *self.summary[1:]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Run(_Done):
    """Results of one run: estimates with the true parameters, and its orbit."""

    kind: ClassVar[str] = "run"
    sets_goal: ClassVar[bool] = True  # of an orbit
    table: ClassVar[str] = "estimates"

    identifications: Mapping[str, Identification]
    """By estimator, of a single run; empty for a run of a sweep, which saves estimates only."""

    @classmethod
    def of(
        cls,
        record: RunRecord,
        title: str,
        *,
        identifications: Mapping[str, Identification] = MappingProxyType({}),
        orbit: Mapping[str, Any] | None = None,
        **about: Any,  # noqa: ANN401 - of the experiment
    ) -> Run:
        """Tabulate the record of a run, with its ``identifications`` and ``orbit`` if known."""
        content = json.loads(record.to_json())
        for unsaid in ("schema", "digest", "versions"):
            del content[unsaid]
        notes, estimates = dict[str, Sequence[str]](), list[dict[str, Any]]()
        orbit = content["orbit"] if orbit is None else orbit
        headline = () if record.orbit is None else orbit_headline(record.orbit)
        for entry in record.estimates:
            identification = identifications.get(entry.estimator)
            if identification is not None:
                estimates.append(identification.to_dict())
                lines = identification.paragraphs()
                notes[entry.estimator] = lines if orbit else lines[len(identification.verdict) :]
            elif entry.estimate is not None:
                estimates.append(_numbers(entry, entry.estimate))
                of_estimate = estimate_sentences if orbit else estimate_notes
                notes[entry.estimator] = of_estimate(entry.estimate)
        judged = _verdict(record)
        of_orbit: Sequence[str] = ()
        if orbit and orbit.get("summary"):  # by one run, whose estimators gave the first model
            judged = Verdict.of_numbers(orbit)
            of_orbit = orbit["summary"][len(headline) + len(judged.lines if judged else ()) :]
        several = len([*filter(None, notes.values())]) + bool(of_orbit) > 1
        return cls(
            title=title,
            judged=judged,
            summary=(
                *headline,
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
                "made_with": record.versions,
                "estimates": estimates,
                "refused": [
                    {"estimator": entry.estimator, "error": entry.error}
                    for entry in record.estimates
                    if entry.estimate is None
                ],
                "orbit": orbit,
            },
            units={"seconds": "s", "estimates.fit": "%", "estimates.held_out": "%"},
            identifications=identifications,
        )

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return the result of `to_dict`'s values (see `Answer.from_dict` for what is raised)."""
        results = [
            Identification.from_dict(estimate)
            for estimate in content["estimates"]
            if "fits" in estimate
        ]
        named = {result.estimator: result for result in results}
        return super().from_dict(content, identifications=named, **more)

    def rows(self) -> list[dict[str, Any]]:
        """Return the parameters of each estimate."""
        columns = ("value", "standard_error", "lower", "upper", "unit")
        return [
            {"estimator": estimate["estimator"], "parameter": name}
            | {key: row[key] for key in columns}
            for estimate in self.content["estimates"]
            for name, row in estimate["parameters"].items()
        ]

    def further(self) -> list[PageTable]:
        """Return the tables of an orbit, of each estimate beside the truth, then the settings."""
        about = self.content
        names = ("key", "status", "seed", "error")
        settings = {name: str(about[name]) for name in names if about[name] != ""}
        settings |= {field_label(name): str(value) for name, value in about["overrides"].items()}
        settings |= {f"seconds, {name}": f"{s:.3g}" for name, s in about["seconds"].items()}
        settings |= {f"version, {name}": text for name, text in about["made_with"].items()}
        tables = [PageTable(**table) for table in (about["orbit"] or {}).get("tables", [])]
        alone = bool(self.identifications or tables)
        for estimate in about["estimates"]:
            name, rows = estimate["estimator"], estimate["parameters"].values()
            identification = self.identifications.get(name)
            values = [values_table(name, [Parameter(**row) for row in rows])]
            tables += values if identification is None else identification.tables()
        return [*tables, PageTable("", (), [*settings.items()], detail=alone)]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sweep(_Done):
    """Results of a sweep."""

    kind: ClassVar[str] = "sweep"
    table: ClassVar[str] = "recovery"

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return the result of `to_dict`'s values (see `Answer.from_dict`)."""
        note = f"{content['ok']} runs done, {content['unsuccessful']} failed."
        return super().from_dict(content, **{"note": note, **more})

    @property
    def unsuccessful(self) -> int:
        """Number of runs of the last call without a result."""
        return int(self.content["unsuccessful"])

    def further(self) -> list[PageTable]:
        """Return the tables of its report."""
        return [PageTable(**table) for table in self.content["tables"]]


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
        record = None if force else ResultStore(folder).latest(tasks[0].key)
        if record is not None and record.status == REFUSED:
            raise ButterflyError(record.reason)
        if record is not None and record.status == OK:
            content = read_saved(folder / RESULT)
            note = "This run was already done; --force repeats it."
            return Run.from_dict(content, note=note, reports=_reports(folder, record))
        with call(folder=folder):
            return _run_once(plan, source, folder, jobs=jobs, figures=figures, track=track)
    workers: Engine = LocalEngine(jobs) if engine == "local" else DaskEngine(scheduler, jobs)
    with call(folder=folder):
        keep_experiment(source, folder)
        summary = run_sweep(plan, folder, workers, force=force, only=only, track=track)
        store = ResultStore(folder)
        plain = sweep_page(store.sweep(), store.table(RUNS), store.table(ESTIMATES))
        more = {"unsuccessful": summary.unsuccessful, "tables": plain.tables}
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
    names = keep_experiment(source, folder)
    store.begin_sweep(sweep_record(plan))
    result = perform(experiment, threads=jobs, track=track)
    written = _write_logs(experiment, result, folder)
    outcome = outcome_of(task, experiment, result)
    store.write(outcome)
    record, identified = outcome.record, result.identifications
    truth, reports = experiment.plant.robot.lumped, _reports(folder, record)
    answers = {
        name: Identification.of(identification) for name, identification in identified.items()
    }
    for path, answer in zip(reports, answers.values(), strict=False):
        answer.report(path, figures=figures)
    orbit = None
    if result.orbit is not None:
        carried = result.orbit.calibration.rounds[0].logs[0].added_mass
        page = orbit_page(result.orbit, truth.with_added_mass(carried))
        write_page(page, folder / _ORBIT_REPORT, figures=figures)
        orbit = page.numbers | {"tables": page.tables}
    done = Run.of(
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


def _write_logs(experiment: Experiment, result: RunResult, folder: Path) -> list[str]:
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
