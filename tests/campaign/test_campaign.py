"""Campaigns with simulated robots of known parameters, sound ones and such as fail."""

import math
from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.campaigns import folder
from butterfly.campaigns.bench import Bench
from butterfly.campaigns.callbacks import CampaignCallbacks
from butterfly.campaigns.contact import Contact
from butterfly.campaigns.drive import SafetyStop
from butterfly.campaigns.folder import Journal, Step
from butterfly.campaigns.guard import Limits
from butterfly.campaigns.laws import Relay, Signal
from butterfly.errors import InputError
from butterfly.identification.design import OF_GOAL
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.plant.motor import CommandPath, Reading
from butterfly.plant.rig import Rig, SimulatedMotor, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import Encoder

TRUE = LumpedParameters(p1=0.004, p2=0.002, p3=0.05, p4=0.3, coulomb=0.001)
COMMAND = 0.15


def rig(simulator=Simulator.GREY_BOX, true=TRUE):
    return Rig(
        robot=Robot.of_lumped(true),
        simulator=simulator,
        encoder=Encoder(steps=8192, noise=2e-4),
        path=CommandPath(limit=COMMAND, delay=0.004),
    )


def robot(of=None):
    of = of or rig()
    return SimulatedMotor(of.joint(NO_ADDED_MASS), path=of.path, encoder=of.encoder)


class Faulty:
    """A robot's motor with something wrong from some time on, as ``wrong`` says."""

    def __init__(self, wrong, since=0.0, of=None):
        self._rig, self._wrong, self._since = of or rig(), wrong, since
        self._inner = robot(self._rig)
        self.input_kind = self._inner.input_kind
        self.commands, self.stopped, self._passed, self._mounts, self.farthest = [], 0, 0.0, 0, 0.0
        self._stuck, self.last_readings = 0.0, (0.0, 0.0)

    def start(self):
        self._inner.start()

    def stop(self):
        self._inner.stop()
        self.stopped += 1

    def command(self, value):
        if self._wrong == "unplugged" and self._passed >= self._since:
            raise OSError("device not configured")
        self.commands.append(value)
        acts = self._wrong == "no supply" and self._passed >= self._since
        odd = self._passed % 2 > 1
        sent = {
            "reversed": -value,
            "one way": abs(value),
            "loose": value * odd,
            "fading": value * (0.1 if odd else 1.0),
        }.get(self._wrong, value)
        self._inner.command(0.0 if acts else sent)
        return max(-COMMAND, min(COMMAND, value))

    def read(self):
        time, angle, current = self._inner.read()
        self.farthest = max(self.farthest, abs(angle))
        self.last_readings = (*self.last_readings[1:], angle)
        self._stuck = angle if self._passed < self._since else self._stuck
        at_rest = not any(self.commands[-50:])
        if self._passed < self._since or (
            self._since > 0 and self._wrong == "slips" and not at_rest
        ):
            return Reading(time, angle, current)
        beyond = self._passed - self._since
        self._since = -math.inf if self._wrong == "slips" else self._since
        return {
            "cable": Reading(time, math.nan, current),
            "frozen": Reading(time, self._stuck, current),
            "late": Reading(time + beyond * 200, angle, current),
            "back": Reading(time - 2 * beyond, angle, current),
            "slips": Reading(time, angle + 0.3, current),
            "current": Reading(time, angle, 50.0),
            "end stop": Reading(time, min(angle, 0.05), current),
        }.get(self._wrong, Reading(time, angle, current))

    def wait(self, duration):
        self._passed += duration
        self._inner.wait(duration)

    def carry(self, mass):
        self._mounts += 1
        if self._wrong != "not mounted" and (self._wrong != "mounted once" or self._mounts == 1):
            self._inner.mount(self._rig.joint(mass))


def run(motor, folder, **options):
    given = {"command": COMMAND, "masses": (0.0, 0.1), "arm": 0.1, "change": motor.carry}
    given |= {"step": 0.005} | options  # a cycle that leaves time to the tests
    return bf.campaign(motor, out=folder, **given)


class Heard(CampaignCallbacks):
    """Keeps what it is told, and how many commands there were by then."""

    def __init__(self, motor):
        self._motor, self.announced, self.phases, self.cycles = motor, None, [], 0

    def begin(self, announcement):
        self.announced = len(self._motor.commands), " ".join(announcement)

    def phase(self, sentence):
        self.phases.append(sentence)

    def cycle(self, *_):
        self.cycles += 1


