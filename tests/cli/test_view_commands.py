"""Films and pictures from the command line."""

import gc

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.io import loadmat

from butterfly.model.parameters import AddedMass
from butterfly.plant.robot import Robot
from butterfly.plant.watch import picture
from butterfly.plant.watch.picture import Painter, RenderingError
from tests.cli.one_line import assert_one_line_error
from tests.conftest import ROBOT


@pytest.fixture
def painted(monkeypatch):
    """Angles that are drawn, in place of the pictures."""
    angles = []

    class Painter:
        def __init__(self, _robot, _added, size):
            self.size = size

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def frame(self, angle):
            angles.append(angle)
            return Image.new("RGB", (self.size, self.size), (len(angles), 0, 0))

    monkeypatch.setattr(picture, "Painter", Painter)
    return angles


ROUGH = {
    "simulator": "grey-box",
    "clock": {"step": 0.002, "jitter": 0.0003},
    "path": {"limit": 0.02, "delay": 0.003},
    "faults": {"dropped": 0.01},
}


@pytest.mark.parametrize("changes", [{}, {"path": {"limit": 0.02}}, ROUGH])
def test_a_film_draws_the_log_that_simulate_writes(
    butterfly, quick_in_mujoco, tmp_path, painted, changes
):
    content = yaml.safe_load(quick_in_mujoco.read_text())
    content.update(duration=4.0, seed=7)
    content["plant"].update(changes)
    experiment = tmp_path / "film.yaml"
    experiment.write_text(yaml.safe_dump(content))
    film = tmp_path / "hand.gif"
    asked = ("--run", 5, "--seconds", 3, "--fps", 20, "--size", 32)
    code, out, _ = butterfly("video", experiment, "--out", film, *asked)
    assert (code, out) == (0, f"Film: {film}\n")
    assert butterfly("simulate", experiment, "--out", tmp_path / "logs")[0] == 0
    (path,) = (tmp_path / "logs").glob("run005_*.mat")
    time, _, angle, _ = loadmat(path)["D"].T
    instants = np.arange(time[0], time[time <= time[0] + 3][-1], 1 / 20)
    np.testing.assert_array_equal(painted, np.interp(instants, time, angle))
    assert np.ptp(painted) > 0.01
    with Image.open(film) as picture:
        assert picture.n_frames == len(painted)


def _needs_drawing():
    try:
        Painter(Robot.of_lumped(ROBOT), AddedMass(), 32).__exit__()
    except RenderingError as error:
        pytest.skip(str(error))


# imageio-ffmpeg leaves the pipes to its encoder to be closed by the garbage collector.
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
@pytest.mark.parametrize("ending", [".gif", ".mp4"])
def test_a_run_is_filmed(butterfly, quick, tmp_path, ending):
    _needs_drawing()
    iio = pytest.importorskip("imageio.v3", reason="the extra 'video' is not installed")
    film = tmp_path / f"hand{ending}"
    asked = ("--run", 4, "--seconds", 1, "--fps", 8, "--size", 64)
    code, out, err = butterfly("video", quick, "--out", film, *asked)
    assert (code, out) == (0, f"Film: {film}\n"), err
    frames = iio.imread(film)
    gc.collect()
    assert frames.shape == (8, 64, 64, 3)
    assert frames[0].std() > 10
    assert np.abs(frames[0].astype(float) - frames[-1]).max() > 30


def test_a_robot_is_drawn(butterfly, tmp_path):
    _needs_drawing()
    pictures = []
    for added in (0.0, 0.05):
        path = tmp_path / f"{added}.png"
        asked = ("--added-mass", added, "--angle", 0.8, "--size", 96)
        code, out, err = butterfly("model", "render", "quickstart", "--out", path, *asked)
        assert (code, out) == (0, f"Picture: {path}\n"), err
        with Image.open(path) as picture:
            pictures.append(np.asarray(picture.convert("RGB")).astype(int))
    orange = [np.argwhere(p[..., 0] - p[..., 2] > 60) for p in pictures]
    assert orange[0].size == 0
    assert orange[1][:, 1].mean() > 48  # to the right of the pivot, at a positive angle
    assert pictures[0].shape == (96, 96, 3)


def test_a_run_that_does_not_exist_cannot_be_filmed(butterfly, tmp_path):
    result = butterfly("video", "quickstart", "--run", 24, "--out", tmp_path / "x.gif")
    assert_one_line_error(result, "--run", "got 24", "from 0 to 23")
