"""Terms that are in the data are chosen, others are not and are said."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.inference.submodels import Submodels
from butterfly.identification.inference.term_choice import (
    candidates,
    choose_terms,
    folds_of,
    stribeck_velocities,
)
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Prior
from tests.conftest import MASSES
from tests.identification.cells import cells
from tests.identification.simulated import ROBOT, steady

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


@pytest.mark.parametrize("seed", range(5))
def test_a_term_in_the_data_is_chosen_and_one_that_is_not_is_said(seed):
    chosen = choose_terms(
        [_nested(truth={"p1": 1, "p3": 2, "drag": 0.5}, seed=seed)], always=ALWAYS
    )
    assert chosen.names == (*ALWAYS, "drag")
    assert chosen.values["drag"] == pytest.approx(0.5, abs=0.05)
    (said,) = chosen.findings
    assert (said.kind, said.parameters) == (FindingKind.NOT_HELPING, ("bias",))


def test_fits_that_predict_as_well_are_rivals():
    """A term of the size of its own error makes no difference to what is foretold."""
    weak = {"p1": 1, "p3": 2, "drag": 0.006}
    choices = [choose_terms([_nested(truth=weak, seed=k)], always=ALWAYS) for k in range(8)]
    undecided = [each for each in choices if each.terms == () and each.rivals]
    assert undecided
    for chosen in undecided:
        for known, values in zip(chosen.rivals, chosen.rival_values, strict=True):
            assert known["drag"] != 0.0 or known["bias"] != 0.0
            np.testing.assert_array_equal(values, [known["p1"], known["p3"]])


def test_of_exact_data_the_smallest_exact_set_is_chosen():
    exact = replace(_nested(truth={"p1": 1, "drag": 2}, noise=0.0), negligible=1e-6)
    assert choose_terms([exact], always=ALWAYS).terms == ("drag",)


def test_what_is_demanded_is_fitted_whether_it_helps_or_not():
    nested = _nested(truth={"p1": 1, "p3": 2})
    chosen = choose_terms([nested], always=ALWAYS, demanded=("bias",))
    assert chosen.terms == ("bias",)


def test_terms_that_the_data_cannot_tell_apart_are_dropped_and_named():
    twins = _nested(truth={"p1": 1, "p3": 2, "drag": 0.5}, twins=[("bias", "drag")])
    chosen = choose_terms([twins], always=ALWAYS, demanded=("drag", "bias"))
    assert chosen.terms == ("drag",)
    assert chosen.inseparable == ("bias",)
    assert FindingKind.INSEPARABLE in {each.kind for each in chosen.findings}
    like_p3 = _nested(truth={"p1": 1, "p3": 2}, twins=[("bias", "p3")])
    assert choose_terms([like_p3], always=ALWAYS).inseparable == ("bias",)


def test_data_that_do_not_determine_what_every_fit_has_are_refused():
    nested = _nested(truth={"p1": 1}, twins=[("p3", "p1")])
    with pytest.raises(IdentifiabilityError, match="p1 and p3 cannot be identified"):
        choose_terms([nested], always=ALWAYS)


def test_one_log_is_enough_where_all_else_is_known():
    """One error has no scatter, and there is nothing to choose."""
    data = DataSet.of(steady(ROBOT, {2.2: 0.5})[:1])
    known = {"p1": ROBOT.p1, "p2": ROBOT.p2, "p3": ROBOT.p3, "p4": ROBOT.p4, "delay": 0.0}
    found = HarmonicBalance(terms=())(data.knowing(Prior.of(known)))
    assert found.parameters.coulomb == pytest.approx(ROBOT.coulomb, rel=1e-3)


def test_the_setting_that_predicts_best_is_chosen_among_several():
    names = (*ALWAYS, "stribeck")
    right = _nested(truth={"p1": 1, "p3": 2, "stribeck": 1.5}, names=names)
    wrong = _nested(truth={"p1": 1, "p3": 2, "stribeck": 1.5}, names=names, noise=1.0)
    fits = [
        replace(each, demanded=("stribeck",), settings={"stribeck_velocity": speed})
        for each, speed in ((wrong, 0.1), (right, 0.2))
    ]
    chosen = choose_terms(fits, always=ALWAYS)
    assert chosen.terms == ("stribeck",)
    assert chosen.settings == {"stribeck_velocity": 0.2}


def test_load_is_tried_with_three_different_masses_only():
    assert candidates(("drag", "load"), MASSES, NO_PRIOR) == ("drag", "load")
    assert candidates(("drag", "load"), MASSES[:2] * 3, NO_PRIOR) == ("drag",)
    same = AddedMass(mass=0.1, arm=0.104), AddedMass(mass=0.1, arm=0.104)
    assert candidates(("load",), (*same, AddedMass()), NO_PRIOR) == ()


def test_what_is_known_is_not_tried_nor_what_no_gravity_moves():
    drag = Prior.of({"drag": 0, "p3": 0})
    assert candidates(("drag", "bias", "p3_offset"), [AddedMass()], drag) == ("bias",)
    assert candidates(("p3_offset",), MASSES, drag) == ("p3_offset",)


def test_gravity_beside_its_line_makes_up_for_no_moment_that_is_known():
    """With one mass a turn of the encoder would: the moment could be any, and larger."""
    weighed = Prior.of({"p3": (2.98, 0.03), "p4": (1.0, 0.2)})
    assert candidates(("drag", "p3_offset"), [AddedMass()] * 3, weighed) == ("drag",)
    assert candidates(("drag", "p3_offset"), MASSES, weighed) == ("drag", "p3_offset")
    assert stribeck_velocities(2.0, Prior.of({"stribeck": 0})) == []
    assert stribeck_velocities(2.0, Prior.of({"stribeck_velocity": 0.3})) == [0.3]


def test_three_parts_are_left_out_as_such_and_of_fewer_each_log():
    np.testing.assert_array_equal(folds_of(["a", "b", "a", "c"]), [0, 1, 0, 2])
    np.testing.assert_array_equal(folds_of(["a", "b", "a", "a"]), [0, 1, 2, 3])


def test_stribeck_velocities_are_shares_of_the_largest_speed():
    speeds = np.array(stribeck_velocities(2.0, NO_PRIOR))
    assert (speeds[0], speeds[-1]) == pytest.approx((0.06, 1.0))
    assert np.ptp(np.diff(np.log(speeds))) < 1e-12
