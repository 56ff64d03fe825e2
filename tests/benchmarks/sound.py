"""Run campaigns with sound robots, which nothing may stop: ``make sound``.

python -m tests.benchmarks.sound --set sound --robots 200 --seed 1
python -m tests.benchmarks.sound --set fresh --robots 60 --seed 3

The motors and the integrator share no code with the program's. ``sound``: robots that are hard to
guard, held by gravity, geared, or held by nothing: stiction, coarse encoders and commands, slow
joints. ``fresh``: such as the goal of 1 % is promised to, with masses or a known gain.
"""

import argparse
import math
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time

import numpy as np

import butterfly as bf
from butterfly.campaigns.bench import SafetyStop
from tests.benchmarks.faults import WRONG, bounded, errors, tried
from tests.independent.drives import log_uniform
from tests.independent.faulty import ANGLE, Endless
from tests.independent.integrator import Joint
from tests.independent.motors import GRAVITY, STICTION_SPEED, IndependentMotor

VERY_WRONG = 0.025
"""Error of a value that is claimed to 1 %, that no claim may have."""

ARM = 0.1
"""Distance of masses from the pivot in m."""

_COMPUTED = 600.0  # s of CPU, after which a campaign is ended from outside


class SoundMotor(IndependentMotor):
    """A sound motor that keeps how far it came."""

    farthest = 0.0

    def advance(self, duration):
        super().advance(duration)
        self.farthest = max(self.farthest, abs(self.angle))


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a campaign with one robot came to."""

    kind: str
    number: int
    seed: int
    reached: bool = False
    stopped: str = ""  # the sentence of a false stop
    ending: str = ""
    robot_time: float = math.nan  # s
    changes: int = 0
    errors: dict[str, float] = field(default_factory=dict)  # shares, by name
    farthest: float = 0.0  # rad
    cpu: float = 0.0  # s
    robot: dict[str, float] = field(default_factory=dict)

    @property
    def error(self):
        """The largest of the errors; 0 without values."""
        return max(self.errors.values(), default=0.0)


def guarded(number, seed):
    """Return kind, motor and options of a robot that is hard to guard."""
    rng = np.random.default_rng([seed, number, 0])
    kind = ("held by gravity", "geared", "held by nothing")[number % 3]
    inertia, gain = log_uniform(rng, 1e-3, 3e-2), log_uniform(rng, 0.1, 3.0)
    period = log_uniform(rng, 0.3, 4.0)
    gravity = inertia * (math.tau / period) ** 2
    torque, damping = gravity, 2 * rng.uniform(0.01, 0.08) * math.tau / period
    static = rng.uniform(0.0, 0.4) * torque
    if kind == "geared":
        torque, damping = inertia * log_uniform(rng, 5.0, 50.0), rng.uniform(1.0, 5.0)
        static = rng.uniform(0.1, 0.4) * torque
        gravity = rng.uniform(0.0, 1.0) * static
    if kind == "held by nothing":
        torque, damping = inertia * log_uniform(rng, 2.0, 20.0), rng.uniform(0.02, 0.3)
        static, gravity = rng.uniform(0.002, 0.05) * torque, 0.0
    coulomb = rng.uniform(0.6, 1.0) * static
    joint = Joint(
        inertia,
        damping * inertia,
        gravity,
        gain,
        coulomb=coulomb,
        excess=static - coulomb,
        excess_velocity=STICTION_SPEED,
    )
    return kind, *_with_drive(rng, joint, torque, 10, known=kind == "held by nothing")


def fresh(number, seed):
    """Return kind, motor and options of a robot that the goal of 1 % is promised to."""
    rng = np.random.default_rng([seed, number, 1])
    kind = "known gain" if number % 2 else "masses"
    inertia, gain = log_uniform(rng, 1e-3, 1e-2), log_uniform(rng, 0.03, 3.0)
    natural = 0.0 if number % 10 < 2 else rng.uniform(0.5, 9.0)  # a fifth is balanced
    torque = inertia * max(natural**2, 4.0)
    joint = Joint(
        inertia,
        2 * rng.uniform(0.01, 0.08) * max(natural, 1.0) * inertia,
        inertia * natural**2,
        gain,
        coulomb=rng.uniform(0.0, 0.3) * torque,
    )
    return kind, *_with_drive(rng, joint, torque, 12, known=kind == "known gain")


SETS = {"sound": (guarded, 200), "fresh": (fresh, 60)}
"""By name: what draws a robot, and how many there are."""


def _with_drive(rng, joint, torque, bits, *, known):
    """Return a motor of a joint, its encoder of so many bits at least, and a campaign's options."""
    limit = rng.uniform(1.5, 3.0) * torque / joint.gain
    counts = 2 ** int(rng.integers(bits, 17))
    held = joint.coulomb / joint.gravity if joint.gravity else 1.0
    motor = SoundMotor(
        joint,
        limit=limit,
        counts=counts,
        noise=float(rng.choice([0.0, math.tau / counts])),
        resolution=2 * limit / 2 ** int(rng.integers(8, 17)),
        delay=float(rng.choice([0.0, rng.uniform(0.0, 0.02)])),
        resets=bool(rng.integers(2)),
        polarity=int(rng.choice([-1, 1])),
        angle=float(rng.uniform(-0.5, 0.5)) * min(held, 0.5),
        seed=int(rng.integers(1 << 30)),
    )
    mass = rng.uniform(0.3, 0.8) * torque / (GRAVITY * ARM)
    options = {"known": {"p4": joint.gain}} if known else {"masses": (0.0, mass), "arm": ARM}
    if not known:
        options["change"] = motor.carry
    return motor, options | {"command": limit, "angle": ANGLE}


