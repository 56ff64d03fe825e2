"""The steady response of the model itself: its free run, read as the log was."""

from __future__ import annotations

import numpy as np

from butterfly.identification.free_run import Trajectory
from butterfly.model.parameters import LumpedParameters
from butterfly.signals.sine_fit import sine_basis, with_transient
from butterfly.signals.window import STEADY_SECONDS, steady_span


def simulated_response(
    trajectory: Trajectory, parameters: LumpedParameters, zero: float, pole: complex | None = None
) -> tuple[complex, float]:
    """Return phasor and mean in rad of the simulated angle, in the window in which a log is read.

    Parameters
    ----------
    trajectory
        Of a sine's log.
    parameters
        Of the bare hand.
    zero
        Encoder reading in rad where the model's angle is 0.
    pole
        In 1/s, of a transient that was fitted to the log, too.
    """
    log = trajectory.log
    assert log.excitation is not None  # noqa: S101 - of a sine
    omega = log.excitation.omega
    angle, _ = trajectory.simulate(parameters, zero)
    inside = trajectory.grid > log.time[-1] - steady_span(log, omega, STEADY_SECONDS)
    time = trajectory.grid[inside]
    basis = with_transient(sine_basis(time, omega), time, pole)
    coefficients = np.linalg.solve(basis @ basis.T, basis @ angle[inside])
    return complex(coefficients[1], -coefficients[2]), float(coefficients[0])
