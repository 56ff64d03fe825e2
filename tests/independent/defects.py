"""Random robots on benches that each have one defect, made by the independent integrator.

`draw` makes robot ``number`` of a row of `ROWS`. Each third is driven by chirps and sums of sines,
the others by sines. Of what varies within a session the mean is true.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from tests.independent import bodies
from tests.independent.drives import chirp, log_uniform, multisine
from tests.independent.integrator import Joint
from tests.independent.kinds import driven, sines
from tests.independent.robots import log_of

_WIDEST = 1.0  # rad, beyond which a robot is drawn again


@dataclass(frozen=True)
class BenchRobot:
    """What was drawn."""

    truth: dict[str, float]  # by name, of the bare joint
    heaviest: float  # largest added gravity moment in N m, as the size of p3's errors
    recordings: tuple[bodies.Recording, ...]

    @property
    def logs(self) -> list[Log]:
        """What identification may see."""
        return [log_of(each, f"log {k}") for k, each in enumerate(self.recordings)]

    @property
    def few_logs(self) -> list[Log]:
        """Two logs with each mass, where these show as much."""
        found: dict[AddedMass, list[Log]] = {}
        for log in self.logs:
            found.setdefault(log.added_mass, []).append(log)
        return [log for logs in found.values() for log in logs[:2]]


def draw(row: str, number: int, seed: int = 1) -> BenchRobot:
    """Return a robot that these alone determine."""
    rng = np.random.default_rng([seed, list(ROWS).index(row), number])
    while True:
        body, runs = _robot(rng, number)
        bench = ROWS[row].make(rng, body, np.array([run.size for run in runs]) / body.joint.gain)
        encoder = bodies.Encoder.drawn(rng, rng.uniform(-0.5, 0.5))
        ticks = log_uniform(rng, 1e-3, 5e-3), rng.uniform(0.0, 0.3)
        logs = []
        for run, rate in zip(runs, np.resize(bench.rates, len(runs)), strict=True):
            period = 2.0 * np.pi / (run.omega or body.pace_of(run.mass))
            duration = rng.uniform(30.0, 40.0) if run.omega else rng.uniform(10.0, 16.0)
            timing = {"ticks": (rate * ticks[0], ticks[1]), "duration": max(duration, 6.0 * period)}
            logs.append(bodies.record(rng, body, run, encoder, **timing, bench=bench))
        if all(bodies.moves(body, log, encoder, _WIDEST) for log in logs):
            return BenchRobot(body.truth(), body.heaviest, tuple(map(bench.notes, logs)))


def _robot(rng, number):
    """Draw a hand with three or four masses, none among them, and 9 to 12 runs."""
    inertia, pace, arm = (
        log_uniform(rng, 1e-3, 1e-2),
        log_uniform(rng, 2.0, 8.0),
        rng.uniform(0.08, 0.2),
    )
    joint = Joint(inertia=inertia, viscous=0.0, gravity=inertia * pace**2, gain=1.0)
    shares = rng.uniform(0.1, 0.3), rng.uniform(0.4, 0.6), rng.uniform(0.8, 1.2)
    loads = tuple(bodies.Mass(inertia * share / arm**2, arm) for share in shares)
    few = int(rng.integers(2))
    body = bodies.damped(
        rng, bodies.Body(joint=joint, masses=(bodies.Mass(), *loads[few:]), pace=pace)
    )
    each = 3 + few * int(rng.integers(2))
    if number % 3 == 2:
        body, runs, sizes = driven(rng, body, [multisine, chirp], each)
    else:
        body, runs, sizes = sines(rng, body, each)
    return bodies.with_gain(rng, body, sizes), runs


# The defects


def _base(rng, body, _):
    """The bench itself swings sideways on springs."""
    loaded = body.carrying(body.masses[-1])
    moment = loaded.gravity / bodies.GRAVITY
    mass = rng.uniform(3.0, 10.0) * moment**2 / loaded.inertia
    omega = rng.uniform(4.0, 7.0) * max(map(body.pace_of, body.masses))
    damping = 2.0 * rng.uniform(0.02, 0.1) * mass * omega

    def joint(each, *_):
        return each._replace(
            base=mass,
            base_viscous=damping,
            base_spring=mass * omega**2,
            imbalance=each.gravity / bodies.GRAVITY,
        )

    return bodies.Bench(joint=joint)


def _own_inertia(_rng, _body, _sizes):
    """Added masses are discs whose own inertia is 5 % of m l^2."""
    return bodies.Bench(
        joint=lambda joint, mass, _: joint._replace(
            inertia=joint.inertia + 0.05 * mass.mass * mass.arm**2
        )
    )


def _friction_by_log(rng, _body, _sizes):
    """All that damps differs from log to log with a standard deviation of 20 %."""
    return bodies.Bench(
        joint=lambda joint, *_: _damped(joint, max(1.0 + 0.2 * rng.standard_normal(), 0.4))
    )


def _regimes(rng, _body, _sizes):
    """Within most logs the clock slows down by 4 to 15 %, or speeds up: a message more, or less.

    The delay is that of the fast clock.
    """
    slower, messages, begins = rng.uniform(1.04, 1.15), rng.uniform(0.5, 1.2), rng.integers(2)

    def clock(stamps):
        step = stamps[-1] / (stamps.size - 1)
        switch = rng.uniform(0.2, 0.8) if rng.random() < 0.8 else 1.0  # some never do
        slow = (np.arange(stamps.size) < switch * stamps.size) == bool(begins)
        cycles = np.diff(stamps) * np.where(slow[1:], slower, 1.0)
        return np.concatenate([[0.0], np.cumsum(cycles)]), messages * step * slow

    return bodies.Bench(clock=clock)


def _together(*makes):
    """Make a bench with several defects at once: of joints, the last one's of the clock."""

    def make(rng, body, sizes):
        benches = [each(rng, body, sizes) for each in makes]

        def joint(each, *log):
            for bench in benches:
                each = bench.joint(each, *log)
            return each

        return replace(benches[-1], joint=joint)

    return make


