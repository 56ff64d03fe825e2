"""The residual torque of a log."""

import dataclasses

import numpy as np

from butterfly.identification.test_functions import ResidualTorque
from butterfly.report.log_figures import torque_figure


def test_times_of_a_residual_are_true_wherever_the_clock_starts(simulated):
    result, _ = simulated
    setting = result.data.simulations.setting(0, result.estimate)
    torque = ResidualTorque.of(result.data.logs[0], setting.parameters, setting.zero)
    late = dataclasses.replace(torque, time=torque.time + 1.7e9)
    drawn = np.asarray(torque_figure(late, result.data.joint).data[0].x)
    assert np.all(np.isin(drawn, late.time))
