"""Commands that show and export the robot of an experiment, or the twin of data."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

import butterfly as bf
from butterfly.cli.options import WRITTEN, HandMass, Out
from butterfly.cli.output import ExitCode, say, say_verdict, show_progress
from butterfly.errors import InputError
from butterfly.twin.forms import DEFAULTS, FORMS, INTEGRATORS, WITH_A_BODY, Options

if TYPE_CHECKING:
    from butterfly.experiment.schema import Experiment

Source = Annotated[Path, Parameter(name="SOURCE")]
AddedMass = Annotated[float, Parameter(metavar="kg")]
Arm = Annotated[
    float | None, Parameter(metavar="m", help="Pivot to added mass; 0.104 if not given.")
]
_FILMS = (".gif", ".mp4", ".webp")


def show(
    source: Source,
    /,
    *,
    run: Annotated[int, Parameter(metavar="N", validator=Number(gte=0))] = 0,
    web: bool = False,
    port: Annotated[int, Parameter(metavar="N", validator=Number(gte=0, lte=65535))] = 0,
    out: Out = None,
    angle: Annotated[float | None, Parameter(metavar="rad", allow_leading_hyphen=True)] = None,
    seconds: Annotated[float, Parameter(metavar="s", validator=Number(gte=0.1))] = 8.0,
    fps: Annotated[int, Parameter(metavar="N", validator=Number(gte=1, lte=120))] = 25,
    size: Annotated[int, Parameter(metavar="N", validator=Number(gte=16, lte=4096))] = 480,
    added_mass: AddedMass = 0.0,
    arm: Arm = None,
) -> ExitCode:
    """Watch a run in a window or a browser, or draw it.

    Commands, clock and simulator are those of the log that `butterfly simulate` writes. With --out
    a film of the run is drawn; or, for .png and .jpg, of a saved result or other data, and with
    --angle, a picture of the robot. Drawing needs no display where EGL is installed.

    Examples: butterfly show quickstart --web; butterfly show quickstart --run 5 --out hand.mp4;
    butterfly show result.json --added-mass 0.05 --out hand.png

    Parameters
    ----------
    source
        An experiment file (YAML) or a shipped one's name; of a picture also a saved result, a
        manifest or a folder of logs.
    run
        Which run of the experiment: added masses times inputs, from 0 on.
    web
        Serve the viewer to a browser on this machine only.
    port
        Of the browser's viewer; 0 picks a free one.
    out
        Draw to this file: .mp4 (extra video), .gif or .webp for a film, .png, .jpg or .webp for a
        picture.
    angle
        Draw a picture of the hand at this angle; 0.5 if not given.
    seconds
        Length of a film; no longer than the experiment's runs.
    fps
        Frames per second of a film.
    size
        Width and height in pixels, even for .mp4.
    added_mass
        What the hand of a picture carries, at --arm.
    """
    from butterfly.api.sources import is_data  # noqa: PLC0415 - slow to import
    from butterfly.files import locate  # noqa: PLC0415

    data = is_data(locate(source))
    if out is None:
        if data:
            raise InputError(source, "--out", "nothing", "a picture: only experiments have a run")
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


_Form: Any = Literal[tuple(FORMS)]
_Integrator: Any = Literal[INTEGRATORS]


def export(
    source: Source,
    /,
    *,
    out: Annotated[Path, Parameter(name=("--out", "-o"), group=WRITTEN, metavar="FILE")],
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
    """Write the joint as a file for another program.

    Says what the form cannot hold, and how far its motion is from our own simulation of the same
    logs at the step that is asked for.

    Examples: butterfly export result.json --out twin.xml --timestep 0.002; butterfly export
    servo.json --to bam --out servo-bam.json

    Parameters
    ----------
    source
        An experiment file or a shipped one's name; a saved result, whose values are taken; or other
        data, which are identified.
    out
        File to write.
    to
        Form: a whole MuJoCo model (mjcf), lines for your own MJCF (snippet), URDF (urdf), fields of
        mjlab's and Isaac Lab's actuators (actuator), one C99 header (c), or the JSON of
        Rhoban's BAM (bam).
    timestep
        Step in s of the simulator for which the file is written.
    integrator
        Of MuJoCo. RK4 is the more exact; implicitfast is what learning frameworks use.
    actuator
        Which of BAM's servos it is, as xl330; that of the servo's law if not given.
    added_mass
        What the joint carries, at --arm.
    """
    from butterfly.api.inspected import robot_of  # noqa: PLC0415 - slow to import
    from butterfly.files import write_file  # noqa: PLC0415
    from butterfly.twin.forms import write_as  # noqa: PLC0415

    if actuator and to != "bam":
        raise InputError("export", "--actuator", actuator, "--to bam beside it")
    named = robot_of(source, hand_mass=hand_mass, added_mass=added_mass, arm=arm)
    if named.judged is not None:
        say_verdict(named.judged)
    asked = Options(timestep=timestep, integrator=integrator, actuator=actuator)
    made = write_as(to, named.twin, asked)
    write_file(out, made.text)
    say(f"Model: {out}, {made.about}.")
    for sentence in (*made.left_out, *(made.accuracy.lines if made.accuracy else ())):
        say(sentence)
    if named.note and to in WITH_A_BODY:
        say(named.note)
    return ExitCode.of(named.judged)
