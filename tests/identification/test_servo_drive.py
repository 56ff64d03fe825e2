"""Servos that are identified in their loops."""

import json
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from butterfly.api.identification import Identification
from butterfly.errors import InputError
from butterfly.identification.chosen_terms import offered_rows
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.output_error import OutputError
from butterfly.identification.estimators.start import servo_start, starts
from butterfly.identification.forecast import Identifiability, forecast
from butterfly.identification.identify import simulated
from butterfly.identification.segments import driven
from butterfly.identification.simulation import Simulation, segment_length
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.servo import ServoLoop
from butterfly.model.terms import LOOP_TERMS
from butterfly.report.format import fit_text
from butterfly.report.summary import loop_table
from tests.model.loops import ENABLED, GOAL, JOINT, TIME, log_of


@pytest.mark.parametrize("input_kind", ["voltage", "torque"])
def test_back_emf_is_tried_of_drives_that_feel_it(input_kind):
    log = replace(log_of("moteus"), input_kind=input_kind)
    rows, _ = offered_rows([log], NO_PRIOR)
    assert ("back_emf" in rows) == (input_kind == "voltage")


SIMPLE = LumpedParameters(p1=0.0066, p2=0.031, p3=0.3, p4=0.09, coulomb=0.01)


def _simulated(*goals, joint=SIMPLE, enabled=None, gains=MappingProxyType({}), **told):
    """The data set of a servo of kp 20 that followed some goals, its loop as told."""
    servo = ServoLoop.of({"law": "pid-voltage", "kp": 20.0, "limit": 6.0, **gains})
    logs = []
    for number, goal in enumerate(goals):
        log = Log(TIME, input=goal, angle=0 * TIME, input_kind="setpoint", servo=servo)
        log = replace(log, enabled=enabled)
        angle = Simulation(driven(log), joint).run(joint, 0.0).at(TIME)
        own = replace(servo, **told)
        logs.append(replace(log, angle=angle, servo=own, zero=Known(value=0.0), name=f"{number}"))
    return DataSet.of(logs, known=Prior.of({"p3": 0.3}))


def _values(estimate):
    return dict(zip(estimate.names, estimate.values.tolist(), strict=True))


def test_a_servo_is_identified_from_its_set_points_and_an_uncertain_gain_with_it():
    data = _simulated(GOAL, kp=Known(value=16.0, uncertainty=8.0))
    assert data.input_kind is InputKind.VOLTAGE
    values = _values(OutputError(terms=())(data))
    assert values["loop_kp"] == pytest.approx(1.25, rel=0.01)
    for name in ("p1", "p2", "p4"):
        assert values[name] == pytest.approx(getattr(SIMPLE, name), rel=0.01)
    found = simulated(data, OutputError(terms=())(data))
    assert found.open_loop_fits["0"] > 95  # by the drive that the gain of 20 makes
    with pytest.raises(InputError, match=r"servo_loop: got open; expected closed, as a gain"):
        OutputError(terms=(), servo_loop="open")(data)


def test_friction_in_a_servo_s_gear_hides_nothing_of_its_forecast():
    joint = replace(SIMPLE, coulomb=0.05, motor_friction=0.15, load_friction=0.1)
    data = _simulated(GOAL, 0.7 * GOAL, joint=joint)
    words = {row.name: row.word for row in forecast(data.recorded, data.given)}
    assert {words[name] for name in ("p1", "p2", "p4")} == {Identifiability.IDENTIFIABLE}


@pytest.mark.parametrize("term", ["back_emf", *LOOP_TERMS])
def test_a_term_of_a_servo_is_recovered(term):
    """The back EMF is that part of p2 which is gone where the servo is off."""
    size = {"back_emf": 0.02, "latency": 0.006}.get(term, 1.2)
    joint = replace(SIMPLE, **{term: size})
    off = ENABLED if term == "back_emf" else None
    data = _simulated(GOAL, joint=joint, enabled=off, gains={"ki": 5.0, "kd": 0.4})
    assert _values(OutputError(terms=(term,))(data))[term] == pytest.approx(size, rel=0.01)


@pytest.mark.parametrize("size", [1.0, 1.2])
def test_a_gain_is_chosen_among_candidates_where_it_differs_from_what_was_given(size):
    data = _simulated(GOAL, 0.7 * GOAL, joint=replace(SIMPLE, loop_kp=size))
    assert OutputError().path(data, ("loop_kp",))[-1] == (("loop_kp",) if size != 1 else ())


def test_the_delay_of_a_servo_is_known_but_for_the_wait_for_its_next_look():
    data = _simulated(GOAL, GOAL[::-1].copy())
    widths = {}
    for clock in (1e-3, 4e-3):
        logs = [replace(log, servo=replace(log.servo, clock=clock)) for log in data.logs]
        estimate = OutputError(terms=()).of_logs(logs, starts(data, ()), data.known)
        widths[clock] = (estimate.upper - estimate.values)[estimate.names.index("delay")]
    assert widths[4e-3] > 1.9 * 4e-3 / 12**0.5
    assert widths[1e-3] < widths[4e-3]


