"""Joints whose logs show friction or gain alone, as they move too slowly to show their inertia."""

import math

import numpy as np

from butterfly.logs.log import InputKind, Log
from tests.independent.drives import clock, log_uniform
from tests.independent.integrator import Joint, Law, motion, tracking

NOTHING_HOLDS = {"p4": 1.0, "p3": 0.0}


def _levels(rng, time, sizes):
    """Return (n,) levels of random number and either sign, with ramps between them."""
    hold = time[-1] / int(rng.integers(4, 10))
    at = np.minimum((time / hold).astype(int), sizes.size - 1)
    ramp = np.clip((time - at * hold) / (0.25 * hold), 0.0, 1.0)
    before = np.where(at > 0, sizes[at - 1], 0.0)
    return before + (sizes[at] - before) * ramp**2 * (3.0 - 2.0 * ramp)


def _recorded(rng, motion, count, noise):
    stamps, inputs, angle = motion
    read = count * np.rint((angle + noise * rng.standard_normal(stamps.size)) / count)
    return stamps, inputs, read


def _logs(rows):
    return [
        Log(*row, input_kind=InputKind.TORQUE, name=f"run {k}", source=f"run {k}")
        for k, row in enumerate(rows)
    ]


def creeping(number):
    """Return logs of a joint that a tight loop takes from slow speed to slow speed, and truths.

    Its torque is recorded; that of its inertia is about a hundredth of that of its friction.
    """
    rng = np.random.default_rng([5, number])
    coulomb, speed = float(log_uniform(rng, 0.03, 1.0)), float(log_uniform(rng, 0.02, 0.5))
    viscous = coulomb / speed * float(rng.uniform(0.0, 0.6))
    inertia = max(float(log_uniform(rng, 1e-4, 1e-2)), 1e-3 * viscous)
    joint = Joint(inertia, viscous, 0.0, 1.0, coulomb, delay=rng.uniform(0.0, 2e-3))
    pace, count = float(log_uniform(rng, 15.0, 40.0)), 2 * np.pi / 2 ** int(rng.integers(12, 17))
    stiffness = inertia * pace**2 + 10.0 * coulomb / (speed + 0.05)
    law = Law(stiffness, 0.025 * stiffness, 10.0 * coulomb, 1e-3 * count, 0.2)
    step, rows = float(log_uniform(rng, 2e-3, 5e-3)), []
    for _ in range(int(rng.integers(1, 4))):
        stamps = clock(rng, float(rng.uniform(15.0, 45.0)), step, 0.02)
        sizes = speed * rng.uniform(0.15, 1.0, 11) * np.where(np.arange(11) % 2, -1.0, 1.0)
        rate = _levels(rng, stamps, sizes)
        way = np.cumsum(np.append(0.0, 0.5 * (rate[1:] + rate[:-1]) * np.diff(stamps)))
        still = np.zeros_like(stamps)
        angle, _, inputs, _ = tracking(joint, law, (stamps, way, rate, still, still))
        rows.append(_recorded(rng, (stamps, inputs, angle), count, rng.uniform(0.0, count)))
    return _logs(rows), {"p1": inertia, "p2": viscous, "coulomb": coulomb}


def steady(number):
    """Return logs of a viscous joint at levels of torque, every other with Coulomb friction.

    Its speed settles within a sample or two.
    """
    rng = np.random.default_rng([6, number])
    viscous = float(log_uniform(rng, 0.01, 1.0))
    inertia = viscous * float(log_uniform(rng, 5e-4, 4e-3))
    coulomb = 0.0 if number % 2 else viscous * float(rng.uniform(0.05, 0.5))
    joint = Joint(inertia, viscous, 0.0, 1.0, coulomb, delay=rng.uniform(0.0, 5e-3))
    count, step = 2 * np.pi / 2 ** int(rng.integers(11, 15)), float(log_uniform(rng, 5e-3, 2e-2))
    rows = []
    for _ in range(int(rng.integers(1, 4))):
        stamps = clock(rng, float(rng.uniform(10.0, 40.0)), step, 0.02)
        sizes = viscous * rng.uniform(0.3, 3.0, 11) * rng.choice([-1.0, 1.0], 11)
        inputs = _levels(rng, stamps, sizes)
        angle, _ = motion(joint, stamps, inputs)
        rows.append(_recorded(rng, (stamps, inputs, angle), count, count))
    return _logs(rows), {"p1": inertia, "p2": viscous, "coulomb": coulomb}


def played(logs, truth, inputs, stamps):
    """Return those logs, and one of the same joint with other (n,) inputs at stamps in s."""
    joint = Joint(truth["p1"], truth["p2"], 0.0, 1.0, truth["coulomb"], delay=1e-3)
    angle, _ = motion(joint, stamps, inputs)
    count, rng = math.tau / 2**14, np.random.default_rng(1)
    row = _recorded(rng, (stamps, inputs, angle), count, count)
    return [*logs, Log(*row, input_kind=InputKind.TORQUE, name="new", source="new")]
