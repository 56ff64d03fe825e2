"""Pictures and films of the robot, drawn with or without a display."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, InputError
from butterfly.files import replacing
from butterfly.model.parameters import AddedMass
from butterfly.outputs import mark_of, require_endings
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Robot
from butterfly.progress import Track, untracked

CAMERA = "bench"
"""Camera of the shipped scene."""

_FINER = 2  # times the width and height of a picture at which it is drawn, for smooth edges
_LARGE = 1024  # pixels of a picture that is fine enough; a finer one might not fit the card
_PILLOW = (".gif", ".webp")
_FFMPEG = ".mp4"
_LINES = 26  # that a picture is high
_GHOST = 0.35  # opacity of what is simulated beside what was measured
_SMALLEST = 8  # pixels of a letter that can be read
_PLACE = (0.66, 0.025)  # of the corner that the hand leaves free, in parts of the picture
_INK = (52, 56, 64)


class RenderingError(ButterflyError):
    """The machine cannot draw."""


class Painter:
    """Draws one robot at any angle; a context manager, since it holds a renderer."""

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

    def frame(self, angle: float, ghost: float | None = None) -> Image.Image:
        """Return the picture of the robot at ``angle`` rad (m for a slide), and of its ghost."""
        self._turn(angle)
        self._renderer.update_scene(self._data, CAMERA)
        if ghost is not None:
            self._add_ghost(ghost)
        return Image.fromarray(self._renderer.render()).reduce(self._finer)

    def _turn(self, angle: float) -> None:
        self._data.joint("hinge").qpos[0] = angle
        mujoco.mj_forward(self._model, self._data)

    def _add_ghost(self, angle: float) -> None:
        """Add the moving parts again to the scene, translucent, at another angle."""
        self._turn(angle)
        scene = self._renderer.scene
        solid = scene.ngeom
        mujoco.mjv_addGeoms(
            self._model,
            self._data,
            mujoco.MjvOption(),
            mujoco.MjvPerturb(),
            mujoco.mjtCatBit.mjCAT_DYNAMIC.value,
            scene,
        )
        for geom in scene.geoms[solid : scene.ngeom]:
            geom.rgba[3] *= _GHOST


def render(
    robot: Robot,
    added: AddedMass,
    angle: float,
    path: Path,
    size: int = 640,
    *,
    ghost: float | None = None,
) -> None:
    """Draw the robot at ``angle`` rad into an image file; its ``ghost`` at another angle."""
    require_endings(path, (".png", ".jpg", ".jpeg", ".webp"), "file name")
    with Painter(robot, added, size) as painter:
        picture = painter.frame(angle, ghost)
    named = PngInfo()
    named.add_text("Software", "butterfly.picture")
    with replacing(path, mark_of(path, "picture")) as draft:
        picture.save(draft, pnginfo=named)  # which other formats ignore


def film(
    robot: Robot,
    added: AddedMass,
    times: Samples,
    angles: Samples,
    path: Path,
    *,
    fps: int = 30,
    size: int = 480,
    simulated: Samples | None = None,
    track: Track = untracked,
) -> None:
    """Draw a motion, (n,) instants in s and angles in rad, as a film in the file's format.

    The robot at (n,) ``simulated`` angles, if given, is drawn as a ghost.
    """
    ending = path.suffix.lower()
    require_endings(path, (_FFMPEG, *_PILLOW), "file name")
    if ending == _FFMPEG and not (find_spec("imageio") and find_spec("imageio_ffmpeg")):
        raise InputError(
            path,
            "file name",
            ending,
            ".gif or .webp, or the extra video (pip install 'butterfly-testbed[video]')",
        )
    instants = np.arange(times[0], times[-1], 1 / fps)
    drawn = np.interp(instants, times, angles).tolist()
    ghosts = [None] * len(drawn)
    if simulated is not None:
        ghosts = np.interp(instants, times, simulated).tolist()
    motion = list(zip(instants.tolist(), drawn, ghosts, strict=True))
    with Painter(robot, added, size) as painter:
        frames = [
            captioned(painter.frame(angle, ghost), instant, angle, ghost)
            for instant, angle, ghost in track(motion, "Drawing frames")
        ]
    with replacing(path) as draft:
        if ending == _FFMPEG:
            import imageio.v3 as iio  # noqa: PLC0415 - an extra, which need not be there

            iio.imwrite(
                draft,
                np.stack([np.asarray(frame) for frame in frames]),
                fps=fps,
                macro_block_size=None,
            )
        else:
            first, *rest = frames
            first.save(draft, save_all=True, append_images=rest, duration=1000 / fps, loop=0)


def captioned(
    picture: Image.Image, instant: float, angle: float, ghost: float | None = None
) -> Image.Image:
    """Write a time in s and the angles in rad, also of the ghost, into a picture; return it."""
    text = caption_text(instant, angle, "θ").replace("-", "−")
    if ghost is not None:
        text += f"\nghost (simulated)\n    {ghost:+z.3f} rad".replace("-", "−")
    place = (_PLACE[0] * picture.width, _PLACE[1] * picture.width)
    ImageDraw.Draw(picture).multiline_text(place, text, _INK, _letters(picture.width // _LINES))
    return picture


@cache
def _letters(height: int) -> ImageFont.FreeTypeFont:
    """Return a font of a height in pixels; Pillow's own has no minus sign."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(path, max(_SMALLEST, height))


def caption_text(instant: float, angle: float, symbol: str) -> str:
    """Return a time in s and an angle in rad as two lines, in ASCII except the symbol."""
    return f"t = {instant:z.2f} s\n{symbol} = {angle:+z.3f} rad"
