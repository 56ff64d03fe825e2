"""What a data set reads off its logs, where the hand hangs among it, and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification import limits as blocks
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError, WeakForm
from butterfly.identification.estimators.start import starts
from butterfly.identification.problem import Start, columns_of
from butterfly.identification.trust import FindingKind
from butterfly.identification.weak_regression import OffsetKind, fitted_offset, near, offset_errors
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import GRAVITY, NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Known, Prior
from butterfly.model.terms import PARAMETERS
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, steady
from tests.independent.integrator import Joint, motion

P1, P2, P3, DRY = 0.0033, 1e-3, 0.05, 5e-4
HEAVY = (NO_ADDED_MASS, AddedMass(mass=0.06, arm=0.104), AddedMass(mass=0.15, arm=0.104))
STEP = 4e-3
PLAIN = WeakForm(terms=())
BIASED = OutputError(terms=("bias",), workers=1)
FEW = {omega: SWINGS[omega] for omega in (2.0, 3.0, 4.4, 8.5)}


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
def test_torque_steps_tell_the_zero_anywhere_and_turns_off_and_the_weak_form_the_robot(zero, size):
    data = DataSet.of(_logs(zero, size, noise=3e-4))
    assert {each.kind for each in data.offsets} == {OffsetKind.FIT}
    for each in data.offsets:
        assert near(each.value, zero) == pytest.approx(zero, abs=1e-3)
    mean = np.mean(data.logs[0].angle)
    assert abs(math.remainder(mean - zero, 2 * np.pi)) > 0.05
    found = PLAIN(data).parameters
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
    assert [each.kind for each in data.offsets] == [OffsetKind.GIVEN] * 3 + [OffsetKind.FIT]
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
    monkeypatch.setattr("butterfly.identification.weak_regression.fitted_offset", lambda _: None)
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

    def keys(*zeros, gravity=GRAVITY):
        masses = [replace(log.added_mass, gravity=gravity) for log in logs]
        facts = zip(logs, zeros, masses, strict=True)
        told = [replace(log, zero=zero, added_mass=mass) for log, zero, mass in facts]
        first = Start(ROBOT, dict.fromkeys(masses, 0.3))
        problem = OutputError(terms=(), fixed=PARAMETERS).problem(told, first)
        columns = [[*columns_of(problem.keys, log).values()] for log in told]
        return [*problem.keys], problem.known, columns

    assert keys(None, None, None) == ([("zero", None)], {}, [[0], [0], [0]])
    assert keys(exact, exact, exact) == ([], {}, [[], [], []])
    assert keys(None, None, None, gravity=0.0)[0] == []
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
    found = fit.of_logs(held.logs, starts(held, ())[:1])
    assert found.local == {}
    assert found.parameters.p3 == pytest.approx(P3, rel=1e-3)
    assert (held.simulations.fits(found) > 99).all()
    rough = DataSet.of([replace(log, zero=(0.33, 1e-4)) for log in logs])
    weighed = fit.of_logs(rough.logs, starts(rough, ())[:1])
    assert 0.3 - 1e-6 < weighed.local[None]["zero"] < 0.33  # but for rounding: the logs are exact


def test_output_error_tells_a_bias_from_a_zero_that_is_told():
    robot = replace(ROBOT, bias=2e-3)
    logs = [replace(log, angle=log.angle + 0.4, zero=0.4) for log in steady(robot, FEW)]
    light = [log for log in logs if log.added_mass == MASSES[0]]
    found = BIASED(DataSet.of(logs))
    assert found.parameters.bias == pytest.approx(2e-3, rel=0.01)
    assert found.local == {}
    doubtful = BIASED(DataSet.of([replace(log, zero=(0.41, 0.01)) for log in logs]))
    assert doubtful.local[None]["zero"] == pytest.approx(0.4, abs=1e-3)
    assert doubtful.parameters.bias == pytest.approx(2e-3, rel=0.01)
    known = Prior.of({"p4": ROBOT.p4})
    alone = BIASED(DataSet.of(light, known=known))
    assert alone.parameters.bias == pytest.approx(2e-3, rel=0.01)


def test_a_bare_joint_hangs_at_its_zero_whatever_half_turn_the_search_ends_at():
    bare = [log for log in _logs(0.3, turns=(0, 0, 0)) if log.added_mass == MASSES[0]]
    fit, data = OutputError(terms=(), workers=1), DataSet.of(bare, known=Prior.of({"p4": ROBOT.p4}))
    (start,) = starts(data, ())[:1]
    turned = Start(
        replace(start.parameters, p3=-start.parameters.p3),
        {mass: zero + np.pi for mass, zero in start.zeros.items()},
    )
    found, same = (fit.of_logs(data.logs, [each], data.known) for each in (start, turned))
    assert same.parameters.p3 == pytest.approx(found.parameters.p3, rel=1e-6)
    assert same.local[None]["zero"] == pytest.approx(found.local[None]["zero"], abs=1e-6)


def test_no_logs_and_logs_of_different_kinds_of_input_are_refused(sine_log):
    with pytest.raises(InputError, match=r"bench.*at least one log"):
        DataSet.of([], name="bench")
    with pytest.raises(InputError, match="torque and voltage"):
        DataSet.of([sine_log, replace(sine_log, input_kind=InputKind.TORQUE)])


def test_logs_get_names_of_their_own_and_can_be_taken_by_number(sine_log):
    heavy = replace(sine_log, added_mass=MASSES[2])
    data = DataSet.of([sine_log, heavy, sine_log])
    names = [log.name for log in data.logs]
    assert len(set(names)) == 3
    assert data.masses == [MASSES[1], MASSES[2]]
    part = data.take([2, 1])
    assert [log.name for log in part.logs] == [names[2], names[1]]
    assert part.points[1] is data.points[1]


def test_the_rest_angle_of_a_mass_is_the_median_of_its_swings_middles(sine_log):
    logs = [replace(sine_log, angle=sine_log.angle + zero) for zero in (0.1, 0.2, 0.9)]
    logs.append(replace(sine_log, excitation=None, added_mass=MASSES[0], angle=sine_log.angle - 1))
    data = DataSet.of(logs)
    assert data.equilibria[MASSES[1]] == pytest.approx(0.2, abs=1e-6)
    assert data.equilibria[MASSES[0]] == data.equilibria[MASSES[1]]  # a guess: the others' zero
    assert len(data.sines) == 3


def test_free_decays_go_with_logs_of_any_input_and_have_no_gain_by_themselves(sine_log):
    decay = replace(sine_log, input=0 * sine_log.input, excitation=None, input_kind=InputKind.NONE)
    mixed = DataSet.of([decay, sine_log])
    assert mixed.input_kind is sine_log.input_kind
    assert "p4" not in mixed.known.values
    assert "delay" not in mixed.known.fixed
    still = replace(decay, input_kind=sine_log.input_kind)
    assert DataSet.of([still]).known.fixed == {"delay": 0.0}
    alone = DataSet.of([decay])
    assert alone.input_kind is InputKind.NONE
    assert alone.known.fixed == {"delay": 0.0, "p4": 0.0}
    with pytest.raises(InputError, match="0 throughout, for the input kind none"):
        replace(sine_log, input_kind=InputKind.NONE)
    with pytest.raises(InputError, match="input kind none if nothing drives"):
        Log(sine_log.time, angle=sine_log.angle)


def test_logs_are_held_out_by_name_and_put_back(sine_log):
    names = ("one/a.mat", "one/b.mat", "two/c.mat")
    data = DataSet.of([replace(sine_log, name=name) for name in names], name="bench")
    apart = data.holding_out(["b", "two/*"])
    assert [log.name for log in apart.logs] == ["one/a.mat"]
    assert [log.name for log in apart.test_logs.logs] == ["one/b.mat", "two/c.mat"]
    assert [log.name for log in apart.whole.logs] == list(names)
    assert apart.whole.test_logs is None
    known = Prior.of({"p3": 0.05})
    assert apart.knowing(known).test_logs.known == known
    assert apart.take([0]).test_logs is None
    twice = data.holding_out(["a"]).holding_out(["c.mat"])
    assert [log.name for log in twice.test_logs.logs] == ["two/c.mat", "one/a.mat"]
    assert data.holding_out([]) is data
    piece = DataSet.of([replace(sine_log, name=name) for name in ("a.mat", "a.mat [part 2]")])
    assert [log.name for log in piece.holding_out(["a.mat [part 2]"]).logs] == ["a.mat"]
    with pytest.raises(InputError, match=r"bench: holdout: got d; expected .* such as"):
        data.holding_out(["d"])
    with pytest.raises(InputError, match="at least one log to estimate from"):
        data.holding_out(["*"])


def test_without_gravity_there_is_no_moment_to_be_known(sine_log):
    carried = replace(sine_log.added_mass, gravity=0.0)
    data = DataSet.of([replace(sine_log, added_mass=carried)])
    assert data.known.fixed == {"p3": 0.0}
    with pytest.raises(InputError, match=r"known: p3: got 0.05; expected 0, as no gravity"):
        data.knowing(Prior.of({"p3": 0.05}))


def test_a_log_has_ten_cells_and_few_logs_two_for_each_parameter():
    assert [blocks.cells_of(logs, 9) for logs in (1, 2, 5)] == [18, blocks.CELLS, blocks.CELLS]
    assert [blocks.independent_cells_of(logs, 9) for logs in (1, 3, 4)] == [18, blocks.CELLS, 1]


def test_blocks_are_as_long_as_each_other_whatever_the_clock():
    time = np.concatenate([np.arange(0, 5, 0.001), np.arange(5, 10, 0.005)])
    edges = blocks.edges_of(time, 5)
    np.testing.assert_allclose(time[edges], [0, 2, 4, 6, 8], atol=0.01)
    assert blocks.edges_of(time[:3], 5) == []
    assert blocks.edges_of(time[:25], 5) == [0]


def test_a_block_of_a_sine_holds_whole_periods(sine_log):
    assert blocks.length_of(sine_log) == pytest.approx(4 * 2 * np.pi / 5)
    assert blocks.length_of(replace(sine_log, excitation=None)) == pytest.approx(4.0, rel=1e-3)
