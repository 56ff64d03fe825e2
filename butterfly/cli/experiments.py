"""Commands of experiments: run, simulate, predict, reproduce, schema."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

import butterfly as bf
from butterfly.cli.options import NO_REPORT, WRITTEN, Data, Experiment, Out, Report, parse_pairs
from butterfly.cli.output import ExitCode, say, show, show_progress, show_table, warn, write_json
from butterfly.errors import InputError
from butterfly.files import replacing, shipped

if TYPE_CHECKING:
    from butterfly.thesis.tables import Synthetic


def run(
    experiment: Experiment,
    /,
    *,
    out: Out = None,
    figures: Annotated[bool, Parameter(group=WRITTEN)] = False,
    jobs: Annotated[int | None, Parameter(metavar="N")] = None,
    force: bool = False,
    only: Annotated[str | None, Parameter(metavar="NUMBERS")] = None,
    engine: Literal["local", "dask"] = "local",
    scheduler: Annotated[str | None, Parameter(metavar="ADDRESS")] = None,
) -> ExitCode:
    """Simulate an experiment, identify the robot from its logs, and write a report.

    Prints the true parameters beside the estimated ones, for each estimator. An experiment with
    `control:` holds its orbit, re-calibrates the model next to it, and holds it better.

    An experiment with `sweep:` is run for each of its variations. Results are kept by what they
    depend on, the code of butterfly included: run again after a kill, Ctrl-C, or after the sweep
    has grown, and only what is missing is done. It has no end but that of its runs, and tells about
    how long they take; --budget ends the search of each run, and a larger one, or none, goes on
    with those that it stopped. Exit code 1 says that some runs gave no result; the report
    says which, and why. Of an experiment without `sweep:`, exit code 3 says that an estimate is not
    to be used.

    Example: butterfly run experiments/quickstart.yaml

    Parameters
    ----------
    out
        Folder for results and report; results/NAME if not given.
    figures
        Write the reports' figures as PNG and SVG too.
    jobs
        Worker processes of a sweep, or threads of a single run; one per core if not given.
    force
        Do runs again that are done.
    only
        Runs of a sweep to do, by number: 0,3,10-19; all if not given.
    engine
        Where a sweep runs; dask needs the extra of that name.
    scheduler
        Address of a Dask scheduler, as tcp://HOST:8786; a cluster on this machine if not given.
    """
    _warn_of_wide_swings(experiment)
    found = bf.run(
        experiment,
        out=out,
        figures=figures,
        jobs=jobs,
        force=force,
        only=only,
        engine=engine,
        scheduler=scheduler,
        track=show_progress,
    )
    ended = show(found)
    for page in found.reports:
        say(f"Report: {page}")
    if isinstance(found, bf.Sweep) and found.unsuccessful:
        return ExitCode.NO_RESULT
    return ended


def simulate(
    experiment: Experiment, /, *, out: Annotated[Path, Parameter(name=("--out", "-o"))]
) -> None:
    """Simulate an experiment in MuJoCo and write its logs.

    The logs have the form of the real ones (.mat with a matrix D of columns t, u, q, dq), so that
    `butterfly identify OUT` treats them alike.

    Parameters
    ----------
    out
        Folder for the logs and their manifest.
    """
    from butterfly.experiment.simulate import simulate as logs_of  # noqa: PLC0415 - slow
    from butterfly.experiment.simulate import write_logs  # noqa: PLC0415

    _warn_of_wide_swings(experiment)
    plan = bf.read_experiment(experiment)
    say(f"Logs: {write_logs(plan, logs_of(plan, track=show_progress), out)}")


def predict(
    data: Data,
    /,
    *,
    given: Annotated[str, Parameter(name="--with", metavar="RESULT")],
    bands: bool = False,
    draws: Annotated[int, Parameter(metavar="N")] = 200,
    seed: Annotated[int, Parameter(metavar="N")] = 0,
    out: Out = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Predict logs, or an experiment that nobody has done, with given parameters.

    Identifies nothing: simulates each log from its first sample and its input alone, and says
    whether these parameters move like this robot. With --bands it says of each instant where the
    angle is with 95 %: of the model, with whatever parameters the estimate leaves open; and of a
    new log, with what the model misses besides, as seen on the logs that the estimate was made
    from.

    Examples: butterfly predict quickstart --with result.json --bands --report prediction.html;
    butterfly predict results/quickstart --with p1=0.0033,p2=0.0014,p3=0.05

    Parameters
    ----------
    data
        What is predicted: a manifest, a folder of logs, a log, a saved result or a shipped data
        set's name; or an experiment, of which the inputs count.
    given
        An identification that was saved (butterfly identify --save FILE); or parameters, p1=…,p3=…
        and whatever else is not 0 (p2, p4, coulomb, delay, …) and not known of the data; without p4
        the best one is taken, without zero=… the encoder's is read off the logs.
    bands
        Say how far the prediction is known; a report always does.
    draws
        Sets of parameters drawn, for bands and --out.
    seed
        Fixes everything random.
    out
        Write the parameter draws, for domain randomisation: .csv, .parquet, or a folder of MJCF.
    """
    pairs = "=" in given and not Path(given).exists()
    result = parse_pairs(given, "--with") if pairs else Path(given)
    if out is not None and pairs:
        raise InputError("butterfly predict", "--out", out, "an identification to draw from")
    found = bf.predict(
        data,
        result,
        bands=bands or (page.report is not None and not pairs),
        draws=draws,
        seed=seed,
        track=show_progress,
    )
    ended = show(found, report=page.report, figures=page.figures)
    if out is not None and isinstance(result, Path):
        drawn = found.drawn or bf.draws(result, draws, seed, track=show_progress)
        drawn.write(out)
        say(f"Draws: {out}")
    return ended


