"""Units and signs, by what they make of numbers."""

import math

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.logs.units import AS_IS, UNITS, Units

DEGREE, TURN = 0.017453292519943295, 6.283185307179586
LENGTHS = {"m": 1, "cm": 0.01, "mm": 0.001, "um": 0.000001}
VOLTS = {"V": 1, "mV": 0.001, "uV": 0.000001, "kV": 1000, "MV": 1e6}
TURNS = {"rad": 1, "mrad": 0.001, "deg": DEGREE, "mdeg": DEGREE / 1000, "arcmin": DEGREE / 60}
TURNS |= {"arcsec": DEGREE / 3600, "gon": TURN / 400, "turns": TURN, **LENGTHS}
RATES = {"rad/s": 1, "mrad/s": 0.001, "deg/s": DEGREE, "rpm": 0.10471975511965977, "turns/s": TURN}
SPEEDS = {**RATES, "m/s": 1, "cm/s": 0.01, "mm/s": 0.001}
WRITTEN = {  # SI brochure, 9th edition: prefixes (table 7) and units outside the SI (table 8)
    "time": {"s": 1, "ms": 0.001, "us": 0.000001, "ns": 0.000000001, "min": 60, "h": 3600}
    | {"days": 86400},
    "input": {**VOLTS, "A": 1, "mA": 0.001, "MA": 1e6, "Nm": 1, "mNm": 0.001, "Ncm": 0.01}
    | {"uA": 0.000001, "kA": 1000, "uNm": 0.000001, "kNm": 1000, "kN": 1000}
    | {"kgf cm": 0.0980665, "MNm": 1e6, "N": 1, "mN": 0.001, "MN": 1e6, "duty": 1, "%": 0.01},
    "angle": TURNS,
    "velocity": SPEEDS,
    "setpoint": TURNS | SPEEDS,
    "supply": VOLTS,
    "omega": {**RATES, "Hz": TURN},
    "mass": {"kg": 1, "g": 0.001},
    "arm": LENGTHS,
}
SPELT = [
    ("time", "µs", 1e-6),
    ("input", "mN m", 1e-3),
    ("input", "-Nm", -1.0),
    ("angle", "-°", -DEGREE),
    ("angle", "counts/4096", TURN / 4096),
    ("angle", "-counts/1000", -TURN / 1000),
    ("angle", "0.5", 0.5),
    ("angle", -0.5, -0.5),
]


def test_every_unit_has_its_written_factor():
    assert {name: set(units) for name, units in UNITS.items()} == {
        name: set(units) for name, units in WRITTEN.items()
    }
    written = [(name, unit, f) for name, units in WRITTEN.items() for unit, f in units.items()]
    for name, unit, factor in written + SPELT:
        found = Units.of({name: unit}).factor(name)
        assert found == pytest.approx(factor, rel=1e-15), (name, unit)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"angle": "degs"}, r"units\.angle: got degs; expected one of rad, mrad, deg, mdeg, arcm"),
        ({"time": "deg"}, r"units\.time: got deg; expected one of s, ms, us"),
        ({"angle": "counts/0"}, r"units\.angle: got counts/0"),
        ({"angle": 0}, r"units\.angle: got 0"),
        ({"angle": math.nan}, r"units\.angle: got nan"),
        ({"angle": True}, r"units\.angle: got True"),
        ({"input": "Mv"}, r"units\.input: got Mv; expected mV or MV"),
        ({"angle": ["deg"]}, r"units\.angle: got \['deg'\]"),
        ({"angel": "deg"}, r"units\.angel: got an unknown name; expected 'angle'"),
        ({"time": -1}, r"units\.time: got -1; expected no minus"),
        ({"mass": "-g"}, r"units\.mass: got -g; expected no minus"),
        ("deg", r"units: got deg; expected a mapping"),
    ],
)
def test_what_is_no_unit_is_refused_with_those_that_are(told, message):
    with pytest.raises(InputError, match=message):
        Units.of(told)


@pytest.mark.parametrize("minus", ["-", "-1", -1])
def test_a_minus_alone_turns_the_sign_and_leaves_the_unit_to_the_file(minus):
    units = Units.of({"angle": minus})
    assert units.factor("angle") == -1.0
    assert units.factor("angle", 0.1) == -0.1
    assert Units.of({"angle": "rad"}).factor("angle", 0.1) == 1.0


def test_a_sign_of_the_input_and_a_minus_cancel_each_other():
    assert AS_IS.with_sign(-1).factor("input") == -1.0
    assert AS_IS.with_sign(-1).with_sign(-1).factor("input") == 1.0
    assert Units.of({"input": "-"}).with_sign(-1).factor("input") == 1.0
    assert Units.of({"input": "-mV"}).with_sign(-1).factor("input") == pytest.approx(1e-3)


def test_a_frame_is_read_in_its_units():
    ramp = np.arange(20.0)
    frame = {"t": ramp, "u": ramp, "q": ramp, "dq": ramp}
    units = {"time": "ms", "input": "-mV", "angle": "deg", "velocity": "rpm"}
    names = {"time": "t", "input": "u", "angle": "q"}
    log = Log.from_frame(frame, **names, velocity="dq", units=units)
    np.testing.assert_allclose(log.time, ramp / 1000)
    np.testing.assert_allclose(log.input, -ramp / 1000)
    np.testing.assert_allclose(log.angle, np.radians(ramp))
    np.testing.assert_allclose(log.velocity, ramp * 2 * np.pi / 60)
    with pytest.raises(InputError, match=r"frame: units\.time: got weeks"):
        Log.from_frame(frame, **names, units={"time": "weeks"})
