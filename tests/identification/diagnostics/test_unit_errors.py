"""Slips are named with what undoes them, and nothing is named where there is none."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import ButterflyError, IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_error_search import find_unit_errors_of_refused
from butterfly.identification.diagnostics.unit_errors import (
    UnitError,
    unit_error,
    unit_error_text,
    unit_errors_of_masses,
)
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.logs.log import Sine
from butterfly.logs.units import Units
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
from butterfly.report.finding_texts import estimate_sentences
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, simulated, steady
from tests.independent.robots import draw
from tests.independent.slips import CASES, NAMED, OF_SINES, ask, names_it


@pytest.fixture(scope="module")
def sines():
    """Logs of sines, four of each mass, by the independent integrator, with names of their own."""
    logs = draw("A", 0, seed=3).logs
    masses = sorted({log.added_mass for log in logs})
    few = [[log for log in logs if log.added_mass == mass][:4] for mass in masses]
    return _with_names([log for own in few for log in own])


@pytest.fixture(scope="module")
def tones():
    """Logs of other inputs."""
    return _with_names(draw("C", 0, seed=3).logs)


def _with_names(logs):
    return [replace(log, name=f"run {k}") for k, log in enumerate(logs)]


def _named(logs, estimator):
    """Return what is named of logs, the level, and all that is said."""
    found = identify(DataSet.of(logs), estimator).estimate
    slips = [each for each in found.findings if each.kind in NAMED]
    return slips, found.level, " ".join(estimate_sentences(found))


def test_nothing_is_named_of_logs_that_are_right(sines, tones):
    for logs, estimator in ((sines, HarmonicBalance()), (tones, WeakForm())):
        slips, level, _ = _named(logs, estimator)
        assert (slips, level) == ([], Level.GOOD)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name"),
    [("A", name) for name in sorted(CASES)]
    + [("C", name) for name in sorted(set(CASES) - OF_SINES)],
)
def test_every_mistake_is_recognised_and_named(sines, tones, kind, name):
    """In logs of sines (A), and of other inputs (C)."""
    logs, seed = (sines, 3) if kind == "A" else (tones, 4)
    wrong = CASES[name].make(logs, np.random.default_rng(seed))
    answer = ask(wrong, kind)
    assert answer.recognised
    assert names_it(name, logs, wrong, answer.text), answer.text


def test_a_slip_is_said_first_and_its_factor_with_it(tones):
    degrees = [replace(log, angle=np.degrees(log.angle)) for log in tones]
    (slip, *_), level, said = _named(degrees, WeakForm())
    assert slip.number == pytest.approx(np.pi / 180)
    assert level is Level.WARNING
    assert said.startswith(
        "Do not use: The angle looks like degrees: multiplied by pi/180 (0.01745),"
    )


@pytest.mark.slow
def test_a_refusal_names_the_slip_that_explains_it(sines):
    degrees = [replace(log, angle=np.degrees(log.angle)) for log in sines]
    with pytest.raises(IdentifiabilityError, match=r"turns over.*looks like degrees"):
        identify(DataSet.of(degrees), HarmonicBalance())


@pytest.mark.parametrize(
    "factor", [0.1, *(pytest.param(each, marks=pytest.mark.slow) for each in (0.8, 1.3, 5.0))]
)
def test_of_three_masses_that_disagree_the_right_value_is_among_those_given(sines, factor):
    """Any one of three may be wrong: only their ratios are seen; the bare hand never is."""
    _, right, other = sorted({log.added_mass for log in sines})
    wrong = replace(right, mass=factor * right.mass)
    logs = [replace(log, added_mass=wrong) if log.added_mass == right else log for log in sines]
    slips, _, said = _named(logs, HarmonicBalance())
    fitting = {each.parameters[1]: each.number for each in slips}
    assert fitting[str(wrong)] == pytest.approx(right.mass, rel=0.05)
    assert fitting[str(other)] == pytest.approx(other.mass * factor, rel=0.05)
    assert all(each.parameters[1] != str(AddedMass()) for each in slips)
    assert said.index("contradict each other") < said.index("explanations")


def test_of_four_masses_the_wrong_one_is_found_alone():
    logs = steady(ROBOT, SWINGS)
    heavy = replace(MASSES[2], mass=0.2)
    more = [
        simulated(ROBOT, heavy, sine.sample, 60.0, sine=sine)
        for sine in (Sine(omega=omega, amplitude=0.02) for omega in (2.0, 3.0, 5.5))
    ]
    wrong = replace(MASSES[1], mass=0.08)
    told = [replace(log, added_mass=wrong) if log.added_mass == MASSES[1] else log for log in logs]
    (slip,), *_ = _named([*told, *more], HarmonicBalance())
    assert slip.parameters[1:] == (str(wrong), "1")
    assert slip.number == pytest.approx(MASSES[1].mass, rel=0.05)


def test_a_log_that_spoils_the_whole_estimate_is_found_by_leaving_it_out():
    """Next to its resonance, and said to carry nothing: the balance ends with hardly any p4."""
    logs = _with_names(steady(ROBOT, SWINGS))
    logs[12] = replace(logs[12], added_mass=AddedMass())
    slips, *_ = _named(logs, HarmonicBalance())
    (slip,) = [each for each in slips if each.kind == "slip"]
    assert slip.logs == ("run 12",)
    assert slip.number == pytest.approx(MASSES[2].mass, rel=0.05)


@pytest.mark.parametrize("ratio", [0.97, 1.01, 1.5])
def test_a_wrong_omega_is_named_with_its_log_and_the_right_one(sines, ratio):
    told = replace(sines[4].excitation, omega=sines[4].excitation.omega * ratio)
    logs = [*sines[:4], replace(sines[4], excitation=told), *sines[5:]]
    answer = ask(logs, "A")
    assert answer.recognised
    right = re.search(
        r"for run 4: (?:times|multiplied by) ([\d.]+),? .*? \(([\d.]+) rad/s\)", answer.text
    )
    assert float(right[1]) == pytest.approx(1 / ratio, rel=2e-3)
    assert float(right[2]) == pytest.approx(sines[4].excitation.omega, rel=2e-3)


def test_omegas_in_hz_are_named(sines):
    logs = [
        replace(log, excitation=replace(log.excitation, omega=log.excitation.omega / (2 * np.pi)))
        for log in sines
    ]
    with pytest.raises(InputError, match=r"look like Hz: multiplied by 2 pi"):
        DataSet.of(logs)


def _let_go(mass):
    return simulated(ROBOT, mass, np.zeros_like, 24.0, start=0.8)


def test_columns_swapped_in_free_decays_are_named_but_a_blocked_joint_is_no_such(sine_log):
    logs = [replace(log, input=log.angle, angle=log.input) for log in map(_let_go, MASSES)]
    with pytest.raises(InputError, match="Input and angle look swapped"):
        DataSet.of(logs)
    blocked = replace(sine_log, angle=np.zeros_like(sine_log.angle), excitation=None)
    with pytest.raises(InputError) as refused:
        DataSet.of([blocked])
    assert "swapped" not in str(refused.value)


def test_a_lone_log_that_no_model_follows_is_judged_though_no_other_can_tell_its_mass():
    data = DataSet.of(
        [simulated(ROBOT, MASSES[1], lambda t: 0.02 * np.sin(3 * t), 12.0)],
        known=Prior.of({"p4": -ROBOT.p4}),
    )
    found = identify(data, WeakForm(terms=()))
    assert found.estimate.level is Level.WARNING


@pytest.mark.parametrize("estimator", [WeakForm(), OutputError(workers=1)])
def test_logs_that_were_never_driven_are_refused(estimator):
    decays = [_let_go(mass) for mass in MASSES]
    with pytest.raises(IdentifiabilityError, match="the input is always zero"):
        identify(DataSet.of(decays), estimator)


def test_a_refusal_without_a_slip_names_none(sines):
    with pytest.raises(ButterflyError) as refused:
        identify(DataSet.of([log for log in sines if log.added_mass.mass == 0]))
    assert "look" not in str(refused.value)


def test_a_log_too_coarse_for_its_sine_is_refused(sine_log):
    coarse = sine_log.take(np.arange(0, sine_log.time.size, 400))
    with pytest.raises(InputError, match="mean sampling interval"):
        DataSet.of([coarse])


@pytest.mark.parametrize(
    ("error", "factor"),
    [
        (UnitError.DEGREES, math.pi / 180),
        (UnitError.TURNS, 2 * math.pi),
        (UnitError.COUNTS, 2 * math.pi / 4096),
        (UnitError.MILLISECONDS, 1e-3),
        (UnitError.MICROSECONDS, 1e-6),
        (UnitError.PER_MINUTE, 2 * math.pi / 60),
        (UnitError.HERTZ, 2 * math.pi),
        (UnitError.MILLIMETRES, 1e-3),
        (UnitError.CENTIMETRES, 1e-2),
        (UnitError.DIAMETER, 0.5),
        (UnitError.GRAMS, 1e-3),
    ],
)
def test_the_unit_that_is_advised_has_the_factor_that_undoes_the_mistake(error, factor):
    said = unit_error_text(unit_error(error, factor))
    name, unit = re.search(r"--units (\w+)=(\S+), ", said).groups()
    assert f"units: {{{name}: {unit}}}" in said
    assert Units.of({name: unit}).factor(name) == pytest.approx(factor, rel=1e-12)


def test_a_heavy_mass_is_asked_about_and_accused_of_nothing():
    grams = AddedMass(mass=52.0, arm=0.1)
    assert unit_errors_of_masses([grams, AddedMass(mass=9.0, arm=0.1)]) == [
        Finding(FindingKind.SUSPECTED, (UnitError.GRAMS,), number=52.0)
    ]
    assert unit_errors_of_masses([AddedMass(mass=9.0, arm=0.1)]) == []
    (asked,) = unit_errors_of_masses([grams])
    assert not asked.forbids
    assert "Is an added mass of 52 kg right?" in unit_error_text(asked)


@pytest.mark.parametrize("ratio", [5.0, 0.2])
def test_a_gear_that_was_forgotten_or_taken_off_twice_is_named(tones, ratio):
    moved = [replace(log, angle=ratio * log.angle) for log in tones]
    data = DataSet.of(moved, known=Prior.of({"gear_ratio": 5.0}))
    (slip, *_) = find_unit_errors_of_refused(data, WeakForm())
    assert slip.parameters[0] is UnitError.GEAR
    assert slip.number == pytest.approx(1 / ratio)
    right = DataSet.of(tones, known=Prior.of({"gear_ratio": 5.0}))
    assert find_unit_errors_of_refused(right, WeakForm()) == []
