"""Commands of experiments: run, simulate, predict, reproduce, schema."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

import butterfly as bf
from butterfly.cli.options import (
    NO_REPORT,
    OUT,
    WRITTEN,
    Data,
    Experiment,
    OutFolder,
    Report,
    parse_pairs,
)
from butterfly.cli.output import ExitCode, say, show, show_progress, show_table, warn, write_json
from butterfly.cli.written import FOLDER, OutputFile
from butterfly.errors import InputError
from butterfly.files import shipped, write_file

if TYPE_CHECKING:
    from butterfly.thesis.tables import Synthetic


def run(
    experiment: Experiment,
    /,
    *,
    out: OutFolder = None,
    figures: Annotated[bool, Parameter(group=WRITTEN)] = False,
    jobs: Annotated[int | None, Parameter(metavar="N")] = None,
    force: bool = False,
    only: Annotated[str | None, Parameter(metavar="NUMBERS")] = None,
    engine: Literal["local", "dask"] = "local",
    scheduler: Annotated[str | None, Parameter(metavar="ADDRESS")] = None,
) -> ExitCode:
    """Simulate an experiment or a sweep, identify the joint, and write a report.

    Prints true and estimated parameters. An interrupted or extended sweep resumes where it stopped.
    Exit code 1: some runs of a sweep failed. Exit code 3: do not use the estimate.

    Example: butterfly run experiments/quickstart.yaml

    Parameters
    ----------
    out
        Folder for results and report. Default: results/NAME.
    figures
        Write the report's figures as PNG and SVG too.
    jobs
        Worker processes of a sweep, or threads of a single run. Default: one per core.
    force
        Repeat finished runs.
    only
        Numbers of the runs to do: 0,3,10-19. Default: all.
    engine
        Where a sweep runs; dask needs butterfly-testbed[dask].
    scheduler
        Address of a Dask scheduler, such as tcp://HOST:8786. Default: a local cluster.
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
    return ExitCode.NO_RESULT if isinstance(found, bf.Sweep) and found.unsuccessful else ended


def simulate(experiment: Experiment, /, *, out: Annotated[Path, OUT, FOLDER]) -> None:
    """Simulate an experiment in MuJoCo, and write only its logs.

    The format is that of real logs, so `butterfly identify OUT` reads them.

    Example: butterfly simulate quickstart --out logs

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
    out: Annotated[Path | None, OUT, OutputFile(("", ".csv", ".parquet"))] = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Predict logs, or a new experiment, with known parameters.

    Simulates each log from its initial angle with the recorded input alone. --bands adds two 95 %
    bands: one for the uncertainty of the parameters, one for a new log (with the model error).

    Examples: butterfly predict new-logs --with result.json --bands --report prediction.html;
    butterfly predict results/quickstart --with p1=0.0033,p2=0.0014,p3=0.05

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest, a saved result, an experiment, or a shipped name.
    given
        A saved result, or parameters: p1=…,p3=…,coulomb=…. Others are 0. Without p4 the
        best-fitting p4; without zero the logs' own encoder zero.
    bands
        Compute 95 % bands (always in a report).
    draws
        Number of parameter draws for the bands and --out.
    seed
        Random seed.
    out
        Write the parameter draws: .csv, .parquet, or a folder of MJCF.
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
        (found.drawn or bf.draws(result, draws, seed)).write(out)
        say(f"Draws: {out}")
    return ended


def reproduce(
    what: Annotated[Literal["thesis"], Parameter(name="WHAT")],  # noqa: ARG001 - there is no other
    /,
    *,
    root: Annotated[Path | None, Parameter(metavar="FOLDER")] = None,
    out: OutFolder = None,
) -> None:
    """Reproduce the thesis's numbers, with its mistakes and corrected.

    Example: butterfly reproduce thesis --out figures

    Parameters
    ----------
    what
        What to reproduce.
    root
        Folder of the 41 real logs. Default: where `butterfly fetch` puts them.
    out
        Write the data of Figures 3-12 to this folder.
    """
    from butterfly.result import document  # noqa: PLC0415 - slow to import
    from butterfly.thesis.figure_data import write_figure_data  # noqa: PLC0415
    from butterfly.thesis.tables import has_real_logs, reproduce  # noqa: PLC0415

    synthetic = thesis_robot()
    rows = reproduce(synthetic, root)
    show_table(
        "The thesis: published and reproduced values",
        ("figures", "published", "reproduced", "same", "corrected"),
        [
            (row.what, row.published, row.obtained, "yes" if row.agrees else "no", row.corrected)
            for row in rows
        ],
    )
    for row in rows:
        if row.note:
            say(f"{row.what}: {row.note}")
    if not has_real_logs(root):
        say("Tables 4 and 5 need the real logs: run `butterfly fetch` or pass --root FOLDER.")
    if out is not None:
        for path in write_figure_data(out, synthetic, root):
            say(f"Figure data: {path}")
    alike = sum(row.agrees for row in rows)
    write_json(
        document(
            "reproduction",
            "The thesis: published and reproduced values",
            {"rows": [{**asdict(row), "same": row.agrees} for row in rows]},
            summary=(f"{alike} of {len(rows)} published values are reproduced.",),
        )
    )


def thesis_robot() -> Synthetic:
    """Return the simulated robot and experiment of Tables 1 and 2 and Figures 3 to 8."""
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
    out: Annotated[Path | None, OUT, OutputFile((".json",))] = None,
) -> None:
    """Print the JSON Schema of experiment or manifest files.

    Editors then complete the keys of a YAML file that starts with
    `# yaml-language-server: $schema=experiment.schema.json`.

    Example: butterfly schema experiment --out experiment.schema.json

    Parameters
    ----------
    what
        Kind of file.
    out
        File to write. Default: print it.
    """
    from butterfly.experiment.schema import Experiment as ExperimentFile  # noqa: PLC0415 - slow
    from butterfly.logs.manifest import Manifest  # noqa: PLC0415

    model = ExperimentFile if what == "experiment" else Manifest
    text = json.dumps(model.model_json_schema(), indent=2, default=str) + "\n"
    if out is None:
        print(text, end="")
        return
    write_file(out, text)
    say(f"Schema: {out}")


def _warn_of_wide_swings(experiment: Path) -> None:
    for added, sine, swing in bf.read_experiment(experiment).wide_swings():
        warn(
            f"{added}, {sine.omega:g} rad/s: predicted swing {swing:.2g} rad; "
            "reduce the amplitude to stay at small angles"
        )
