import gc
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image, ImageSequence

from butterfly.errors import InputError
from butterfly.plant.watch import picture
from butterfly.plant.watch.picture import Painter, caption_text, captioned, film
from tests.plant.setting import ADDED, robot, skip_where_nothing_is_drawn

ROBOT = robot()
TIMES, ANGLES = np.array([0.0, 0.2]), np.array([-0.8, 0.8])


@pytest.fixture(scope="module", autouse=True)
def _can_draw():
    skip_where_nothing_is_drawn()


def _mass_column(picture):
    """Mean column of the orange pixels: where the added mass is."""
    pixels = np.asarray(picture.convert("RGB")).astype(int)
    return np.argwhere(pixels[..., 0] - pixels[..., 2] > 60)[:, 1].mean()


@pytest.mark.parametrize("ending", [".gif", ".webp"])
def test_a_film_shows_the_motion_at_the_frames_per_second_asked_for(tmp_path, ending):
    path = tmp_path / f"hand{ending}"
    film(ROBOT, ADDED, TIMES, ANGLES, path, fps=10, size=120)
    with Image.open(path) as picture:
        frames = [frame.copy() for frame in ImageSequence.Iterator(picture)]
        columns = [_mass_column(frame) for frame in frames]
        assert picture.info["duration"] == 100
        corners = [np.asarray(frame.convert("L"))[:20, 79:] for frame in frames]
    assert len(columns) == 2
    assert np.all(np.diff(columns) > 0)
    assert all((corner < 128).sum() > 20 for corner in corners)  # time and angle
    assert all((one != other).any() for one, other in pairwise(corners))


# imageio-ffmpeg leaves the pipes to its encoder to be closed by the garbage collector.
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_an_mp4_holds_the_same_frames(tmp_path):
    iio = pytest.importorskip("imageio.v3", reason="the extra 'video' is not installed")
    path = tmp_path / "hand.mp4"
    film(ROBOT, ADDED, TIMES, ANGLES, path, fps=10, size=128)
    frames = iio.imread(path)
    gc.collect()
    assert frames.shape == (2, 128, 128, 3)
    columns = [_mass_column(Image.fromarray(frame)) for frame in frames]
    assert np.all(np.diff(columns) > 0)


def test_an_unknown_film_format_is_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(InputError, match=r"got \.avi; expected \.mp4, \.gif or \.webp"):
        film(ROBOT, ADDED, TIMES, TIMES, tmp_path / "hand.avi")


def test_time_and_angle_are_written_with_their_units_and_no_0_is_negative():
    assert caption_text(3.251, -12.5664, "θ") == "t = 3.25 s\nθ = -12.566 rad"
    assert caption_text(0.0, -1e-5, "θ") == "t = 0.00 s\nθ = +0.000 rad"


@pytest.mark.parametrize("size", [240, 480, 1024])
def test_the_caption_fits_into_its_corner(size):
    blank = Image.new("RGB", (size, size), "white")
    ink = np.argwhere(np.asarray(captioned(blank, 100.0, -12.566).convert("L")) < 200)
    assert ink[:, 0].max() < 0.2 * size
    assert ink[:, 1].min() > 0.6 * size
    assert ink[:, 1].max() < size - 1


def _blue(picture):
    """Pixels of the plates."""
    pixels = np.asarray(picture.convert("RGB")).astype(int)
    return pixels[..., 2] - pixels[..., 0] > 30


def test_a_ghost_is_drawn_where_the_simulation_is_and_lets_the_solid_be_seen():
    with Painter(ROBOT, ADDED, 200) as painter:
        alone, beside, same = (painter.frame(0.6, ghost) for ghost in (None, -0.2, 0.6))
    added = _blue(beside) & ~_blue(alone)
    assert added.sum() > 200
    colours = [np.asarray(each)[mask] for each, mask in ((beside, added), (alone, _blue(alone)))]
    assert colours[0].mean() > colours[1].mean() + 20  # the paper shines through
    assert not (_blue(same) & ~_blue(alone)).sum() > 50


def test_shadows_are_soft_and_edges_smooth_of_pictures_drawn_larger_or_not(monkeypatch):
    for size, largest in ((320, 320), (640, 639)):
        monkeypatch.setattr(picture, "_LARGE", largest)
        with Painter(ROBOT, ADDED, size) as painter:
            grey = np.asarray(painter.frame(0.6).convert("L")).astype(int)
        shadow = grey[int(0.93 * size) :, int(0.75 * size) :]
        levels = np.unique(shadow[shadow < 240])
        assert shadow.min() < 215
        assert len(levels) >= 5
        row = grey[size // 2, : size // 4]  # the ring's left edge
        steps = np.abs(np.diff(row))
        assert np.count_nonzero(steps > 8) >= 3 > np.count_nonzero(steps > 60)
