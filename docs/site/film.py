"""Draw the films anew: `make film`, after the hand, its orbits or its compensation have changed.

The hand of `orbit-recalibration` on its orbit in MuJoCo, and as a ghost what the model identified
from small swings makes of the same torques; that of `orbit-rotation` turning over. The hand of
`quickstart`, pushed, under its exported compensation, and as a ghost without. Beside each lies the
record of what it shows, as of other pictures.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from runpy import run_path

import numpy as np
from PIL import Image
from records import PICTURES, recorded, write_record

import butterfly as bf
from butterfly.arrays import Samples
from butterfly.experiment.source import read_experiment
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.outputs import call
from butterfly.plant.mjcf import compile_model, hinge_of
from butterfly.plant.robot import Robot
from butterfly.plant.watch.picture import film

FILMS = {  # experiment and log
    "orbit.gif": ("orbit-recalibration", "round1_run0.mat"),
    "rotation.gif": ("orbit-rotation", "also_round1_run0.mat"),
}
FLOATING = PICTURES / "floating.gif"
SECONDS, FPS, SIZE, COLOURS = 6.0, 15, 320, 48
PUSHES = ((0.3, 0.07), (2.3, 0.05), (4.3, -0.1))  # s, N m
PUSHED, STEP = 0.15, 1e-3  # s, of each; and of MuJoCo


def main() -> None:
    """Draw all, over those that are there."""
    with call(overwrite=True):
        for name, (experiment, log) in FILMS.items():
            shown = _orbit(PICTURES / name, experiment, log)
            write_record(PICTURES / name, recorded(f"butterfly run {experiment}", shown))
        shown = _floating()
        write_record(FLOATING, recorded("butterfly run quickstart", shown))


def _orbit(path: Path, experiment: str, held: str) -> list[str]:
    """Hold an orbit, simulate a log of it with the first model, draw both, return their reach."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ran = bf.run(experiment, out=folder)
        log = bf.read(folder / held, input="torque").logs[0]
    spec = read_experiment(experiment)
    found = [each.estimate.parameters for each in ran.identifications.values()]
    run = FreeRun.of(log, Setting(parameters=(*found, spec.control.believed)[0], zero=0.0))
    robot = spec.plant.robot
    kept = log.time <= log.time[0] + SECONDS
    motion = (np.asarray(each)[kept] for each in (log.time, log.angle, run.simulated))
    times, measured, simulated = motion
    film(robot, log.added_mass, times, measured, path, fps=FPS, size=SIZE, simulated=simulated)
    _shrink(path)
    return [f"log {Path(held).stem}", *_reach(measured, simulated)]


def _reach(hand: Samples, ghost: Samples) -> list[str]:
    """Return how far both get, and how far apart."""
    angles = {"hand": hand, "ghost": ghost, "between them": hand - ghost}
    return [f"{what} at most {np.degrees(abs(x).max()):.0f}°" for what, x in angles.items()]


def _floating() -> list[str]:
    """Push the hand in MuJoCo with and without what is exported, draw both, return their reach."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "compensation.py"
        (found,) = bf.run("quickstart", out=Path(name)).identifications.values()
        found.model.export(path, to="compensation")
        made = run_path(str(path))
    guided = made["Parameters"](dry=0.5, damping=-3.0)  # which brakes
    robot = read_experiment("quickstart").plant.robot
    times = STEP * np.arange(round(SECONDS / STEP))
    with_it, without = (
        _pushed(robot, times, law)
        for law in (lambda x, v: made["command"](x, v, p=guided), lambda _x, _v: 0.0)
    )
    film(robot, NO_ADDED_MASS, times, with_it, FLOATING, fps=FPS, size=SIZE, simulated=without)
    _shrink(FLOATING)
    return [f"{len(PUSHES)} pushes of {PUSHED:g} s", *_reach(with_it, without)]


def _pushed(robot: Robot, times: Samples, law: Callable[[float, float], float]) -> Samples:
    """Return the angles of a robot in MuJoCo that a law of angle and velocity drives."""
    import mujoco  # noqa: PLC0415 - after the plant, which chooses what draws

    model = compile_model(robot, NO_ADDED_MASS)
    model.opt.timestep = STEP
    data, hinge, angles = mujoco.MjData(model), hinge_of(model), np.zeros(times.size)
    for k, now in enumerate(times):
        data.qfrc_applied[hinge] = sum(push * (0 <= now - at < PUSHED) for at, push in PUSHES)
        data.ctrl[0] = law(data.qpos[hinge], data.qvel[hinge])
        mujoco.mj_step(model, data)
        angles[k] = data.qpos[hinge]
    return angles


def _shrink(path: Path) -> None:
    """Write a film with fewer colours."""
    with Image.open(path) as drawn:
        frames = [
            (drawn.seek(k), drawn.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE))[1]
            for k in range(drawn.n_frames)
        ]
    first, *rest = frames
    first.save(path, save_all=True, append_images=rest, duration=1000 // FPS, loop=0, optimize=True)


if __name__ == "__main__":
    main()
