"""The thesis's synthetic robot next to its 60 degree orbit, as the tests and benchmarks use it."""

import math
from dataclasses import replace
from functools import cache, partial

import numpy as np

from butterfly.experiment.schema import PlantSpec
from butterfly.identification.estimators import Linear
from butterfly.logs.log import Sine
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.orbit.controller import EnergyShaping, gain_for
from butterfly.orbit.loop import OrbitSchedule, study_orbit
from butterfly.orbit.recalibration import RecalibrationOptions
from butterfly.plant.rig import Simulator
from butterfly.plant.rollout import simulate_runs
from butterfly.signals.frequency_response import response_point

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)
SIXTY = math.radians(60)
KNOWN = AddedMass(mass=0.05, arm=0.1)
STARTS = (0.6, 0.9, 1.2, 1.5)


def plant(friction=None, hand=None, step=1e-3, **path):
    hand = hand or {"mass": 0.1, "com_distance": 0.05, "inertia": 0.003}
    about = {"hand": hand, "drive": {"torque": {"gain": 10.0}}, "clock": {"step": step}}
    about |= {"friction": {"viscous": 1e-3} | (friction or {}), "path": path}
    return PlantSpec.model_validate(about | {"encoder": {"steps": 8192, "noise": 2e-4}})


def wrong(parameters, rng):
    """Believe p1..p4 wrong by 10 to 30 % either way, and nothing of Coulomb friction."""
    factors = 1 + rng.choice([-1, 1], 4) * rng.uniform(0.1, 0.3, 4)
    names = ("p1", "p2", "p3", "p4")
    values = {n: getattr(parameters, n) * f for n, f in zip(names, factors, strict=True)}
    return replace(parameters, coulomb=0.0, **values)


def grey_rig(spec, rng):
    """Rig of the same plant, simulated by the grey-box equation."""
    return partial(replace(spec.rig, simulator=Simulator.GREY_BOX).run, rng=rng)


def runs(spec, rng, *, starts=STARTS, masses=(NO_ADDED_MASS,), duration=20.0):
    """Log a badly informed controller from several starts."""
    believed = wrong(spec.robot.lumped, rng)
    rig = grey_rig(spec, rng)
    logs = []
    for mass in masses:
        orbit = Orbit.of_amplitude(believed.with_added_mass(mass), SIXTY)
        for start in starts:
            law = EnergyShaping(orbit, gain_for(orbit, 0.5))
            logs.append(rig(law, start, duration, mass))
    return logs


def generic(spec, amplitudes, *, simulator=Simulator.MUJOCO, duration=60.0):
    """Identify a linear model from small sines of given torque amplitudes in units of 1e-5."""
    omegas = (2.5, 3.2, 3.6, 3.9, 4.2, 4.8, 6.0)
    sines = [Sine(omega=w, amplitude=1e-5 * a) for w, a in zip(omegas, amplitudes, strict=True)]
    jobs = [(mass, sine) for mass in (NO_ADDED_MASS, KNOWN) for sine in sines]
    seeds = np.random.SeedSequence(0).spawn(len(jobs))
    logs = simulate_runs(replace(spec.rig, simulator=simulator), jobs, duration, seeds)
    return Linear().of_points([response_point(log) for log in logs]).parameters


def two_sines(spec, masses, duration):
    """Log two small sines with each of some masses in kg, by the grey box."""
    sines = [Sine(omega=3.0, amplitude=4e-4), Sine(omega=5.0, amplitude=8e-4)]
    jobs = [(AddedMass(mass=mass, arm=0.1), sine) for mass in masses for sine in sines]
    seeds = np.random.SeedSequence(0).spawn(len(jobs))
    rig = replace(spec.rig, simulator=Simulator.GREY_BOX)
    return list(simulate_runs(rig, jobs, duration, seeds))


def sixty_degrees(**changes):
    """Plan rounds at 60 degrees."""
    target = {"target": lambda p: Orbit.of_amplitude(p, SIXTY), "starts": (1.05, 0.6, 0.9, 1.5)}
    return OrbitSchedule(**(target | {"duration": 30.0} | changes))


SMALL = (10, 7, 4, 3, 4, 10, 20)
"""Torques in 1e-5 units that swing the hand a few hundredths of a radian."""

AGAINST_COULOMB = (20, 14, 10, 8, 10, 20, 40)
"""The same where Coulomb friction of 4e-4 N m has to be overcome first."""

EFFECTS = {
    "none": (plant(), SMALL, {}),
    "Coulomb": (plant({"coulomb": 4e-4}), AGAINST_COULOMB, {}),
    "quadratic drag": (plant({"drag": 2e-4}), SMALL, {}),
    "gain compression": (plant(compression=500.0), SMALL, {}),
    "Stribeck": (plant({"coulomb": 3e-4, "stribeck": 3e-4}), (24, 17, 12, 10, 12, 24, 48), {}),
    "bias": (plant({"bias": 1e-3}), SMALL, {}),
    "offset of the centre of mass": (
        plant(hand={"mass": 0.1, "com_distance": 0.05, "com_offset": 0.003, "inertia": 0.003}),
        SMALL,
        {},
    ),
    "cogging, 7 periods a turn": (plant({"cogging": 2e-3, "cogging_periods": 7}), SMALL, {}),
    "the same, told of cogging": (
        plant({"cogging": 2e-3, "cogging_periods": 7}),
        SMALL,
        {"candidates": ("coulomb", "drag", "cogging", "cogging_cosine"), "cogging_periods": 7},
    ),
}
"""Plant, torques of the small sines, and what the re-calibration is told, for each effect."""


def invariant(parameters, orbit, angle, velocity):
    """(n,) values of I = E - E* (107) in J along a motion."""
    return energy(parameters, angle, velocity) - orbit.energy


ROUGH = plant({"coulomb": 1e-4}, step=5e-3)


@cache
def hanging_study():
    """A study of an orbit, on a rig that cannot hold the hand at an angle."""
    rng = np.random.default_rng(0)
    held = grey_rig(ROUGH, rng)

    def rig(law, start, duration, added):  # noqa: ARG001 - all runs begin where the hand hangs
        return held(law, 0.0, duration, added)

    options = RecalibrationOptions(candidates=("coulomb",))
    plan = sixty_degrees(starts=(0.0, 0.0), kick=2e-3, dither=0.3, rounds=2, recalibration=options)
    return study_orbit(rig, wrong(ROUGH.robot.lumped, rng), 0.0, plan, rng=rng)
