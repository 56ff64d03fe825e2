"""Watch a run: in MuJoCo's own viewer, in a browser, or as a film."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.model.parameters import AddedMass
from butterfly.plant import has_display
from butterfly.plant.excitations import Excitation
from butterfly.plant.robot import Robot
from butterfly.plant.setup import Setup
from butterfly.plant.watch.caption import Caption
from butterfly.plant.watch.live import LiveRun, RealTime
from butterfly.plant.watch.picture import Painter, RenderingError
from butterfly.progress import Track, untracked

if TYPE_CHECKING:
    from PIL import Image

_FRAME = 0.01  # s of rest between two frames
_PILLOW = (".gif", ".webp")
_FFMPEG = (".mp4",)


def watch(
    setup: Setup,
    added: AddedMass,
    excitation: Excitation,
    duration: float,
    seed: np.random.SeedSequence,
    *,
    web: bool = False,
    port: int = 0,
) -> None:
    """Run a robot in a viewer, in real time, until the viewer is closed or Ctrl-C is pressed.

    Parameters
    ----------
    setup, added, excitation, duration, seed
        What is run (see `LiveRun`).
    web
        Serve the viewer to a browser on this machine instead of opening a window.
    port
        Of the browser's viewer; 0 picks a free one.

    Raises
    ------
    InputError
        If the simulator cannot do what the robot has.
    RenderingError
        If a window is wanted and there is no display.
    """
    run = LiveRun(setup, added, excitation, duration, seed)
    pace = RealTime(run)
    if not web:
        _run_in_window(run, pace)
        return
    from butterfly.plant.watch import browser  # noqa: PLC0415 - slow to import, and seldom wanted

    def advance() -> None:
        time.sleep(_FRAME)
        pace.catch_up()

    browser.serve(run.model, run.data, advance, port)


def film(
    robot: Robot,
    added: AddedMass,
    times: NDArray[np.float64],
    angles: NDArray[np.float64],
    path: Path,
    *,
    fps: int = 30,
    size: int = 480,
    track: Track = untracked,
) -> None:
    """Draw a recorded motion as a film with time and angle, in the format of the file's ending.

    Parameters
    ----------
    robot, added
        What is drawn.
    times, angles
        (n,) instants in s and angles in rad.
    path
        .gif, .webp, or .mp4 (needs the extra ``video``).
    fps, size
        Frames per second; width and height in pixels.
    track
        Shows progress.

    Raises
    ------
    InputError
        If the ending is none of these, the extra is missing, or the file cannot be written.
    RenderingError
        If MuJoCo finds no way to draw.
    """
    save = _saver(path)
    caption = Caption(size)
    instants = np.arange(times[0], times[-1], 1 / fps)
    shown = list(zip(instants.tolist(), np.interp(instants, times, angles).tolist(), strict=True))
    with Painter(robot, added, size) as painter:
        frames = [
            caption.write(painter.frame(angle), instant, angle)
            for instant, angle in track(shown, "Drawing frames")
        ]
    with replacing(path) as draft:
        save(draft, frames, fps)


def _saver(path: Path) -> Callable[[Path, list[Image.Image], int], None]:
    ending = path.suffix.lower()
    if ending in _PILLOW:
        return _save_with_pillow
    if ending not in _FFMPEG:
        raise InputError(path, "file name", path.suffix or "no ending", ".mp4, .gif or .webp")
    if find_spec("imageio") is None or find_spec("imageio_ffmpeg") is None:
        raise InputError(path, "file name", ending, ".gif or .webp, or the extra 'video' installed")
    return _save_with_ffmpeg


def _save_with_pillow(path: Path, frames: list[Image.Image], fps: int) -> None:
    first, *rest = frames
    first.save(path, save_all=True, append_images=rest, duration=1000 / fps, loop=0)


def _save_with_ffmpeg(path: Path, frames: list[Image.Image], fps: int) -> None:
    import imageio.v3 as iio  # noqa: PLC0415 - an extra, which need not be there

    iio.imwrite(
        path, np.stack([np.asarray(frame) for frame in frames]), fps=fps, macro_block_size=None
    )


def _run_in_window(run: LiveRun, pace: RealTime) -> None:
    if not has_display():
        raise RenderingError("no display for a viewer: use --web, or --out FILM")
    from mujoco import viewer  # noqa: PLC0415 - needs the window system when it is imported

    with viewer.launch_passive(run.model, run.data) as handle:
        while handle.is_running():
            time.sleep(_FRAME)
            with handle.lock():
                pace.catch_up()
            handle.sync()
