"""Commands beside the verbs: manifest, fetch, reproduce, schema; show, export."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

import butterfly as bf
from butterfly.cli.options import OUT, SILENT, WRITTEN, DataOptions, Facts, HandMass, OutFolder
from butterfly.cli.output import (
    ExitCode,
    OutputFile,
    asked,
    put,
    say,
    say_verdict,
    show_progress,
    show_table,
    write_json,
)
from butterfly.errors import InputError
from butterfly.files import shipped, write_file
from butterfly.twin.forms import DEFAULTS, FORMS, INTEGRATORS, WITH_A_BODY, Options
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from butterfly.experiment.schema import Experiment
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
    from butterfly.api.joint_models import with_joints  # noqa: PLC0415 - slow to import
    from butterfly.logs import reading as drafts  # noqa: PLC0415
    from butterfly.logs.manifest import MANIFEST_NAME, checked_options  # noqa: PLC0415

    path = out or (folder.parent if folder.is_file() else folder) / MANIFEST_NAME
    named = not folder.is_file() and drafts.has_thesis_names(folder)
    if named and options.arm is None:
        raise InputError(folder, "--arm", "missing", "m from pivot to the masses in the file names")
    description = options.description()
    if options.model is not None:
        logs = options.root or (folder if folder.is_dir() else folder.parent)
        description["model"] = os.path.relpath(options.model.resolve(), logs.resolve())
    if options.names_joints:
        del description["of"]  # of each log
    given = checked_options(description)
    drafted = drafts.draft(folder, given)
    if options.model is not None:
        drafted = with_joints(drafted, given_input="input" in given)
    if not all(entry.of for entry in drafted.logs):
        drafted = drafts.with_columns(drafted, given)
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
    from butterfly.thesis import figures, tables  # noqa: PLC0415

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
        drawn += [figures.scale_figure(robot), figures.cases_figure(robot)]
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


AddedMass = Annotated[float, Parameter(metavar="kg")]
Arm = Annotated[
    float | None, Parameter(metavar="m", help="Distance from pivot to added mass. Default: 0.104.")
]
_FILMS = (".gif", ".mp4", ".webp")
_PICTURES = (".png", ".jpg", ".jpeg")


def show(
    source: Path,
    /,
    *,
    run: Annotated[int, Parameter(metavar="N", validator=Number(gte=0))] = 0,
    web: bool = False,
    port: Annotated[int, Parameter(metavar="N", validator=Number(gte=0, lte=65535))] = 0,
    out: Annotated[Path | None, OUT, OutputFile((*_FILMS, *_PICTURES))] = None,
    angle: Annotated[float | None, Parameter(metavar="rad", allow_leading_hyphen=True)] = None,
    seconds: Annotated[float, Parameter(metavar="s", validator=Number(gte=0.1))] = 8.0,
    fps: Annotated[int, Parameter(metavar="N", validator=Number(gte=1, lte=120))] = 25,
    size: Annotated[int, Parameter(metavar="N", validator=Number(gte=16, lte=4096))] = 480,
    added_mass: AddedMass = 0.0,
    arm: Arm = None,
    log: Annotated[int | None, Parameter(metavar="N", validator=Number(gte=0))] = None,
) -> ExitCode:
    """Watch a run, or save it as a film or picture.

    Opens a window, or with --web a browser page. --out saves a film of an experiment's run, of a
    saved result's log, or a picture. Films and pictures need no display if EGL is installed.

    Parameters
    ----------
    source
        An experiment file or name. For a picture also a saved result, a manifest or logs.
    run
        Number of the experiment's run, from 0.
    web
        Watch in a browser on this machine.
    port
        Port for --web; 0 picks a free one.
    out
        File to write. Film: .mp4 (needs butterfly-testbed[video]), .gif, .webp. Picture: .png,
        .jpg, .webp.
    angle
        Draw a picture at this angle. Default: 0.5.
    seconds
        Length of the film; at most the run's.
    fps
        Frames per second of the film.
    size
        Width and height in pixels; even for .mp4.
    added_mass
        Added mass in a picture, at --arm.
    log
        Number of a saved result's log, from 0: measured solid, simulated as a ghost. A picture
        shows the instant of the largest error.
    """
    from butterfly.api.sources import is_data  # noqa: PLC0415 - slow to import
    from butterfly.files import locate  # noqa: PLC0415

    data = is_data(locate(source))
    if log is not None:
        return _show_log(source, log, out, seconds, fps=fps, size=size)
    if out is None:
        if data:
            expected = "a picture file with --out (only an experiment has runs to watch)"
            raise InputError(source, "--out", "missing", expected)
        from butterfly.plant.watch.live import LiveRun, watch  # noqa: PLC0415 - slow to import

        plan = _with_run(source, run)
        shown = LiveRun(plan.plant.rig, *plan.runs()[run], plan.duration, plan.seeds()[run])
        with suppress(KeyboardInterrupt):
            watch(shown, web=web, port=port)
    elif data or angle is not None or out.suffix.lower() not in _FILMS:
        from butterfly.api.inspected import robot_of  # noqa: PLC0415 - slow to import
        from butterfly.plant.watch.picture import render  # noqa: PLC0415

        named = robot_of(source, hand_mass=None, added_mass=added_mass, arm=arm)
        if named.judged is not None:
            say_verdict(named.judged)
        render(*named.twin.built, 0.5 if angle is None else angle, out, size)
        say(f"Picture: {out}")
        return ExitCode.of(named.judged)
    else:
        _film(source, run, out, seconds, fps=fps, size=size)
    return ExitCode.DONE


def _show_log(
    source: Path, number: int, out: Path | None, seconds: float, *, fps: int, size: int
) -> ExitCode:
    """Draw a saved result's log, measured, and its free run, as a ghost."""
    from butterfly.api.verbs import saved_identification  # noqa: PLC0415 - slow to import
    from butterfly.files import locate  # noqa: PLC0415
    from butterfly.plant.watch.picture import film, render  # noqa: PLC0415

    result = saved_identification(locate(source))
    if result is None:
        raise InputError(source, "--log", number, "a saved result (butterfly identify --save)")
    if out is None:
        raise InputError(source, "--out", "missing", "a file for the film or picture of a log")
    runs = result.free_runs
    if number >= len(runs):
        raise InputError(source, "--log", number, f"a number from 0 to {len(runs) - 1}")
    run = runs[number]
    if run.log.measures != "angle":
        raise InputError(run.log.name, "angle", "missing", "a log with a measured angle to draw")
    if result.judged is not None:
        say_verdict(result.judged)
    robot, added = result.model.twin(run.log.added_mass).built
    time, angle, simulated = run.log.time, run.log.angle, run.simulated
    if out.suffix.lower() in _FILMS:
        shown = time <= time[0] + seconds
        motion, ghost = (time[shown] - time[0], angle[shown], out), simulated[shown]
        film(robot, added, *motion, fps=fps, size=size, simulated=ghost, track=show_progress)
        say(f"Film: {out}")
    else:
        worst = int(abs(simulated - angle).argmax())
        render(robot, added, angle[worst], out, size, ghost=simulated[worst])
        say(f"Picture: {out}")
    return ExitCode.of(result.judged)


