"""Draw the films of the orbits anew: `make film`, after the hand or its orbits have changed.

The hand of `orbit-recalibration` on its orbit in MuJoCo, and as a ghost what the model identified
from small swings makes of the same torques; and that of `orbit-rotation` turning over.
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

PICTURES = Path(__file__).parents[1] / "pictures"
FILMS = {  # experiment and log
    "orbit.gif": ("orbit-recalibration", "round1_run0.mat"),
    "rotation.gif": ("orbit-rotation", "also_round1_run0.mat"),
}
SECONDS, FPS, SIZE, COLOURS = 6.0, 15, 320, 48


def draw(path: Path, experiment: str, held: str) -> None:
    """Hold an orbit, simulate a log of it with the first model, and draw both."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ran = bf.run(experiment, out=folder)
        log = bf.read(folder / held, input="torque").logs[0]
        (found,) = ran.identifications.values()
    run = FreeRun.of(log, Setting(parameters=found.estimate.parameters, zero=0.0))
    robot = read_experiment(experiment).plant.robot
    kept = log.time <= log.time[0] + SECONDS
    motion = (np.asarray(each)[kept] for each in (log.time, log.angle, run.simulated))
    times, measured, simulated = motion
    film(robot, log.added_mass, times, measured, path, fps=FPS, size=SIZE, simulated=simulated)
    with Image.open(path) as drawn:
        frames = [
            (drawn.seek(k), drawn.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE))[1]
            for k in range(drawn.n_frames)
        ]
    first, *rest = frames
    first.save(path, save_all=True, append_images=rest, duration=1000 // FPS, loop=0, optimize=True)


if __name__ == "__main__":
    for name, told in FILMS.items():
        draw(PICTURES / name, *told)
