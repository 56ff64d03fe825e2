"""The robot that the tests of the plant drive, how they drive it, and what they compare it with."""

from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.logs.log import Sine
from butterfly.model.greybox import simulate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, Friction, Hand, VoltageDrive
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.mjcf import built, text_of
from butterfly.plant.motor import ControlLoop
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder
from butterfly.plant.watch.picture import Painter, RenderingError

HAND = Hand(mass=0.1, com_distance=0.05, inertia=0.003)
MOTOR = VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.03)
ADDED = AddedMass(mass=0.05, arm=0.104)
SINE = Sine(omega=4.0, amplitude=0.3)
FINE = Encoder(steps=2**45)
JOINTS = [MujocoJoint, GreyBoxJoint]


def robot(drive=MOTOR, hand=HAND, clutch=None, **friction):
    friction = Friction(**({"viscous": 2e-4} | friction))
    return Robot(hand=hand, drive=drive, friction=friction, clutch=clutch)


def mjcf(robot, added=NO_ADDED_MASS, *, scene=False):
    """The text of a robot's model, which loads in plain MuJoCo."""
    return text_of(built(robot, added, scene=scene))


def play(joint, duration=5.0, amplitude=0.5, omega=4.0, step=0.01):
    """The log of a joint under a sine, by the motor wrapper, read without steps."""
    with ControlLoop(SimulatedMotor(joint, encoder=FINE), clock=Clock(step=step)) as loop:
        return loop.play(lambda time: amplitude * np.sin(omega * time), duration)


def under_law(joint, law, duration, step=1e-3, **parts):
    """The log of a joint under feedback, in the same way; ``parts`` of the motor."""
    with ControlLoop(SimulatedMotor(joint, encoder=FINE, **parts), clock=Clock(step=step)) as loop:
        return loop.run(law, duration)


def integrated(log, rhs, start):
    """Angle at a log's stamps by SciPy, each held input integrated on its own to 1e-12."""
    state, angles = np.array(start), [start[0]]
    for begin, end, held in zip(log.time, log.time[1:], log.input, strict=False):
        piece = solve_ivp(rhs, (begin, end), state, "DOP853", args=(held,), rtol=1e-12, atol=1e-14)
        state = piece.y[:, -1]
        angles.append(state[0])
    return np.array(angles)


def grey_box(parameters, time, inputs, start=0.0):
    """Angles and velocities of the equation at (n,) stamps, each input held to the next."""
    return simulate(parameters, time, np.repeat(inputs[: time.size - 1, None], 3, axis=1), start)


def mujoco_alone(model, commands, start=0.0, *, by="ctrl", which=0, joint=0):
    """(n + 1, 2) angles and velocities of a joint of a model or text in MuJoCo, and its step."""
    model = mujoco.MjModel.from_xml_string(model) if isinstance(model, str) else model
    data = mujoco.MjData(model)
    data.qpos[joint] = start
    states = [(start, 0.0)]
    for command in commands:
        getattr(data, by)[which] = command
        mujoco.mj_step(model, data)
        states.append((data.qpos[joint], data.qvel[joint]))
    return np.array(states), model.opt.timestep


def simulated(rig, runs, duration, threads=1):
    """The logs of runs, by compiled loops."""
    seeds = np.random.SeedSequence(3).spawn(len(runs))
    return list(simulate_runs(rig, runs, duration, seeds, threads=threads))


def wrapped(rig, runs, duration):
    """The same logs by the motor wrapper, from cycle to cycle."""
    seeds = np.random.SeedSequence(3).spawn(len(runs))
    generators = map(np.random.default_rng, seeds)
    return [rig.play(*run, duration, rng) for run, rng in zip(runs, generators, strict=True)]


@cache
def skip_where_nothing_is_drawn():
    try:
        Painter(robot(), ADDED, 32).__exit__()
    except RenderingError as error:
        pytest.skip(str(error))
