"""Pictures and films of the robot, drawn with or without a display."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, InputError
from butterfly.files import replacing
from butterfly.model.parameters import AddedMass
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Robot
from butterfly.progress import Track, untracked

CAMERA = "bench"
"""Camera of the shipped scene."""

_FINER = 2  # drawn, either way, than the picture, whose edges are then smooth
_LARGE = 1024  # pixels of a picture that is fine enough; a finer one might not fit the card
_PILLOW = (".gif", ".webp")
_FFMPEG = ".mp4"
_LINES = 26  # that a picture is high
_SMALLEST = 8  # pixels of a letter that can be read
_PLACE = (0.66, 0.025)  # of the corner that the hand leaves free, in parts of the picture
_INK = (52, 56, 64)


class RenderingError(ButterflyError):
    """The machine has no way to draw."""


class Painter:
    """Draws one robot at any angle; a context manager, since it holds a drawing surface."""

    def __init__(self, robot: Robot, added: AddedMass, size: int = 640) -> None:
        model = compile_model(robot, added, scene=True)
        self._finer = _FINER if size <= _LARGE else 1
        drawn = self._finer * size
        model.vis.global_.offwidth = model.vis.global_.offheight = drawn
        model.vis.quality.offsamples = 4 if self._finer == 1 else 0
        self._model, self._data = model, mujoco.MjData(model)
        try:
            self._renderer = mujoco.Renderer(model, drawn, drawn)
        except Exception as error:  # whatever the OpenGL platform at hand raises
            raise RenderingError(
                f"cannot draw on this machine ({error}): install EGL (libegl1) or set MUJOCO_GL"
            ) from error

    def __enter__(self) -> Painter:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def frame(self, angle: float) -> Image.Image:
        """Return the picture of the robot turned by ``angle`` rad."""
        self._data.joint("hinge").qpos[0] = angle
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, CAMERA)
        return Image.fromarray(self._renderer.render()).reduce(self._finer)


def render(robot: Robot, added: AddedMass, angle: float, path: Path, size: int = 640) -> None:
    """Draw the robot at ``angle`` rad into an image file, in the format of its ending."""
    if path.suffix.lower() not in Image.registered_extensions():
        raise InputError(path, "file name", path.suffix or "no ending", ".png, .jpg or .webp")
    with Painter(robot, added, size) as painter:
        picture = painter.frame(angle)
    with replacing(path) as draft:
        picture.save(draft)


def film(
    robot: Robot,
    added: AddedMass,
    times: Samples,
    angles: Samples,
    path: Path,
    *,
    fps: int = 30,
    size: int = 480,
    track: Track = untracked,
) -> None:
    """Draw a motion, (n,) instants in s and angles in rad, as a film of the file's format."""
    ending = path.suffix.lower()
    if ending not in (*_PILLOW, _FFMPEG):
        raise InputError(path, "file name", path.suffix or "no ending", ".mp4, .gif or .webp")
    if ending == _FFMPEG and not (find_spec("imageio") and find_spec("imageio_ffmpeg")):
        raise InputError(path, "file name", ending, ".gif or .webp, or the extra 'video' installed")
    instants = np.arange(times[0], times[-1], 1 / fps)
    motion = list(zip(instants.tolist(), np.interp(instants, times, angles).tolist(), strict=True))
    with Painter(robot, added, size) as painter:
        frames = [
            captioned(painter.frame(angle), instant, angle)
            for instant, angle in track(motion, "Drawing frames")
        ]
    with replacing(path) as draft:
        if ending == _FFMPEG:
            import imageio.v3 as iio  # noqa: PLC0415 - an extra, which need not be there

            iio.imwrite(
                draft,
                np.stack([np.asarray(each) for each in frames]),
                fps=fps,
                macro_block_size=None,
            )
        else:
            first, *rest = frames
            first.save(draft, save_all=True, append_images=rest, duration=1000 / fps, loop=0)


def captioned(picture: Image.Image, instant: float, angle: float) -> Image.Image:
    """Write a time in s and an angle in rad into a picture, and return it."""
    text = caption_text(instant, angle, "θ").replace("-", "−")
    place = (_PLACE[0] * picture.width, _PLACE[1] * picture.width)
    ImageDraw.Draw(picture).multiline_text(place, text, _INK, _letters(picture.width // _LINES))
    return picture


@cache
def _letters(height: int) -> ImageFont.FreeTypeFont:
    """Return letters in pixels; Pillow's own are Latin, and have no minus."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(path, max(_SMALLEST, height))


def caption_text(instant: float, angle: float, symbol: str) -> str:
    """Return a time in s and an angle in rad as two lines, in letters that any font has."""
    return f"t = {instant:z.2f} s\n{symbol} = {angle:+z.3f} rad"
