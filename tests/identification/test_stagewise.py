"""Terms that are in the data are chosen, others are not, by nested fits like those made anew."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.scatter import Submodels, folds_of
from butterfly.identification.stagewise import (
    candidates,
    stagewise,
    stribeck_velocities,
    stribeck_velocity,
)
from butterfly.identification.trust import Finding, FindingKind
from butterfly.model.parameters import AddedMass, friction_brakes
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.orbit.recalibration import LinearModel
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, cells, steady

ALWAYS = ("p1", "p3")
NAMES = (*ALWAYS, "drag", "bias")
LOGS, ROWS = 12, 20


def _nested(*, truth, noise=0.1, seed=0, names=NAMES, twins=()):
    """Equations of a linear problem; ``twins`` are columns that are the same."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((LOGS, ROWS, len(names)))
    for one, other in twins:
        rows[..., names.index(one)] = rows[..., names.index(other)]
    target = rows @ np.array([truth.get(name, 0.0) for name in names])
    target += noise * rng.standard_normal(target.shape)
    return Submodels(equations=cells(names, rows, -target), folds=np.arange(LOGS) % 4)


def _choose(nested, rare=()):
    """Choose from the terms of equations, beginning with none."""
    rows = tuple(name for name in nested.names if name not in ALWAYS)
    return stagewise(LinearModel(every=nested, optional=rows), rows, rare)


@pytest.mark.parametrize("seed", range(5))
def test_a_term_in_the_data_is_chosen_and_one_that_is_not_is_said(seed):
    chosen = _choose(_nested(truth={"p1": 1, "p3": 2, "drag": 0.5}, seed=seed))
    assert chosen.model.terms == {"drag"}
    assert chosen.model.values[NAMES.index("drag")] == pytest.approx(0.5, abs=0.05)
    assert chosen.model.values[NAMES.index("bias")] == 0.0
    assert chosen.path == ((), ("drag",))
    (said,) = chosen.findings
    assert (said.kind, said.parameters) == (FindingKind.NOT_HELPING, ("bias",))


def test_sound_data_rarely_get_a_term_that_is_not_there():
    """At a hundredth of chance, and a gain, per choice from two: of 300 about two."""
    choices = [_choose(_nested(truth={"p1": 1, "p3": 2}, seed=k)) for k in range(300)]
    assert sum(bool(each.model.terms) for each in choices) <= 6


def test_more_is_asked_of_a_rare_term():
    weak = {"p1": 1, "p3": 2, "drag": 0.025}
    every = [_nested(truth=weak, seed=k) for k in range(60)]
    often, rarely = ([_choose(n, rare).model.terms for n in every] for rare in ((), ("drag",)))
    taken = [sum("drag" in each for each in found) for found in (often, rarely)]
    assert taken[1] + 5 < taken[0]


def test_a_common_term_that_might_help_is_a_rival():
    weak = {"p1": 1, "p3": 2, "drag": 0.01}
    choices = [_choose(_nested(truth=weak, seed=k)) for k in range(12)]
    undecided = [each for each in choices if not each.model.terms and each.rivals]
    assert undecided
    for chosen in undecided:
        assert chosen.rival_values()
        for rival in chosen.rival_values():
            assert rival["drag"] != 0.0 or rival["bias"] != 0.0


class _Descended(LinearModel):
    """A fit whose values are known, as a descent finds them, though its equations are singular."""

    nested = property(lambda self: self.every)


def test_a_fit_that_predicts_nothing_loses_what_it_cannot_tell_and_only_that():
    names = (*ALWAYS, "drag", "load", "bias")
    truth = {"p1": 1, "p3": 2, "drag": 0.5, "bias": 0.5}
    nested = _nested(truth=truth, names=names, twins=[("load", "p3")])
    begun = _Descended(every=nested, optional=names[2:], terms=frozenset(names[2:]))
    assert stagewise(begun, names[2:], ()).path == (names[2:], ("drag", "bias"))


def test_what_does_not_help_leaves_at_once_what_a_fit_began_with():
    names = (*ALWAYS, "drag", "load", "bias", "spring")
    nested = _nested(truth={"p1": 1, "p3": 2, "bias": 0.5}, names=names, seed=3)
    begun = LinearModel(every=nested, optional=names[2:], terms=frozenset(names[2:]))
    found = stagewise(begun, names[2:], ())
    assert found.path == (names[2:], ("bias",))
    assert found.idle == ("drag", "load", "spring")


class _Needing(LinearModel):
    """A fit whose simulations follow no log without some term, whatever its equations promise."""

    def without(self, names):
        return None if "load" in names else super().without(names)


def test_a_term_without_which_no_simulation_is_as_good_stays_though_it_does_not_help():
    names = (*ALWAYS, "drag", "load", "bias")
    nested = _nested(truth={"p1": 1, "p3": 2, "bias": 0.5}, names=names, seed=3)
    begun = _Needing(every=nested, optional=names[2:], terms=frozenset(names[2:]))
    found = stagewise(begun, names[2:], ())
    assert found.model.terms == {"load", "bias"}
    assert found.idle == ("drag",)


