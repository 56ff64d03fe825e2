"""What a data set refuses, and what it reads off its logs."""

from dataclasses import replace

import pytest

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.logs.log import InputKind, Log
from butterfly.model.prior import Prior
from tests.conftest import MASSES


def test_no_logs_are_refused_by_the_name_of_the_data_set():
    with pytest.raises(InputError, match=r"bench.*at least one log"):
        DataSet.of([], name="bench")


def test_logs_of_different_kinds_of_input_are_refused(sine_log):
    other = replace(sine_log, input_kind=InputKind.TORQUE)
    with pytest.raises(InputError, match="torque and voltage"):
        DataSet.of([sine_log, other])


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


def test_a_joint_that_is_never_driven_has_no_delay(sine_log):
    still = replace(sine_log, input=0.0 * sine_log.input, excitation=None)
    assert DataSet.of([still]).known.fixed == {"delay": 0.0}
    assert "delay" not in DataSet.of([still, sine_log]).known.fixed


def test_free_decays_go_with_logs_of_any_input_and_have_no_gain_by_themselves(sine_log):
    decay = replace(sine_log, input=0 * sine_log.input, excitation=None, input_kind=InputKind.NONE)
    mixed = DataSet.of([decay, sine_log])
    assert mixed.input_kind is sine_log.input_kind
    assert "p4" not in mixed.known.values
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


def test_what_is_known_holds_for_logs_that_are_held_out(sine_log):
    data = DataSet.of([sine_log, sine_log]).holding([1])
    known = Prior.of({"p3": 0.05})
    assert data.knowing(known).test_logs.known == known


def test_without_gravity_there_is_no_moment_to_be_known(sine_log):
    carried = replace(sine_log.added_mass, gravity=0.0)
    data = DataSet.of([replace(sine_log, added_mass=carried)])
    assert data.known.fixed == {"p3": 0.0}
    with pytest.raises(InputError, match=r"known: p3: got 0.05; expected 0, as no gravity"):
        data.knowing(Prior.of({"p3": 0.05}))
