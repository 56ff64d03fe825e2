"""What the viewer in a browser shows, and to whom: nobody without its address."""

import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from types import SimpleNamespace

import mujoco
import pytest
from mujoco.studio import messages

from butterfly.plant.mjcf import compile_model
from butterfly.plant.watch import browser
from tests.plant.setting import ADDED, robot

GUARD = browser.Guard(8001, "known-to-one")
HOST = {"Host": "127.0.0.1:8001"}
LOCAL = {"Host": "localhost:8001"}
COOKIE = {"Cookie": GUARD.cookie.partition(";")[0]}


@pytest.fixture(name="front")
def _front():
    model = compile_model(robot(), ADDED, scene=True)
    front = browser.Front()
    front.viewer = SimpleNamespace(camera=mujoco.MjvCamera(), data=mujoco.MjData(model))
    front.look(messages.PostModelEvent(model=model, data=front.viewer.data))
    return front


def test_the_browser_looks_at_the_hand_s_front(front):
    camera = front.viewer.camera
    assert (camera.azimuth, camera.elevation) == (117, -10)
    assert camera.distance < 1.0


def test_the_browser_tells_time_and_angle(front, monkeypatch):
    said = []
    pane = {name: lambda *_: None for name in ("Begin", "End")}
    flags = browser.dear_imgui.WindowFlags
    stand_in = SimpleNamespace(Text=said.append, WindowFlags=flags, **pane)
    monkeypatch.setattr(browser, "dear_imgui", stand_in)
    front.viewer.data.time, front.viewer.data.qpos[0] = 2.5, -0.125
    front.tell(messages.BuildGuiEvent())
    assert said == ["t = 2.50 s\nangle = -0.125 rad"]


@pytest.mark.parametrize(
    ("path", "headers", "admitted"),
    [
        (f"/?token={GUARD.token}", HOST, True),
        ("/model", HOST | COOKIE, True),
        ("/ui?sid=1", HOST | COOKIE | {"Origin": "http://127.0.0.1:8001"}, True),
        ("/", LOCAL | COOKIE | {"Origin": "http://localhost:8001"}, True),
        ("/", HOST, False),
        ("/?token=", HOST, False),
        (f"/?token={GUARD.token[:-1]}", HOST, False),
        ("//[?token=x", HOST, False),
        ("/", COOKIE, False),
        ("/", {"Host": "evil.example:8001"} | COOKIE, False),
        ("/", {"Host": "127.0.0.1:8002"} | COOKIE, False),
        ("/ui", HOST | COOKIE | {"Origin": "http://evil.example"}, False),
        ("/ui", HOST | COOKIE | {"Origin": "null"}, False),
        ("/ui", HOST | COOKIE | {"Origin": "http://["}, False),
        ("/ui", HOST | COOKIE | {"Origin": "https://127.0.0.1:8001"}, False),
        ("/", HOST | {"Cookie": "butterfly-viewer-8001=guess"}, False),
        ("/", HOST | {"Cookie": "\x00=;;=,["}, False),
    ],
)
def test_who_knows_the_token_is_admitted_and_nobody_else(path, headers, admitted):
    refusal = GUARD.refusal(path, headers)
    assert refusal is None if admitted else refusal


def test_two_viewers_in_one_browser_do_not_lock_each_other_out():
    other = browser.Guard(8002)
    both = {"Cookie": "; ".join(each.cookie.partition(";")[0] for each in (GUARD, other))}
    assert GUARD.refusal("/", HOST | both) is None
    assert other.refusal("/", {"Host": "127.0.0.1:8002"} | both) is None


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
    words = [sys.executable, "-m", "butterfly", "show", "quickstart", "--web", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(words, **pipes, text=True, cwd=folder) as viewer:  # noqa: S603 - our own
        try:
            yield viewer
        finally:
            viewer.terminate()


HANDSHAKE = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec_WebSocket_Version": "13"}
HANDSHAKE |= {"Sec_WebSocket_Key": "MDEyMzQ1Njc4OWFiY2RlZg=="}


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_port_that_is_taken_is_one_line(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with _viewer(tmp_path, "--port", str(port)) as viewer:
            said, _ = viewer.communicate(timeout=60)
    assert re.fullmatch(
        rf"error: butterfly show: --port: got {port} \(.*\); .*a free port.*\n", said
    )
