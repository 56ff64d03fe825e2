"""Random joints that turn or slide, and recordings of them as an encoder sees them."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.independent.drives import clock, log_uniform
from tests.independent.integrator import Joint, Law, motion, tracking

GRAVITY = 9.81
MOST_FRICTION = 0.3  # Coulomb torque over the drive's amplitude, in every log

_LEAST_MOTION = 1e-3  # rad rms in the second half of a driven log, and three steps of the encoder

Table = Mapping[str, NDArray[np.float64]]

_NAMES = {
    "p1": "inertia",
    "p2": "viscous",
    "p3": "gravity",
    "p4": "gain",
    "coulomb": "coulomb",
    "drag": "drag",
    "delay": "delay",
}


class Mass(NamedTuple):
    """What a joint carries: kg, and m from its axis."""

    mass: float = 0.0
    arm: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Body:
    """A bare joint, the masses that it carries one after another, and how it likes to be moved."""

    joint: Joint
    masses: tuple[Mass, ...]
    pace: float  # rad/s that moves it well, where gravity gives it none
    gravity: float = GRAVITY  # m/s^2, on the masses
    reach: float = 1.0  # what is as large a motion as 1 rad is: 1, or in m for a slide
    slides: bool = False
    load: float = 0.0  # m, growth of Coulomb friction with the added weight

    def carrying(self, mass: Mass) -> Joint:
        """Return the joint with a mass."""
        inertia = mass.mass if self.slides else mass.mass * mass.arm**2
        return self.joint._replace(
            inertia=self.joint.inertia + inertia,
            gravity=self.joint.gravity + mass.mass * self.gravity * mass.arm,
            coulomb=self.joint.coulomb + self.load * mass.mass * self.gravity,
        )

    def pace_of(self, mass: Mass) -> float:
        """Return the angular frequency about which it is moved."""
        loaded = self.carrying(mass)
        if loaded.gravity == 0.0:
            return self.pace
        return max(math.sqrt(loaded.gravity / loaded.inertia), 1.0)

    def torque_of(self, mass: Mass, omega: float, swing: float) -> float:
        """Return the amplitude that swings it by ``swing`` rad, by describing functions."""
        loaded, swing = self.carrying(mass), swing * self.reach
        speed = omega * swing
        shape = 1.0 - swing**2 / 8.0
        in_phase = (loaded.gravity * shape - loaded.inertia * omega**2) * swing
        braking = loaded.viscous * speed + 8 / (3 * np.pi) * loaded.drag * speed**2
        return math.hypot(in_phase, braking + 4 / np.pi * loaded.coulomb)

    def having(self, **torques: float) -> "Body":
        """Return it with other parameters of the joint."""
        return replace(self, joint=self.joint._replace(**torques))

    @property
    def heaviest(self) -> float:
        """Largest added gravity moment in N m, as the size of p3's errors."""
        return max(each.mass * self.gravity * each.arm for each in self.masses)

    def truth(self) -> dict[str, float]:
        """Return the parameters by the names that the program gives them."""
        return {name: float(getattr(self.joint, each)) for name, each in _NAMES.items()}


@dataclass(frozen=True, kw_only=True)
class Run:
    """A torque of (n,) stamps in s, of a body let go at ``start`` rad; or a law and its plan."""

    mass: Mass
    torque: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None
    size: float  # amplitude of the torque
    omega: float | None = None  # of a sine
    start: float = 0.0
    law: Law | None = None
    # angles and rates that the law shall track, and its pumps, of (n,) stamps
    plan: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], ...]] | None = None


@dataclass(frozen=True)
class Recording:
    """(n,) stamps in s, inputs, the encoder's readings in rad or m, and what was carried.

    Also velocities in rad/s or m/s: the true ones, unless a tachometer has ``seen`` them instead.
    """

    time: NDArray[np.float64]
    input: NDArray[np.float64]
    angle: NDArray[np.float64]
    mass: Mass
    omega: float | None = None
    amplitude: float | None = None
    velocity: NDArray[np.float64] | None = None
    seen: str = "angle"


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """Its step, its noise's standard deviation and its reading at angle 0, in rad or m."""

    count: float
    spread: float
    zero: float

    @classmethod
    def drawn(cls, rng, zero: float, reach: float = 1.0) -> "Encoder":
        """Draw one of 12 to 16 bits a turn."""
        count = 2.0 * np.pi / 2 ** int(rng.integers(12, 17))
        return cls(count=reach * count, spread=reach * rng.uniform(0.0, 1e-3), zero=reach * zero)


def hinge(rng, masses: int, *, balance: bool = False, upright: bool = False) -> Body:
    """Draw a joint that turns: bare, or with a number of masses of which the first is none.

    A ``balance`` has no gravity moment of its own, an ``upright`` axis gives none to masses either.
    """
    inertia = log_uniform(rng, 1e-4, 1.0)
    pace = log_uniform(rng, 1.0, 9.0)
    arm = rng.uniform(0.08, 0.4)
    shares = [0.0, rng.uniform(0.1, 0.4), rng.uniform(0.5, 1.2)][:masses]
    return damped(
        rng,
        Body(
            joint=Joint(
                inertia=float(inertia),
                viscous=0.0,
                gravity=0.0 if balance or upright else float(inertia * pace**2),
                gain=1.0,
            ),
            masses=tuple(Mass(inertia * share / arm**2, arm if share else 0.0) for share in shares),
            pace=float(pace),
            gravity=0.0 if upright else GRAVITY,
        ),
    )