def test_a_campaign_says_what_it_does_and_why_and_ends_at_rest(tmp_path):
    motor = Faulty("")
    heard = Heard(motor)
    found = run(motor, tmp_path / "a", callbacks=heard)
    commands, announcement = heard.announced
    assert commands == 0
    assert "Limits: command 0.15 unit, angle 1 rad from rest" in announcement
    assert heard.cycles > 1000
    begins = [sentence for sentence in heard.phases if ": to " in sentence or "gives" in sentence]
    assert [sentence[:5] for sentence in begins] == [f"Run {k}" for k in range(len(begins))]
    assert len(begins) == len(found.rows())
    assert all("s of robot time" in sentence for sentence in begins)
    assert "predicted, not fitted" in begins[-1]
    assert motor.stopped == len(found.rows()) + 1  # after contact and after each run
    before, after = motor.last_readings
    assert abs(after) < 0.05
    assert abs(after - before) < 1e-3


def test_an_unknown_robot_is_known_to_one_per_cent_after_a_minute(tmp_path):
    found = run(Faulty("reversed"), tmp_path / "a", known=None, step=None)
    estimate = found.identification.estimate
    assert found.reached
    assert found.content["polarity"] == -1
    assert found.content["changes"] == 1
    assert found.content["robot_time"] < 90
    for name in OF_GOAL:
        assert estimate.named[name] == pytest.approx(getattr(TRUE, name), rel=0.015)
    assert min(found.content["held_out"].values()) > 99


def test_the_same_in_mujoco(tmp_path):
    found = run(Faulty("", of=rig(Simulator.MUJOCO)), tmp_path / "a")
    values = found.identification.estimate.named
    assert found.reached
    assert all(values[n] == pytest.approx(getattr(TRUE, n), rel=0.015) for n in OF_GOAL)


def test_identify_answers_alike_from_the_folder_and_a_saved_campaign_shows_what_it_showed(tmp_path):
    found = run(Faulty(""), tmp_path / "a")
    again = bf.identify(tmp_path / "a")
    assert again.estimate.named == pytest.approx(found.identification.estimate.named)
    found.save(tmp_path / "saved.json")
    loaded = bf.load(tmp_path / "saved.json")
    assert (str(loaded), loaded.rows()) == (str(found), found.rows())
    assert "shrinking" in found.page_path.read_text(encoding="utf-8")


def test_a_known_gain_needs_no_change_of_mass(tmp_path):
    found = run(Faulty(""), tmp_path / "a", known={"p4": TRUE.p4})
    assert found.reached
    assert found.content["changes"] == 0


def test_without_a_mass_ratios_are_all_that_is_claimed(tmp_path):
    found = run(Faulty(""), tmp_path / "a", masses=(0.0,), change=None)
    assert not found.reached
    assert "ratios are known" in found.content["ending"]
    assert found.identification.estimate.named["p3"] == pytest.approx(12.5, rel=0.01)


@pytest.mark.parametrize(("owner", "after"), [(Bench, 1), (Bench, 2), (folder, 5)])
def test_a_campaign_that_was_killed_goes_on_and_ends_alike(tmp_path, monkeypatch, owner, after):
    name = "run" if owner is Bench else "write_file"  # a journal then, before its manifest
    kept, calls = getattr(owner, name), []

    def killed(of, what, *more, **options):
        motor = getattr(getattr(of, "_drive", None), "_motor", None)
        laws = isinstance(motor, Faulty) and isinstance(what, Relay | Signal)
        calls.append(laws or owner is folder)
        if sum(calls) > after:
            raise KeyboardInterrupt
        return kept(of, what, *more, **options)

    monkeypatch.setattr(owner, name, killed)
    motor = Faulty("")
    with pytest.raises(KeyboardInterrupt):
        run(motor, tmp_path / "a")
    assert motor.commands[-1] == 0
    assert motor.stopped
    monkeypatch.undo()
    found = run(Faulty(""), tmp_path / "a")
    assert found.reached
    assert len(found.rows()) == len(list((tmp_path / "a").glob("*.parquet")))


FAILURES = [
    ("no supply", 0.0, "nothing moves", {}),
    ("no supply", 12.0, "no longer moves", {}),
    pytest.param("loose", 0.0, "no longer moves", {"step": None}, marks=pytest.mark.slow),
    ("one way", 0.0, "both signs", {}),
    ("cable", 12.0, "no number", {}),
    ("frozen", 12.0, "no longer moves|nothing moves", {}),
    ("late", 12.0, "passed between two readings", {}),
    ("back", 12.0, "ran back", {}),
    *[("slips", since, "slips", {}) for since in (14.0, 20.0, 22.0)],
    ("not mounted", 0.0, "not mounted", {}),
    ("mounted once", 0.0, "as it did with 100 g at 100 mm", {"goal": 1e-4, "price": 0.0}),
    *[("current", since, "50 A beyond 10 A", {"current": 10.0}) for since in (0.0, 12.0)],
    ("unplugged", 12.0, "no longer answers", {}),
]


