"""Servos of another simulator: joints between looks of the firmware, and laws as told."""

import math

import numpy as np
import pytest

import butterfly as bf
from tests.benchmarks.servos import counts
from tests.independent.integrator import Joint, motion
from tests.independent.scores import Score
from tests.independent.servo import PID, Firmware, run
from tests.independent.servos import LAWS, SLIPS, draw, manifest_of

TICK = 2e-3
STAMPS = TICK * np.arange(250)
ON = np.ones(STAMPS.size)
SERVO = Joint(inertia=6e-3, viscous=4e-3, back_emf=0.03, gravity=0.4, gain=0.09)
FIRMWARE = Firmware(PID, TICK, math.tau / 4096, 0.9, p=2.0, i=3.0, d=0.02, zero=0.1, supply=7.4)
STEPS = 0.1 + 0.6 * np.sign(np.sin(6 * STAMPS))


def test_it_moves_as_the_joint_does_and_its_firmware_does_what_the_law_says():
    readings, drives, supplies, angles = run(SERVO, FIRMWARE, (STAMPS, STEPS, ON))
    np.testing.assert_allclose(angles, motion(SERVO, STAMPS, drives)[0], atol=1e-9)
    np.testing.assert_allclose(readings, angles + 0.1, atol=FIRMWARE.count)
    error, total, last = STEPS - readings, 0.0, None
    for k in range(STAMPS.size - 1):
        slope = 0.0 if last is None else (error[k] - last) / TICK
        raw = 2.0 * error[k] + total + 0.02 * slope
        duty, last = min(max(raw, -0.9), 0.9), error[k]
        assert drives[k] == pytest.approx(7.4 * duty, abs=1e-9)
        if duty == raw or error[k] * raw < 0.0:
            total += 3.0 * TICK * error[k]
    assert np.all(supplies == 7.4)
    assert np.mean(np.abs(drives) == 0.9 * 7.4) > 0.01  # it was clipped


def test_friction_on_torques_holds_a_load_that_coulomb_friction_would_let_fall():
    off, low = np.zeros(STAMPS.size), 0.05 * SERVO.gravity
    gear = SERVO._replace(coulomb=low, load_friction=0.4)
    *_, angles = run(gear, FIRMWARE, (STAMPS, STEPS, off), 0.08)
    assert np.all(angles == 0.08)  # sin 0.08 < 0.05 + 0.4 sin 0.08
    *_, angles = run(gear._replace(load_friction=0.3), FIRMWARE, (STAMPS, STEPS, off), 0.08)
    assert angles[-1] < 0.08
    *_, angles = run(SERVO, FIRMWARE, (STAMPS, STEPS, off), 0.8)  # and no back EMF brakes it
    energy = SERVO.gravity * (math.cos(0.0) - math.cos(0.8))
    fastest = np.abs(np.gradient(angles, TICK)).max()
    assert 0.85 < 0.5 * SERVO.inertia * fastest**2 / energy < 1.0


def test_a_supply_sags_and_goals_and_drives_come_late():
    sagging = FIRMWARE._replace(sag=2.0)
    _, drives, supplies, _ = run(SERVO, sagging, (STAMPS, STEPS, ON))
    assert 5.0 < supplies.min() < 7.0 < supplies.max()
    assert np.abs(drives).max() < 0.9 * 7.4
    shift = 5 * TICK
    late = FIRMWARE._replace(i=0.0, d=0.0, delay=shift)
    _, drives, _, _ = run(SERVO, late, (STAMPS, 0.1 + 0.5 * (STAMPS > 0.1), ON))
    assert STAMPS[np.argmax(np.abs(drives) > 0.5)] == pytest.approx(0.102 + shift)


@pytest.mark.parametrize("law", LAWS)
def test_servos_of_every_law_are_told_as_their_owners_know_them(law):
    servo = draw(law, 2)
    assert [each.enabled.all() for each in servo.recordings] == 2 * [True, True, False]
    told = {way: manifest_of(servo, servo.recordings, way) for way in ("setpoint", *SLIPS)}
    assert told["setpoint"]["input"] == "setpoint"
    loop, wrong = (told[way]["logs"][0]["loop"] for way in ("setpoint", "constant"))
    (unsure,) = (name for name, gain in loop.items() if isinstance(gain, dict))
    assert loop["law"] == law
    assert servo.gains[f"loop_{unsure}"] == pytest.approx(1 / 1.3)
    assert wrong[unsure]["value"] == pytest.approx(2.0 * loop[unsure]["value"])
    assert told["voltage"]["input"] == ("voltage" if servo.electric else "torque")


def test_numbers_determine_a_servo_and_its_files(tmp_path):
    servo, again = draw("feetech-sts", 1), draw("feetech-sts", 1)
    assert servo.truth == again.truth
    np.testing.assert_array_equal(servo.recordings[0].angle, again.recordings[0].angle)
    for way in ("drive", "gear"):
        servo.write(tmp_path / way, way)
    logs = bf.read(tmp_path / "drive").logs
    assert [log.added_mass.mass > 0.0 for log in logs] == [False, False, True, True]
    turned = np.loadtxt(tmp_path / "gear" / "0.csv", delimiter=",", skiprows=1)[:, 2]
    np.testing.assert_allclose(turned, servo.ratio * logs[0].angle, rtol=1e-6)


def test_slips_that_are_named_are_counted():
    told = {"family": "odrive", "repeat": 0}
    named = Score(
        **told, number=0, method="gear", text="Perhaps a gear of 50.", verdict="use with care"
    )
    silent = Score(**told, number=1, method="gear", text="All is well.", verdict="good")
    text = counts([named, silent])
    assert "| 1/2 |" in text
    assert "slips called good: ['odrive1 gear']" in text
