"""Draw the film of the first page anew: `make film`, after the hand or its orbit have changed.

The hand of `orbit-recalibration` on its orbit in MuJoCo, and as a ghost what the model identified
from small swings makes of the same torques.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import butterfly as bf
from butterfly.experiment.source import read_experiment
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.plant.watch.picture import film

FILM = Path(__file__).parents[1] / "pictures/orbit.gif"
EXPERIMENT = "orbit-recalibration"
SECONDS, FPS, SIZE, COLOURS = 6.0, 15, 320, 48


def main() -> None:
    """Hold the orbit, simulate its last log with the first model, and draw both."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ran = bf.run(EXPERIMENT, out=folder)
        log = bf.read(folder / "round1_run0.mat", input="torque").logs[0]
        (found,) = ran.identifications.values()
    run = FreeRun.of(log, Setting(parameters=found.estimate.parameters, zero=0.0))
    robot = read_experiment(EXPERIMENT).plant.robot
    kept = log.time <= log.time[0] + SECONDS
    motion = (np.asarray(each)[kept] for each in (log.time, log.angle, run.simulated))
    times, measured, simulated = motion
    film(robot, log.added_mass, times, measured, FILM, fps=FPS, size=SIZE, simulated=simulated)
    with Image.open(FILM) as drawn:
        frames = [
            (drawn.seek(k), drawn.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE))[1]
            for k in range(drawn.n_frames)
        ]
    first, *rest = frames
    first.save(FILM, save_all=True, append_images=rest, duration=1000 // FPS, loop=0, optimize=True)


if __name__ == "__main__":
    main()
