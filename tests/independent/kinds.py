"""Random robots of unknown kind, each with what its owner says of it in a manifest.

`draw` makes robot ``number`` of a kind; `RobotOfKind.write` writes its folder of logs. Nothing of
the program is used: what it reads are files.
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.independent import bodies
from tests.independent.drives import chirp, log_uniform, multisine, sine, stairs, steps, still
from tests.independent.integrator import Law

_SWING = 2.0  # rad, widest of a robot that is driven about its rest
_TRAVEL = 30.0  # rad, of a joint that gravity does not bring back
_TURNS = 25.0  # rad, of a swing through the upright


@dataclass(frozen=True)
class RobotOfKind:
    """What was drawn: body, encoder, one file of each recording, and what the owner says."""

    body: bodies.Body
    encoder: bodies.Encoder
    recordings: list[bodies.Recording]
    widest: float  # rad, beyond which it is drawn again
    owner: dict[str, Any] = field(default_factory=dict)  # keys of the manifest, all but the logs
    # numbers of recordings with further keys of an entry; each once where there are none
    parts: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    accepted: bool = True
    kind: str = ""
    number: int = 0

    @property
    def truth(self) -> dict[str, float]:
        """Parameters by name, in SI units."""
        return self.body.truth()

    @property
    def zero(self) -> float:
        """Of the encoder in rad or m, but for whole turns."""
        return self.encoder.zero

    @property
    def known(self) -> frozenset[str]:
        """Names of the parameters that the owner knows exactly."""
        told = self.owner.get("known", {})
        exact = {name for name, value in told.items() if not isinstance(value, dict)}
        weightless = self.owner.get("gravity") == 0 or self.owner.get("joint") == "slide"
        return frozenset(exact | ({"p3"} if weightless else set()))

    def write(self, folder: Path) -> None:
        """Write the logs and their manifest."""
        tables = [
            {name: getattr(log, name) for name in ("time", "input", log.seen)}
            for log in self.recordings
        ]
        told = {"input": "torque"} | self.owner | {"name": f"{self.kind} {self.number}"}
        bodies.write_set(folder, told | {"logs": [*self._entries()]}, tables, "%.12g")

    def _entries(self):
        for k, keys in self.parts or [(k, {}) for k in range(len(self.recordings))]:
            log = self.recordings[k]
            entry = {"file": f"{k}.csv", **keys, **bodies.entry_of(log.mass)}
            if log.omega:
                entry |= {"omega": log.omega, "amplitude": log.amplitude}
            yield entry


def draw(kind: str, number: int, seed: int = 1) -> RobotOfKind:
    """Return a robot that these alone determine."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number])
    while True:
        made = KINDS[kind](rng, number)
        if made.accepted and all(
            bodies.moves(made.body, each, made.encoder, made.widest) for each in made.recordings
        ):
            return replace(made, kind=kind, number=number)


# What several kinds have in common


def _known_gain(rng, body, sizes, number):
    """Tell the gain: 1 of half the robots, else any number, of which one in four is uncertain."""
    if number % 2 == 0:
        return body, {"p4": 1.0}
    body = bodies.with_gain(rng, body, sizes)
    if number % 4 == 1:
        return body, {"p4": body.joint.gain}
    share = rng.uniform(0.01, 0.03)
    said = body.joint.gain * (1.0 + share * rng.standard_normal())
    return body, {"p4": {"value": float(said), "uncertainty": float(said * share)}}


def _somewhere(rng, joint):
    """Angle at which friction holds a joint at rest, if gravity pulls it."""
    if joint.gravity == 0.0:
        return 0.0
    return math.asin(0.7 * rng.uniform(-1.0, 1.0) * min(joint.coulomb / joint.gravity, 1.0))


def driven(rng, body, inputs, each):
    """``each`` runs of every mass, by inputs in turn."""
    sizes = bodies.sizes_of(rng, body)
    body = bodies.dry(rng, body, sizes)
    runs = []
    for mass, size in zip(body.masses, sizes, strict=True):
        joint, strong = body.carrying(mass), size + 4 / np.pi * body.joint.coulomb
        for k in range(each):
            make = inputs[k % len(inputs)]
            torque, most = make(body.pace_of(mass), strong, rng)
            start = rng.uniform(0.4, 1.2) if make is still else _somewhere(rng, joint)
            runs.append(bodies.Run(mass=mass, torque=torque, size=most, start=start))
    return body, runs, [run.size for run in runs]