def _over(terms, fixed, horizon):
    return OutputError(terms=tuple(terms), fixed=tuple(fixed), horizon=horizon).problem


def test_fits_of_servos_begin_with_the_delay_of_their_set_points():
    data = _simulated(GOAL, joint=replace(SIMPLE, delay=0.018))
    first = starts(data, ())[0]
    begun = servo_start(_over, ((), ()), data.logs, first, data.known)
    assert begun.parameters.delay == pytest.approx(0.018, abs=1e-3)
    assert begun.parameters.p1 == pytest.approx(SIMPLE.p1, rel=0.03)
    assert begun.parameters.motor_friction == begun.parameters.load_friction == 0.0  # not asked


def test_a_first_guess_without_gravity_and_damping_is_one_to_begin_with():
    data = _simulated(GOAL)
    first = starts(data, ())[0]
    poor = replace(first.parameters, p1=1.5 * SIMPLE.p1, p2=0.0, p3=0.0)
    guess = replace(first, parameters=poor)
    begun = servo_start(_over, ((), ()), data.logs, guess, Prior.of({"p4": 0.09}))
    assert begun.parameters.p1 == pytest.approx(SIMPLE.p1, rel=0.05)


def test_a_loop_of_speed_keeps_where_it_began_and_a_fit_finds_out():
    whole, still = {"horizon": np.inf, "velocity_known": False}, np.maximum(TIME - 0.5, 0.0)
    of_speed, of_angle = (
        replace(log_of(law), angle=still) for law in ("dynamixel-x-velocity", "dynamixel-x")
    )
    assert segment_length(of_speed, JOINT, **whole) == np.inf
    assert segment_length(of_angle, JOINT, **whole) is None
    moving = replace(of_angle, angle=np.sin(TIME))
    assert segment_length(moving, JOINT, **whole) == np.inf


def test_a_fit_with_the_loop_open_follows_the_drive():
    data = _simulated(GOAL, kp=Known(value=25.0))  # a drive that is 25 % too large
    errors = {}
    for way in ("closed", "open"):
        found = OutputError(terms=(), servo_loop=way)(data)
        for moved in (data.logs[0], data.logs[0].opened):
            angle = Simulation(moved, found.parameters).run(found.parameters, 0.0).at(TIME)
            errors[way, moved.closed] = np.std(angle - moved.angle)
    assert errors["open", False] < 0.8 * errors["closed", False]
    assert errors["closed", True] < 0.8 * errors["open", True]
    with pytest.raises(InputError, match=r"servo_loop.*'closed'"):
        OutputError(servo_loop="ajar")


def test_what_follows_in_the_loop_and_by_the_drive_alone_is_told_of_each_log():
    data = _simulated(GOAL, 0.5 * GOAL).holding_out(["1"])
    off = replace(SIMPLE, p2=0.04)
    names = ("p1", "p2", "p4", "coulomb")
    values = np.array([getattr(off, name) for name in names])
    told = {"covariance": 1e-6 * np.eye(4), "lower": 0.9 * values, "upper": 1.1 * values}
    estimate = Estimate(method="oe", names=names, values=values, fixed={"p3": 0.3}, **told)
    found = Identification.of(simulated(data, estimate))
    runs = {log.name: log for part in (data, data.test_logs) for log in part.logs}
    for name, log in runs.items():
        for moved, told in ((log, found.mean_errors), (log.opened, found.open_loop_fits)):
            angle = Simulation(moved, off).run(off, 0.0).at(TIME)
            error = np.abs(angle - log.angle)
            share = 1 - np.sqrt(np.mean(error**2)) / np.std(log.angle)
            expected = np.mean(error) if moved.closed else 100 * share
            assert told[name] == pytest.approx(expected, rel=1e-6)
    again = Identification.from_dict(json.loads(json.dumps(found.to_dict())))
    assert (again.open_loop_fits, again.mean_errors) == (found.open_loop_fits, found.mean_errors)
    rows = {row[0]: row[1:] for row in loop_table(again).rows}
    assert rows["in the loop"][3] == f"{1e3 * found.mean_errors['0']:.1f}"
    assert rows["by the drive alone, held out"][0] == fit_text(found.open_loop_fits["1"])
    (line,) = [line for line in found.summary if line.startswith("FIT in the loop")]
    assert f"mean error {rows['in the loop'][3]} mrad; by the drive alone" in line
    drawn = found.page().series["time"]
    assert [trace.get("name") for trace in drawn.data][-1] == "set-point"
