from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from butterfly.errors import InputError
from butterfly.logs.health import Repair, examine
from butterfly.logs.log import FileReading, Log
from butterfly.logs.units import ColumnReading
from butterfly.model.parameters import JointKind
from butterfly.verdict import Level

ALL = frozenset(Repair)


def test_a_healthy_log_passes_unchanged(sine_log):
    clean, health = examine(sine_log)
    assert health.findings == []
    assert health.dropped == 0
    np.testing.assert_array_equal(clean.angle, sine_log.angle)
    assert health.step == pytest.approx(1e-3)
    assert health.jitter == pytest.approx(0, abs=1e-12)


@given(rows=st.sets(st.integers(1, 998), max_size=20))
def test_each_repeated_stamp_is_dropped_and_counted(sine_log, rows):
    log = sine_log.take(np.arange(1000))
    time = log.time.copy()
    isolated = sorted(r for r in rows if r - 1 not in rows)
    time[isolated] = time[[r - 1 for r in isolated]]
    clean, health = examine(replace(log, time=time))
    assert health.duplicate_stamps == health.dropped == len(isolated)
    assert clean.time.size == time.size - len(isolated)
    assert np.all(np.diff(clean.time) > 0)


@pytest.mark.parametrize(
    ("rows", "shift"),
    [
        (slice(100, 103), -0.0105),
        (slice(25_000, None), -25),
        (slice(100, 101), 1e6),
        (slice(39_000, 39_001), 5.0),
        (slice(1, 2), 1e-2),
    ],
)
def test_a_backward_stamp_is_refused_unless_allowed_and_then_counted(sine_log, rows, shift):
    time = sine_log.time.copy()
    time[rows] += shift
    first, kept = rows.start, np.delete(np.arange(40_000), rows)
    count = 40_000 - kept.size
    with pytest.raises(InputError, match=rf"time: got .* at sample {first} \({count} such samples"):
        examine(replace(sine_log, time=time))
    clean, health = examine(replace(sine_log, time=time), ALL)
    assert (health.backward_stamps, health.duplicate_stamps, health.dropped) == (count, 0, count)
    np.testing.assert_array_equal(clean.time, time[kept])
    np.testing.assert_array_equal(clean.angle, sine_log.angle[kept])


@pytest.mark.parametrize("name", ["time", "input", "angle", "velocity"])
def test_a_value_that_is_no_number_is_refused_by_column_and_sample(sine_log, name):
    column = getattr(sine_log, name).copy()
    column[[70, 90]] = np.nan
    with pytest.raises(InputError, match=rf"{name}: got nan at sample 70 \(2 such samples"):
        examine(replace(sine_log, **{name: column}))
    clean, health = examine(replace(sine_log, **{name: column}), ALL)
    assert (health.non_finite, health.dropped) == (2, 2)
    assert all(np.isfinite(values).all() for values in clean.columns().values())


def test_a_repair_is_advised_only_if_it_leaves_a_log_that_can_be_used(sine_log):
    angle = sine_log.angle.copy()
    angle[70] = np.nan
    with pytest.raises(InputError, match="to drop them: --repair non_finite"):
        examine(replace(sine_log, angle=angle))
    angle[:60], angle[60:] = 0.5, np.nan
    with pytest.raises(
        InputError, match=r"without these samples, angle is a constant 0\.5"
    ) as said:
        examine(replace(sine_log, angle=angle))
    assert "--repair" not in str(said.value)


def test_gaps_are_counted_and_measured(sine_log):
    keep = np.ones(sine_log.time.size, dtype=bool)
    keep[500:512] = keep[9000:9005] = False
    _, health = examine(sine_log.take(keep))
    assert health.gaps == 2
    assert health.longest_gap == pytest.approx(0.013)


@pytest.mark.parametrize("gap", [0.0, 0.5])
def test_jitter_is_the_rms_of_what_was_put_in_whatever_the_gaps(sine_log, gap):
    steps = 1e-3 + 1e-4 * np.random.default_rng(1).standard_normal(sine_log.time.size)
    steps[20_000] += gap
    _, health = examine(replace(sine_log, time=np.cumsum(steps)))
    assert health.gaps == (gap > 0)
    assert health.jitter == pytest.approx(1e-4, rel=0.02)


@pytest.mark.parametrize(
    ("name", "what"), [("input", "excites"), ("angle", "moving"), ("time", "never advances")]
)
def test_a_constant_column_is_refused(sine_log, name, what):
    with pytest.raises(InputError, match=what):
        examine(replace(sine_log, **{name: np.full(sine_log.time.size, 0.3)}), ALL)


def test_the_real_logs_have_the_known_faults_and_no_others(real_data):
    for log, health in zip(real_data.logs, real_data.health, strict=True):
        stamps = loadmat(log.source)["D"][:, 0]
        assert health.duplicate_stamps == np.sum(np.diff(stamps) == 0)
    assert max(health.longest_gap for health in real_data.health) == pytest.approx(0.0129, abs=1e-4)
    for health in real_data.health:
        assert health.duplicate_stamps <= 5
        assert (
            health.backward_stamps == health.non_finite == health.saturated == health.clipped == 0
        )
        assert 1.5e-4 < health.jitter < 3e-4


