"""Random robots and their logs, made by the independent integrator.

Three families: A as the manual asks (sines, three masses, viscous and Coulomb friction); B sines of
a robot that has some of Stribeck friction, drag, friction by load and a bias besides; C other
inputs (sums of sines, chirps, free decays), half of the robots with drag.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.data import DataSet
from butterfly.logs.log import Log, Sine
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from tests.independent.drives import chirp, clock, log_uniform, multisine
from tests.independent.integrator import Joint, motion

FAMILIES = "ABC"

_WIDEST = {"A": 1.0, "B": 1.0, "C": 2.0}  # rad, beyond which a robot is drawn again
_LEAST_MOTION = 1e-3  # rad rms in the second half of a driven log, and three steps of the encoder
_SLOWEST = 1.5  # rad/s, of a sine: a log of 40 s then holds ten periods
_MOST_FRICTION = 0.3  # Coulomb torque over the drive's amplitude, in every log
_ATTEMPTS = 1000


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


@dataclass(frozen=True, kw_only=True)
class _Run:
    """A drive in N m, as a function of (n,) stamps in s, of a hand let go at ``start`` rad."""

    added: AddedMass
    torque: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    size: float  # amplitude in N m
    omega: float | None = None
    start: float = 0.0


def draw(family: str, number: int, seed: int = 1, repeat: int = 0) -> RandomRobot:
    """Return a robot that these numbers alone determine; ``repeat`` changes its noise only."""
    stream = [seed, FAMILIES.index(family), number]
    rng, noise = np.random.default_rng(stream), np.random.default_rng([*stream, repeat])
    for _ in range(_ATTEMPTS):
        truth, masses = _hand(rng)
        truth, runs = (_other_inputs if family == "C" else _sines)(family, truth, masses, rng)
        truth, runs = _in_volts(truth, runs, rng)
        ticks = rng.uniform(1e-3, 5e-3), rng.uniform(0.0, 0.5)
        duration = rng.uniform(40.0, 60.0) if family != "C" else rng.uniform(15.0, 30.0)
        encoder = 2.0 * np.pi / 2 ** int(rng.integers(12, 17)), rng.uniform(0.0, 1e-3)
        zero = rng.uniform(-0.5, 0.5)
        clean = [_clean(truth, run, clock(rng, duration, *ticks)) for run in runs]
        if all(_accepted(log, _WIDEST[family], encoder[0]) for log in clean):
            logs = tuple(_seen(log, zero, *encoder, noise) for log in clean)
            named = {"family": family, "seed": seed, "number": number, "repeat": repeat}
            return RandomRobot(**named, truth=truth, zero=zero, logs=logs)
    raise RuntimeError(f"no robot {family}{number} of seed {seed} moves as it should")


def _hand(rng):
    """Draw p1, p2, p3 and the delay, and what the hand carries: nothing, and two masses."""
    p1 = log_uniform(rng, 1e-3, 1e-2)
    p3 = p1 * log_uniform(rng, 0.5, 9.0) ** 2
    arm = rng.uniform(0.08, 0.2)
    shares = rng.uniform(0.1, 0.4), rng.uniform(0.5, 1.2)
    masses = [NO_ADDED_MASS, *(AddedMass(mass=p1 * share / arm**2, arm=arm) for share in shares)]
    middle = masses[1]
    stiff = (p1 + middle.inertia) * (p3 + middle.gravity_moment)
    p2 = 2.0 * log_uniform(rng, 0.005, 0.1) * math.sqrt(stiff)
    delay = rng.uniform(0.0, 0.01)
    return LumpedParameters(p1=p1, p2=p2, p3=p3, p4=1.0, delay=delay), masses


def _resonance(truth, added):
    return math.sqrt((truth.p3 + added.gravity_moment) / (truth.p1 + added.inertia))


def _drive(truth, added, omega, swing):
    """Amplitude in N m that swings the hand by ``swing`` rad, by describing functions."""
    inertia, gravity = truth.p1 + added.inertia, truth.p3 + added.gravity_moment
    speed = omega * swing
    in_phase = (gravity * (1.0 - swing**2 / 8.0) - inertia * omega**2) * swing
    dry = truth.coulomb + truth.load * added.weight
    braking = truth.p2 * speed + 8 / (3 * np.pi) * truth.drag * speed**2 + 4 / np.pi * dry
    return math.hypot(in_phase, braking)


def _sines(family, truth, masses, rng):
    """Sines on both sides of the resonance of each mass."""
    aims = []
    for added in masses:
        resonance = _resonance(truth, added)
        count = int(rng.integers(4, 7))
        below, above = count // 2, count - count // 2
        tones = [*rng.uniform(0.5, 0.95, below), *rng.uniform(1.05, 2.0, above)]
        slowest = max(1.0, _SLOWEST / (0.5 * resonance))  # a hand next to balance is driven above
        omegas = resonance * slowest * np.array(tones)
        aims += [(added, omega, rng.uniform(0.1, 0.5)) for omega in omegas]
    drives = [_drive(truth, *aim) for aim in aims]
    drive = float(np.median(drives))
    share = rng.uniform(0.0, _MOST_FRICTION)
    dry = min(share * np.quantile(drives, 0.25), _MOST_FRICTION * min(drives))
    truth = replace(truth, coulomb=float(dry))
    if family == "B":
        speed = float(np.median([omega * swing for _, omega, swing in aims]))
        truth = replace(truth, **_other_terms(truth, masses, drive, speed, rng))
    return truth, [_sine(truth, *aim) for aim in aims]


def _sine(truth, added, omega, swing):
    size = _drive(truth, added, omega, swing)
    rest = math.asin(truth.bias / (truth.p3 + added.gravity_moment))
    return _Run(
        added=added,
        torque=lambda time: size * np.sin(omega * time),
        size=size,
        omega=omega,
        start=rest,
    )


def _other_terms(truth, masses, drive, speed, rng):
    """Draw at least one of what B has besides."""
    sizes = {
        "stribeck": rng.uniform(0.1, 0.6) * max(truth.coulomb, 0.02 * drive),
        "drag": rng.uniform(0.1, 1.0) * truth.p2 / speed,
        "load": rng.uniform(0.1, 1.0) * truth.coulomb / masses[-1].weight,
        "bias": rng.choice([-1, 1]) * rng.uniform(0.01, 0.1) * min(truth.p3, drive),
    }
    slow = log_uniform(rng, 0.02, 0.3)
    order = rng.permutation(list(sizes))
    chosen = order[: int(rng.integers(1, len(sizes) + 1))]
    settings = {"stribeck_velocity": float(slow)} if "stribeck" in chosen else {}
    return {str(name): float(sizes[name]) for name in chosen} | settings


def _other_inputs(_, truth, masses, rng):
    """Sums of sines, chirps and free decays; at least one log of each mass is driven."""
    resonances = {added: max(_resonance(truth, added), 1.0) for added in masses}
    sizes = {
        added: _drive(truth, added, 0.6 * resonances[added], rng.uniform(0.15, 0.4))
        for added in masses
    }
    truth = replace(truth, coulomb=min(sizes.values()) * rng.uniform(0.0, _MOST_FRICTION))
    if rng.integers(2):
        truth = replace(truth, drag=rng.uniform(0.1, 1.0) * truth.p2 / rng.uniform(0.5, 2.0))
    driven = [[_multisine], [_chirp], [_multisine, _chirp]][int(rng.integers(3))]
    kinds = [*driven, *[_decay] * int(rng.integers(2))]
    runs = []
    for added in masses:
        for k in range(max(len(kinds), int(rng.integers(2, 5)))):
            size = sizes[added] + 4 / np.pi * truth.coulomb
            runs.append(kinds[k % len(kinds)](added, resonances[added], size, rng))
    return truth, runs


def _multisine(added, resonance, size, rng):
    torque, most = multisine(resonance, size, rng)
    return _Run(added=added, torque=torque, size=most)


def _chirp(added, resonance, size, rng):
    torque, most = chirp(resonance, size, rng)
    return _Run(added=added, torque=torque, size=most)


def _decay(added, _, size, rng):
    return _Run(added=added, torque=np.zeros_like, size=size, start=rng.uniform(0.4, 1.2))


def _in_volts(truth, runs, rng):
    """Choose p4 such that all amplitudes lie between 0.05 and 5 V, as far as they can."""
    sizes = np.array([run.size for run in runs])
    least, most = sizes.max() / 5.0, sizes.min() / 0.05
    if least > most:
        return replace(truth, p4=float(math.sqrt(least * most))), runs
    return replace(truth, p4=float(log_uniform(rng, least, most))), runs


def _clean(truth, run, stamps):
    """Log of what an encoder without noise or steps, its zero at 0, would see."""
    added = run.added
    joint = Joint(
        inertia=truth.p1 + added.inertia,
        viscous=truth.p2,
        gravity=truth.p3 + added.gravity_moment,
        gain=truth.p4,
        coulomb=truth.coulomb + truth.load * added.weight,
        drag=truth.drag,
        bias=truth.bias,
        excess=truth.stribeck,
        excess_velocity=truth.stribeck_velocity,
        delay=truth.delay,
    )
    inputs = run.torque(stamps) / truth.p4
    angle, _ = motion(joint, stamps, inputs, run.start)
    sine = Sine(omega=run.omega, amplitude=run.size / truth.p4) if run.omega else None
    return Log(time=stamps, input=inputs, angle=angle, added_mass=added, excitation=sine)


def _accepted(log, widest, count):
    """Whether a hand swings, and not too wide; a decay comes to rest."""
    moving = log.angle[log.angle.size // 2 :] if np.ptp(log.input) else log.angle
    still = max(_LEAST_MOTION, 3.0 * count)
    return bool(np.abs(log.angle).max() < widest and np.std(moving) > still)


def _seen(log, zero, count, spread, noise):
    angle = zero + log.angle + spread * noise.standard_normal(log.angle.size)
    return replace(log, angle=count * np.rint(angle / count))