def _damped(joint, factor):
    return joint._replace(
        viscous=factor * joint.viscous, coulomb=factor * joint.coulomb, drag=factor * joint.drag
    )


def _weighed(rng, body, _):
    """Masses are told up to 3 % wrong, but together right: what they share is the row *scale*."""
    errors = rng.uniform(-0.03, 0.03, len(body.masses) - 1)
    factors = dict(zip(body.masses, [1.0, *(1.0 + errors - errors.mean())], strict=True))
    return bodies.Bench(notes=lambda log: _told_mass(log, factors[log.mass]))


def _scaled(rng, *_):
    """All masses are told 3 % wrong."""
    factor = 1.0 + 0.03 * rng.choice([-1.0, 1.0])
    return bodies.Bench(notes=lambda log: _told_mass(log, factor))


def _level(rng, *_):
    """The bench is tilted by 4 to 8 degrees, though added masses are told to hang straight down.

    The joint's own gravity moment is that of the tilted bench.
    """
    lost = 1.0 - math.cos(math.radians(rng.uniform(4.0, 8.0)))
    return bodies.Bench(
        joint=lambda joint, mass, _: joint._replace(
            gravity=joint.gravity - lost * mass.mass * bodies.GRAVITY * mass.arm
        )
    )


def _arm(rng, *_):
    """All arms are told 1 % wrong."""
    factor = 1.0 + 0.01 * rng.choice([-1.0, 1.0])
    return bodies.Bench(
        notes=lambda log: replace(log, mass=log.mass._replace(arm=factor * log.mass.arm))
    )


def _told_mass(log, factor):
    return replace(log, mass=log.mass._replace(mass=factor * log.mass.mass))


def _dead_zone(_rng, _body, sizes):
    """The drive takes 3 % of the median command away."""
    zone = 0.03 * np.median(sizes)
    return bodies.Bench(drive=lambda _, u: np.sign(u) * np.maximum(np.abs(u) - zone, 0.0))


def _saturation(rng, _body, sizes):
    """The drive gives no more than a share of the largest command."""
    limit = rng.uniform(0.75, 0.9) * sizes.max()
    return bodies.Bench(drive=lambda _, u: np.clip(u, -limit, limit))


def _lag(rng, _body, _sizes):
    """The drive smooths the command with a time constant of 2 to 10 ms."""
    constant = rng.uniform(2e-3, 10e-3)

    def smoothed(stamps, inputs):
        out, now = np.empty_like(inputs), 0.0
        for k, share in enumerate(-np.expm1(-np.gradient(stamps) / constant)):
            now += share * (inputs[k] - now)
            out[k] = now
        return out

    return bodies.Bench(drive=smoothed)


