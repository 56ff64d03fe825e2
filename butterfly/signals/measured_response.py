"""Measured frequency-response points as python-control's data, to lay over a model's response."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError
from butterfly.model.control_bridge import frequency_response_data
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.signals.frequency_response import ResponsePoint

if TYPE_CHECKING:
    import control


def measured_response(
    points: Iterable[ResponsePoint], added_mass: AddedMass = NO_ADDED_MASS
) -> control.FrequencyResponseData:
    """Return what was measured with one added mass: the angle over the input, in rad per unit.

    Frequencies are in rad/s, each once and in order. Logs of one frequency count as one: the gain
    is that which gives their angles from their inputs with the least sum of squares, so that the
    larger swings weigh more. A real hand's gain depends on its swing; such logs are averaged.

    Takes what was measured with this added mass, or one that loads alike; an InputError if nothing
    was.
    """
    taken = [
        point
        for point in points
        if point.added_mass.inertia_and_moment == added_mass.inertia_and_moment
    ]
    if not taken:
        raise InputError(
            "measured response", "added mass", added_mass, "one that sines were logged with"
        )
    inputs = np.array([point.input for point in taken])
    angles = np.array([point.angle.fundamental for point in taken])
    omegas, which = np.unique([point.omega for point in taken], return_inverse=True)
    gains = []
    for k in range(omegas.size):
        rows = which == k
        gains.append(np.vdot(inputs[rows], angles[rows]) / np.vdot(inputs[rows], inputs[rows]))
    return frequency_response_data(omegas, gains)
