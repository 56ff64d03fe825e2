"""Joints as others log them, and how well their logs can tell the inertia at best.

Three kinds: carts, arms and positioners that nothing holds, in a loop of somebody's; balanced
joints, driven as a pendulum is; carts of one size with three logs of a relay each. What an owner
says is p4 (and p3 = 0 of a joint that turns), or two masses of a balanced joint. As in
`tests.independent.kinds`, nothing of the program is used.
"""

from dataclasses import replace

import numpy as np

from tests.independent import bodies
from tests.independent.drives import chirp, log_uniform, multisine, steps
from tests.independent.integrator import Joint, Law, motion
from tests.independent.kinds import RobotOfKind, driven, followed, sines

FRICTION = 0.4
"""Largest friction at rest over the drive's limit."""

_DIFFERS = 0.25  # share of joints whose friction is not the same everywhere
_FARTHEST = 60.0  # rad, or as many times as far as a cart is told to go
_NORMAL = 1.96  # standard deviations in the half-width of a 95 % interval
_STEP = 1e-6  # of the values, and of rad, to differentiate by: no stop is gained or lost by it
_FIELDS = ("inertia", "viscous", "gravity", "gain", "coulomb", "bias", "excess", "uneven", "delay")
_EFFECTS = {  # shares of the Coulomb friction by which friction differs, and how
    "": lambda _, _level: {},
    "direction": lambda share, level: {"bias": share * level},
    "stribeck": lambda share, level: {"excess": share * level},
    "place": lambda share, _level: {"uneven": share},
}


def draw(kind: str, number: int, seed: int = 1) -> RobotOfKind:
    """Return a robot that these alone determine."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number])
    while True:
        made = KINDS[kind](rng, number)
        if all(
            bodies.moves(made.body, each, made.encoder, made.widest) for each in made.recordings
        ):
            return replace(made, number=number)


def bound(robot: RobotOfKind) -> float:
    """Least half-width of a 95 % interval of the inertia, over it: the Cramer-Rao bound.

    The inputs are known and the joint obeys its equation, so that a reading is its simulation
    along the recorded input with white noise: the encoder's own, and a twelfth of its count
    squared. A reading that repeats the one before adds nothing, as the error of a count is the
    same then. Unknown are all parameters that are not 0 and the owner does not know, and the angle
    at which each log starts; derivatives are central differences.
    """
    known = {"p3": "gravity", "p4": "gain"}
    told = {known[name] for name in robot.known & known.keys()}
    names = [each for each in _FIELDS if getattr(robot.body.joint, each) and each not in told]
    noise = np.hypot(robot.encoder.spread, robot.encoder.count / np.sqrt(12.0))
    information = np.zeros((len(names), len(names)))
    for log in robot.recordings:
        new = np.append(True, np.diff(log.angle) != 0.0)
        columns = [_derivative(robot, log, name)[new] for name in (*names, "")]
        start = columns.pop()
        rows = np.column_stack(columns)
        rows -= np.outer(start, start @ rows) / (start @ start)
        information += rows.T @ rows / noise**2
    scale = np.sqrt(np.diag(information))
    scaled = information / np.outer(scale, scale)
    return float(_NORMAL * np.sqrt(np.linalg.inv(scaled)[0, 0]) / scale[0])


def _derivative(robot, log, name):
    """Return (n,) derivatives of a log's angle by a field relative to it, or by its start."""
    ends = []
    for sign in (1.0, -1.0):
        body, start = robot.body, log.angle[0] - robot.zero
        if name:
            value = getattr(body.joint, name)
            body = body.having(**{name: value * (1.0 + sign * _STEP)})
        else:
            start += sign * _STEP
        ends.append(motion(body.carrying(log.mass), log.time, log.input, start)[0])
    return (ends[0] - ends[1]) / (2.0 * _STEP)


# A loop of somebody's


def _free(rng, number):
    """A cart on a relay, an arm from place to place, a positioner along a sweep."""
    kind = list(_PLANS)[number % 3]
    inertia = log_uniform(rng, 0.1, 30.0) if kind == "cart" else log_uniform(rng, 1e-3, 1.0)
    duration = float(log_uniform(rng, 5.0, 120.0))
    return _looped(rng, kind, float(inertia), int(rng.integers(1, 4)), duration)


def _relay(rng, _):
    """A cart of some kilograms, three times on a relay."""
    return _looped(rng, "cart", float(rng.uniform(4.0, 9.0)), 3, rng.uniform(15.0, 60.0))


