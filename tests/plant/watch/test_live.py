"""What `butterfly show` steps, without a window."""

import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from butterfly.logs.log import Sine
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder
from butterfly.plant.watch.live import LiveRun, RealTime, watch
from butterfly.plant.watch.picture import RenderingError
from butterfly.signals.excitations import FreeDecay
from tests.plant.setting import ADDED, MOTOR, SINE, robot

ROUGH = Rig(
    robot=robot(replace(MOTOR, inductance=0.002), coulomb=3e-4),
    clock=Clock(step=0.002, jitter=3e-4),
    path=CommandPath(limit=0.2, delay=0.0037),
    encoder=Encoder(noise=1e-4),
)
SEED = np.random.SeedSequence(5)


class _Wall:
    """A clock on the wall that is moved by hand."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.mark.parametrize("simulator", Simulator)
@pytest.mark.parametrize("excitation", [SINE, FreeDecay(angle=0.5)])
def test_the_samples_of_a_watched_run_are_those_of_its_log(simulator, excitation):
    """Samples that are stepped, and angles that are shown, in real time by a wall clock."""
    rig = replace(ROUGH, simulator=simulator)
    run, wall = LiveRun(rig, ADDED, excitation, 0.5, SEED), _Wall()
    seen, forward = [(*run.sample, run.data.qpos[0])], run.advance

    def advance():
        forward()
        seen.append((*run.sample, run.data.qpos[0]))

    run.advance = advance
    pace = RealTime(run, wall)
    while run.elapsed < 0.45:
        pace.catch_up()
        assert run.elapsed <= wall.now - 100.0 + 0.004
        wall.now += 0.01
    (log,) = simulate_runs(rig, [(ADDED, excitation)], 0.5, [SEED])
    assert len(seen) > 0.85 * log.time.size
    for values, column in zip(np.transpose(seen), (log.time, log.input, log.angle), strict=False):
        np.testing.assert_array_equal(values, column[: len(seen)])
    angles, shown = np.transpose(seen)[2:]
    np.testing.assert_allclose(shown, angles, atol=1e-3)  # encoder and its noise apart
    assert np.ptp(shown) > 0.02


@pytest.mark.parametrize("simulator", Simulator)
def test_a_viewer_gets_a_model_with_light_and_camera_that_shows_the_hand_turned(simulator):
    rig = replace(ROUGH, simulator=simulator)
    run = LiveRun(rig, ADDED, FreeDecay(angle=0.5), 1.0, SEED)
    assert run.model.nlight == 7
    assert run.model.camera("bench").id == 0
    for _ in range(100):
        run.advance()
    mujoco.mj_kinematics(run.model, run.data)
    along = run.data.body("added_mass").xpos
    assert np.arctan2(along[0], -along[2]) == pytest.approx(run.sample[2], abs=1e-3)


@pytest.mark.parametrize("simulator", Simulator)
def test_at_its_end_and_when_a_viewer_resets_it_the_run_starts_again(simulator):
    run = LiveRun(replace(ROUGH, simulator=simulator), ADDED, SINE, 0.1, SEED)

    def samples(count):
        return [run.advance() or run.sample for _ in range(count)]

    first = [run.sample, *samples(50)]
    assert samples(1) == first[:1]
    assert run.elapsed == pytest.approx(first[-1][0])
    assert samples(19) == first[1:20]
    mujoco.mj_resetData(run.model, run.data)
    assert samples(51) == first


def test_a_frame_ends_even_if_a_sample_costs_more_than_it_lasts():
    run = LiveRun(Rig(robot=robot()), ADDED, Sine(omega=3.0, amplitude=0.1), 60.0, SEED)
    wall = _Wall()
    pace = RealTime(run, wall)
    pace.catch_up()
    taken = []
    cheap = run.advance

    def dear():
        taken.append(1)
        wall.now += 0.005  # for a sample of 1 ms
        cheap()

    run.advance = dear
    for _ in range(200):
        wall.now += 0.01
        begun = wall.now
        pace.catch_up()
        assert wall.now - begun <= 0.02 + 0.005
    assert len(taken) > 500
    wall.now += 3600.0  # the machine slept
    pace.catch_up()
    assert run.elapsed < 2.0


def test_without_a_display_the_viewer_says_what_else_there_is(monkeypatch):
    if sys.platform != "linux":
        pytest.skip("other systems always have a display")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderingError, match="--web"):
        watch(LiveRun(Rig(robot=robot()), ADDED, SINE, 1.0, SEED))
