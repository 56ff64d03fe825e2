"""An identification holds a few times the bytes of its logs, not a copy of them for each step."""

import tracemalloc

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.identify import identify
from butterfly.logs.log import Log
from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass, LumpedParameters

ROBOT = LumpedParameters(p1=0.008, p2=0.02, p3=0.25, p4=0.06, coulomb=0.003)
ESTIMATOR = OutputError(terms=(), workers=1)
STEP = 2 * np.pi / 4096  # of the encoder in rad


def _log(mass, seconds):
    """A log at 1 kHz of several sines, from rest, of a joint with some mass in kg."""
    added, time = AddedMass(mass=mass, arm=0.15), np.arange(seconds * 1000) / 1000
    pairs = zip((1.1, 2.7, 4.3, 6.1), range(4), strict=True)
    commands = 0.7 * sum(np.sin(omega * time + phase) for omega, phase in pairs)
    held = np.repeat(commands[:-1, None], 3, axis=1)
    angle, _ = simulate(ROBOT.with_added_mass(added), time, held, 0.0)
    noise = 2e-4 * np.random.default_rng(1).standard_normal(time.size)
    return Log(time, commands, np.rint((angle + noise) / STEP) * STEP, added_mass=added)


def test_identify_holds_at_most_four_bytes_for_each_byte_of_its_logs():
    brief, logs = ([_log(mass, each) for mass in (0.0, 0.05)] for each in (5, 80))
    identify(DataSet.of(brief), ESTIMATOR)  # imports and compiles
    of_logs = sum(column.nbytes for log in logs for column in log.columns().values())
    tracemalloc.start()
    try:
        found = identify(DataSet.of(logs), ESTIMATOR)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found.fits.values()
    assert of_logs + peak <= 4 * of_logs
