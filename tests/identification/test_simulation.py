"""Starts of segments, against SciPy's and NumPy's least squares of one segment after the other."""

from itertools import pairwise

import numpy as np
import pytest

from butterfly.identification import segments
from butterfly.identification.simulation import SegmentStarts, Simulation
from butterfly.model.parameters import LumpedParameters
from tests.identification.simulated import driven
from tests.independent.integrator import Joint

BOUNDS = np.array([0, 12, 30, 30, 55])  # one segment has no errors
UNIT = 3.0


def _random(seed=0):
    rng = np.random.default_rng(seed)
    errors, moves = rng.standard_normal(55), rng.standard_normal((55, 2))
    moves[12:30, 1] = 2.0 * moves[12:30, 0]  # velocity does there what the angle does
    return errors, moves


def _starts(errors, moves, at_rest=(False, False, False, True)):
    begins = np.zeros((4, 2))
    rest = np.array(at_rest)
    return SegmentStarts.of(begins, errors, moves, BOUNDS, at_rest=rest, unit=UNIT)


def _parts():
    return [slice(*ends) for ends in pairwise(BOUNDS.tolist())]


def test_steps_are_those_of_least_squares_of_each_segment():
    errors, moves = _random()
    found = _starts(errors, moves)
    for k, part in enumerate(_parts()):
        if part.stop == part.start:
            assert not found.step[k].any()
            continue
        scaled = moves[part] * [1.0, UNIT]
        kept = scaled[:, :1] if k == 3 else scaled  # the last begins at rest
        step = np.linalg.lstsq(kept, -errors[part], rcond=1e-6)[0]
        expected = np.append(step, 0.0)[:2] * [1.0, UNIT]
        np.testing.assert_allclose(found.step[k], expected, atol=1e-12)
        assert found.cost[k] == pytest.approx(np.mean(errors[part] ** 2))


def test_what_starts_explain_is_taken_away():
    errors, moves = _random(1)
    effects = _starts(errors, moves).effects
    rows = np.random.default_rng(2).standard_normal((55, 3))
    left, alone = rows.copy(), errors.copy()
    effects.take_away(left)
    effects.take_away(alone)
    for k, part in enumerate(_parts()):
        kept = moves[part, :1] if k == 3 else moves[part]
        fit = np.linalg.pinv(kept, rcond=1e-6)
        np.testing.assert_allclose(left[part], rows[part] - kept @ (fit @ rows[part]), atol=1e-12)
        expected = errors[part] - kept @ (fit @ errors[part])
        np.testing.assert_allclose(alone[part], expected, atol=1e-12)


def test_a_segment_that_diverges_stays_where_it_is_and_leaves_others_alone():
    errors, moves = _random(3)
    sound = _starts(errors, moves)
    errors[5], moves[40, 1] = np.nan, np.inf
    with np.errstate(invalid="ignore"):
        found = _starts(errors, moves)
    assert found.settled[[0, 3]].all()
    assert not found.step[[0, 3]].any()
    np.testing.assert_array_equal(found.step[1], sound.step[1])


def test_a_log_in_many_segments_is_simulated_by_few_calls(monkeypatch):
    """Whatever their number: each simulates all segments whose starts are not found yet."""
    joint = Joint(inertia=0.19, viscous=0.3, gravity=0.0, gain=1.0, coulomb=0.15)
    time = np.arange(0.0, 60.0, 0.01)
    log = driven(joint, time, 2.0 * np.sign(np.sin(1.3 * time)) + np.sin(4 * time))
    robot = LumpedParameters(p1=0.2, p2=0.31, p3=0.0, p4=1.0, coulomb=0.15)
    calls, simulate = [], segments.differentiate
    monkeypatch.setattr(
        segments, "differentiate", lambda *a, **k: calls.append(1) or simulate(*a, **k)
    )
    simulation = Simulation(log, robot, horizon=0.4)
    errors, rows = simulation.linearised(("p1", "coulomb"), robot, 0.0)
    assert len(simulation.begins) == 150
    assert len(calls) < 30
    assert np.isfinite(errors).all()
    assert np.isfinite(rows).all()
