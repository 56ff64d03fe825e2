"""Contradictions of physics: planted ones are found where they begin, sound logs have none."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from butterfly.logs.contradictions import find_contradiction
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind, Log
from butterfly.verdict import Level
from tests.independent.drives import chirp, multisine, sine, steps
from tests.independent.integrator import Joint, motion

_CASES = Path(__file__).parents[3] / "shared/data/cases/inspect"
_TIME = np.arange(0.0, 24.0, 0.004)
_PENDULUM = Joint(inertia=0.004, viscous=0.004, gravity=0.1, gain=1.0, coulomb=0.004, delay=0.005)
_COUNT = 2 * np.pi / 4096
_RNG = np.random.default_rng(3)
_WAVES = multisine(5.0, 0.03, _RNG)[0](_TIME)
_SINE, _FAST = sine(0.03, 4.0)(_TIME), multisine(7.0, 0.05, _RNG)[0](_TIME)
_NOISE = _RNG.standard_normal(_TIME.size)
_LATE = _TIME > 10.0  # s


def _log(torque, start=0.0, count=_COUNT, **joint):
    angle, _ = motion(_PENDULUM._replace(**joint), _TIME, torque, start)
    return Log(time=_TIME, input=torque, angle=count * np.rint((angle + 0.1) / count))


def _scaled(column, factor):
    return np.where(_LATE, factor * column, column)


_FOUND = {
    "frozen-half": "from 6 to 12 s the angle is constant while the input goes on",
    "mid-input-mV": "from 6.004 s on the input is about 1000 times as large",
    "angle-1e6": "from 0 s on the joint moves at up to 1.5e+06 rad/s",
}


@pytest.mark.skipif(not _CASES.is_dir(), reason="the shared cases are not there")
@pytest.mark.parametrize("case", _FOUND)
def test_the_cases_are_to_check_from_where_they_begin(case):
    time, inputs, angle = np.loadtxt(_CASES / f"{case}.csv", delimiter=",", skiprows=1).T
    _, health = examine(Log(time=time, input=inputs, angle=angle))
    assert health.condition is Level.CARE
    assert health.findings[0].startswith(_FOUND[case])
    assert health.remarks[0].hint.startswith("Check the ")


@pytest.mark.parametrize(
    ("change", "begin", "words"),
    [
        (lambda u, q: (u, np.where(_LATE, q[_LATE][0], q)), 10.0, "to 24 s the angle is constant"),
        (lambda u, q: (_scaled(u, 1e3), q), 10.0, "the input is about [1-9]00+ times as large"),
        (lambda u, q: (_scaled(u, 1e-3), q), 10.0, r"the input is about 0\.00.* times as large"),
        (lambda u, q: (u, _scaled(q, 60.0)), 10.0, "the angle is about [5-7]0 times as large"),
        (lambda u, q: (u, 1e5 * q), 0.0, "the joint moves at up to .* rad/s"),
        (lambda u, q: (u, 0 * q + _COUNT * _NOISE), 0.0, "the angle does not respond to the input"),
    ],
)
@pytest.mark.parametrize("torque", [_WAVES, _SINE, _FAST], ids=["waves", "sine", "fast"])
def test_a_planted_contradiction_is_found_where_it_begins(torque, change, begin, words):
    log = _log(torque)
    inputs, angle = change(log.input, log.angle)
    text, _ = find_contradiction(replace(log, input=inputs, angle=angle))
    assert float(text.split()[1]) == pytest.approx(begin, abs=1.0 if begin else 3.0)
    assert re.search(words, text)


_FREE = _log(np.zeros(_TIME.size), 1.0)
_SOUND = {
    "free": _FREE,
    "waves": _log(_WAVES),
    "steps": _log(steps(2.0, 0.05, _RNG)[0](_TIME)),
    "sweep": _log(chirp(5.0, 0.03, _RNG)[0](_TIME)),
    "dead for good after its last move": _log(_scaled(_WAVES, 0.1), coulomb=0.01),
    "held by friction at two counts": _log(_WAVES, count=0.1, coulomb=0.02),
    "let go, and held by friction": _log(0.1 * _WAVES, 1.0, coulomb=0.01),
    "a hundred times as strong": _log(_scaled(0.01 * _WAVES, 100.0), coulomb=0.0),
    "a hundred times as weak": _log(_scaled(_WAVES, 0.01)),
    "a step after a long rest": _log(np.where(_LATE, 0.05, 0.0)),
    "pauses": _log(np.where(np.sin(_TIME) > 0.0, _WAVES, 0.0)),
    "forty turns": _log(np.where(_LATE, 0.05, -0.05), gravity=0.0),
    "turns through the upright": _log(2.0 * np.sin(0.2 * _TIME)),
    "noise of an input that does not act": replace(_FREE, input=_NOISE),
    "no input": replace(_FREE, input_kind=InputKind.NONE),
}


@pytest.mark.parametrize("name", _SOUND)
def test_a_sound_log_has_no_contradiction(name):
    assert find_contradiction(_SOUND[name]) is None


def test_the_real_logs_have_none(real_data):
    assert {health.contradiction for health in real_data.health} == {None}


def test_units_are_blamed_for_a_speed_that_lasts_and_the_encoder_for_a_jump():
    log = _log(_WAVES)
    jump = np.where((log.time > 10.0) & (log.time < 10.1), 1e3 * log.angle + 50.0, log.angle)
    for angle, blamed in ((1e6 * log.angle, "units"), (jump, "encoder")):
        said, hint = find_contradiction(replace(log, angle=angle))
        assert "faster than any joint" in said
        assert blamed in hint
