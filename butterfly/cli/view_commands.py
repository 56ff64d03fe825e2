"""`butterfly view` and `butterfly video`: watch a run of an experiment."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from butterfly.cli.options import ExperimentArgument
from butterfly.cli.show_progress import show_progress
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.watch.live import watch
from butterfly.plant.watch.picture import film

if TYPE_CHECKING:
    import numpy as np

    from butterfly.experiment.schema import Experiment
    from butterfly.model.parameters import AddedMass
    from butterfly.signals.excitations import Excitation

RunOption = Annotated[
    int, typer.Option("--run", min=0, help="Which run of it: added masses times inputs, from 0 on.")
]


def view_command(
    *,
    experiment: ExperimentArgument,
    number: RunOption = 0,
    web: Annotated[
        bool, typer.Option("--web", help="Serve the viewer to a browser on this machine only.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of the browser's viewer; 0 picks a free one.")
    ] = 0,
) -> None:
    """Watch a run in MuJoCo's viewer, in real time; `--web` needs no display.

    Its commands, clock and simulator are those of the log that `butterfly simulate` writes.
    """
    plan = read_experiment(locate(experiment))
    (added, excitation), seed = _chosen(plan, number, experiment)
    with suppress(KeyboardInterrupt):
        watch(plan.plant.rig, added, excitation, plan.duration, seed, web=web, port=port)


def video_command(
    *,
    experiment: ExperimentArgument,
    out: Annotated[Path, typer.Option(help="Film to write: .mp4 (extra video), .gif, .webp.")],
    number: RunOption = 0,
    seconds: Annotated[
        float, typer.Option(min=0.1, help="Length; no longer than the experiment's runs.")
    ] = 8.0,
    fps: Annotated[int, typer.Option(min=1, max=120, help="Frames per second.")] = 25,
    size: Annotated[
        int, typer.Option(min=16, max=4096, help="Width and height in pixels, even for .mp4.")
    ] = 480,
) -> None:
    """Draw a run as a film; needs no display where EGL is installed.

    It shows the angles of the log that `butterfly simulate` writes.
    """
    plan = read_experiment(locate(experiment))
    run, seed = _chosen(plan, number, experiment)
    (log,) = simulate_runs(plan.plant.rig, [run], plan.duration, [seed])
    shown = log.take(log.time <= log.time[0] + seconds)
    film(
        plan.plant.robot,
        log.added_mass,
        shown.time,
        shown.angle,
        out,
        fps=fps,
        size=size,
        track=show_progress,
    )
    typer.echo(f"Film: {out}")


def _chosen(
    plan: Experiment, number: int, source: Path
) -> tuple[tuple[AddedMass, Excitation], np.random.SeedSequence]:
    """Return a run of an experiment, and the source of everything random in it."""
    runs = plan.runs()
    if number >= len(runs):
        raise InputError(source, "--run", number, f"a number from 0 to {len(runs) - 1}")
    return runs[number], plan.seeds()[number]
