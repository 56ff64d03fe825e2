"""Set-points told as drives and gains told wrongly are named, and nothing where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.unit_error_search import (
    find_unit_errors,
    find_unit_errors_of_refused,
)
from butterfly.identification.diagnostics.unit_errors import UnitError
from butterfly.identification.estimators import OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.identification.servo_drive import driven
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Known, Prior
from butterfly.model.servo import ServoLoop
from butterfly.report.finding_texts import estimate_sentences
from butterfly.verdict import Level

TIME = np.arange(0.0, 6.0, 0.005)
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


def _data(logs):
    return DataSet.of(logs, known=Prior.of({"p3": JOINT.p3}))


def _as_voltage(log, drive):
    return Log(log.time, drive, log.angle, zero=log.zero)


def test_a_set_point_told_as_a_voltage_is_named_and_never_good():
    told = _data([_as_voltage(log, log.setpoint) for log in _servo(3.0)])
    found = identify(told, WeakForm()).estimate
    assert found.level is Level.WARNING
    assert "input: setpoint and the servo's loop" in estimate_sentences(found)[0]


def test_its_drive_is_accused_of_nothing_nor_a_spring_of_another_stiffness():
    drives = [_as_voltage(log, log.input) for log in _servo(1.0)]
    assert find_unit_errors_of_refused(_data(drives), WeakForm()) == []
    sprung = [_as_voltage(log, 2 * log.setpoint) for log in _servo(3.0)]
    found = find_unit_errors_of_refused(_data(sprung), WeakForm())
    assert not any(UnitError.SETPOINT in each.parameters for each in found)


def test_a_gain_told_twice_too_large_is_named_by_its_factor_and_a_right_one_is_not():
    estimator = OutputError(terms=(), workers=1)
    logs = _servo(3.0, limit=0.35)[:2]
    for factor, named in ((1.0, []), (2.0, [UnitError.GAIN])):
        told = ServoLoop.of({"law": "pid-torque", "kp": 3.0 * factor, "limit": 0.35})
        data = _data([driven(replace(log, servo=told)) for log in logs])
        found = find_unit_errors(data, estimator, estimator(data))
        assert [each.parameters[0] for each in found] == named
        assert [each.number for each in found] == pytest.approx([1 / factor] * len(named), rel=0.02)