def _looped(rng, kind, inertia, count, duration):
    """Record ``count`` logs of a joint in a loop."""
    slides, pace = kind == "cart", float(log_uniform(rng, 3.0, 20.0))
    far = float(log_uniform(rng, 0.1, 0.5)) if slides else float(rng.uniform(0.4, 1.2))
    drive = inertia * pace**2 * far * rng.uniform(0.4, 1.0)
    effect = list(_EFFECTS)[int(rng.integers(1, 4))] if rng.random() < _DIFFERS else ""
    share = rng.uniform(0.1, 0.5) if effect else 0.0
    coulomb = rng.uniform(0.02, FRICTION) * drive / (1.0 + share)
    joint = Joint(
        inertia=inertia,
        viscous=inertia / float(log_uniform(rng, 0.3, 20.0)),
        gravity=0.0,
        gain=1.0,
        coulomb=coulomb,
        excess_velocity=float(log_uniform(rng, 0.02, 0.2)),
        delay=rng.uniform(0.0, 0.01),
        **_EFFECTS[effect](share, coulomb),
    )
    body = bodies.Body(
        joint=joint,
        masses=(bodies.Mass(),),
        pace=pace,
        gravity=0.0,
        reach=far if slides else 1.0,
        slides=slides,
    )
    encoder = bodies.Encoder.drawn(rng, 0.0, far if slides else 1.0)
    ticks, runs = (float(log_uniform(rng, 2e-3, 1e-2)), 0.05), []
    for _ in range(count):
        law, plan = _PLANS[kind](rng, joint, (pace, far, drive))
        runs.append(bodies.Run(mass=bodies.Mass(), size=drive, law=law, plan=plan))
    logs = [bodies.record(rng, body, run, encoder, ticks=ticks, duration=duration) for run in runs]
    owner = {"joint": "slide", "known": {"p4": 1.0}} if slides else {"known": {"p4": 1.0, "p3": 0}}
    name = f"{kind} {effect}".strip()
    return RobotOfKind(body, encoder, logs, _FARTHEST, owner, kind=name)


def _on_relay(rng, joint, sizes):
    """Full drive one way and the other; it turns where the joint soon is as far as it may go."""
    _, far, drive = sizes
    lead = rng.uniform(0.3, 0.9) * np.sqrt(far * joint.inertia / drive)
    steep = 50.0 * drive / far
    law = Law(stiffness=steep, damping=steep * lead, limit=drive, count=1.0, share=0.5)
    far *= rng.uniform(0.5, 1.0)

    def plan(time):
        nothing = np.zeros(time.size)
        return nothing, nothing, np.full(time.size, steep * far)

    return law, plan


def _in_steps(rng, joint, sizes):
    pace, far, drive = sizes
    angle, _ = steps(0.4 * pace, far, rng)
    nothing = np.zeros_like
    return _tracks(rng, joint, pace, drive), lambda time: (
        angle(time),
        nothing(time),
        nothing(time),
    )


def _in_sweeps(rng, joint, sizes):
    pace, far, drive = sizes
    angle, _ = chirp(rng.uniform(0.2, 0.5) * pace, far, rng)
    return _tracks(rng, joint, pace, drive), lambda time: followed(time, angle(time))


def _tracks(rng, joint, pace, drive):
    return Law(
        stiffness=joint.inertia * pace**2,
        damping=2.0 * rng.uniform(0.5, 1.0) * joint.inertia * pace,
        limit=drive,
        count=1.0,
        share=rng.uniform(0.2, 0.6),
    )


_PLANS = {"cart": _on_relay, "arm": _in_steps, "positioner": _in_sweeps}


# Without a loop


def _balanced(rng, number):
    """A joint that is nearly balanced and pushed to one side; its scale by p4 or two masses."""
    weighed = number % 2 == 1
    body = bodies.hinge(rng, 1 + weighed, balance=True)
    if number % 4 >= 2:
        made = sines(rng, body, 2 if weighed else 4)
    else:
        made = driven(rng, body, [[multisine, chirp, steps][int(rng.integers(3))], multisine], 2)
    body, runs, sizes = made
    stiff = body.joint.inertia * body.pace**2
    body = body.having(
        gravity=float(stiff * rng.choice([0.0, 1.0]) * rng.uniform(0.0, 0.03)),
        bias=float(body.joint.coulomb * rng.uniform(-0.3, 0.3)),
    )
    body = bodies.with_gain(rng, body, sizes)
    known = {} if weighed else {"known": {"p4": body.joint.gain}}
    encoder = bodies.Encoder.drawn(rng, 0.0)
    ticks = float(log_uniform(rng, 2e-3, 8e-3)), rng.uniform(0.0, 0.1)
    logs = []
    for run in runs:
        duration = max(rng.uniform(15.0, 40.0), 8.0 * np.pi / run.omega if run.omega else 0.0)
        logs.append(bodies.record(rng, body, run, encoder, ticks=ticks, duration=duration))
    name = "two masses" if weighed else "known gain"
    return RobotOfKind(body, encoder, logs, _FARTHEST, known, kind=name)


KINDS = {"free": _free, "balanced": _balanced, "relay": _relay}