def _film(source: Path, number: int, out: Path, seconds: float, *, fps: int, size: int) -> None:
    from butterfly.plant.rollout import simulate_runs  # noqa: PLC0415 - slow to import
    from butterfly.plant.watch.picture import film  # noqa: PLC0415

    plan = _with_run(source, number)
    run, seed = plan.runs()[number], plan.seeds()[number]
    (log,) = simulate_runs(plan.plant.rig, [run], plan.duration, [seed])
    shown = log.take(log.time <= log.time[0] + seconds)
    robot, carried, motion = plan.plant.robot, log.added_mass, (shown.time, shown.angle)
    film(robot, carried, *motion, out, fps=fps, size=size, track=show_progress)
    say(f"Film: {out}")


def _with_run(source: Path, number: int) -> Experiment:
    """Return an experiment that has a run of this number."""
    plan = bf.read_experiment(source)
    last = len(plan.runs()) - 1
    if number > last:
        raise InputError(source, "--run", number, f"a number from 0 to {last}")
    return plan


_TWINS = tuple(sorted({ending for _, *endings in FORMS.values() for ending in endings}))
_Form: Any = Literal[tuple(FORMS)]
_Integrator: Any = Literal[INTEGRATORS]


def export(
    source: Path,
    /,
    *more: Annotated[Path, Parameter(show=False)],
    out: Annotated[Path, OUT, OutputFile(_TWINS, copies="into")],
    into: Annotated[Path | None, Parameter(group=WRITTEN, metavar="FILE")] = None,
    to: Annotated[_Form, Parameter(group=WRITTEN)] = "mjcf",
    timestep: Annotated[
        float, Parameter(group=WRITTEN, metavar="s", validator=Number(gte=1e-6, lte=0.1))
    ] = DEFAULTS.timestep,
    integrator: Annotated[_Integrator, Parameter(group=WRITTEN)] = DEFAULTS.integrator,
    actuator: Annotated[str | None, Parameter(group=WRITTEN, metavar="NAME")] = None,
    hand_mass: HandMass = None,
    added_mass: AddedMass = 0.0,
    arm: Arm = None,
) -> ExitCode:
    """Export the identified joint (its twin) to MuJoCo, URDF, C and others, or into your own model.

    Says whether the file can be used, what the format cannot represent, and how far the twin's
    motion is from our own simulation at the given time step; of a compensation, how far its command
    may be off.

    Parameters
    ----------
    source
        A saved result; an experiment file or name; or logs, to identify first.
    out
        File to write.
    into
        Your robot's own MJCF or URDF: a copy of it is written in which only attributes of the
        identified joint change. Several results, one a joint, may be given at once.
    to
        Format: MuJoCo model (mjcf), lines to paste into your MJCF (snippet), URDF (urdf), actuator
        settings for mjlab and Isaac Lab (actuator), ranges to randomise in (randomisation; several
        results are units of a product), a C99 header (c), JSON for BAM (bam), the command that
        cancels gravity and friction in C or Python (compensation), or gains of WPILib as JSON
        (wpilib).
    timestep
        Time step of your simulator.
    integrator
        MuJoCo integrator: RK4 is more accurate, implicitfast is common in learning frameworks.
    actuator
        BAM's name of the servo, such as xl330. Default: from the servo's law.
    added_mass
        Added mass, at --arm.
    """
    from butterfly.api.inspected import robot_of  # noqa: PLC0415 - slow to import
    from butterfly.api.sources import is_data  # noqa: PLC0415
    from butterfly.files import locate  # noqa: PLC0415
    from butterfly.twin.forms import write_twin  # noqa: PLC0415

    if into is not None:
        return _export_into([source, *more], into, out)
    if more and to != "randomisation":
        expected = "one result; or --into FILE for joints of a model, --to randomisation for units"
        raise InputError("export", "source", f"{len(more) + 1} results", expected)
    if actuator and to != "bam":
        raise InputError("export", "--actuator", actuator, "--to bam as well")
    carried: dict[str, Any] = {"hand_mass": hand_mass, "added_mass": added_mass, "arm": arm}
    named, *others = (robot_of(path, **carried) for path in (source, *more))
    verdicts = {
        str(path): robot.judged
        for path, robot in zip((source, *more), (named, *others), strict=True)
        if robot.judged is not None
    }
    verdict = Verdict.of_several(verdicts) if len(verdicts) > 1 else named.judged
    options = Options(
        timestep=timestep,
        integrator=integrator,
        actuator=actuator,
        units=tuple(unit.twin for unit in others),
    )
    made = write_twin(to, named.twin, options, out)
    load = f", with {named.twin.added}" if added_mass and to != "bam" else ""
    say(f"{made.title}: {out}, {made.about}{load}. {_use(verdict, made.left_out)}")
    if verdict is not None:
        say_verdict(verdict)
    accuracy = (made.accuracy.sentence,) if made.accuracy else ()
    for sentence in (*made.notes, *made.left_out, *accuracy):
        say(sentence)
    if named.note and to in WITH_A_BODY:
        say(named.note)
    if not asked.silent and not more and is_data(locate(source)):
        put(f"Next: butterfly compare {shlex.quote(str(source))}")
    return ExitCode.of(verdict)


