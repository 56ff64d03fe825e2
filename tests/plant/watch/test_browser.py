"""What the browser's viewer shows beside the hand; who may see it, `test_show.py`."""

from types import SimpleNamespace

import mujoco
import pytest
from mujoco.studio import messages

from butterfly.plant.mjcf import compile_model
from butterfly.plant.watch import browser
from tests.plant.test_setup import ADDED, ROBOT


@pytest.fixture(name="front")
def _front():
    model = compile_model(ROBOT, ADDED, scene=True)
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
