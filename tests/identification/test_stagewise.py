"""Terms that are in the data are chosen, others are not, by nested fits like those made anew."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.stagewise import (
    candidates,
    friction_brakes,
    stagewise,
    stribeck_velocities,
    stribeck_velocity,
)
from butterfly.identification.submodels import Submodels, folds_of, without_logs
from butterfly.model.parameters import AddedMass
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


PARTS, EACH = 6, 5
COLUMNS = ("p1", "p3", "coulomb", "drag")
UNITS = np.array([1e-3, 1.0, 1e3, 1e-2])
FREE = np.full(4, -np.inf)


def _problem(*, lower=FREE, folds=None, seed=0):
    """A linear problem, and its equations about values that are not its solution."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((PARTS, EACH, 4)) / UNITS
    truth = UNITS * np.array([1.0, 2.0, 0.2, -0.5])
    target = rows @ truth + 0.3 * rng.standard_normal((PARTS, EACH))
    about = np.maximum(truth + UNITS * rng.standard_normal(4), lower)
    nested = Submodels(
        equations=cells(COLUMNS, rows, rows @ about - target, values=about, lower=lower),
        folds=np.arange(PARTS) if folds is None else folds,
    )
    return rows, target, nested


def _anew(rows, target, kept, lower=FREE):
    """Fit some columns to some logs by another solver; the other values are 0."""
    values = np.zeros(4)
    scaled = rows[..., kept] * UNITS[kept]
    found = lsq_linear(
        scaled.reshape(-1, kept.sum()), target.ravel(), (lower[kept] / UNITS[kept], np.inf)
    )
    values[kept] = found.x * UNITS[kept]
    return values


SUBSETS = np.array([[1, 1, 1, 1], [1, 1, 0, 0], [1, 0, 1, 1], [0, 1, 0, 1]], dtype=bool)
EVERYTHING = SUBSETS[:1]


BOUNDED = np.array([-np.inf, -np.inf, 0.0, 0.0])


@pytest.mark.parametrize(("lower", "atol"), [(FREE, 1e-9), (BOUNDED, 1e-7)])
def test_fits_with_fewer_terms_are_those_of_the_remaining_columns_within_their_bounds(lower, atol):
    rows, target, nested = _problem(lower=lower)
    found = nested.fitted(SUBSETS)
    assert (found[0, 3] == 0.0) == (lower is not FREE)  # which the data would have below 0
    for kept, values, costs in zip(SUBSETS, found, nested.costs(found), strict=True):
        expected = _anew(rows, target, kept, lower)
        np.testing.assert_allclose(values / UNITS, expected / UNITS, atol=atol)
        np.testing.assert_allclose(costs, np.sum((rows @ values - target) ** 2, axis=1), rtol=1e-9)


@pytest.mark.parametrize("folds", [np.arange(PARTS), np.array([0, 0, 1, 1, 2, 2])])
def test_errors_of_what_was_left_out_are_those_of_fits_to_the_rest(folds):
    rows, target, nested = _problem(folds=folds)
    expected = np.empty((len(SUBSETS), PARTS))
    for kept, errors in zip(SUBSETS, expected, strict=True):
        for part in np.unique(folds):
            mine = folds == part
            values = _anew(rows[~mine], target[~mine], kept)
            errors[mine] = np.sum((rows[mine] @ values - target[mine]) ** 2, axis=1)
    np.testing.assert_allclose(nested.held_out(SUBSETS), expected, rtol=1e-9)


def test_what_the_data_do_not_determine_has_no_fit():
    rows, target, _ = _problem()
    rows[..., 3] = rows[..., 2]
    equations = cells(COLUMNS, rows, -target)
    nested = Submodels(equations=equations, folds=np.arange(PARTS))
    sets = np.array([[True, True, True, True], [True, True, True, False]])
    for found in (nested.fitted(sets), nested.held_out(sets)):
        assert np.isnan(found[0]).any()
        assert np.isfinite(found[1]).all()


def test_where_the_rest_of_the_parts_does_not_determine_a_fit_single_cells_are_left_out():
    _, _, nested = _problem(folds=np.zeros(PARTS, dtype=int))
    alone = replace(nested, folds=np.arange(PARTS))
    np.testing.assert_array_equal(nested.held_out(EVERYTHING), alone.held_out(EVERYTHING))


def test_what_ran_away_is_no_lack_of_data():
    _, _, nested = _problem()
    equations = nested.equations
    rows, residuals = (each.copy() for each in equations.stack)
    rows[:, -1], residuals[:, -1] = 0.0, 1e200
    flat = {"rows": rows.reshape(-1, rows.shape[2]), "residuals": residuals.ravel()}
    away = replace(nested, equations=replace(equations, **flat))
    with np.errstate(over="ignore"):
        assert np.isposinf(away.held_out(EVERYTHING)).all()


def test_a_companion_that_is_absent_keeps_its_value_and_other_terms_are_nothing():
    _, _, nested = _problem()
    names = ("p1", "p3", "stribeck", "stribeck_velocity")
    nested = replace(nested, equations=replace(nested.equations, names=names))
    (found,) = nested.fitted(np.array([[True, True, False, False]]))
    assert found[2] == 0.0
    assert found[3] == nested.equations.values[3]


@pytest.mark.parametrize("lost", [[0], [1, 4]])
def test_the_estimate_without_some_logs_is_that_of_the_rest(lost):
    rows, target, nested = _problem()
    kept = [k for k in range(PARTS) if k not in lost]
    expected = _anew(rows[kept], target[kept], np.ones(4, dtype=bool))
    found = without_logs(nested.equations, lost)
    np.testing.assert_allclose(found / UNITS, expected / UNITS, atol=1e-9)


def test_what_only_the_lost_logs_move_keeps_its_value():
    """The gain, where all driven logs carry the mass that is left out."""
    rows, target, nested = _problem()
    rows[2:, :, 3] *= 1e-12
    values = nested.equations.values
    found = without_logs(cells(COLUMNS, rows, rows @ values - target, values=values), [0, 1])
    assert found[3] == values[3]
    kept = np.array([True, True, True, False])
    expected = _anew(rows[2:], target[2:] - rows[2:, :, 3] * values[3], kept)
    np.testing.assert_allclose(found[:3] / UNITS[:3], expected[:3] / UNITS[:3], atol=1e-9)


def test_a_parameter_on_its_bound_that_moves_nothing_stays_there():
    """Coulomb friction of a joint without any: its derivative is 0 where it is 0."""
    rows, target, _ = _problem(lower=BOUNDED)
    rows[..., 2] = 0.0
    equations = cells(COLUMNS, rows, -target, lower=BOUNDED)
    (found,) = Submodels(equations=equations, folds=np.arange(PARTS)).fitted(EVERYTHING)
    assert found[2] == 0.0
    expected = _anew(rows, target, np.array([True, True, False, True]), BOUNDED)
    np.testing.assert_allclose(found / UNITS, expected / UNITS, atol=1e-7)
