"""Pictures of the robot, drawn with or without a display."""

from __future__ import annotations

from pathlib import Path

import mujoco
from PIL import Image

from butterfly.errors import ButterflyError, InputError
from butterfly.files import replacing
from butterfly.model.parameters import AddedMass
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Robot

CAMERA = "bench"
"""Camera of the shipped scene."""

_FINER = 2  # drawn, either way, than the picture, whose edges are then smooth
_LARGE = 1024  # pixels of a picture that is fine enough; a finer one might not fit the card


class RenderingError(ButterflyError):
    """The machine has no way to draw."""


class Painter:
    """Draws one robot at any angle; a context manager, since it holds a drawing surface.

    Parameters
    ----------
    robot, added
        The robot and what it carries.
    size
        Width and height in pixels.

    Raises
    ------
    RenderingError
        If MuJoCo finds no way to draw.
    """

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
        self._data.qpos[0] = angle
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, CAMERA)
        return Image.fromarray(self._renderer.render()).reduce(self._finer)


def render(robot: Robot, added: AddedMass, angle: float, path: Path, size: int = 640) -> None:
    """Draw the robot at ``angle`` rad into an image file, in the format of its ending.

    Raises
    ------
    RenderingError
        If MuJoCo finds no way to draw.
    InputError
        If the file cannot be written, or its ending names no image format.
    """
    if path.suffix.lower() not in Image.registered_extensions():
        raise InputError(path, "file name", path.suffix or "no ending", ".png, .jpg or .webp")
    with Painter(robot, added, size) as painter:
        picture = painter.frame(angle)
    with replacing(path) as draft:
        picture.save(draft)
