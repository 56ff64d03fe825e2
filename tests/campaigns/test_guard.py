"""The guard of a motion, shown readings of joints whose motion is known in closed form."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.campaigns import guard as module
from butterfly.campaigns.drive import SafetyStop
from butterfly.campaigns.guard import Expected, Limits, MotionGuard
from butterfly.plant.motor import Reading

STEP = 0.002


class Shown:
    """A guard that is shown angles, cycle by cycle."""

    def __init__(self, *, step=STEP, resonance=None, stiffness=None, breakaway=math.inf, **limits):
        self.guard = MotionGuard(Limits(**{"command": 1.0, "angle": 1.0} | limits), step)
        if resonance is not None:
            self.guard.model = Expected(resonance=resonance, stiffness=stiffness)
        self.guard.breakaway = breakaway
        self.guard.home = 0.0
        self.step, self.time = step, 0.0

    def show(self, angle, command=0.0, current=math.nan):
        self.guard.saw(Reading(self.time, float(angle), current))
        self.guard.sent(command)
        self.guard.waited(self.step)
        self.time += self.step

    def stopped_after(self, angles, command=0.0, **more):
        """Return the s until it is stopped, and the last angle; None if it is not."""
        begin = self.time
        for angle in angles:
            try:
                self.show(angle, command, **more)
            except SafetyStop as stop:
                self.sentence = str(stop)
                return self.time - begin, angle
        return None


def times(seconds, step=STEP):
    return np.arange(0, seconds, step)


def counted(angles, counts):
    return np.round(angles * counts / math.tau) * math.tau / counts if counts else angles


@pytest.mark.parametrize("acceleration", [3.0, 25.0, 400.0])
@pytest.mark.parametrize("counts", [0, 8192, 1024])
def test_a_joint_that_runs_on_after_a_cut_is_switched_off_in_time(acceleration, counts):
    shown = Shown()
    path = counted(acceleration * times(2.0) ** 2 / 2, counts)
    begins = int(np.argmax(path > 0.6))
    assert shown.stopped_after(path[:begins], 0.5) is None
    assert shown.guard.exceeded(0.5)
    seconds, angle = shown.stopped_after(path[begins:])
    assert angle < 1.5
    beyond = max(seconds - math.sqrt(2 / acceleration) + math.sqrt(1.2 / acceleration), 0)
    assert beyond < 0.2


def test_a_joint_that_creeps_on_at_one_speed_is_switched_off_in_time_too():
    shown = Shown()
    path = 0.3 * times(6.0)
    _, angle = shown.stopped_after(path, 0.5)
    assert angle == pytest.approx(1 + 0.3 * 0.15, abs=0.01)
    assert "beyond 1 rad" in shown.sentence


@settings(max_examples=30, deadline=None)
@given(
    joint=st.tuples(st.floats(1.5, 20), st.floats(0, 0.5)),
    start=st.tuples(st.floats(0.02, 0.95), st.floats(0, math.tau)),
    counts=st.sampled_from([0, 65536, 4096, 1024]),
    is_cut=st.booleans(),
)
def test_a_joint_that_swings_out_by_itself_is_let(joint, start, counts, is_cut):
    (resonance, damping), (swing, phase), time = joint, start, times(4.0)
    shown = Shown(resonance=0.8 * resonance, stiffness=0.64 * resonance**2)
    path = counted(swing * np.exp(-damping * time) * np.cos(resonance * time + phase), counts)
    for angle in path[:10]:
        shown.show(angle, 0.2)
    if is_cut:
        shown.guard.save()
    assert shown.stopped_after(path[10:]) is None


def test_a_joint_that_gains_energy_at_command_0_is_stopped_within_its_limits():
    shown = Shown(resonance=5.0, stiffness=25.0)
    still = np.zeros(200)
    assert shown.stopped_after(still) is None
    _, angle = shown.stopped_after(10 * times(1.0) ** 2 / 2)
    assert angle < 0.3
    assert "faster than when the command went to 0" in shown.sentence


def test_a_brake_that_pushes_the_wrong_way_is_stopped_within_a_tenth_of_a_time_constant():
    shown = Shown(resonance=4.0, stiffness=16.0)
    for angle in 0.1 + 0.2 * times(0.1):
        shown.show(angle, 0.1)
    shown.guard.save()
    away = times(1.0)
    seconds, angle = shown.stopped_after(0.12 + 0.2 * away + 12 * away**2 / 2, -0.1)
    assert seconds < 0.12
    assert angle < 0.3


def test_friction_that_holds_a_joint_is_no_dead_encoder_and_a_dead_one_is():
    shown = Shown(breakaway=0.1)
    slow = 0.095 * np.sin(2 * times(8.0))  # within what friction holds either way
    assert all(shown.stopped_after([0.3], command) is None for command in slow)
    relay = [0.15] * 150 + [-0.15] * 400
    since = [k for k, command in enumerate(relay) if shown.stopped_after([0.3], command)]
    assert 150 < since[0] < 150 + 0.8 / STEP
    assert "no longer moves" in shown.sentence


def test_noise_of_a_brake_moves_nothing_and_is_no_sign_of_a_dead_encoder():
    shown = Shown(breakaway=0.1)
    rng = np.random.default_rng(1)
    commands = 0.3 * rng.choice([-1, 1], 2000)
    assert all(shown.stopped_after([0.3], command) is None for command in commands)


@pytest.mark.parametrize("counts", [0, 8192])
def test_an_encoder_that_stands_at_once_is_seen_where_a_joint_cannot_stop_so_fast(counts):
    def swing(time):
        return 0.5 * np.sin(4 * time)

    shown = Shown()
    assert shown.stopped_after(counted(swing(times(3.2)), counts), 0.2) is None
    seconds, _ = shown.stopped_after(counted(swing(3.2) * np.ones(300), counts), 0.2)
    assert seconds < 0.1
    assert "stopped abruptly" in shown.sentence
    again = Shown()
    assert again.stopped_after(counted(swing(times(3.2)), counts), 0.2) is None
    braked = np.minimum(times(2.0), 1.9 / 9)  # by friction that takes 9 rad/s^2, as it has seen
    path = swing(3.2) + np.sign(math.cos(12.8)) * (1.9 * braked - 9 * braked**2 / 2)
    assert again.stopped_after(counted(path, counts), 0.0) is None


def test_an_angle_that_no_joint_reaches_in_a_cycle_is_a_jump():
    shown = Shown()
    assert shown.stopped_after(np.zeros(100)) is None
    assert shown.stopped_after([0.3]) is not None
    assert "slips" in shown.sentence


@pytest.mark.parametrize(
    ("of_drive", "of_computer", "fails"),
    [(1.0, 0.001, False), (1.0, 7.0, False), (1.5, 1.5, False), (0.5, 1.0, True), (2.0, 1.0, True)],
    ids=["simulated", "simulated slowly", "late cycles", "half speed", "double speed"],
)
def test_the_clock_of_the_drive_is_held_against_the_computers(
    monkeypatch, of_drive, of_computer, fails
):
    shown, begun = Shown(), 100.0
    monkeypatch.setattr(module.computer, "monotonic", lambda: begun + of_computer * shown.time)

    def show(cycle):
        time = cycle * STEP
        shown.time = time
        shown.guard.saw(Reading(of_drive * time, 0.0, math.nan))
        shown.guard.sent(0.0)
        shown.guard.waited(STEP)

    if fails:
        with pytest.raises(SafetyStop, match="clock"):
            [show(cycle) for cycle in range(3000)]
    else:
        [show(cycle) for cycle in range(3000)]


def test_a_limit_of_speed_and_of_current_hold_while_the_joint_is_braked():
    shown = Shown(speed=2.0)
    shown.guard.save()
    seconds, _ = shown.stopped_after(3.0 * times(0.4) - 0.5, 0.1)
    assert seconds < 0.2
    assert "speed" in shown.sentence
    shown = Shown(current=3.0)
    seconds, _ = shown.stopped_after(np.zeros(400), current=4.0)
    assert seconds < 0.2
