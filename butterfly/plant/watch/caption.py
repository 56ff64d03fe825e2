"""What stands in a film's corner."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
from PIL import ImageDraw, ImageFont

if TYPE_CHECKING:
    from PIL import Image

_LINES = 26  # that a picture is high
_SMALLEST = 8  # pixels of a letter that can be read
_PLACE = (0.66, 0.025)  # of the corner that the hand leaves free, in parts of the picture
_INK = (52, 56, 64)


class Caption:
    """Writes time and angle into pictures of one size.

    Parameters
    ----------
    size
        Width and height of the pictures in pixels.
    """

    def __init__(self, size: int) -> None:
        # Pillow's own letters are Latin, and have no minus.
        letters = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
        self._font = ImageFont.truetype(letters, max(_SMALLEST, size // _LINES))
        self._place = (_PLACE[0] * size, _PLACE[1] * size)

    def write(self, picture: Image.Image, instant: float, angle: float) -> Image.Image:
        """Write a time in s and an angle in rad into a picture, and return it."""
        text = told(instant, angle, "θ").replace("-", "−")
        ImageDraw.Draw(picture).multiline_text(self._place, text, _INK, self._font)
        return picture


def told(instant: float, angle: float, symbol: str) -> str:
    """Return a time in s and an angle in rad as two lines, in letters that any font has."""
    return f"t = {instant:z.2f} s\n{symbol} = {angle:+z.3f} rad"
