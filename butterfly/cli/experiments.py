"""Commands that run experiments: run, simulate, schema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

import butterfly as bf
from butterfly.cli.options import WRITTEN, Experiment, Out
from butterfly.cli.output import ExitCode, print_document, say, show, warn
from butterfly.cli.progress import show_progress


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
    depend on, the code of butterfly included: run again after a kill, or after the sweep has grown,
    and only what is missing is done. Exit code 1 says that some runs gave no result; the report
    says which, and why. Of an experiment without `sweep:`, exit code 3 says that an estimate is not
    to be used.

    Example: butterfly run experiments/quickstart.yaml

    Parameters
    ----------
    experiment
        An experiment file (YAML), or a shipped one's name.
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
    experiment
        An experiment file (YAML), or a shipped one's name.
    out
        Folder for the logs and their manifest.
    """
    from butterfly.experiment.simulate import simulate as logs_of  # noqa: PLC0415 - slow
    from butterfly.experiment.simulate import write_logs  # noqa: PLC0415

    _warn_of_wide_swings(experiment)
    plan = bf.read_experiment(experiment)
    say(f"Logs: {write_logs(plan, logs_of(plan, track=show_progress), out)}")


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
    from butterfly.files import replacing  # noqa: PLC0415
    from butterfly.logs.manifest import Manifest  # noqa: PLC0415

    model = ExperimentFile if what == "experiment" else Manifest
    text = json.dumps(model.model_json_schema(), indent=2, default=str) + "\n"
    if out is None:
        print_document(text)
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