def _use(verdict: Verdict | None, limits: Sequence[str]) -> str:
    """Say whether a written model can be used; ``limits``: what it lacks, which is said below."""
    if verdict is not None and verdict.level is not Level.GOOD:
        return f"{verdict.level.verdict.capitalize()}."
    return "Ready to use, within the limits below." if limits else "Ready to use."


def _export_into(sources: Sequence[Path], into: Path, out: Path) -> ExitCode:
    """Write saved results into a copy of a robot's own model."""
    from butterfly.api.verbs import saved_identification  # noqa: PLC0415 - slow to import
    from butterfly.files import locate  # noqa: PLC0415
    from butterfly.report.format import counted  # noqa: PLC0415

    results = []
    for source in sources:
        result = saved_identification(locate(source))
        if result is None:
            expected = "a saved result (butterfly identify --model --of --save)"
            raise InputError(source, "--into", into, expected)
        results.append(result)
    first, *others = results
    verdicts = {str(result.origin["manifest"]["of"]): result.judged for result in results}
    verdict = Verdict.of_several(verdicts) if others else first.judged
    written = first.write_back(into, out, others=others)
    count, use = len(written.changes), _use(verdict, written.not_found)
    say(f"{out}: {counted(count, 'attribute')} of {into} changed, nothing else. {use}")
    say_verdict(verdict)
    for sentence in written.sentences:
        say(sentence)
    return ExitCode.of(verdict)