def test_terms_that_stay_go_only_if_they_end_on_their_bound():
    names = (*ALWAYS, "drag", "load", "bias")
    nested = _nested(truth={"p1": 1, "p3": 2, "drag": -0.5, "bias": 0.5}, names=names, seed=3)
    values = np.array([1.0, 2.0, 0.0, 0.0, 0.5])
    there = replace(nested.about(values).equations, held=np.arange(5) == 2)
    begun = LinearModel(
        every=replace(nested, equations=there), optional=names[2:], terms=frozenset(names[2:])
    )
    begun.__dict__["nested"] = begun.every  # where a descent ended
    found = stagewise(begun, names[2:], (), staying=names[2:])
    assert found.path == (names[2:], ("load", "bias"))


def test_of_exact_data_the_smallest_exact_set_is_chosen():
    exact = replace(_nested(truth={"p1": 1, "drag": 2}, noise=0.0), negligible=1e-6)
    assert _choose(exact).model.terms == {"drag"}


def test_a_term_that_no_longer_helps_goes_again():
    """A column between two others is the best of one, and nothing beside both."""
    names = (*ALWAYS, "drag", "load", "bias")
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((LOGS, ROWS, len(names)))
    rows[..., 4] = rows[..., 2] + rows[..., 3] + 0.3 * rng.standard_normal(rows.shape[:2])
    target = rows @ np.array([1.0, 2.0, 1.0, 1.0, 0.0])
    target += 0.05 * rng.standard_normal(target.shape)
    nested = Submodels(equations=cells(names, rows, -target), folds=np.arange(LOGS) % 4)
    chosen = _choose(nested)
    assert set(chosen.path[1]) == {"bias"}
    assert chosen.model.terms == {"drag", "load"}


def test_terms_that_fit_as_well_in_place_of_each_other_are_rivals():
    twins = _nested(truth={"p1": 1, "p3": 2, "drag": 0.5}, noise=0.1)
    rows = twins.equations.stack[0].copy()
    rows[..., 3] = rows[..., 2] + 1e-3 * np.random.default_rng(1).standard_normal(rows.shape[:2])
    alike = replace(twins, equations=replace(twins.equations, rows=rows.reshape(-1, rows.shape[2])))
    chosen = _choose(alike)
    (taken,) = chosen.model.terms
    (other,) = {"drag", "bias"} - {taken}
    assert any(each[other] != 0.0 and each[taken] == 0.0 for each in chosen.rival_values())


def test_a_term_that_the_data_cannot_tell_from_the_rest_is_named():
    like_p3 = _nested(truth={"p1": 1, "p3": 2}, twins=[("bias", "p3")])
    assert Finding(FindingKind.INSEPARABLE, ("bias",)) in _choose(like_p3).findings


def test_one_log_is_enough_where_all_else_is_known():
    """One error has no scatter, and there is nothing to choose."""
    data = DataSet.of(steady(ROBOT, {2.2: 0.5})[:1])
    known = {"p1": ROBOT.p1, "p2": ROBOT.p2, "p3": ROBOT.p3, "p4": ROBOT.p4, "delay": 0.0}
    found = OutputError(terms=(), workers=1)(data.knowing(Prior.of(known)))
    assert found.parameters.coulomb == pytest.approx(ROBOT.coulomb, rel=1e-3)


def test_friction_that_would_drive_the_joint_is_not_possible():
    light, heavy = AddedMass(), AddedMass(mass=1.0, arm=0.1)
    assert friction_brakes({"coulomb": 1.0, "load": -0.05}, (light, heavy))
    assert not friction_brakes({"coulomb": 1.0, "load": -0.2}, (light, heavy))
    assert not friction_brakes({"coulomb": 0.0, "stribeck": 0.1}, (light,))
    assert friction_brakes({"stribeck": 0.1}, ())


def test_what_is_known_is_not_tried_nor_what_masses_or_gravity_cannot_tell():
    """Gravity beside its line, with one mass, would make up for any error of a known moment."""
    bare, heavy = AddedMass(), AddedMass(mass=0.1, arm=0.104)
    assert candidates(("drag", "load"), MASSES, NO_PRIOR) == ("drag", "load")
    assert candidates(("drag", "load"), MASSES[:2] * 3, NO_PRIOR) == ("drag",)
    assert candidates(("load",), (heavy, heavy, bare), NO_PRIOR) == ()
    drag = Prior.of({"drag": 0, "p3": 0})
    assert candidates(("drag", "bias", "p3_offset"), [bare], drag) == ("bias",)
    assert candidates(("p3_offset",), MASSES, drag) == ("p3_offset",)
    weighed = Prior.of({"p3": (2.98, 0.03), "p4": (1.0, 0.2)})
    assert candidates(("drag", "p3_offset"), [bare] * 3, weighed) == ("drag",)
    assert candidates(("drag", "p3_offset"), MASSES, weighed) == ("drag", "p3_offset")


def test_three_parts_are_left_out_as_such_and_of_fewer_each_log():
    np.testing.assert_array_equal(folds_of(["a", "b", "a", "c"]), [0, 1, 0, 2])
    np.testing.assert_array_equal(folds_of(["a", "b", "a", "a"]), [0, 1, 2, 3])


def test_stribeck_velocities_are_shares_of_the_largest_speed_or_known():
    speeds = np.array(stribeck_velocities(2.0))
    assert (speeds[0], speeds[-1]) == pytest.approx((0.06, 0.74))
    assert np.ptp(np.diff(np.log(speeds))) < 1e-12
    assert stribeck_velocity(2.0, NO_PRIOR) == speeds[1]
    known = Prior.of({"stribeck_velocity": 0.3})
    assert stribeck_velocities(2.0, known) == [stribeck_velocity(2.0, known)] == [0.3]