def _backlash(_rng, _body, _sizes):
    """The encoder's gear has a play of 0.3 degrees."""
    half = math.radians(0.3) / 2.0

    def played(angle):
        out, now = np.empty_like(angle), angle[0]
        for k, each in enumerate(angle):
            now = min(max(now, each - half), each + half)
            out[k] = now
        return out

    return bodies.Bench(encoder=played)


def _eccentric(rng, _body, _sizes):
    """The encoder's disc sits beside its axis: 0.5 degrees once a turn."""
    phase = rng.uniform(0.0, 2.0 * np.pi)
    return bodies.Bench(encoder=lambda angle: angle + math.radians(0.5) * np.sin(angle - phase))


def _clock(rng, _body, _sizes):
    """Stamps run 0.1 to 0.5 % fast or slow."""
    rate = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(1e-3, 5e-3)
    return bodies.Bench(notes=lambda log: replace(log, time=rate * log.time))


def _falling(_rng, _body, _sizes):
    """All that damps falls within each log, from 1.1 to 0.9 times its mean."""
    share = 0.9 / 1.1 - 1.0
    return bodies.Bench(joint=lambda joint, _, end: _damped(joint, 1.1)._replace(wear=share / end))


def _resistance(_rng, body, _sizes):
    """The motor's resistance rises by 10 % from the first mass to the last.

    Half of what damps is the motor's voltage.
    """
    warmth = dict(zip(body.masses, np.linspace(-0.05, 0.05, len(body.masses)), strict=True))

    def joint(each, mass, _):
        cold = 1.0 / (1.0 + warmth[mass])
        return each._replace(gain=cold * each.gain, viscous=0.5 * (1.0 + cold) * each.viscous)

    return bodies.Bench(joint=joint)


def _spring(rng, body, _):
    """A cable pulls to some angle with 10 % of p3 a rad."""
    stiffness, rest = 0.1 * body.joint.gravity, rng.uniform(-0.3, 0.3)
    return bodies.Bench(joint=lambda joint, *_: joint._replace(spring=stiffness, spring_rest=rest))


class Row(NamedTuple):
    """How a bench is made of a robot; parameters that its defect moves; words that name it."""

    make: Callable[..., bodies.Bench]
    moved: tuple[str, ...] = ()
    words: str = ""  # a regular expression


ROWS = {
    "control": Row(lambda *_: bodies.Bench()),
    "base": Row(_base, ("p1",), r"\bbase\b"),
    "own inertia": Row(_own_inertia, ("p1",), r"own inertia|mass_inertia"),
    "friction by log": Row(_friction_by_log, ("p2", "coulomb"), r"between logs"),
    "weighed": Row(_weighed, ("p1", "p3", "p4"), r"weighed|masses contradict"),
    "dead zone": Row(_dead_zone, ("p4",), r"dead.zone"),
    "saturation": Row(_saturation, ("p4",), r"saturat|compression"),
    "backlash": Row(_backlash, ("p1", "p4"), r"backlash"),
    "clock": Row(_clock, ("p1",), r"clock"),
    "falling friction": Row(
        _falling, ("p2", "coulomb"), r"warm|within (a|the|each) log|with (the )?time"
    ),
    "resistance": Row(_resistance, ("p4",), r"resistance"),
    "spring": Row(_spring, ("p3",), r"spring"),
    # every second log has another clock
    "two rates": Row(lambda rng, *_: bodies.Bench(rates=(1.0, rng.uniform(2.0, 4.0)))),
    "eccentric": Row(_eccentric),
    "scale": Row(_scaled),
    "lag": Row(_lag),
    "base, friction by log": Row(
        _together(_base, _friction_by_log), ("p1", "p2", "coulomb"), r"\bbase\b"
    ),
    "regimes": Row(_regimes, ("delay",), r"regime|slow.delay"),
    "base, friction by log, regimes": Row(
        _together(_base, _friction_by_log, _regimes), ("p1", "p2", "coulomb"), r"\bbase\b"
    ),
    "level": Row(_level),
    "arm": Row(_arm),
}