def test_a_free_decay_needs_no_input(sine_log):
    released = replace(sine_log, input=np.zeros_like(sine_log.time), excitation=None)
    clean, health = examine(released)
    assert clean.time.size == sine_log.time.size
    assert any("with a constant input" in finding for finding in health.findings)


def _turning(log, **changes):
    angle = 8.0 * np.sin(0.7 * log.time)
    return replace(log, angle=(angle + np.pi) % (2 * np.pi) - np.pi, **changes), angle


def test_a_wrapped_angle_is_refused_unless_allowed_and_then_unwrapped_and_counted(sine_log):
    wrapped, angle = _turning(sine_log)
    jumps = np.sum(np.abs(np.diff(wrapped.angle)) > np.pi)
    with pytest.raises(InputError, match=rf"angle: got {jumps} jumps by 6\.283.*--repair unwrap"):
        examine(wrapped)
    clean, health = examine(wrapped, ALL)
    np.testing.assert_allclose(clean.angle, angle, atol=1e-9)
    assert (health.wraps, health.dropped) == (jumps, 0)
    assert health.turns == pytest.approx(16 / (2 * np.pi), rel=1e-3)


def test_a_turn_that_is_none_of_the_joint_is_refused_even_if_allowed(sine_log):
    turn = 2 * np.pi / 7.3
    with pytest.raises(InputError, match=r"expected jumps by a whole turn.*counts/N"):
        examine(replace(sine_log, angle=(8.0 * np.sin(0.7 * sine_log.time)) % turn), ALL)


def test_a_slide_does_not_wrap_and_does_not_turn(sine_log):
    wrapped, _ = _turning(sine_log, added_mass=replace(sine_log.added_mass, joint=JointKind.SLIDE))
    clean, health = examine(wrapped)
    assert clean is wrapped
    assert (health.wraps, health.turns) == (0, 0.0)


def test_what_reading_did_stands_in_the_record(sine_log):
    own = ColumnReading(name="t [ms]", number=0, unit="ms", unit_source="name", factor=1e-3)
    given = replace(own, unit_source="given")
    read = replace(
        sine_log, reading=FileReading(cut_lines=1, columns={"time": own, "input": given})
    )
    _, health = examine(read)
    assert (health.cut_lines, health.columns) == (1, {"time": own, "input": given})
    assert [each.removesuffix(" dropped") for each in health.findings] == [
        "1 incomplete last line",
        'converted from the file\'s units: time: column 0 "t [ms]", ms',
    ]


@pytest.mark.parametrize(
    ("changes", "condition"),
    [
        ({}, "good"),
        ({"time": lambda log: np.repeat(log.time[::2], 2)}, "care"),
        ({"time": lambda log: np.concatenate([log.time[:1], log.time[:-1]])}, "note"),
        ({"input": lambda log: np.clip(log.input, -0.15, 0.15)}, "care"),
        ({"angle": lambda log: np.minimum(np.round(log.angle / 2e-3) * 2e-3, 0.06)}, "care"),
        ({"time": lambda log: 1e3 * log.time}, "care"),
        ({"angle": lambda log: 90 * log.angle}, "note"),
    ],
)
def test_findings_have_a_condition_and_the_worst_comes_first(sine_log, changes, condition):
    changed = {name: change(sine_log) for name, change in changes.items()}
    _, health = examine(replace(sine_log, **changed))
    conditions = [remark.condition for remark in health.remarks]
    assert Level.worst(conditions) == condition
    assert conditions == sorted(conditions, key=lambda each: each != Level.CARE)


TIME = np.arange(40) * 0.01
RAMP = np.arange(40.0)


@pytest.mark.parametrize(
    ("time", "inputs", "angle", "message"),
    [
        (TIME, RAMP, 1e31 * RAMP, "angle: got numbers up to 3.9e"),
        (TIME, RAMP, -1e31 * RAMP, "angle: got numbers up to 3.9e"),
        (TIME, 1e-32 * RAMP, RAMP, "input: got numbers that differ by 3.9e-31"),
        (1e-40 * RAMP, RAMP, RAMP, "time: got numbers that differ by 3.9e-39"),
        (np.append(1e-31 * RAMP[:20], TIME[20:]), RAMP, RAMP, "time: got timestamps 1e-31 s apart"),
    ],
)
def test_what_no_bench_has_is_refused(time, inputs, angle, message):
    with pytest.raises(InputError, match=message):
        examine(Log(time, inputs, angle))


def test_what_a_bench_may_have_is_not():
    examine(Log(1e-6 * RAMP, 0.0 * RAMP, 1e12 + RAMP))
    examine(Log(1.7e9 + TIME, 1e-9 * RAMP, 1e-9 * RAMP, velocity=1e300 * RAMP))
