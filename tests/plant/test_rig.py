import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, SimulatedMotor, Simulator
from butterfly.plant.robot import Clutch
from butterfly.plant.sensors import Clock, ClockRegime, Encoder, Faults
from butterfly.signals.excitations import Chirp, FreeDecay, Multisine
from tests.plant.setting import ADDED, FINE, MOTOR, SINE, robot, simulated, wrapped

PLAIN = Rig(robot=robot(coulomb=3e-4))
STICKS = {"coulomb": 3e-4, "stribeck": 3e-4}
ROUGH = replace(PLAIN, path=CommandPath(compression=0.1), encoder=Encoder(noise=1e-3))
ROUGH = replace(ROUGH, faults=Faults(dropped=0.1, duplicated=0.1))
REGIMES = (ClockRegime(begin=0.05, step=8e-4, delay=2.5e-3), ClockRegime(begin=0.1, step=1.2e-3))
UNEVEN = {
    "jitter": replace(PLAIN, clock=Clock(jitter=1e-4)),
    "delay": replace(PLAIN, path=CommandPath(delay=0.0033)),
    "delay, jitter": replace(PLAIN, clock=Clock(jitter=3e-4), path=CommandPath(delay=0.003)),
    "delay of a cycle": replace(PLAIN, path=CommandPath(delay=0.001)),
    "regimes": replace(PLAIN, clock=Clock(jitter=1e-4, regimes=REGIMES)),
}
ASSISTED = {
    "inductance": Rig(robot=robot(replace(MOTOR, inductance=0.002), coulomb=3e-4)),
    "Stribeck": Rig(robot=robot(**STICKS)),
    "bristles": Rig(robot=robot(**STICKS, bristle_stiffness=1.0)),
}
PLAY = Clutch(backlash=0.01, rotor_inertia=1e-3)
RIGS = UNEVEN | ASSISTED
RIGS |= {
    "plain": PLAIN,
    "clutch": Rig(robot=robot(clutch=PLAY, coulomb=3e-4)),
    "shaped commands": replace(PLAIN, encoder=FINE, path=CommandPath(limit=0.2, resolution=0.01)),
    "compression, noise, faults": ROUGH,
}


RUNS = [
    (ADDED, SINE),
    (AddedMass(), FreeDecay(angle=0.3)),
    (ADDED, Multisine(base=0.5, harmonics=(3, 5, 8, 13), peak=0.3)),
    (ADDED, Chirp(start=2.0, stop=8.0, duration=3.0, amplitude=0.2)),
]
NAMES = ["run000_50g_4rads", "run001_0g_signal", "run002_50g_signal", "run003_50g_signal"]


@pytest.mark.parametrize("name", RIGS)
def test_runs_give_the_log_of_the_wrapper_without_going_through_it(name, monkeypatch):
    """Whatever the number of threads; bit for bit, but on an even clock in MuJoCo's own loop."""
    rig = RIGS[name]
    with monkeypatch.context() as patch:
        patch.delattr(SimulatedMotor, "read")
        logs, others = (simulated(rig, RUNS, 0.15, threads) for threads in (1, 3))
    assert (name in ASSISTED) == (not rig.runs_in_mujoco)
    assert [log.name for log in logs] == NAMES
    singles = wrapped(rig, RUNS, 0.15)
    for log, other, single, run in zip(logs, others, singles, RUNS, strict=True):
        for column in ("time", "input", "angle", "velocity") if name in UNEVEN | ASSISTED else ():
            assert getattr(log, column).tobytes() == getattr(single, column).tobytes(), column
        np.testing.assert_array_equal(log.angle, other.angle)
        np.testing.assert_allclose(log.time, single.time, atol=1e-12)
        np.testing.assert_allclose(log.input, single.input, atol=1e-12)
        step = 2 * math.pi / rig.encoder.steps  # a reading on the edge may round either way
        reach = 1e-10 if step < 1e-9 else 1.01 * step
        assert np.abs(log.angle - single.angle).max() < reach
        assert (log.source, log.added_mass) == (single.source, run[0])


def test_a_law_meets_the_clock_path_encoder_and_faults_of_the_rig():
    rig = replace(PLAIN, clock=Clock(step=0.002, jitter=3e-4), path=CommandPath(limit=0.1))
    rig = replace(rig, encoder=Encoder(steps=1000), faults=Faults(dropped=0.2))
    log = rig.run(lambda _: 5.0, 0.4, 1.0, ADDED, rng=np.random.default_rng(0))
    assert np.all(log.input == 0.1)
    assert log.time.size == pytest.approx(400, abs=40)
    assert np.diff(log.time).std() > 3e-4
    turns = log.angle / (2 * np.pi / 1000)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert log.angle[0] == pytest.approx(0.4, abs=0.1)
    assert log.added_mass == ADDED


@pytest.mark.parametrize("simulator", Simulator)
@pytest.mark.parametrize("jitter", [0.0, 1e-4])
@pytest.mark.parametrize(
    ("driven", "added", "named"),
    [
        (robot(coulomb=1e-3, load=-5e-3), ADDED, "load"),
        (robot(), AddedMass(mass=0.05, joint=JointKind.SLIDE), "on a slide"),
    ],
)
def test_a_mass_that_cannot_be_carried_is_refused_by_every_way_to_run(
    simulator, jitter, driven, added, named
):
    rig = Rig(robot=driven, simulator=simulator, clock=Clock(jitter=jitter))
    with pytest.raises(InputError, match=named):
        simulated(rig, [(added, SINE)], 0.15)