def sines(rng, body, each):
    """``each`` sines of every mass."""
    aims = [
        (mass, body.pace_of(mass) * tone, rng.uniform(0.1, 0.5))
        for mass in body.masses
        for tone in [*rng.uniform(0.5, 0.95, each // 2), *rng.uniform(1.05, 2.0, each - each // 2)]
    ]
    body = bodies.dry(rng, body, [body.torque_of(*aim) for aim in aims])
    runs = []
    for mass, omega, swing in aims:
        size = body.torque_of(mass, omega, swing)
        runs.append(bodies.Run(mass=mass, torque=sine(size, omega), size=size, omega=omega))
    return body, runs, [run.size for run in runs]


def _moved(rng, body, number, each):
    """Sines of one robot in five, else inputs of two kinds."""
    if number % 5 == 4:
        return sines(rng, body, max(each, 4))
    pool = [multisine, chirp, steps]
    first = int(rng.integers(3))
    return driven(rng, body, [pool[first], pool[(first + 1) % 3]], each)


def _recorded(rng, body, runs, encoder):
    """Recordings by one clock, of sines longer than of others."""
    ticks = float(log_uniform(rng, 1e-3, 8e-3)), rng.uniform(0.0, 0.3)
    found = []
    for run in runs:
        period = 2.0 * np.pi / (run.omega or body.pace_of(run.mass))
        least = rng.uniform(30.0, 40.0) if run.omega else rng.uniform(8.0, 16.0)
        duration = min(max(least, 6.0 * period), 60.0)
        found.append(bodies.record(rng, body, run, encoder, ticks=ticks, duration=duration))
    return found


def _plain(rng, body, runs, widest, **owner):
    """A robot whose encoder's zero is within half a rad."""
    encoder = bodies.Encoder.drawn(rng, rng.uniform(-0.5, 0.5), body.reach)
    return RobotOfKind(body, encoder, _recorded(rng, body, runs, encoder), widest, owner)


# The kinds


def _one_mass(rng, number):
    body = bodies.hinge(rng, 2)
    body = replace(body, masses=body.masses[number // 2 % 2 :][:1])
    body, runs, sizes = _moved(rng, body, number, int(rng.integers(3, 6)))
    body, known = _known_gain(rng, body, sizes, number)
    return _plain(rng, body, runs, _SWING, known=known)


def _balanced(rng, number):
    body = bodies.hinge(rng, 1, balance=True)
    body, runs, sizes = _moved(rng, body, number, int(rng.integers(3, 6)))
    body, known = _known_gain(rng, body, sizes, number)
    return _plain(rng, body, runs, _TRAVEL, known=known | {"p3": 0.0})


def _vertical(rng, number):
    body = bodies.hinge(rng, 2 + number % 2, upright=True)
    body, runs, sizes = _moved(rng, body, number, int(rng.integers(2, 4)))
    return _plain(rng, bodies.with_gain(rng, body, sizes), runs, _TRAVEL, gravity=0)


def _slide(rng, number):
    weighed = number // 2 % 2
    body = bodies.slide(rng, 2 + number % 2 if weighed else 1)
    body, runs, sizes = _moved(rng, body, number, int(rng.integers(2, 5)))
    if weighed:
        return _plain(rng, bodies.with_gain(rng, body, sizes), runs, _TRAVEL, joint="slide")
    body, known = _known_gain(rng, body, sizes, number)
    return _plain(rng, body, runs, _TRAVEL, joint="slide", known=known)


def _pieces(rng, number):
    """One long log of a mass, of which pieces are files, parts of a file, or restarts in it."""
    masses = 3 if number % 2 else 1
    body = bodies.hinge(rng, masses)
    body, runs, sizes = driven(rng, body, [[multisine, stairs][int(rng.integers(2))]], 1)
    known = {}
    if masses == 1:
        body, known = _known_gain(rng, body, sizes, 2 * number // 4)
    else:
        body = bodies.with_gain(rng, body, sizes)
    encoder = bodies.Encoder.drawn(rng, rng.uniform(-0.5, 0.5))
    ticks = float(log_uniform(rng, 2e-3, 8e-3)), rng.uniform(0.0, 0.3)
    whole = [
        bodies.record(rng, body, run, encoder, ticks=ticks, duration=rng.uniform(40.0, 60.0))
        for run in runs
    ]
    cuts = [_cuts(rng, log.time[-1], 9 // masses) for log in whole]
    owner, files, parts = {"known": known} if known else {}, whole, []
    way = number // 2 % 3
    if way == 0:
        files = [_cut(log, *cut) for log, those in zip(whole, cuts, strict=True) for cut in those]
    elif way == 1:
        ends = ("from", "to")
        parts = [
            (k, dict(zip(ends, cut, strict=True))) for k, those in enumerate(cuts) for cut in those
        ]
    else:
        files = [
            _end_to_end([_cut(log, *cut) for cut in those])
            for log, those in zip(whole, cuts, strict=True)
        ]
        owner["split"] = "restarts"
    return RobotOfKind(body, encoder, files, _SWING, owner, parts)


def _cuts(rng, end, count):
    """Draw ``count`` stretches of a log, some of it left out between them."""
    edges = np.linspace(0.0, end, count + 1)
    lengths = rng.uniform(0.5, 0.95, count) * np.diff(edges)
    starts = edges[:-1] + rng.uniform(0.0, 1.0, count) * (np.diff(edges) - lengths)
    return [(float(a), float(a + length)) for a, length in zip(starts, lengths, strict=True)]


def _cut(log, begin, end):
    rows = (log.time >= begin) & (log.time <= end)
    time = log.time[rows]
    return replace(log, time=time - time[0], input=log.input[rows], angle=log.angle[rows])


def _end_to_end(pieces):
    columns = {
        name: np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("time", "input", "angle")
    }
    return replace(pieces[0], **columns)


def _closed_loop(rng, number):
    """A law tracks waves, steps, a turn up to the upright and down again, or several turns."""
    body = bodies.hinge(rng, 2)
    body = replace(body, masses=body.masses[number // 2 % 2 :][:1])
    (mass,) = body.masses
    loaded, pace = body.carrying(mass), body.pace_of(mass)
    high = loaded.gravity + loaded.inertia * pace**2
    body = bodies.dry(rng, body, [0.4 * high])
    bandwidth = min(pace * rng.uniform(1.8, 4.0), 18.0)
    law = Law(
        stiffness=loaded.inertia * bandwidth**2 + loaded.gravity,
        damping=2.0 * rng.uniform(0.5, 1.0) * loaded.inertia * bandwidth,
        limit=rng.uniform(1.5, 3.0) * high,
        count=1.0,
        share=rng.uniform(0.2, 0.6),
    )
    aims = [_wave, _levels, _to_the_upright, _round]
    chosen = [aims[0], aims[1 + number % 3], aims[int(rng.integers(4))]]
    runs = [
        bodies.Run(
            mass=mass,
            size=law.limit,
            law=law,
            plan=aim(rng, pace),
            start=_somewhere(rng, body.carrying(mass)),
        )
        for aim in chosen
    ]
    body, known = _known_gain(rng, body, [law.limit], number)
    return _plain(rng, body, runs, _TURNS, known=known)


def _wave(rng, pace):
    torque, _ = multisine(0.6 * pace, rng.uniform(0.3, 1.0), rng)
    return lambda time: followed(time, torque(time) - torque(np.zeros(1)))


def _levels(rng, pace):
    angle, _ = steps(0.4 * pace, rng.uniform(0.5, 1.5), rng)
    return lambda time: (angle(time), np.zeros(time.size), np.zeros(time.size))


def _to_the_upright(rng, pace):
    """Up in a smooth step, held there, down again, time after time."""
    period = rng.uniform(4.0, 8.0) * 2.0 * np.pi / pace
    hold = rng.uniform(1.0, 4.0)
    top = math.pi * float(rng.choice([-1.0, 1.0]))

    def plan(time):
        level = np.tanh(hold * np.cos(2.0 * np.pi * time / period)) / math.tanh(hold)
        return followed(time, top * 0.5 * (1.0 - level))

    return plan


def _round(rng, pace):
    """Turns one way and back."""
    turns, period = rng.uniform(1.0, 2.5), rng.uniform(5.0, 8.0) * 2.0 * np.pi / pace
    return lambda time: followed(time, np.pi * turns * (1.0 - np.cos(2.0 * np.pi * time / period)))


def followed(time, angle):
    """Plan an angle with its rate."""
    return angle, np.gradient(angle, time), np.zeros(time.size)


def _anywhere(rng, number):
    """The zero of the encoder anywhere, whole turns off between logs; steps, swing-ups, ..."""
    body, runs, encoder = _three_masses(rng, number, np.pi, swings=True)
    recordings = [
        replace(log, angle=log.angle + 2.0 * np.pi * int(rng.integers(-2, 3)))
        for log in _recorded(rng, body, runs, encoder)
    ]
    return RobotOfKind(body, encoder, recordings, _TURNS + 4 * np.pi)


def _wrapped(rng, number):
    """Angles within a turn, wherever its zero lies: from -pi to pi, or from 0 on."""
    body, runs, encoder = _three_masses(rng, number, np.pi, swings=number % 2 == 0)
    lowest = [-np.pi, 0.0][number % 2]
    recordings = _recorded(rng, body, runs, encoder)
    within = all(bodies.moves(body, each, encoder, _TURNS) for each in recordings)
    wrapped = [
        replace(log, angle=lowest + (log.angle - lowest) % (2.0 * np.pi)) for log in recordings
    ]
    jumps = any(np.abs(np.diff(log.angle)).max() > np.pi for log in wrapped)
    owner = {"repair": ["unwrap"]}
    return RobotOfKind(body, encoder, wrapped, np.inf, owner, accepted=within and jumps)


def _units(rng, number):
    """Degrees and ms; torque in mN m of a known gain 1, or mV and three masses in g at mm."""
    if number % 2:
        body, runs, encoder = _three_masses(rng, number, 0.5, swings=False)
        unit, known = "mV", {}
    else:
        body = bodies.hinge(rng, 1)
        body, runs, _ = driven(rng, body, [steps, multisine], 4)
        encoder = bodies.Encoder.drawn(rng, rng.uniform(-0.5, 0.5))
        unit, known = "mNm", {"known": {"p4": 1.0}}
    recordings = _recorded(rng, body, runs, encoder)
    accepted = all(bodies.moves(body, each, encoder, _SWING) for each in recordings)
    recordings = [
        replace(
            log,
            time=1e3 * log.time,
            input=1e3 * log.input,
            angle=np.degrees(log.angle),
            mass=bodies.Mass(1e3 * log.mass.mass, 1e3 * log.mass.arm),
        )
        for log in recordings
    ]
    units = {"time": "ms", "input": unit, "angle": "deg", "mass": "g", "arm": "mm"}
    told = {"input": "torque" if known else "voltage", "units": units, **known}
    return RobotOfKind(body, encoder, recordings, np.inf, told, accepted=accepted)


def _three_masses(rng, number, zero, *, swings):
    """A robot of unknown gain; each mass swings up once where ``swings`` are wanted."""
    body = bodies.hinge(rng, 3)
    pool = [stairs, chirp, multisine, steps, still]
    first = number % 3
    inputs = [pool[first], pool[(first + 1) % 4], pool[int(rng.integers(5))]]
    body, runs, sizes = driven(rng, body, inputs, 3)
    if swings:
        runs[2::3] = [_swing_up(rng, body, run) for run in runs[2::3]]
    body = bodies.with_gain(rng, body, sizes)
    return body, runs, bodies.Encoder.drawn(rng, rng.uniform(-zero, zero))


def _swing_up(rng, body, run):
    """Pump along the velocity for a while, then let it swing."""
    loaded = body.carrying(run.mass)
    strong = rng.uniform(0.2, 0.5) * loaded.gravity + 1.3 * loaded.coulomb
    pause = rng.uniform(2.0, 5.0) * 2.0 * np.pi / body.pace_of(run.mass)
    law = Law(stiffness=0.0, damping=0.0, limit=strong, count=1.0, share=rng.uniform(0.05, 0.2))

    def plan(time):
        nothing = np.zeros(time.size)
        return nothing, nothing, np.where(time < pause, strong, 0.0)

    return replace(run, torque=None, law=law, plan=plan, size=strong, start=0.0)


def _tachometer(rng, number):
    """A joint that no gravity pulls at, of which nobody saw the angle."""
    kinds = [_vertical, _slide, _balanced]
    drawn = kinds[number % 3](rng, number // 3)
    noise, step = log_uniform(rng, 1e-3, 5e-2), log_uniform(rng, 1e-4, 2e-2)
    recordings = []
    for log in drawn.recordings:
        size = float(np.std(log.velocity))
        seen = log.velocity + noise * size * rng.standard_normal(log.time.size)
        seen = step * size * np.rint(seen / (step * size))
        recordings.append(replace(log, velocity=seen, seen="velocity"))
    return replace(drawn, recordings=recordings)


KINDS = {
    "one-mass": _one_mass,
    "balanced": _balanced,
    "vertical": _vertical,
    "slide": _slide,
    "pieces": _pieces,
    "closed-loop": _closed_loop,
    "anywhere": _anywhere,
    "wrapped": _wrapped,
    "units": _units,
    "tachometer": _tachometer,
}