@pytest.mark.parametrize(("wrong", "since", "said", "options"), FAILURES)
def test_what_is_wrong_ends_in_words_with_the_drive_off_and_nothing_lost(
    tmp_path, wrong, since, said, options
):
    motor = Faulty(wrong, since)
    with pytest.raises(SafetyStop, match=said):
        run(motor, tmp_path / "a", **options)
    assert motor.commands[-1] == 0 or wrong == "unplugged"
    assert motor.stopped
    kept = len(list((tmp_path / "a").glob("run_???.parquet"))) if (tmp_path / "a").exists() else 0
    assert kept == (len(bf.read(tmp_path / "a").recorded) if kept else 0)


@pytest.mark.slow
def test_readings_that_end_at_a_stop_are_not_followed_and_no_goal_is_claimed(tmp_path):
    found = run(Faulty("end stop"), tmp_path / "a")
    assert not found.reached
    assert "no end stop or cable touches the joint" in found.content["ending"]


def test_what_the_model_does_not_follow_ends_in_words_after_small_runs(tmp_path):
    found = run(Faulty("fading"), tmp_path / "a", step=None)
    assert not found.reached
    assert "encoder does not slip, and that no end stop" in found.content["ending"]
    shows = "residual" if found.identification is not None else "inspect"  # what can be shown
    assert f"butterfly {shows}" in str(found)
    assert all("relay of 0.18 rad" in row["played"] for row in found.rows())


def test_where_friction_holds_the_joint_anywhere_it_stays_within_a_tenth_of_its_limit(tmp_path):
    stiff = Faulty("", of=rig(true=replace(TRUE, p3=0.01, coulomb=0.01)))
    found = run(stiff, tmp_path / "a", angle=0.3)
    assert found.reached
    assert stiff.farthest < 0.33


def test_runs_that_bring_less_than_half_of_what_was_expected_are_in_vain():
    def step(share, expected=None, name="p2", **more):
        about = {"what": "", "why": "", "added_mass": NO_ADDED_MASS, "seconds": 1.0}
        return Step(**about, shares={name: share} if share else {}, expected=expected, **more)

    def in_vain(*steps):
        return len(Journal(input_kind="torque", contact=Contact(1, 0.1), steps=steps).in_vain)

    assert in_vain(step(None), step(None)) == 2
    assert in_vain(step(8.0), step(3.9, 2.0)) == 0  # half of the way is to 4
    assert in_vain(step(8.0), step(4.1, 2.0), step(6.0, 1.0)) == 2
    assert in_vain(step(8.0), step(9.0, 2.0), step(1.0, 2.0)) == 0
    assert in_vain(step(8.0), step(9.0, 2.0), step(30.0, 2.0, "p1")) == 0  # the scale is known
    assert in_vain(step(8.0), step(9.0, 2.0), step(None, held_out=True)) == 1


@pytest.mark.parametrize(("command", "brake"), [(0.03, COMMAND), (COMMAND, 0.02)])
def test_a_limit_cuts_a_run_short_and_the_drive_is_off_where_the_brake_is_too_weak(command, brake):
    motor = Faulty("", of=rig(true=replace(TRUE, p2=1e-4, coulomb=0.0)))
    with Bench(motor, Limits(command=COMMAND, angle=0.2), 0.002) as bench:
        bench.settle()
        bench.braked_with(brake, 0.5)
        cut = bench.run(lambda _: command, 5.0)
        if brake >= command:
            bench.settle()
        else:
            with pytest.raises(SafetyStop, match="beyond its limit"):
                bench.settle()
    assert "swing" in cut.cut
    assert np.abs(cut.angle).max() < 0.22
    assert motor.farthest < 0.25


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"goal": "0%"}, "goal"),
        ({"command": None}, "command"),
        ({"masses": (-1.0,)}, "mass"),
        ({"arm": 0.0}, "arm"),
        ({"command": 0.0}, "command"),
        ({"known": {"p9": 1.0}}, "p9"),
        ({"angle": 0.0}, "angle"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(tmp_path, options, named):
    motor = Faulty("")
    with pytest.raises(InputError, match=named):
        run(motor, tmp_path / "a", **options)
    assert not motor.commands
