import gc
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image, ImageSequence

from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass
from butterfly.plant.watch import picture
from butterfly.plant.watch.picture import Painter, caption_text, captioned, film, render
from tests.plant.setting import ADDED, robot, skip_where_nothing_is_drawn

ROBOT = robot()
TIMES, ANGLES = np.array([0.0, 0.2]), np.array([-0.8, 0.8])


@pytest.fixture(scope="module", autouse=True)
def _can_draw():
    skip_where_nothing_is_drawn()


def _excess(picture):
    """How much more blue than red each pixel is: the plates are, and the added mass is not."""
    pixels = np.asarray(picture.convert("RGB")).astype(int)
    return pixels[..., 2] - pixels[..., 0]


def _plates(picture):
    """Rows and columns of the pixels of the plates."""
    return np.argwhere(_excess(picture) > 50)


def _mass(picture):
    """Rows and columns of the pixels of the added mass."""
    return np.argwhere(_excess(picture) < -70)


@cache
def _frames(added, *angles):
    """Pictures of the hand at some angles."""
    with Painter(ROBOT, added, 200) as painter:
        return [painter.frame(angle) for angle in angles]


def test_a_picture_shows_the_hand_turned_and_its_mass(tmp_path):
    hanging, turned = _frames(ADDED, 0.0, 1.5)
    height, width = np.ptp(_plates(hanging), axis=0)
    assert height > 1.5 * width
    height, width = np.ptp(_plates(turned), axis=0)
    assert width > 1.3 * height
    assert _mass(hanging)[:, 0].mean() > 110
    render(ROBOT, ADDED, 0.5, tmp_path / "hand.png", 100)
    with Image.open(tmp_path / "hand.png") as picture:
        assert picture.size == (100, 100)


def test_up_and_down_look_different_and_an_added_mass_by_its_size():
    down, up = _frames(AddedMass(), 0.0, np.pi)
    apart = np.abs(np.asarray(up).astype(int) - np.asarray(down))
    assert (apart.max(axis=2) > 60).mean() > 0.003
    small, _ = _frames(ADDED, 0.0, 1.5)
    (large,) = _frames(AddedMass(mass=0.154, arm=0.104), 0.0)
    none, few, many = (len(_mass(each)) for each in (down, small, large))
    assert none == 0
    assert 30 < few < 0.6 * many


def test_an_added_mass_far_beyond_the_plate_stays_in_the_picture():
    for each in _frames(AddedMass(mass=2.0, arm=0.6), 0.0, 1.5, 3.0):
        seen = _mass(each)
        assert len(seen) > 30
        assert seen.min() > 0
        assert seen.max() < 199


# imageio-ffmpeg leaves the pipes to its encoder to be closed by the garbage collector.
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
@pytest.mark.parametrize("ending", [".gif", ".webp", ".mp4"])
def test_a_film_shows_the_motion_at_the_frames_per_second_asked_for(tmp_path, ending):
    path = tmp_path / f"hand{ending}"
    if ending == ".mp4":
        iio = pytest.importorskip("imageio.v3", reason="the extra 'video' is not installed")
    film(ROBOT, ADDED, TIMES, ANGLES, path, fps=10, size=128)
    if ending == ".mp4":
        frames = [Image.fromarray(each) for each in iio.imread(path)]
        gc.collect()
    else:
        with Image.open(path) as picture:
            frames = [frame.copy() for frame in ImageSequence.Iterator(picture)]
            assert picture.info["duration"] == 100
    assert [frame.size for frame in frames] == 2 * [(128, 128)]
    assert np.all(np.diff([_mass(frame)[:, 1].mean() for frame in frames]) > 0)
    corners = [np.asarray(frame.convert("L"))[:21, 84:] for frame in frames]
    assert all((corner < 128).sum() > 20 for corner in corners)  # time and angle
    assert all((one != other).any() for one, other in pairwise(corners))


def test_an_unknown_format_is_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(InputError, match=r"got \.avi; expected \.mp4, \.gif or \.webp"):
        film(ROBOT, ADDED, TIMES, TIMES, tmp_path / "hand.avi")
    with pytest.raises(InputError, match=r"got \.foo"):
        render(ROBOT, ADDED, 0.5, tmp_path / "hand.foo")


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


def test_a_ghost_is_drawn_where_the_simulation_is_and_lets_the_solid_be_seen():
    with Painter(ROBOT, ADDED, 200) as painter:
        alone, beside, same = (painter.frame(0.6, ghost) for ghost in (None, -0.2, 0.6))
    solid, more = (_excess(each) > 30 for each in (alone, beside))
    colours = [np.asarray(each)[mask] for each, mask in ((beside, more & ~solid), (alone, solid))]
    assert len(colours[0]) > 200
    assert colours[0].mean() > colours[1].mean() + 20  # the paper shines through
    assert not ((_excess(same) > 30) & ~solid).sum() > 50


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