def reproduce(
    what: Annotated[Literal["thesis"], Parameter(name="WHAT")],  # noqa: ARG001 - there is no other
    /,
    *,
    root: Annotated[Path | None, Parameter(metavar="FOLDER")] = None,
    out: Out = None,
) -> None:
    """Print the thesis's figures beside those obtained the same way, and the right ones.

    Example: butterfly reproduce thesis --out figures

    Parameters
    ----------
    what
        What to reproduce: thesis.
    root
        Folder of the 41 real logs, if not fetched.
    out
        Write the data of Figures 3-12 to this folder.
    """
    from butterfly.result import document  # noqa: PLC0415 - slow to import
    from butterfly.thesis.figure_data import write_figure_data  # noqa: PLC0415
    from butterfly.thesis.tables import has_real_logs, reproduce  # noqa: PLC0415

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
        say("Tables 4 and 5 need the real logs: run `butterfly fetch`, or give --root.")
    if out is not None:
        for path in write_figure_data(out, synthetic, root):
            say(f"Figure data: {path}")
    alike = sum(row.agrees for row in rows)
    write_json(
        document(
            "reproduction",
            "The thesis, published against obtained",
            {"rows": [{**asdict(row), "same": row.agrees} for row in rows]},
            summary=(f"{alike} of {len(rows)} are the same.",),
        )
    )


def thesis_robot() -> Synthetic:
    """Return what Tables 1 and 2 and Figures 3 to 8 rest on."""
    from butterfly.experiment.source import read_experiment  # noqa: PLC0415
    from butterfly.thesis.tables import Synthetic  # noqa: PLC0415

    experiment = read_experiment(shipped("experiments/thesis/synthetic.yaml"))
    return Synthetic(
        rig=experiment.plant.rig,
        added_masses=experiment.added_masses,
        sines=experiment.excitations,
        duration=experiment.duration,
    )


def schema(
    what: Annotated[Literal["experiment", "manifest"], Parameter(name="FILE")] = "experiment",
    /,
    *,
    out: Out = None,
) -> None:
    """Print the JSON Schema of experiment or manifest files, for editors.

    With `# yaml-language-server: $schema=experiment.schema.json` as the first line of a YAML file,
    editors complete its keys and mark slips.

    Parameters
    ----------
    what
        Which file.
    out
        Write it to this file; it is printed if not given.
    """
    from butterfly.experiment.schema import Experiment as ExperimentFile  # noqa: PLC0415 - slow
    from butterfly.logs.manifest import Manifest  # noqa: PLC0415

    model = ExperimentFile if what == "experiment" else Manifest
    text = json.dumps(model.model_json_schema(), indent=2, default=str) + "\n"
    if out is None:
        print(text, end="")
        return
    with replacing(out) as draft:
        draft.write_text(text, encoding="utf-8")
    say(f"Schema: {out}")


def _warn_of_wide_swings(experiment: Path) -> None:
    for added, sine, swing in bf.read_experiment(experiment).wide_swings():
        warn(
            f"{added}, {sine.omega:g} rad/s: predicted to swing {swing:.2g} rad; "
            "a smaller amplitude keeps to small angles"
        )
