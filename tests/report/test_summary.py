"""A joint that nothing holds and that something pushes which no log has: what is said of it."""

import math
import warnings

import numpy as np
import pytest

import butterfly as bf
from butterfly.logs.log import InputKind, Log
from tests.independent.integrator import Joint, motion

SECONDS, HORIZON = 20.0, 0.5
JOINT = Joint(inertia=0.02, viscous=0.004, gravity=0.0, gain=1.0)
DRIFTS = "Whole runs of up to 20 s, from their start alone, drift away (median FIT "
SEGMENTS = "; over 0.5 s at a time the median FIT is 9"


def _log(number, push):
    """Return a log of a joint on two sines of torque; a third, a ``push`` in N m, is not logged."""
    rng = np.random.default_rng(number)
    stamps = np.arange(0.0, SECONDS + 0.0025, 0.005)
    inputs = 0.3 * np.cos(6.0 * stamps) + 0.2 * np.cos((10.0 + number) * stamps)
    angle, _ = motion(JOINT, stamps, inputs + push * np.sin(0.4 * stamps))
    read = angle + 1e-3 * rng.standard_normal(stamps.size)
    return Log(stamps, inputs, read, input_kind=InputKind.TORQUE, name=f"log {number}")


def _data(push):
    return bf.read([_log(1, push), _log(2, push)], known={"p4": 1.0, "p3": 0.0})


@pytest.fixture(scope="module")
def pushed():
    return bf.identify(_data(0.02), terms=(), horizon=HORIZON)


def test_the_summary_says_over_which_time_it_holds_and_that_whole_runs_drift(pushed):
    assert pushed.judged.level.usable
    said = " ".join(pushed.summary)
    assert DRIFTS in said
    assert SEGMENTS in said
    assert " of the motion over segments of 0.5 s, " in pushed.verdict[1]


def test_the_fit_of_whole_runs_is_that_of_a_simulation_from_the_first_sample(pushed):
    fits = []
    for log in pushed.data.logs:
        motion_of = pushed.model.simulate(log).measured
        error = np.linalg.norm(motion_of - log.measured)
        fits.append(100 * (1 - error / np.linalg.norm(log.measured - log.measured.mean())))
    assert pushed.fit.whole == pytest.approx(np.median(fits), abs=0.5)
    assert pushed.fit.longest == pytest.approx(SECONDS)
    assert pushed.fit.median > 90.0
    assert pushed.fit.whole < 50.0


def test_programs_and_saved_results_have_both_fits(pushed, tmp_path):
    numbers = pushed.to_dict()["fit"]
    assert numbers["horizon"] == HORIZON
    assert numbers["whole"] == pytest.approx(pushed.fit.whole)
    pushed.save(tmp_path / "joint.json")
    assert bf.load(tmp_path / "joint.json").fit == pushed.fit


def test_prediction_and_twin_say_over_which_time_they_hold(pushed, tmp_path):
    assert DRIFTS in " ".join(bf.predict(pushed.data, pushed, bands=False).summary)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what MuJoCo lacks is another matter
        written = pushed.model.export(tmp_path / "joint.xml")
    assert written.notes[0].startswith(DRIFTS)
    assert DRIFTS in written.text


def test_whole_runs_that_follow_are_said_to():
    found = bf.identify(_data(0.0), terms=(), horizon=HORIZON)
    follows = "Whole runs of up to 20 s, from their start alone, follow too (median FIT "
    assert found.fit.holds.startswith(follows)


def test_of_logs_that_are_simulated_whole_nothing_is_said():
    found = bf.identify(_data(0.0), terms=(), horizon=math.inf)
    assert found.fit.holds == ""
    assert "whole" not in found.to_dict()["fit"]
    assert "segments" not in found.verdict[1]