def outcome(name, number, seed):
    """Return what a campaign with one robot of a set comes to."""
    kind, motor, options = SETS[name][0](number, seed)
    about = {"kind": kind, "number": number, "seed": seed}
    about["robot"] = motor.bare._asdict() | {
        "limit": motor.limit,
        "delay": motor.delay,
        "resets": motor.resets,
        "counts": round(math.tau / motor.count),
        "noise": motor.noise,
        "mass": options.get("masses", (0.0,))[-1],
    }
    begun = process_time()
    with tempfile.TemporaryDirectory() as folder:
        try:
            with bounded(_COMPUTED):
                found = bf.campaign(motor, out=Path(folder, "campaign"), **options)
            about |= {key: found.content[key] for key in ("reached", "ending", "changes")}
            about["robot_time"] = found.content["robot_time"]
            if found.identification is not None:
                values = found.identification.estimate.named
                about["errors"] = errors(values, motor.bare, motor.limit)
        except SafetyStop as stop:
            about["stopped"] = str(stop)
        except Endless:
            about["ending"] = f"still computing after {_COMPUTED:g} s of CPU"
        except Exception as error:  # whatever comes is what is counted
            about["stopped"] = f"{type(error).__name__}: {error}"
    return Outcome(farthest=motor.farthest, cpu=process_time() - begun, **about)


def main(arguments=None):
    """Run, print a line as each ends, and a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", choices=SETS, default="sound")
    parser.add_argument("--robots", type=int, help="default: 200 sound ones, 60 fresh ones")
    parser.add_argument("--number", nargs="*", type=int, help="of robots, instead of the first")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, help="file that gets a line as each campaign ends")
    asked = parser.parse_args(arguments)
    numbers = asked.number or range(asked.robots or SETS[asked.set][1])
    jobs = [(asked.set, number, asked.seed) for number in numbers]
    print(report(tried(_outcome, jobs, asked, _line)))


def _outcome(job):
    return outcome(*job)


def _line(each):
    ends = f"STOPPED {each.stopped}" if each.stopped else each.ending
    claim = f", error {100 * each.error:.2g} %" if each.reached else ""
    return (
        f"{each.kind} {each.number}: {each.robot_time:.0f} s, {each.cpu:.0f} s CPU{claim}: {ends}"
    )


def report(outcomes):
    """Return a table by kind, and the sentences of false stops and other ends."""
    lines = [
        "| kind | robots | false stops | reached | median s | error above 1.5 % | above 2.5 % |",
        "|---" * 7 + "|",
    ]
    for kind in [*sorted({each.kind for each in outcomes}), "all"]:
        some = [each for each in outcomes if kind in {each.kind, "all"}]
        claims = [each for each in some if each.reached]
        time = np.median([each.robot_time for each in claims]) if claims else math.nan
        lines.append(
            f"| {kind} | {len(some)} | {sum(bool(each.stopped) for each in some)} | {len(claims)} "
            f"| {time:.0f} | {sum(each.error > WRONG for each in claims)} "
            f"| {sum(each.error > VERY_WRONG for each in claims)} |"
        )
    for title, chosen in (
        ("stopped", [each.stopped for each in outcomes if each.stopped]),
        ("ended", [each.ending for each in outcomes if not (each.stopped or each.reached)]),
    ):
        ends = Counter(_without_numbers(text) for text in chosen)
        lines += [f"{title} {count} times: {text}" for text, count in ends.most_common()]
    wrong = [each for each in outcomes if each.reached and each.error > WRONG]
    lines += [f"wrong: {_line(each)}; {each.errors}" for each in wrong]
    return "\n".join(lines)


def _without_numbers(text):
    """Return a sentence whose numbers are gone, so that such sentences count as one."""
    words = ("#" if word[:1].isdigit() or word[1:2].isdigit() else word for word in text.split())
    return " ".join(words)


if __name__ == "__main__":
    sys.exit(main())
