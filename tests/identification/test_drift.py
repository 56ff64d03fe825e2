"""Joints that nothing brings back: what a model lacks adds up, and is not fitted over long."""

from __future__ import annotations

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import OutputError, Suitable, WeakForm
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.known import Knowledge
from butterfly.model.parameters import AddedMass, JointKind

STEP, SUB = 1e-3, 10
MASS, DAMPING, FRICTION, GAIN = 95.0, 200.0, 20.0, 35.0
SLIDE = AddedMass(joint=JointKind.SLIDE)


def _program(count):
    """Positions in m of a table that goes to and fro in trapezoids of velocity."""
    time = np.arange(count) * STEP
    pace = np.clip(3 * np.sin(2 * np.pi * time / 3.1), -1, 1) * (0.08 + 0.03 * np.sin(0.9 * time))
    return np.cumsum(pace) * STEP


def _followed(ripple, noise, seconds=20.0):
    """Record a slide that follows a program by a cascade, friction changing along its way.

    Semi-implicit Euler of steps of 0.1 ms, friction taking no more than all of the velocity.
    """
    rng = np.random.default_rng(1)
    wanted = _program(int(seconds / STEP))
    x, v, before = 0.0, 0.0, 0.0
    commands, positions = np.empty(wanted.size), np.empty(wanted.size)
    for k in range(wanted.size):
        speed, before = (x - before) / STEP, x
        commands[k] = np.clip(240 * (150 * (wanted[k] - x) - speed), -10, 10)
        positions[k] = x + noise * rng.standard_normal()
        uneven = ripple * np.sin(2 * np.pi * x / 0.017 + 0.4)
        for _ in range(SUB):
            free = v + STEP / SUB * (GAIN * commands[k] - DAMPING * v) / MASS
            held = STEP / SUB * (FRICTION + uneven) / MASS
            v = np.sign(free) * max(abs(free) - held, 0.0)
            x += STEP / SUB * v
    return Log(
        time=np.arange(wanted.size) * STEP,
        input=commands,
        angle=positions,
        velocity=None,
        input_kind=InputKind.VOLTAGE,
        intersample=Intersample.ZERO_ORDER_HOLD,
        added_mass=SLIDE,
        excitation=None,
        source="slide",
    )


def _data(log):
    return DataSet.of([log], known=Knowledge.told({"p4": GAIN}))


def _found(log, **options):
    return OutputError(workers=1, **options)(_data(log))


def _covers(found, **truth):
    rows = zip(found.names, found.lower, found.upper, strict=True)
    bands = {name: (low, high) for name, low, high in rows}
    return {name: bands[name][0] <= value <= bands[name][1] for name, value in truth.items()}


def _cut(found):
    return [each.number for each in found.findings if each.kind is FindingKind.ADDS_UP]


def test_friction_that_changes_along_the_way_is_not_taken_for_mass_or_delay():
    log = _followed(ripple=4.0, noise=1e-7)
    truth = {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}
    found, whole = _found(log), _found(log, horizon=0)
    assert _cut(found) == [0.5]
    assert all(_covers(found, **truth).values())
    assert not all(_covers(whole, **truth).values())


def test_nobody_who_names_no_method_gets_such_friction_added_up():
    uneven, even = (_followed(ripple=ripple, noise=2e-5) for ripple in (4.0, 0.0))
    assert isinstance(Suitable().suited(_data(uneven)), WeakForm)
    assert isinstance(Suitable().suited(_data(even)), OutputError)
    truth = {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}
    assert all(_covers(Suitable()(_data(uneven)), **truth).values())


def test_logs_that_hold_nothing_but_noise_besides_are_fitted_whole():
    found = _found(_followed(ripple=0.0, noise=2e-5))
    assert not _cut(found)
    assert all(_covers(found, p1=MASS, p2=DAMPING, coulomb=FRICTION).values())
