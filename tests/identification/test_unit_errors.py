"""Slips are named with what undoes them, and nothing is named where there is none."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.identification.segments import driven
from butterfly.identification.simulation import Simulation
from butterfly.identification.trust import Finding, FindingKind
from butterfly.identification.unit_error_search import find_slow_clock, find_unit_errors
from butterfly.identification.unit_errors import (
    UnitError,
    clock_error,
    unit_error,
    unit_error_text,
    unit_errors_of_masses,
    unit_errors_of_omegas,
)
from butterfly.logs.log import Log
from butterfly.logs.units import Units
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known, Prior
from butterfly.model.servo import ServoLoop
from butterfly.report.finding_texts import estimate_sentences
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.mistaken import fitted, named_of, recorded, with_names
from tests.identification.simulated import ROBOT, SWINGS, steady, wild
from tests.independent.paces import draw as draw_paced
from tests.independent.robots import draw
from tests.independent.slips import CASES, OF_SINES, ask, names_it

FEW = {omega: SWINGS[omega] for omega in (2.0, 4.4, 8.5)}
SIMULATED = OutputError(terms=(), workers=1)


@pytest.fixture(scope="module")
def logs():
    """Logs of sines with names of their own."""
    return with_names(steady(ROBOT, FEW))


@pytest.fixture(scope="module")
def sines(logs):
    """The same, with noise."""
    return recorded(logs)


@pytest.fixture(scope="module")
def tones():
    """Logs of other inputs."""
    return recorded(wild(ROBOT, MASSES * 2, 8.0))


@pytest.fixture(scope="module")
def drawn():
    """Logs of sines (A), four of each mass, and of other inputs (C), by another integrator."""
    logs = draw("A", 0, seed=3).logs
    masses = sorted({log.added_mass for log in logs})
    few = [log for mass in masses for log in [each for each in logs if each.added_mass == mass][:4]]
    return {"A": with_names(few), "C": with_names(draw("C", 0, seed=3).logs)}


def test_nothing_is_named_of_logs_that_are_right(sines, tones):
    fast = HarmonicBalance(), Level.CARE
    for logs, estimator, best in ((sines, *fast), (tones, WeakForm(), Level.GOOD)):
        slips, level, _ = named_of(logs, estimator)
        assert (slips, level) == ([], best)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name"),
    [("A", name) for name in sorted(CASES)]
    + [("C", name) for name in sorted(set(CASES) - OF_SINES)],
)
def test_every_mistake_is_recognised_and_named(drawn, kind, name):
    """In logs of sines (A), and of other inputs (C)."""
    logs = drawn[kind]
    wrong = CASES[name].make(logs, np.random.default_rng(3 if kind == "A" else 4))
    answer = ask(wrong, kind)
    assert answer.recognised
    assert names_it(name, logs, wrong, answer.text), answer.text


TURN = 2 * math.pi
FACTORS = {"DEGREES": TURN / 360, "TURNS": TURN, "COUNTS": TURN / 4096, "HERTZ": TURN}
FACTORS |= {"MILLISECONDS": 1e-3, "MICROSECONDS": 1e-6, "PER_MINUTE": TURN / 60, "DIAMETER": 0.5}
FACTORS |= {"MILLIMETRES": 1e-3, "CENTIMETRES": 1e-2, "GRAMS": 1e-3}


@pytest.mark.parametrize(("error", "factor"), FACTORS.items())
def test_the_unit_that_is_advised_has_the_factor_that_undoes_the_mistake(error, factor):
    said = unit_error_text(unit_error(UnitError[error], factor))
    name, unit = re.search(r"--units (\w+)=(\S+), ", said).groups()
    assert f"units: {{{name}: {unit}}}" in said
    assert Units.of({name: unit}).factor(name) == pytest.approx(factor, rel=1e-12)


def test_a_heavy_mass_is_asked_about_and_accused_of_nothing():
    grams = AddedMass(mass=52.0, arm=0.1)
    assert unit_errors_of_masses([grams, AddedMass(mass=9.0, arm=0.1)]) == [
        Finding(FindingKind.ASKED, (UnitError.GRAMS,), number=52.0)
    ]
    assert unit_errors_of_masses([AddedMass(mass=9.0, arm=0.1)]) == []
    (asked,) = unit_errors_of_masses([grams])
    assert not asked.forbids
    assert "Is an added mass of 52 kg right?" in unit_error_text(asked)


def test_a_gear_that_was_forgotten_or_taken_off_twice_is_named(tones):
    for ratio, named in ((5.0, [UnitError.GEAR]), (0.2, [UnitError.GEAR]), (1.0, [])):
        moved = [replace(log, angle=ratio * log.angle) for log in tones]
        data = DataSet.of(moved, known=Prior.of({"gear_ratio": 5.0}))
        slips = find_unit_errors(data, WeakForm(terms=()))[:1]
        assert [slip.parameters[0] for slip in slips] == named
        assert [slip.number for slip in slips] == pytest.approx([1 / ratio] * len(named))


TIME = np.arange(0.0, 2.5, 0.006)
GOALS = (
    1.2 * np.sin(2 * TIME),
    1.4 * np.sin(1.5 * TIME + 0.3 * TIME**2),
    np.sign(np.sin(1.5 * TIME)),
)
JOINT = LumpedParameters(p1=0.0066, p2=0.05, p3=0.3, p4=1.0, coulomb=0.02)


def _servo(kp, **more):
    servo = ServoLoop.of({"law": "pid-torque", "kp": kp, **more})
    told = {"input_kind": "setpoint", "servo": servo, "zero": Known(value=0.0)}
    still = [Log(TIME, input=goal, angle=0 * TIME, **told) for goal in GOALS]
    runs = [Simulation(driven(log), JOINT).run(JOINT, 0.0).at(TIME) for log in still]
    return [driven(replace(log, angle=run)) for log, run in zip(still, runs, strict=True)]


def _of_springs(logs):
    return DataSet.of(logs, known=Prior.of({"p3": JOINT.p3}))


def _as_voltage(log, drive):
    return Log(log.time, drive, log.angle, zero=log.zero)


def test_a_set_point_told_as_a_voltage_is_named_and_never_good():
    told = _of_springs([_as_voltage(log, log.setpoint) for log in _servo(3.0)])
    found = identify(told, WeakForm()).estimate
    assert found.level is Level.WARNING
    assert "input: setpoint and the servo's loop" in estimate_sentences(found)[0]


def test_its_drive_is_accused_of_nothing_nor_a_spring_of_another_stiffness():
    drives = [_as_voltage(log, log.input) for log in _servo(1.0)]
    assert find_unit_errors(_of_springs(drives), WeakForm()) == []
    sprung = [_as_voltage(log, 2 * log.setpoint) for log in _servo(3.0)]
    found = find_unit_errors(_of_springs(sprung), WeakForm())
    assert not any(UnitError.SETPOINT in each.parameters for each in found)


def test_a_gain_told_twice_too_large_is_named_by_its_factor_and_a_right_one_is_not():
    logs = _servo(3.0, limit=0.35)[:1]
    for factor, named in ((1.0, []), (2.0, [UnitError.GAIN])):
        told = ServoLoop.of({"law": "pid-torque", "kp": 3.0 * factor, "limit": 0.35})
        data = _of_springs([driven(replace(log, servo=told)) for log in logs])
        found = find_unit_errors(data, SIMULATED, SIMULATED(data))
        assert [each.parameters[0] for each in found] == named
        assert [each.number for each in found] == pytest.approx([1 / factor] * len(named), rel=0.02)


@pytest.mark.parametrize("rate", [0.997, 1.0, 1.002])
def test_the_share_by_which_sines_run_off_is_told(logs, rate):
    data = DataSet.of([replace(log, time=rate * log.time) for log in logs])
    share = clock_error(data.sines)
    assert share == pytest.approx(1 / rate - 1, abs=2e-5)
    assert (share == 0) == (rate == 1)


def test_omegas_that_are_rounded_to_either_side_are_no_clock(logs):
    data = DataSet.of(logs)
    random = np.random.default_rng(0)
    points = [replace(each, detuning=1e-3 * random.standard_normal()) for each in data.sines]
    assert clock_error(points) == 0


def test_logs_whose_inputs_are_next_to_their_omega_are_named_and_no_other(logs):
    data = DataSet.of(logs)
    points = [replace(each, detuning=0.02 * (k == 1)) for k, each in enumerate(data.sines)]
    slipped = replace(data, points=(*points[:-1], None))
    (found,) = find_unit_errors(slipped, SIMULATED)
    assert (found.logs, found.number) == (("run 1",), pytest.approx(1.02))
    ratios = np.array([1 + each.detuning for each in data.sines])
    assert unit_errors_of_omegas(data.logs, ratios) == []
    ratios[:2] = 0.97, 1.02
    each = unit_errors_of_omegas(data.logs, ratios)
    assert [(slip.logs, slip.number) for slip in each] == [(("run 0",), 0.97), (("run 1",), 1.02)]


@pytest.mark.parametrize(
    ("wrong", "kind"), [("clock", FindingKind.CLOCK_SET), ("omega", FindingKind.OMEGA_SET)]
)
def test_known_masses_tell_which_is_wrong_and_logs_held_out_are_corrected_too(logs, wrong, kind):
    told = DataSet.of([_told_wrong(log, wrong) for log in logs]).holding_out(["run 1"])
    data, found = fitted(told, SIMULATED)
    assert data.correction.kind is kind
    assert "mass_inertia" not in found.names
    assert found.parameters.p1 == pytest.approx(ROBOT.p1, rel=2e-3)
    (held,) = data.test_logs.logs
    for log, right in ((data.logs[0], logs[0]), (held, logs[1])):
        assert log.time[-1] == pytest.approx(right.time[-1], rel=1e-4)
        assert log.excitation.omega == pytest.approx(right.excitation.omega, rel=1e-4)
    assert data.test_logs.simulations.fits(found).min() > 99


def test_what_is_held_out_is_predicted_on_the_corrected_clock(logs):
    wrong = DataSet.of([log.timed(0.996) for log in logs])
    held, right = (
        bf.validate(data, SIMULATED, split="log", folds=3).to_dict()["fit"]["left_out"]["median"]
        for data in (wrong, DataSet.of(logs))
    )
    assert held == pytest.approx(right, abs=0.05)


@pytest.mark.parametrize("wrong", ["clock", "omega"])
def test_where_nothing_tells_the_interval_holds_both(logs, wrong):
    bare = [_told_wrong(log, wrong) for log in logs if not log.added_mass.mass]
    data = DataSet.of(bare, known=Prior.of({"p4": ROBOT.p4}))
    found = identify(data, SIMULATED).estimate
    assert FindingKind.CLOCK in {each.kind for each in found.findings}
    (place,) = [k for k, name in enumerate(found.names) if name == "p1"]
    assert found.lower[place] <= ROBOT.p1 <= found.upper[place]
    assert found.upper[place] - found.lower[place] < 0.02 * ROBOT.p1


def _told_wrong(log, what):
    return log.timed(0.996) if what == "clock" else log.tuned(0.996)


def test_a_slow_robot_s_clock_is_not_called_wrong(tmp_path):
    """Ten samples in up to twenty seconds; of a quick one, whose stamps are in ms, it is."""
    found = []
    for number in range(9):
        folder = tmp_path / f"{number}"
        draw_paced("slow", number).write(folder)
        data = bf.read(folder)
        found.append(data.logs[0].mean_step)
        assert find_slow_clock(data) == []
    assert max(found) > 1.0
    quick = with_names(steady(ROBOT, FEW))
    slow = [replace(log, time=1e3 * log.time, excitation=None) for log in quick]
    (said,) = find_slow_clock(DataSet.of(slow))
    assert said.parameters[0] == UnitError.MILLISECONDS
