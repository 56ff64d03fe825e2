"""What is known beforehand: exactly, with an uncertainty, wrongly, or not enough of it."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.derived_quantities import discrepancies, implied
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.limits import cluster_covariance
from butterfly.identification.loss import Loss
from butterfly.identification.trust import FindingKind
from butterfly.identification.unit_error_search import find_unit_errors
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.model.prior import Known, Penalty, Prior
from butterfly.model.terms import PARAMETERS
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, simulated, steady, wild
from tests.identification.simulated import noisy as simulated_noise

ONE = MASSES[1]
FEW = {omega: SWINGS[omega] for omega in (2.0, 4.4, 8.5)}
METHODS = {
    "harmonic-balance": HarmonicBalance(terms=()),
    "weak-form": WeakForm(terms=()),
    "output-error": OutputError(terms=(), workers=1),
}
EXACT = ("weak-form", "output-error")
"""Those without an error of their own."""
LINEAR = ("p1", "p2", "p3", "p4", "coulomb")
MOTOR = {"torque_constant": (0.05, 0.002), "resistance": (2.3, 0.12), "gear_ratio": 4}


def noisy(logs):
    return simulated_noise(logs, 2e-4, np.random.default_rng(0))


@pytest.fixture(scope="module")
def sines():
    return noisy(log for log in steady(ROBOT, SWINGS) if log.added_mass == ONE)


@pytest.fixture(scope="module")
def pair():
    """Two logs with one added mass: nothing tells the scale."""
    return noisy(wild(ROBOT, [ONE, ONE], duration=6.0))


@pytest.fixture(scope="module")
def several():
    """Logs with three added masses, by method."""
    free = noisy(wild(ROBOT, duration=8.0))
    return dict.fromkeys(METHODS, free) | {"harmonic-balance": noisy(steady(ROBOT, FEW))}


def knowing(logs, **told):
    return DataSet.of(logs, known=Prior.of(told))


def found(estimate):
    return dict(zip(estimate.names, estimate.values.tolist(), strict=True)) | estimate.fixed


def contradicted(estimate, kind):
    """Return parameter and number of the findings of a kind."""
    return [(each.parameters, each.number) for each in estimate.findings if each.kind is kind]


@pytest.mark.parametrize("name", LINEAR)
def test_any_parameter_that_is_known_sets_the_scale(pair, name):
    estimate = METHODS["weak-form"](knowing(pair, **{name: getattr(ROBOT, name)}))
    for other in ("p1", "p3", "p4"):
        assert found(estimate)[other] == pytest.approx(getattr(ROBOT, other), rel=0.02)


@pytest.mark.parametrize("method", EXACT)
def test_a_gain_takes_the_place_of_a_second_mass_and_widens_all_by_its_uncertainty(sines, method):
    share = 0.02
    estimate = METHODS[method](knowing(sines, p4=(ROBOT.p4, share * ROBOT.p4)))
    exact = METHODS[method](knowing(sines, p4=ROBOT.p4))
    assert "p4" not in exact.names
    assert exact.parameters.p4 == ROBOT.p4
    for name in LINEAR:
        assert found(exact)[name] == pytest.approx(getattr(ROBOT, name), rel=0.02), name
    errors = dict(zip(estimate.names, estimate.standard_errors, strict=True))
    rest = dict(zip(exact.names, exact.standard_errors, strict=True))
    carried = {"p1": ONE.inertia, "p3": ONE.gravity_moment}
    for name in ("p1", "p2", "p3", "p4"):
        grown = getattr(ROBOT, name) + carried.get(name, 0.0)
        closed = np.hypot(share * grown, rest.get(name, 0.0))
        assert errors[name] == pytest.approx(closed, rel=0.05), name
    assert found(estimate)["p4"] == pytest.approx(ROBOT.p4, rel=1e-3)
    assert not estimate.fixed.keys() & {*estimate.names}


def test_a_gain_that_sets_the_scale_does_so_beside_a_bias_of_each_log(pair):
    estimator = OutputError(terms=(), per_log=("bias",), workers=1)
    estimate = estimator(knowing(pair, p4=(ROBOT.p4, 0.02 * ROBOT.p4)))
    assert found(estimate)["p1"] == pytest.approx(ROBOT.p1, rel=0.02)
    assert {"bias"} in [values.keys() for values in estimate.local.values()]
    errors = dict(zip(estimate.names, estimate.standard_errors, strict=True))
    assert errors["p4"] == pytest.approx(0.02 * ROBOT.p4, rel=0.01)


def test_an_uncertain_zero_counts_beside_a_value_that_sets_the_scale(pair):
    zero, gain = Known(value=0.0, uncertainty=1e-6), ROBOT.p4
    biased = OutputError(terms=("bias",), workers=1)
    scaled, exact = (
        biased(knowing(pair, p4=p4).with_zero(zero)) for p4 in ((gain, 1e-6 * gain), gain)
    )
    errors = dict(zip(scaled.names, scaled.standard_errors, strict=True))
    assert [errors[name] for name in exact.names] == pytest.approx(exact.standard_errors, rel=0.03)


def test_two_priors_are_weighed_by_their_uncertainties(sines):
    told = {"p4": (1.01 * ROBOT.p4, 0.02 * ROBOT.p4), "p3": (ROBOT.p3, 0.002 * ROBOT.p3)}
    one = METHODS["output-error"](knowing(sines, p3=told["p3"]))
    both = METHODS["output-error"](knowing(sines, **told))
    at = both.names.index("p4")
    precisions = np.array([1 / one.covariance[at, at], 1 / told["p4"][1] ** 2])
    weighed = precisions @ [one.values[at], told["p4"][0]] / precisions.sum()
    assert both.values[at] == pytest.approx(weighed, rel=1e-4)
    assert both.standard_errors[at] == pytest.approx(precisions.sum() ** -0.5, rel=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_priors_beside_three_masses_go_from_nothing_to_all(several, method):
    logs, estimator = several[method], METHODS[method]
    plain = estimator(DataSet.of(logs))
    vague = estimator(knowing(logs, p4=(ROBOT.p4, 10.0)))
    np.testing.assert_allclose(vague.values, plain.values, rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(vague.standard_errors, plain.standard_errors, rtol=0.02)
    tight = estimator(knowing(logs, p4=(1.0001 * ROBOT.p4, 1e-9)))
    assert found(tight)["p4"] == pytest.approx(1.0001 * ROBOT.p4, rel=1e-6)


def test_a_prior_that_the_logs_contradict_is_said(several):
    def judged(factor):
        data = knowing(several["weak-form"], p4=(factor * ROBOT.p4, 0.01 * ROBOT.p4))
        return contradicted(METHODS["weak-form"](data), FindingKind.PRIOR_CONFLICT)

    ((parameters, number),) = judged(1.1)
    assert parameters == ("p4",)
    assert number > 5
    assert judged(1.01) == []


@pytest.mark.parametrize("method", EXACT)
def test_a_fixed_value_that_the_masses_contradict_is_said(several, method):
    def judged(factor):
        data = knowing(several[method], p4=factor * ROBOT.p4)
        return contradicted(METHODS[method](data), FindingKind.KNOWN_CONFLICT)

    assert judged(1.03) == [(("p4",), pytest.approx(-0.03, abs=0.005))]
    assert judged(1.0) == []


def test_a_term_may_be_known():
    robot = replace(ROBOT, drag=1e-3)
    logs = wild(robot, duration=8.0)
    exact = METHODS["output-error"](knowing(logs, drag=1e-3))
    assert exact.parameters.drag == 1e-3
    assert exact.parameters.p2 == pytest.approx(robot.p2, rel=1e-3)
    vague = METHODS["output-error"](knowing(logs, drag=(2e-3, 1.0)))
    assert vague.parameters.drag == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize("method", EXACT)
def test_known_cogging_acts_as_often_in_a_turn_as_is_known(method):
    robot = replace(ROBOT, cogging=0.003, cogging_periods=7.0)
    data = knowing(steady(robot, FEW, MASSES[::2]), cogging=0.003, cogging_periods=7.0)
    estimate = METHODS[method](data)
    for name in LINEAR:
        assert found(estimate)[name] == pytest.approx(getattr(robot, name), rel=1e-3), name
    assert estimate.parameters.cogging_periods == 7.0


def test_what_a_method_cannot_use_is_refused_with_one_that_can(sines):
    with pytest.raises(InputError, match=r"known.tilt: got 0.1; expected the method output-error"):
        METHODS["harmonic-balance"](knowing(sines, p4=1, tilt=0.1))
    with pytest.raises(InputError, match=r"known.cogging_periods: .*expected an exact value"):
        METHODS["output-error"](knowing(sines, p4=1, cogging_periods=(2, 1)))


@pytest.mark.parametrize("method", METHODS)
def test_nothing_that_tells_the_scale_is_refused_with_what_would(sines, method):
    with pytest.raises(IdentifiabilityError, match=r"same added mass.*--known p4=1.*--known p3="):
        METHODS[method](DataSet.of(sines))
    with pytest.raises(IdentifiabilityError, match="identifiable only up to a common factor"):
        METHODS[method](knowing(sines, delay=0.0, coulomb=0.0))


@pytest.mark.parametrize("method", ["weak-form", "output-error"])
def test_undriven_logs_need_a_gain_but_it_tells_no_scale(method):
    starts = (0.8, -0.6)
    still = [simulated(ROBOT, ONE, np.zeros_like, 6.0, start=start) for start in starts]
    with pytest.raises(IdentifiabilityError, match="--known p4="):
        METHODS[method](knowing(still, p3=0.04))
    told = (ROBOT.p3, 0.02 * ROBOT.p3)
    estimate = METHODS[method](knowing(noisy(still), p4=ROBOT.p4, delay=0.0, p3=told))
    assert found(estimate)["p1"] == pytest.approx(ROBOT.p1, rel=0.01)
    assert estimate.standard_errors[estimate.names.index("p3")] == pytest.approx(told[1], rel=0.05)


def test_a_prior_widens_a_robust_fit_as_it_does_a_plain_one(pair):
    data = knowing(pair, p4=(ROBOT.p4, 0.02 * ROBOT.p4), p3=(1.01 * ROBOT.p3, 0.02 * ROBOT.p3))
    plain, robust = (
        replace(METHODS["output-error"], loss=loss)(data) for loss in (Loss.LINEAR, Loss.HUBER)
    )
    assert robust.standard_errors[:4] == pytest.approx(plain.standard_errors[:4], rel=0.05)


def test_a_vague_prior_beside_two_masses_widens_nothing():
    logs = noisy(wild(ROBOT, [MASSES[0], MASSES[0], ONE, ONE], duration=6.0))
    checked = WeakForm(terms=())
    with_it, without = checked(knowing(logs, p4=(ROBOT.p4, ROBOT.p4))), checked(DataSet.of(logs))
    assert with_it.upper - with_it.lower == pytest.approx(without.upper - without.lower, rel=1e-3)


def test_a_term_that_is_known_is_not_chosen_away(pair):
    estimate = OutputError(workers=1)(knowing(pair, p4=ROBOT.p4, bias=(2e-3, 2e-4)))
    assert "bias" in estimate.names
    ((said, _),) = contradicted(estimate, FindingKind.PRIOR_CONFLICT)
    assert said == ("bias",)


def test_an_uncertain_zero_weighs_as_its_uncertainty_says(pair):
    data = knowing(pair, p4=ROBOT.p4)
    told = data.with_zero(Known(value=0.01, uncertainty=0.02))
    left, free = (METHODS["output-error"](each) for each in (told, data))
    assert left.local[None]["zero"] == pytest.approx(free.local[None]["zero"], abs=1e-6)
    assert left.standard_errors == pytest.approx(free.standard_errors, rel=1e-2)


def test_what_is_known_is_not_to_be_found_otherwise(pair):
    data = knowing(pair, p4=(0.5, 0.01), bias=0.0)
    for options, message in (
        ({"fixed": ("p4",)}, "fixed: got p4; expected a parameter without a prior"),
        ({"per_log": ("bias",)}, "per_log: got bias; expected a parameter that is not among"),
    ):
        with pytest.raises(InputError, match=message):
            OutputError(terms=(), **options)(data)
    every = {name: getattr(ROBOT, name) for name in PARAMETERS}
    with pytest.raises(InputError, match=r"known: got p1, .* all exactly; expected at least one"):
        METHODS["weak-form"](data.knowing(Prior.of(every)))


def test_a_wrong_mass_is_weighed_by_the_gravity_there():
    masses = [replace(mass, gravity=3.7) for mass in MASSES for _ in range(2)]
    logs = wild(ROBOT, masses, duration=6.0)
    logs[-1] = replace(logs[-1], added_mass=replace(masses[-1], mass=masses[-1].mass + 0.01))
    data = DataSet.of(noisy(logs))
    (slip,) = find_unit_errors(data, METHODS["weak-form"], METHODS["weak-form"](data))
    assert slip.number == pytest.approx(masses[-1].mass, abs=1e-3)


@pytest.mark.parametrize("known", [{}, {"p3": 0.0}, {"p1": ROBOT.p1, "p4": ROBOT.p4}])
def test_uncertain_masses_and_arms_widen_the_intervals(known):
    logs = wild(replace(ROBOT, **known), duration=8.0)
    share = 0.01

    def estimated(factor, uncertainty):
        arms = [log.added_mass.arm for log in logs]
        told = [
            replace(log.added_mass, arm=factor * arm, arm_uncertainty=uncertainty * arm)
            for log, arm in zip(logs, arms, strict=True)
        ]
        weighed = [replace(log, added_mass=mass) for log, mass in zip(logs, told, strict=True)]
        return METHODS["weak-form"](knowing(weighed, **known))

    exact, longer, vague = estimated(1, 0), estimated(1 + share, 0), estimated(1, share)
    moved = abs(longer.values - exact.values)
    for name in {"p1", "p3", "p4"} & set(exact.names):
        at, of_vague = exact.names.index(name), vague.names.index(name)
        added = vague.covariance[of_vague, of_vague] - exact.covariance[at, at]
        assert np.sqrt(added) == pytest.approx(moved[at], rel=0.1)


def test_covariance_with_a_prior_is_that_of_many_draws():
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((12, 4, 2)) @ np.array([[1.0, 0.9], [0.0, 0.05]])
    truth, told, size = np.array([1.0, 2.0]), 0.3, 0.4
    flat = rows.reshape(-1, 2)
    prior = Penalty(mean=truth, weight=np.array([0.0, (size / told) ** 2]), variance=size**2)
    normal = np.linalg.inv(flat.T @ flat + prior.curvature)
    values, covariances = [], []
    for _ in range(1000):
        noise = size * np.repeat(rng.standard_normal(12), 4) * np.tile([1, 0, 0, 0], 12)
        noise += size * rng.standard_normal(48) * np.tile([0, 1, 1, 1], 12)
        mean = truth + np.array([0, told * rng.standard_normal()])
        fit = normal @ (flat.T @ (flat @ truth + noise) + prior.weight * mean)
        values.append(fit)
        covariances.append(
            cluster_covariance(rows, (flat @ fit - flat @ truth - noise).reshape(12, 4), prior)[0]
        )
    np.testing.assert_allclose(
        np.mean(covariances, axis=0), np.cov(np.transpose(values)), rtol=0.12
    )


def _implied(told, kind=InputKind.VOLTAGE, joint=JointKind.HINGE):
    return implied(Prior.of(told), kind, joint).parameters


def test_a_data_sheet_tells_the_gain_of_a_voltage_and_the_inertia_of_a_slide():
    """By the closed form of a quotient; a hinge without a gear is driven directly, a slide not."""
    p4 = _implied(MOTOR)["p4"]
    assert p4.value == pytest.approx(4 * 0.05 / 2.3)
    assert p4.uncertainty / p4.value == pytest.approx(np.hypot(0.002 / 0.05, 0.12 / 2.3))
    assert not _implied(MOTOR, InputKind.TORQUE)
    direct = {"torque_constant": 0.05, "resistance": 2.0}
    assert _implied(direct)["p4"] == Known(value=0.025)
    assert not _implied(direct, joint=JointKind.SLIDE)
    told = {"hand_mass": (0.5, 0.003), "gear_ratio": 100.0, "rotor_inertia": (1e-5, 4e-7)}
    p1 = _implied(told, joint=JointKind.SLIDE)["p1"]
    assert (p1.value, p1.uncertainty) == (pytest.approx(0.6), pytest.approx(0.005))
    assert "p1" not in _implied(told)


def test_two_sources_weigh_by_their_variances_and_what_is_exact_alone():
    told = {"p4": (0.0250, 0.0005), "torque_constant": (0.05, 0.001), "resistance": 2.1}
    follows = (0.05 / 2.1, 0.001 / 2.1)
    weights = np.array([0.0005**-2, follows[1] ** -2])
    p4 = _implied(told)["p4"]
    assert p4.value == pytest.approx(weights @ [0.025, follows[0]] / weights.sum())
    assert p4.uncertainty == pytest.approx(weights.sum() ** -0.5)
    far = discrepancies(Prior.of(told), InputKind.VOLTAGE)
    assert far == {"p4": pytest.approx((0.025 - follows[0]) / np.hypot(0.0005, follows[1]))}
    # What is exact counts alone; two exact values agree or are refused.
    sheet = {"torque_constant": 0.05, "resistance": 2.0}
    assert _implied(sheet | {"p4": (0.03, 0.001)})["p4"] == Known(value=0.025)
    uncertain = {"torque_constant": (0.05, 0.01), "resistance": 2.0}
    assert _implied(uncertain | {"p4": 0.03})["p4"] == Known(value=0.03)
    assert _implied(sheet | {"p4": 0.025001})["p4"] == Known(value=0.025001)
    with pytest.raises(InputError, match=r"p4: got 0.03; expected 0.025, by the other known"):
        _implied(sheet | {"p4": 0.03})
