import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import Sine
from butterfly.model.parameters import AddedMass, Friction, Hand, JointKind, VoltageDrive
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Clutch, Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder, Faults
from butterfly.signals.excitations import FreeDecay

ROBOT = Robot(
    hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003),
    drive=VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.03),
    friction=Friction(viscous=2e-4, coulomb=3e-4),
)
PLAIN = Rig(robot=ROBOT)
ADDED = AddedMass(mass=0.05, arm=0.104)
SINE = Sine(omega=4.0, amplitude=0.3)
STIFF = replace(ROBOT.drive, inductance=0.002)
STICKS = replace(ROBOT.friction, stribeck=3e-4)

NEEDING_THE_WRAPPER = {
    "jitter": replace(PLAIN, clock=Clock(jitter=1e-4)),
    "delay": replace(PLAIN, path=CommandPath(delay=0.003)),
    "inductance": replace(PLAIN, robot=replace(ROBOT, drive=STIFF)),
    "Stribeck": replace(PLAIN, robot=replace(ROBOT, friction=STICKS)),
    "bristles": replace(
        PLAIN, robot=replace(ROBOT, friction=replace(STICKS, bristle_stiffness=1.0))
    ),
}
PLAY = Clutch(backlash=0.01, rotor_inertia=1e-3)
NOT_NEEDING_IT = {
    "plain": PLAIN,
    "clutch": replace(PLAIN, robot=replace(ROBOT, clutch=PLAY)),
    "shaped commands": replace(PLAIN, path=CommandPath(limit=0.2, resolution=0.01)),
    "compression, noise, faults": replace(
        PLAIN,
        path=CommandPath(compression=0.1),
        encoder=Encoder(noise=1e-3),
        faults=Faults(dropped=0.1, duplicated=0.1),
    ),
}
GREY_BOXES = {
    f"grey box, {name}": replace(rig, simulator=Simulator.GREY_BOX)
    for name, rig in (NEEDING_THE_WRAPPER | NOT_NEEDING_IT).items()
    if name != "clutch"
}


def _logs(rig, duration=0.3):
    runs = [(ADDED, SINE), (AddedMass(), FreeDecay(angle=0.3))]
    return runs, list(simulate_runs(rig, runs, duration, np.random.SeedSequence(3).spawn(2)))


@pytest.mark.parametrize("name", NEEDING_THE_WRAPPER | NOT_NEEDING_IT | GREY_BOXES)
def test_the_compiled_loop_runs_what_it_can_and_gives_the_log_of_the_wrapper(name, monkeypatch):
    rig = (NEEDING_THE_WRAPPER | NOT_NEEDING_IT | GREY_BOXES)[name]
    played, play = [], Rig.play
    monkeypatch.setattr(Rig, "play", lambda *run: played.append(run) or play(*run))
    runs, logs = _logs(rig)
    assert bool(played) == (name in NEEDING_THE_WRAPPER)
    assert rig.runs_open_loop == (name not in NEEDING_THE_WRAPPER)
    for log, run, seed in zip(logs, runs, np.random.SeedSequence(3).spawn(2), strict=True):
        single = rig.play(*run, 0.3, np.random.default_rng(seed))
        np.testing.assert_allclose(log.time, single.time, atol=1e-12)
        np.testing.assert_allclose(log.input, single.input, atol=1e-12)
        step = 2 * math.pi / rig.encoder.steps  # a reading on the edge may round either way
        assert np.abs(log.angle - single.angle).max() < 1.01 * step
        assert log.source == single.source


def test_a_law_meets_the_clock_path_encoder_and_faults_of_the_rig():
    rig = Rig(
        robot=ROBOT,
        clock=Clock(step=0.002, jitter=3e-4),
        path=CommandPath(limit=0.1),
        encoder=Encoder(steps=1000),
        faults=Faults(dropped=0.2),
    )
    log = rig.run(lambda _: 5.0, 0.4, 1.0, ADDED, rng=np.random.default_rng(0))
    assert np.all(log.input == 0.1)
    assert log.time.size == pytest.approx(400, abs=40)
    assert np.diff(log.time).std() > 3e-4
    turns = log.angle / (2 * np.pi / 1000)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert log.angle[0] == pytest.approx(0.4, abs=0.1)
    assert log.added_mass == ADDED


def test_each_log_of_a_sweep_is_named_after_its_number_mass_and_frequency():
    _, logs = _logs(PLAIN)
    assert [log.name for log in logs] == ["run000_50g_4rads", "run001_0g_signal"]


@pytest.mark.parametrize("simulator", Simulator)
def test_friction_that_a_weight_makes_negative_is_refused_by_every_way_to_run(simulator):
    relieved = replace(ROBOT, friction=Friction(coulomb=1e-3, load=-5e-3))
    for jitter in (0.0, 1e-4):
        rig = Rig(robot=relieved, simulator=simulator, clock=Clock(jitter=jitter))
        with pytest.raises(InputError, match="load"):
            _logs(rig)


@pytest.mark.parametrize("simulator", Simulator)
@pytest.mark.parametrize("jitter", [0.0, 1e-4])
def test_a_mass_that_is_not_on_a_hinge_is_refused_by_every_way_to_run(simulator, jitter):
    rig = Rig(robot=ROBOT, simulator=simulator, clock=Clock(jitter=jitter))
    sliding = AddedMass(mass=0.05, joint=JointKind.SLIDE)
    with pytest.raises(InputError, match="on a slide"):
        list(simulate_runs(rig, [(sliding, SINE)], 0.1, np.random.SeedSequence(3).spawn(1)))
