"""Derivatives where a joint rests, breaks loose or reverses."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.model.greybox import Columns, differentiate, simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import TERMS
from tests.model.joints import agrees, angle_readings, instants


@pytest.mark.parametrize(
    ("first", "speed"), [((-0.05, 0.1, 0.5), 0.5), ((-0.3, 0.1, 0.9), 0.0), ((0.1, 0.6, -0.1), 0.0)]
)
def test_a_joint_that_rests_and_breaks_loose_within_one_step_has_the_derivatives_of_differences(
    first, speed
):
    joint = LumpedParameters(p1=0.1, p2=0.02, p3=0.03, p4=1.0, coulomb=0.2, bias=0.01)
    inputs = np.array([first, [0.5, 0.3, 0.2]])
    time, readings = np.array([0.0, 1.0, 1.5]), angle_readings(2)
    late = np.array([[0.3, -0.2, 0.1], [0.1, 0.2, -0.1]])  # what a delay might do to the drive
    names = ["p1", "p2", "p3", "p4", "p3_offset", "coulomb", "bias", "zero", "delay"]
    names += ["velocity"] if speed else []

    def angles(**by):
        moved = replace(joint, **{n: getattr(joint, n) + h for n, h in by.items() if n in TERMS})
        start = (0.3 - by.get("zero", 0.0), speed + by.get("velocity", 0.0))
        return simulate(moved, time, inputs + by.get("delay", 0.0) * late, *start)[0][1:]

    columns, both = Columns.of(names, joint), np.stack([inputs, late])
    _, rows, *_ = differentiate(time, both, (0.3, speed), readings, columns)
    for name, row in zip(names, rows.T, strict=True):
        assert agrees(row, lambda h, name=name: angles(**{name: h}), (1e-4, 1e-5, 1e-6)), name


@pytest.mark.parametrize("beside", [0.0, 1e-15, -1e-15, 1e-9, -1e-9])
def test_a_velocity_that_touches_0_leaves_derivatives_finite(beside):
    """It is (1 - t)^2, or as much as ``beside`` above or below."""
    unit = LumpedParameters(p1=1.0, p2=0.0, p3=0.0, p4=1.0)
    time = np.linspace(0, 2, 11)
    inputs = -2.0 * (1.0 - instants(time))
    columns = Columns.of(["coulomb", "stribeck", "p1", "p2", "velocity"], unit)
    readings = angle_readings(10)
    start = (0.0, 1.0 + beside)
    values, rows, *_ = differentiate(time, inputs[None], start, readings, columns)
    expected = (1 - (1 - time[1:]) ** 3) / 3 + beside * time[1:]
    np.testing.assert_allclose(values, expected, atol=1e-9)
    assert np.isfinite(rows).all()
    np.testing.assert_allclose(rows[:4, -1], time[1:5])
