"""Random joints whose logs have little time, or few samples for their time: short runs, slow films.

A *short* run holds two periods of a pendulum, or five time constants of a joint that nothing holds;
a *slow* one is seen about ten times a period, with a film's noise. `draw` makes joint ``number`` of
a kind; `RobotOfPace.write` writes its logs, one or two, and what their owner says. What noise makes
of them tells, by the Cramer-Rao bound, what they are made for. Nothing of the program is used.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.independent import bodies
from tests.independent.drives import log_uniform, multisine, steps
from tests.independent.integrator import Joint, motion

TOLD = 0.2
"""Half-width of the best 95 % interval over the value, below which logs tell of it."""

_FINE = 400  # steps of the integrator in a period, at least
_TRIES = 500
_WIDEST = 2.0  # rad, of what gravity holds
_STILL, _STICKS = 0.005, 0.3  # of its fastest, below which it sticks, for at most so much of a log
_SMALL = 1e-3  # relative change of a value, for derivatives
_FIELDS = {"p1": "inertia", "p2": "viscous", "p3": "gravity", "coulomb": "coulomb"}


@dataclass(frozen=True)
class RobotOfPace:
    """What was drawn: a joint, tables of its logs, and what the owner says in a manifest."""

    kind: str
    number: int
    truth: dict[str, float]  # of what is not known, by name
    main: str  # parameter that the logs are made for
    owner: dict[str, Any]
    tables: list[bodies.Table]

    @property
    def asked(self) -> list[str]:
        """Names of what is not known, first what the logs are made for."""
        return sorted(self.truth, key=lambda name: name != self.main)

    def write(self, folder: Path) -> None:
        """Write the logs and their manifest."""
        told = self.owner | {"name": f"{self.kind} {self.number}"}
        logs = [{"file": f"{k}.csv"} for k in range(len(self.tables))]
        bodies.write_set(folder, told | {"logs": logs}, self.tables, "%.9g")


@dataclass(frozen=True)
class _Way:
    """How a joint is moved and recorded."""

    pace: float  # rad/s, of the joint or of what moves it
    held: bool  # by gravity
    free: bool  # whether nothing drives it
    periods: float
    samples: float  # in a period
    noise: float  # over the motion
    measured: str
    drives: tuple[str, ...]
    damping: float  # ratio, of a joint of that pace


@dataclass(frozen=True)
class _Run:
    """(n,) stamps in s and torques, the joint's state at the first, and what is measured."""

    stamps: NDArray[np.float64]
    torque: NDArray[np.float64]
    angle: float
    velocity: float
    measured: str
    finest: float  # step of the integrator in s

    def motion(self, joint):
        """Return (n,) angles and velocities."""
        state = self.angle, self.velocity
        return motion(joint, self.stamps, self.torque, *state, step=self.finest)

    def seen(self, joint):
        """(n,) angles or velocities, as they are measured."""
        return self.motion(joint)[("angle", "velocity").index(self.measured)]

    def information(self, joint, names, *, free):
        """(k, k) information by a noise of 1 on relative errors of k values, whatever the start."""
        columns = []
        for name in names:
            value = getattr(joint, _FIELDS[name])
            changed = (
                joint._replace(**{_FIELDS[name]: value * (1.0 + s)}) for s in (_SMALL, -_SMALL)
            )
            columns.append(np.subtract(*map(self.seen, changed)) / (2.0 * _SMALL))
        open_, size = ["angle"] * (self.measured == "angle") + ["velocity"] * free, _SMALL
        starts = []
        for name in open_:
            at = getattr(self, name)
            changed = (replace(self, **{name: at + s}).seen(joint) for s in (size, -size))
            starts.append(np.subtract(*changed) / (2.0 * size))
        if starts:
            basis, _ = np.linalg.qr(np.column_stack(starts))
            columns = [each - basis @ (basis.T @ each) for each in columns]
        rows = np.column_stack(columns)
        return rows.T @ rows


