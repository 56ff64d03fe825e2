"""Random robots and their logs, made by the independent integrator.

Three families: A as the manual asks (sines, three masses, viscous and Coulomb friction); B sines of
a robot that has some of Stribeck friction, drag, friction by load and a bias besides; C other
inputs (sums of sines, chirps, free decays), half of the robots with drag.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.logs.log import Log, Sine
from butterfly.model.parameters import AddedMass, LumpedParameters
from tests.independent import bodies
from tests.independent.drives import chirp, clock, log_uniform, multisine, sine
from tests.independent.integrator import Joint, motion

FAMILIES = "ABC"

_WIDEST = {"A": 1.0, "B": 1.0, "C": 2.0}  # rad, beyond which a robot is drawn again
_SLOWEST = 1.5  # rad/s, of a sine: a log of 40 s then holds ten periods


@dataclass(frozen=True, kw_only=True)
class RandomRobot:
    """What was drawn: robot ``number`` of a family with a seed, its noise the ``repeat``-th."""

    family: str
    seed: int
    number: int
    repeat: int
    truth: LumpedParameters  # of the bare hand
    zero: float  # of the encoder, in rad
    logs: tuple[Log, ...]  # what identification may see

    @cached_property
    def data(self) -> DataSet:
        """The logs, ready for estimators."""
        return DataSet.of(self.logs, name=f"{self.family}{self.number}")

    @property
    def masses(self) -> list[AddedMass]:
        """The different added masses."""
        return sorted({log.added_mass for log in self.logs})


def draw(family: str, number: int, seed: int = 1, repeat: int = 0) -> RandomRobot:
    """Return a robot that these numbers alone determine; ``repeat`` changes its noise only."""
    stream = [seed, FAMILIES.index(family), number]
    rng, noise = np.random.default_rng(stream), np.random.default_rng([*stream, repeat])
    while True:
        body, runs = (_other_inputs if family == "C" else _sines)(family, _hand(rng), rng)
        body = bodies.with_gain(rng, body, [run.size for run in runs])
        ticks = rng.uniform(1e-3, 5e-3), rng.uniform(0.0, 0.5)
        duration = rng.uniform(40.0, 60.0) if family != "C" else rng.uniform(15.0, 30.0)
        count = 2.0 * np.pi / 2 ** int(rng.integers(12, 17))
        encoder = bodies.Encoder(count=count, spread=rng.uniform(0.0, 1e-3), zero=0.0)
        zero = rng.uniform(-0.5, 0.5)
        clean = [_clean(body, run, clock(rng, duration, *ticks)) for run in runs]
        if all(bodies.moves(body, log, encoder, _WIDEST[family]) for log in clean):
            logs = tuple(log_of(_seen(log, replace(encoder, zero=zero), noise)) for log in clean)
            named = {"family": family, "seed": seed, "number": number, "repeat": repeat}
            return RandomRobot(**named, truth=_truth(body), zero=zero, logs=logs)


def log_of(each: bodies.Recording, name: str = "") -> Log:
    """Return a recording as identification may see it."""
    return Log(
        time=each.time,
        input=each.input,
        angle=each.angle,
        added_mass=AddedMass(mass=each.mass.mass, arm=each.mass.arm),
        excitation=Sine(omega=each.omega, amplitude=each.amplitude) if each.omega else None,
        name=name,
    )


def _truth(body):
    joint = body.joint
    terms = {"load": body.load, "bias": joint.bias, "stribeck": joint.excess}
    terms |= {"stribeck_velocity": joint.excess_velocity} if joint.excess else {}
    return LumpedParameters(**body.truth(), **terms)


def _hand(rng):
    """Draw inertia, damping, gravity and delay, and what the hand carries: nothing, two masses."""
    inertia = log_uniform(rng, 1e-3, 1e-2)
    gravity = inertia * log_uniform(rng, 0.5, 9.0) ** 2
    arm = rng.uniform(0.08, 0.2)
    shares = rng.uniform(0.1, 0.4), rng.uniform(0.5, 1.2)
    joint = Joint(inertia=inertia, viscous=0.0, gravity=gravity, gain=1.0)
    masses = (bodies.Mass(), *(bodies.Mass(inertia * share / arm**2, arm) for share in shares))
    body = bodies.Body(joint=joint, masses=masses, pace=1.0)
    middle = body.carrying(masses[1])
    damping = 2.0 * log_uniform(rng, 0.005, 0.1) * math.sqrt(middle.inertia * middle.gravity)
    return body.having(viscous=damping, delay=rng.uniform(0.0, 0.01))


def _sines(family, body, rng):
    """Sines on both sides of the resonance of each mass."""
    aims = []
    for mass in body.masses:
        loaded = body.carrying(mass)
        resonance = math.sqrt(loaded.gravity / loaded.inertia)
        count = int(rng.integers(4, 7))
        below, above = count // 2, count - count // 2
        tones = [*rng.uniform(0.5, 0.95, below), *rng.uniform(1.05, 2.0, above)]
        slowest = max(1.0, _SLOWEST / (0.5 * resonance))  # a hand next to balance is driven above
        omegas = resonance * slowest * np.array(tones)
        aims += [(mass, omega, rng.uniform(0.1, 0.5)) for omega in omegas]
    drives = [body.torque_of(*aim) for aim in aims]
    share = rng.uniform(0.0, bodies.MOST_FRICTION)
    dry = min(share * np.quantile(drives, 0.25), bodies.MOST_FRICTION * min(drives))
    body = body.having(coulomb=float(dry))
    if family == "B":
        speed = float(np.median([omega * swing for _, omega, swing in aims]))
        body = _with_other_terms(body, float(np.median(drives)), speed, rng)
    return body, [_sine(body, *aim) for aim in aims]


def _sine(body, mass, omega, swing):
    size, loaded = body.torque_of(mass, omega, swing), body.carrying(mass)
    rest = math.asin(loaded.bias / loaded.gravity)
    return bodies.Run(mass=mass, torque=sine(size, omega), size=size, omega=omega, start=rest)


def _with_other_terms(body, drive, speed, rng):
    """Draw at least one of what B has besides."""
    joint, heaviest = body.joint, body.masses[-1].mass * body.gravity
    sizes = {
        "excess": rng.uniform(0.1, 0.6) * max(joint.coulomb, 0.02 * drive),
        "drag": rng.uniform(0.1, 1.0) * joint.viscous / speed,
        "load": rng.uniform(0.1, 1.0) * joint.coulomb / heaviest,
        "bias": rng.choice([-1, 1]) * rng.uniform(0.01, 0.1) * min(joint.gravity, drive),
    }
    slow = float(log_uniform(rng, 0.02, 0.3))
    order = rng.permutation(list(sizes))
    chosen = order[: int(rng.integers(1, len(sizes) + 1))]
    found = {str(name): float(sizes[name]) for name in chosen}
    body = replace(body, load=found.pop("load", 0.0))
    return body.having(**found, excess_velocity=slow)


def _other_inputs(_, body, rng):
    """Sums of sines, chirps and free decays; at least one log of each mass is driven."""
    sizes = bodies.sizes_of(rng, body)
    body = body.having(coulomb=min(sizes) * rng.uniform(0.0, bodies.MOST_FRICTION))
    if rng.integers(2):
        drag = rng.uniform(0.1, 1.0) * body.joint.viscous / rng.uniform(0.5, 2.0)
        body = body.having(drag=drag)
    driven = [[multisine], [chirp], [multisine, chirp]][int(rng.integers(3))]
    kinds = [*driven, *[None] * int(rng.integers(2))]
    runs = []
    for mass, least in zip(body.masses, sizes, strict=True):
        for k in range(max(len(kinds), int(rng.integers(2, 5)))):
            make, size = kinds[k % len(kinds)], least + 4 / np.pi * body.joint.coulomb
            if make is None:  # a free decay
                run = {"torque": np.zeros_like, "size": size, "start": rng.uniform(0.4, 1.2)}
            else:
                run = dict(
                    zip(("torque", "size"), make(body.pace_of(mass), size, rng), strict=True)
                )
            runs.append(bodies.Run(mass=mass, **run))
    return body, runs


def _clean(body, run, stamps):
    """Return what an encoder without noise or steps, its zero at 0, would see."""
    gain = body.joint.gain
    inputs = run.torque(stamps) / gain
    angle, _ = motion(body.carrying(run.mass), stamps, inputs, run.start)
    sine = {"omega": run.omega, "amplitude": run.size / gain} if run.omega else {}
    return bodies.Recording(time=stamps, input=inputs, angle=angle, mass=run.mass, **sine)


def _seen(log, encoder, noise):
    angle = encoder.zero + log.angle + encoder.spread * noise.standard_normal(log.angle.size)
    return replace(log, angle=encoder.count * np.rint(angle / encoder.count))
