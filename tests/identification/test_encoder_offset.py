"""Where the hand hangs, as the encoder reads it, found from any log."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.encoder_offset import (
    OffsetKind,
    fitted_offset,
    near,
    offset_errors,
)
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.estimators.local_parameters import columns_of, known_zeros, local_keys
from butterfly.identification.estimators.multistart import starts
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Known, Prior
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, steady
from tests.independent.integrator import Joint, motion

P1, P2, P3, DRY = 0.0033, 1e-3, 0.05, 5e-4
HEAVY = (NO_ADDED_MASS, AddedMass(mass=0.06, arm=0.104), AddedMass(mass=0.15, arm=0.104))
STEP = 4e-3
PLAIN = WeakForm(terms=())
BIASED = HarmonicBalance(terms=("bias",))


def _run(mass, inputs, zero, *, start=0.0, bias=0.0, noise=0.0):
    """A log of the independent integrator, in N m, of an encoder of 2^14 steps."""
    joint = Joint(P1 + mass.inertia, P2, P3 + mass.gravity_moment, 1.0, coulomb=DRY, bias=bias)
    time = STEP * np.arange(inputs.size)
    angle, _ = motion(joint, time, inputs, start, step=STEP / 4)
    seen = angle + zero + noise * np.random.default_rng(0).standard_normal(time.size)
    count = 2 * np.pi / 2**14
    if noise:
        seen = count * np.rint(seen / count)
    return Log(time=time, input=inputs, angle=seen, added_mass=mass, input_kind="torque")


def _steps(seed, size, duration=12.0):
    """Torque steps of 0.6 s about a mean that is not 0."""
    levels = size * np.random.default_rng(seed).uniform(-0.6, 1.0, int(duration / 0.6) + 1)
    return np.repeat(levels, 150)[: int(duration / STEP)]


def _logs(zero, size=0.6, noise=0.0, turns=(0, 1, -2)):
    steps = [_steps(k, size * (P3 + mass.gravity_moment)) for k, mass in enumerate(HEAVY)]
    zeros = [zero + 2 * np.pi * turn for turn in turns]
    return [_run(*each, noise=noise) for each in zip(HEAVY, steps, zeros, strict=True)]


@pytest.mark.parametrize(("zero", "size"), [(0.0, 0.6), (3.1, 0.6), (-1.9, 1.6)])
def test_torque_steps_tell_the_zero_anywhere_and_turns_off(zero, size):
    data = DataSet.of(_logs(zero, size, noise=3e-4))
    assert {each.kind for each in data.offsets} == {OffsetKind.FIT}
    for each in data.offsets:
        assert near(each.value, zero) == pytest.approx(zero, abs=1e-3)
    mean = np.mean(data.logs[0].angle)
    assert abs(math.remainder(mean - zero, 2 * np.pi)) > 0.05


def test_the_weak_form_finds_the_robot_from_torque_steps_whatever_the_zero():
    found = PLAIN(DataSet.of(_logs(-2.5))).parameters
    for name, truth in (("p1", P1), ("p3", P3), ("p4", 1.0)):
        assert getattr(found, name) == pytest.approx(truth, rel=2e-3)


def test_a_constant_torque_is_told_from_gravity_where_the_motion_is_wide():
    found = fitted_offset([_run(NO_ADDED_MASS, _steps(3, 0.08), 0.4, bias=6e-3)])
    assert near(found.value, 0.4) == pytest.approx(0.4, abs=2e-3)


def test_masses_that_hang_elsewhere_keep_their_zeros_and_share_none():
    logs = [replace(log, angle=log.angle + 0.2 * k) for k, log in enumerate(_logs(0.3))]
    data = DataSet.of(logs)
    found = [near(data.equilibria[mass], 0.3) for mass in HEAVY]
    np.testing.assert_allclose(found, [0.3, 0.5, 0.7], atol=1e-3)
    assert offset_errors(data.offsets).shape == (3, 3)
    assert offset_errors(DataSet.of(_logs(0.3)).offsets).shape == (1, 3)


def test_what_is_told_is_taken_for_each_log_by_itself():
    logs = [replace(log, zero=(2.0 + k, 0.1 * k)) for k, log in enumerate(_logs(0.3))]
    data = DataSet.of([*logs, replace(logs[0], zero=None)])
    assert [data.zero_of(log) for log in data.logs[:3]] == [2.0, 3.0, 4.0]
    assert [each.kind for each in data.offsets] == [OffsetKind.TOLD] * 3 + [OffsetKind.FIT]
    assert near(data.equilibria[HEAVY[0]], 0.3) == pytest.approx(0.3, abs=1e-3)
    np.testing.assert_allclose(np.sort(offset_errors(data.offsets).max(axis=1))[-2:], [0.1, 0.2])
    assert {each.value for each in data.with_zero(Known(value=0.7)).offsets} == {0.7}
    with pytest.raises(InputError, match="zero"):
        replace(logs[0], zero="left")


def test_a_log_that_hardly_moves_and_one_that_says_nothing_are_guessed():
    nudged = np.zeros(1000)
    nudged[400:403] = 0.03
    log = _run(NO_ADDED_MASS, nudged, 0.5, noise=2e-4)
    (rest,) = DataSet.of([log]).offsets
    assert rest.value == pytest.approx(0.5, abs=0.02)
    brief = _logs(0.5)[0].take(np.arange(20))
    data = DataSet.of([brief])
    assert data.offsets[0].kind is OffsetKind.GUESS
    assert data.guessed == (data.logs[0].name,)
    heavy = _logs(0.5)[2]
    assert {each.kind for each in DataSet.of([brief, heavy]).offsets} == {OffsetKind.FIT}
    assert DataSet.of([brief], known=Prior.of({"p3": 0})).guessed == ()


def test_the_weak_form_says_that_it_rests_on_a_guess(monkeypatch):
    monkeypatch.setattr("butterfly.identification.encoder_offset.fitted_offset", lambda _: None)
    found = PLAIN(DataSet.of(_logs(0.3, turns=(0, 0, 0))))
    assert FindingKind.ZERO_GUESSED in {each.kind for each in found.findings}


def test_an_uncertain_zero_adds_what_it_moves_the_estimate_by():
    """Of logs that begin in motion, where no window may stick or not, and without a bound."""
    logs, doubt = [log.piece(150, log.time.size) for log in _logs(0.3)], 1e-4
    known = Prior.of({"delay": 0})

    def at(zero, **uncertain):
        return PLAIN.of_logs(logs, dict.fromkeys(HEAVY, zero), known, **uncertain)

    added = at(0.3, uncertain=np.full((1, 3), doubt)).covariance - at(0.3).covariance
    moved = (at(0.3 + doubt).values - at(0.3 - doubt).values) / 2
    np.testing.assert_allclose(np.sqrt(np.diag(added)), abs(moved), rtol=0.15)


def test_output_error_fits_no_zero_that_is_exact_and_one_prior_for_each_that_is_not():
    logs = [replace(log, name=f"{k}") for k, log in enumerate(_logs(0.3))]
    exact, rough = Known(value=0.3), Known(value=0.3, uncertainty=0.01)

    def keys(*zeros, hangs=True):
        told = [replace(log, zero=zero) for log, zero in zip(logs, zeros, strict=True)]
        found = local_keys(told, (), (), hangs=hangs, anchored=told)
        return found, known_zeros(found, told), [columns_of(found, log) for log in told]

    assert keys(None, None, None) == ([("zero", None)], {}, [[0], [0], [0]])
    assert keys(exact, exact, exact) == ([], {}, [[], [], []])
    assert keys(None, None, None, hangs=False)[0] == []
    assert keys(None, exact, None)[2] == [[0], [], [0]]
    assert keys(rough, rough, rough)[:2] == ([("zero", None)], {("zero", None): rough})
    found, known, columns = keys(rough, None, exact)
    assert found == [("zero", HEAVY[0]), ("zero", None)]
    assert known == {("zero", HEAVY[0]): rough}
    assert columns == [[0], [1], []]


def test_output_error_holds_a_told_zero_and_weighs_an_uncertain_one():
    logs = [log.take(np.arange(1500)) for log in _logs(0.3, turns=(0, 0, 0))]
    fit = OutputError(terms=(), workers=1)
    held = DataSet.of([replace(log, zero=0.3) for log in logs])
    found = fit.of_logs(held.logs, [next(starts(held, ()))])
    assert found.local == {}
    assert found.parameters.p3 == pytest.approx(P3, rel=1e-3)
    assert (held.simulations.fits(found) > 99).all()
    rough = DataSet.of([replace(log, zero=(0.33, 1e-4)) for log in logs])
    weighed = fit.of_logs(rough.logs, [next(starts(rough, ()))])
    assert 0.3 < weighed.local[None]["zero"] < 0.33


def test_harmonic_balance_tells_a_bias_from_a_zero_that_is_told():
    robot = replace(ROBOT, bias=2e-3)
    logs = [replace(log, angle=log.angle + 0.4, zero=0.4) for log in steady(robot, SWINGS)]
    light = [log for log in logs if log.added_mass == MASSES[0]]
    found = BIASED(DataSet.of(logs))
    assert found.parameters.bias == pytest.approx(2e-3, rel=0.01)
    assert found.local == {}
    doubtful = [replace(log, zero=(0.4, 0.01)) for log in logs]
    unsure = BIASED(DataSet.of(doubtful))
    moments = [ROBOT.p3 + mass.gravity_moment for mass in MASSES]
    assert 0.9 * min(moments) < unsure.standard_errors[-1] / 0.01 < max(moments)
    known = Prior.of({"p4": ROBOT.p4})
    alone = BIASED(DataSet.of(light, known=known))
    assert alone.parameters.bias == pytest.approx(2e-3, rel=0.01)
