import gc
import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial
from http.client import HTTPConnection
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from butterfly.errors import InputError
from butterfly.logs.log import Sine
from butterfly.model.friction import Friction
from butterfly.model.parameters import AddedMass, Hand, TorqueDrive
from butterfly.plant.robot import Robot
from butterfly.plant.setup import Setup
from butterfly.plant.watch.picture import Painter, RenderingError
from butterfly.plant.watch.show import film, watch

ROBOT = Robot(
    hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003),
    drive=TorqueDrive(gain=1.0),
    friction=Friction(),
)
ADDED = AddedMass(mass=0.05, arm=0.104)
TIMES = np.array([0.0, 1.0])


@pytest.fixture(scope="module", autouse=True)
def _can_draw():
    try:
        Painter(ROBOT, ADDED, 32).__exit__()
    except RenderingError as error:
        pytest.skip(str(error))


def _mass_column(picture):
    """Mean column of the orange pixels: where the added mass is."""
    pixels = np.asarray(picture.convert("RGB")).astype(int)
    return np.argwhere(pixels[..., 0] - pixels[..., 2] > 60)[:, 1].mean()


@pytest.mark.parametrize("ending", [".gif", ".webp"])
def test_a_film_shows_the_motion_at_the_frames_per_second_asked_for(tmp_path, ending):
    path = tmp_path / f"hand{ending}"
    film(ROBOT, ADDED, TIMES, np.array([-0.8, 0.8]), path, fps=10, size=120)
    with Image.open(path) as picture:
        frames = [frame.copy() for frame in ImageSequence.Iterator(picture)]
        columns = [_mass_column(frame) for frame in frames]
        assert picture.info["duration"] == 100
        corners = [np.asarray(frame.convert("L"))[:20, 79:] for frame in frames]
    assert len(columns) == 10
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
    film(ROBOT, ADDED, TIMES, np.array([-0.8, 0.8]), path, fps=10, size=128)
    frames = iio.imread(path)
    gc.collect()
    assert frames.shape == (10, 128, 128, 3)
    columns = [_mass_column(Image.fromarray(frame)) for frame in frames]
    assert np.all(np.diff(columns) > 0)


def test_an_unknown_film_format_is_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(InputError, match=r"got \.avi; expected \.mp4, \.gif or \.webp"):
        film(ROBOT, ADDED, TIMES, TIMES, tmp_path / "hand.avi")


def test_without_a_display_the_viewer_says_what_else_there_is(monkeypatch):
    if sys.platform != "linux":
        pytest.skip("other systems always have a display")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderingError, match="--web"):
        watch(
            Setup(robot=ROBOT),
            ADDED,
            Sine(omega=3.0, amplitude=0.1),
            1.0,
            np.random.SeedSequence(0),
        )


def _status(port, path, patience=30.0, **headers):
    """Status and headers of a page whose server has been announced but may still be starting."""
    deadline = time.monotonic() + patience
    while True:
        try:
            link = HTTPConnection("127.0.0.1", port, timeout=patience)
            link.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
            answer = link.getresponse()
            answer_headers = dict(answer.getheaders())
            link.close()
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
        else:
            return answer.status, answer_headers


@contextmanager
def _viewer(folder, *options):
    words = [sys.executable, "-m", "butterfly", "view", "quickstart", "--web", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(words, **pipes, text=True, cwd=folder) as viewer:  # noqa: S603 - our own
        try:
            yield viewer
        finally:
            viewer.terminate()


HANDSHAKE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
}


def test_the_browser_s_viewer_asks_who_comes_is_served_on_loopback_alone_and_prints_one_line(
    tmp_path,
):
    with _viewer(tmp_path) as viewer:
        line = viewer.stdout.readline()
        port, token = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", line).groups()
        status, headers = _status(int(port), f"/?token={token}")
        assert status == 200
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert "HttpOnly; SameSite=Strict" in headers["Set-Cookie"]
        ask = partial(_status, int(port), Cookie=cookie)
        own = f"http://127.0.0.1:{port}"
        assert ask("/model")[0] == 200
        assert ask("/state?sid=1", Origin=own, **HANDSHAKE)[0] == 101
        assert ask("/state?sid=1", Origin="http://evil.example", **HANDSHAKE)[0] == 403
        assert ask("/ui?sid=1", Origin="null", **HANDSHAKE)[0] == 403
        assert ask("/", Host=f"evil.example:{port}")[0] == 403
        assert _status(int(port), "/")[0] == 403
        assert _status(int(port), "/?token=guess")[0] == 403
        assert _status(int(port), "/drop", Origin=own, **HANDSHAKE)[0] == 403
        if Path("/proc/net/tcp").exists():
            assert _listening(int(port)) == [f"0100007F:{int(port):04X}"]
        viewer.terminate()
        assert viewer.stdout.read() == ""


def _listening(port):
    """Addresses at which a port is listened to, as Linux writes them."""
    return [
        row.split()[1]
        for table in ("tcp", "tcp6")
        for row in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
        if row.split()[3] == "0A" and row.split()[1].endswith(f":{port:04X}")
    ]


def test_a_port_that_is_taken_is_one_line(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with _viewer(tmp_path, "--port", str(port)) as viewer:
            said, _ = viewer.communicate(timeout=60)
    assert re.fullmatch(
        rf"error: butterfly show: --port: got {port} \(.*\); .*a free one.*\n", said
    )