def draw(kind: str, number: int, seed: int = 1) -> RobotOfPace:
    """Return a robot that these alone determine."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number])
    for _ in range(_TRIES):
        if found := _recorded(rng, KINDS[kind](rng, number)):
            return RobotOfPace(kind, number, *found)
    raise RuntimeError(f"no {kind} robot {number} moves")


def _short(rng, number):
    """Two periods or five time constants; one in four is free, half are held by gravity."""
    held = number % 2 == 0
    return _Way(
        pace=2.0 * math.pi / float(log_uniform(rng, 0.15, 3.0)),
        held=held,
        free=number // 2 % 4 == 3,
        periods=2.0 if held else 5.0 / (2.0 * math.pi),
        samples=float(log_uniform(rng, 40.0, 400.0)) * (1.0 if held else math.pi),
        noise=float(log_uniform(rng, 3e-4, 1e-2)),
        measured="angle" if held or number % 4 == 1 else "velocity",
        drives=("push", "steps"),
        damping=float(log_uniform(rng, 0.01, 0.1)) if held else 0.5,
    )


def _slow(rng, number):
    """About ten samples a period of .5 to 20 s; a third is free, another is held by nothing."""
    held = number % 3 != 0
    return _Way(
        pace=2.0 * math.pi / float(log_uniform(rng, 0.5, 20.0)),
        held=held,
        free=number % 3 == 1,
        periods=rng.uniform(4.0, 20.0),
        samples=rng.uniform(8.0, 14.0),
        noise=float(log_uniform(rng, 0.01, 0.1)),
        measured="angle",
        drives=("multisine", "steps"),
        damping=float(log_uniform(rng, 0.01, 0.05) if held else log_uniform(rng, 0.02, 0.2)),
    )


def _recorded(rng, way):
    """Draw a joint, move it, and look at it; None if it sticks, goes far or nothing shows."""
    inertia, pace = float(log_uniform(rng, 1e-3, 30.0)), way.pace
    swing = rng.uniform(0.15, 0.6) if way.held else float(log_uniform(rng, 0.1, 3.0))
    force = inertia * pace**2 * swing  # that moves it so
    joint = Joint(
        inertia=inertia,
        viscous=2.0 * way.damping * inertia * pace,
        gravity=inertia * pace**2 if way.held else 0.0,
        gain=1.0,
        coulomb=rng.uniform(0.0, 0.2) * force / (4.0 * way.periods if way.free else 1.0),
    )
    truth = {n: getattr(joint, f) for n, f in _FIELDS.items() if way.held or n != "p3"}
    known = {"p1": truth.pop("p1")} if way.free else {"p4": 1.0}
    main = "p1" if not way.free else "p3" if way.held else "p2"
    tables, information = [], np.zeros((len(truth), len(truth)))
    for _ in range(int(rng.integers(1, 3))):
        run = _run(rng, way, rng.uniform(0.6, 1.0) * swing, force)
        angle, velocity = run.motion(joint)
        still = np.abs(velocity) < _STILL * np.abs(velocity).max()
        far = np.abs(angle).max() > (_WIDEST if way.held else np.inf)
        if far or not velocity.any() or np.mean(still) > _STICKS:
            return None
        seen = run.seen(joint)
        noise = way.noise * float(np.ptp(seen)) / 2
        inputs = {} if way.free else {"input": run.torque}
        read = seen + noise * rng.standard_normal(seen.size)
        tables.append({"time": run.stamps, **inputs, way.measured: read})
        information += run.information(joint, [*truth], free=way.free) / noise**2
    best = 1.96 * np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)))
    if np.linalg.cond(information) > 1.0 / _SMALL**4 or best[[*truth].index(main)] > TOLD:
        return None
    owner = {"input": "none" if way.free else "torque", "known": known}
    return truth, main, owner | ({} if way.held else {"joint": "slide"}), tables


def _run(rng, way, swing, force):
    """Draw what moves a joint, or where it is let go, or seen from a moment on."""
    pace = way.pace
    stamps = np.arange(round(way.periods * way.samples) + 1) * (2.0 * math.pi / pace / way.samples)
    torque, angle, velocity = np.zeros(stamps.size), 0.0, 0.0
    if not way.free:
        torque = DRIVES[rng.choice(way.drives)](pace, rng.uniform(0.6, 1.0) * force, rng)[0](stamps)
    elif way.held:
        phase = rng.uniform(0.0, 1.0) * rng.integers(2)
        angle, velocity = swing * math.cos(phase), -swing * pace * math.sin(phase)
    else:
        velocity = swing * pace
    finest = 2.0 * math.pi / pace / max(_FINE, way.samples)
    return _Run(stamps, torque, angle, velocity, way.measured, finest)


def _push(_, size, rng):
    """Push from the first sample on, which ends before the log does or not."""
    share = rng.uniform(0.3, 1.3)
    return lambda time: np.where(time < share * time[-1], size, 0.0), size


DRIVES = {"push": _push, "multisine": multisine, "steps": steps}
KINDS = {"short": _short, "slow": _slow}
