from dataclasses import replace

import control
import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import Sine
from butterfly.model.control_bridge import linearised
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.signals.frequency_response import measured_response, response_point
from tests.identification.simulated import simulated

ROBOT = LumpedParameters(p1=0.003, p2=4e-3, p3=0.04, p4=0.5, delay=0.02)
MASS = AddedMass(mass=0.05, arm=0.104)
SWING = 0.02


def _points(robot, mass, omegas):
    points = []
    for omega in omegas:
        gain = abs(linearised(robot, mass)["angle", "command"](1j * omega))
        sine = Sine(omega=omega, amplitude=SWING / gain)
        log = simulated(robot, mass, sine.sample, 50.0, sine=sine)
        points.append(response_point(log))
    return points


def test_of_small_swings_it_lies_on_the_state_space_s_response_within_a_tenth_of_a_per_cent():
    points = _points(ROBOT, MASS, (8.0, 2.0, 3.5)) + _points(ROBOT, AddedMass(), (3.0,))
    found = measured_response(points, MASS)
    assert isinstance(found, control.FrequencyResponseData)
    np.testing.assert_array_equal(found.omega, [2.0, 3.5, 8.0])
    assert (found.input_labels, found.output_labels) == (["command"], ["angle"])
    expected = linearised(ROBOT, MASS)["angle", "command"](1j * found.omega)
    np.testing.assert_allclose(found.complex, expected, rtol=1e-3)
    alone = measured_response(points)
    np.testing.assert_array_equal(alone.omega, [3.0])


def test_logs_of_one_frequency_count_as_one_by_least_squares(sine_log):
    point = response_point(sine_log)
    other = replace(point, input=3j * point.input)
    found = measured_response([point, other, point], point.added_mass)
    inputs = np.array([point.input, other.input, point.input])
    expected = np.linalg.lstsq(inputs[:, None], np.full(3, point.angle.fundamental), rcond=None)[0]
    assert found.omega.tolist() == [point.omega]
    np.testing.assert_allclose(found.complex, expected, rtol=1e-12)


def test_a_mass_that_was_not_measured_is_refused(sine_log):
    with pytest.raises(InputError, match="added mass: got 200 g at 100 mm"):
        measured_response([response_point(sine_log)], AddedMass(mass=0.2, arm=0.1))
