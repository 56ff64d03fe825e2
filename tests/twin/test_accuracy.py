"""How far an exported joint moves from our own simulation of its logs."""

from dataclasses import replace

import numpy as np

from butterfly.api.inspected import robot_of
from butterfly.identification.free_run import Setting
from butterfly.logs.reading import read_entry
from butterfly.model.parameters import LumpedParameters
from butterfly.twin.forms import Options, write_as
from tests.twin.alone import twin_of


def test_the_twin_of_an_experiment_is_measured_on_its_runs(quick):
    twin = robot_of(quick, hand_mass=None, added_mass=0.05, arm=None).twin
    recorded = twin.recorded()
    some = recorded[:: len(recorded) - 1]
    twin = replace(twin, recorded=lambda: some)
    accuracy = write_as("mjcf", twin).accuracy
    assert [*accuracy.errors] == [log.name for log, _ in some]
    assert accuracy.worst < 1e-4


STICKS = {"coulomb": 8e-4, "stribeck": 4e-4, "stribeck_velocity": 0.2}


def test_the_twin_of_a_real_log_moves_alone(real_manifest):
    """It sticks harder than it slides, and its stamps are its own."""
    whole = read_entry(real_manifest, real_manifest.logs[20])
    log = whole.piece(0, int(np.searchsorted(whole.time, whole.time[0] + 0.8)))
    parameters = LumpedParameters(p1=0.0034, p2=1e-3, p3=0.04, p4=1.0, delay=0.004, **STICKS)
    recorded = [(log, Setting(parameters=parameters, zero=log.angle[0], velocity=0.0))]
    twin = replace(twin_of(parameters), added=log.added_mass, recorded=lambda: recorded)
    for step, most in ((2e-4, 2e-4), (2e-3, 2e-3)):
        assert write_as("mjcf", twin, Options(timestep=step)).accuracy.worst < most
