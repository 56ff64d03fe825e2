import numpy as np
import pytest
from PIL import Image

from butterfly.plant.watch.caption import Caption, told


@pytest.mark.parametrize(
    ("instant", "angle", "text"),
    [
        (3.251, 0.1234, "t = 3.25 s\nθ = +0.123 rad"),
        (0.0, -1e-5, "t = 0.00 s\nθ = +0.000 rad"),
        (61.0, -12.5664, "t = 61.00 s\nθ = -12.566 rad"),
    ],
)
def test_time_and_angle_are_told_with_their_units(instant, angle, text):
    assert told(instant, angle, "θ") == text


@pytest.mark.parametrize("size", [240, 480, 1024])
def test_the_caption_fits_into_its_corner(size):
    blank = Image.new("RGB", (size, size), "white")
    ink = np.argwhere(np.asarray(Caption(size).write(blank, 100.0, -12.566).convert("L")) < 200)
    assert ink[:, 0].max() < 0.2 * size
    assert ink[:, 1].min() > 0.6 * size
    assert ink[:, 1].max() < size - 1