def slide(rng, masses: int) -> Body:
    """Draw a joint that slides, of 0.1 to 30 kg."""
    inertia, pace = log_uniform(rng, 0.1, 30.0), log_uniform(rng, 2.0, 15.0)
    shares = [0.0, rng.uniform(0.1, 0.4), rng.uniform(0.5, 1.2)][:masses]
    joint = Joint(inertia=float(inertia), viscous=0.0, gravity=0.0, gain=1.0)
    carried = tuple(Mass(inertia * share) for share in shares)
    reach = float(log_uniform(rng, 0.03, 0.3))
    body = Body(joint=joint, masses=carried, pace=float(pace), reach=reach, slides=True)
    return damped(rng, replace(body, gravity=0.0))


def damped(rng, body: Body) -> Body:
    """Draw viscous friction and a delay."""
    inertia = body.carrying(body.masses[-1]).inertia
    delay = rng.uniform(0.0, 0.01) if rng.integers(3) else rng.uniform(0.0, 0.5e-3)
    viscous = 2.0 * log_uniform(rng, 0.005, 0.1) * inertia * body.pace_of(body.masses[-1])
    return body.having(viscous=float(viscous), delay=float(delay))


def sizes_of(rng, body: Body) -> list[float]:
    """Draw torques that move a body with each of its masses."""
    return [
        body.torque_of(mass, 0.6 * body.pace_of(mass), rng.uniform(0.15, 0.4))
        for mass in body.masses
    ]


def dry(rng, body: Body, sizes) -> Body:
    """Draw Coulomb friction that torques of these sizes overcome, and some drag now and then."""
    drag = 0.0
    if rng.integers(3) == 0:
        speed = rng.uniform(0.2, 1.0) * body.pace_of(body.masses[0]) * body.reach
        drag = rng.uniform(0.1, 1.0) * body.joint.viscous / speed
    return body.having(
        coulomb=float(min(sizes) * rng.uniform(0.0, MOST_FRICTION)), drag=float(drag)
    )


def with_gain(rng, body, sizes):
    """Choose p4 such that inputs lie between 0.05 and 5, as far as they can."""
    least, most = max(sizes) / 5.0, min(sizes) / 0.05
    gain = math.sqrt(least * most) if least > most else log_uniform(rng, least, most)
    return body.having(gain=float(gain))


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What is not as one believes: of a log's joint, drive, encoder, notes, and clock."""

    # of the joint, its mass, and the log's end in s
    joint: Callable[[Joint, Mass, float], Joint] = lambda joint, *_: joint
    # of (n,) stamps in s and inputs
    drive: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]] = (
        lambda _, inputs: inputs
    )
    encoder: Callable[[NDArray[np.float64]], NDArray[np.float64]] = lambda angle: angle
    notes: Callable[[Recording], Recording] = lambda log: log
    rates: tuple[float, ...] = (1.0,)  # mean sampling steps of the logs in turn, over the first
    # stamps of a log's even clock turned into those of its own, and how late its commands are in s
    clock: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]] = (
        lambda stamps: (stamps, np.zeros_like(stamps))
    )


def record(
    rng, body: Body, run: Run, encoder: Encoder, *, ticks, duration, bench: Bench | None = None
) -> Recording:
    """Return what is seen of a run; ``ticks`` are mean cycle in s and its relative spread.

    A law knows no ``bench``.
    """
    bench, joint = bench or Bench(), body.carrying(run.mass)
    stamps, late = bench.clock(clock(rng, duration, *ticks))
    offsets = encoder.zero + encoder.spread * rng.standard_normal(stamps.size)
    if run.plan is None:
        inputs = run.torque(stamps) / joint.gain
        real = bench.joint(joint, run.mass, stamps[-1])
        rest = real.spring * real.spring_rest / (real.spring + real.gravity or 1.0)
        driven = stamps, bench.drive(stamps, inputs)
        angle, velocity = motion(real, *driven, run.start + rest, late=late)
        readings = encoder.count * np.rint((bench.encoder(angle) + offsets) / encoder.count)
    else:
        wanted, rates, pumps = run.plan(stamps)
        plan = (stamps, wanted + encoder.zero, rates, pumps / joint.gain, offsets)
        law = run.law._replace(
            stiffness=run.law.stiffness / joint.gain,
            damping=run.law.damping / joint.gain,
            limit=run.law.limit / joint.gain,
            count=encoder.count,
        )
        _, velocity, inputs, readings = tracking(joint, law, plan, run.start)
    amplitude = run.size / joint.gain if run.omega else None
    return Recording(stamps, inputs, readings, run.mass, run.omega, amplitude, velocity)


def moves(body: Body, recording: Recording, encoder: Encoder, widest: float) -> bool:
    """Whether it moves enough, and not too far, in rad or as far as its reach makes of it."""
    angle = recording.angle - encoder.zero
    later = angle[angle.size // 2 :] if np.ptp(recording.input) else angle
    least = max(_LEAST_MOTION * body.reach, 3.0 * encoder.count)
    return bool(np.abs(angle).max() < widest * body.reach and np.std(later) > least)


def entry_of(mass: Mass) -> dict[str, float]:
    """Return what a manifest's entry says of an added mass."""
    return {key: x for key, x in zip(("added_mass", "arm"), mass, strict=True) if x}


def write_set(folder: Path, manifest: dict[str, Any], tables: Sequence[Table], form: str) -> None:
    """Write each table of columns, and a manifest (YAML that is JSON)."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, columns in enumerate(tables):
        rows, head = np.column_stack([*columns.values()]), ",".join(columns)
        np.savetxt(folder / f"{k}.csv", rows, form, ",", header=head, comments="")
    (folder / "manifest.yaml").write_text(json.dumps(manifest, indent=1), encoding="utf-8")
