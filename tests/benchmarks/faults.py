"""Break a robot in every way, in a campaign, and judge what it does: ``make faults``.

python -m tests.benchmarks.faults --only "encoder is frozen" --joint held-by-nothing --seed 2

Each fault begins in some phases of a campaign, which are told by the motor alone: by its commands,
its motion, and the logs in the folder. A miss is a letter:

    B  driven beyond a limit for more than 0.2 s (an evident fault: driven for so long at all;
       a frozen encoder: 1 s and a period of the joint; before contact: to the end of its ramp)
    A  driven beyond 1.5 limits of angle     E  the drive is left enabled
    W  no typed sentence ends it             L  a finished run is lost or changed
    R  a sound motor cannot go on            C  the goal is claimed, an error is above 1.5 %
    S  a harmless one is stopped             T  it computes for half a minute
    u  it goes on within its limits for 120 s, which is no miss

The drive is enabled from `start` to `stop`, and drives where a command other than 0 acts.
"""

import argparse
import json
import math
import os
import signal
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np

import butterfly as bf
from butterfly.errors import ButterflyError
from butterfly.identification.design import OF_GOAL
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from tests.independent.faults import (
    AT_ONCE,
    BLIND,
    BRAKE,
    CONTACT,
    FAULTS,
    LATER,
    RAMP,
    RELAY,
    START,
)
from tests.independent.faulty import ANGLE, Endless, FaultyMotor, GoesOn, OutOfTime
from tests.independent.integrator import Joint
from tests.independent.motors import IndependentMotor

FARTHEST = 1.5
"""Limits of angle, within which the drive is switched off."""

WRONG = 0.015
"""Error of a value that is claimed to 1 %, from which on the claim is wrong."""

COMPUTED = 30.0
"""CPU time in s of a campaign, after which it is ended from outside."""

JOINTS = {
    "held by gravity": (Joint(0.004, 0.002, 0.05, 0.3, coulomb=0.001), 0.3),
    "geared": (Joint(0.02, 0.05, 0.01, 1.0, coulomb=0.03, excess=0.006, excess_velocity=0.01), 0.3),
    "held by nothing": (Joint(0.004, 5e-4, 0.0, 0.3, coulomb=5e-4), 0.15),
}
"""A joint and the largest command, by name."""

_MASS = AddedMass(mass=0.1, arm=0.1)
_UNKNOWN = 0.2  # share by which a joint's values differ from those above


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What became of a campaign that a fault befell."""

    fault: str
    phase: str
    joint: str
    misses: str  # letters
    begun: float | None  # s of simulated time; None if the phase never came
    is_by_limit: bool  # whether that counts which is driven beyond a limit, or all since the onset
    beyond: float  # s driven beyond a limit
    driven: float  # s driven since the onset
    farthest: float  # rad while driven
    lasted: float  # s of simulated time since the onset
    ending: str
    resumed: str
    runs: int  # in the folder in the end
    error: float | None  # the largest of the values, where the goal is claimed
    cpu: float  # s

    @property
    def is_missed(self):
        """Whether a letter says so, but for that of a campaign that goes on within its limits."""
        return bool(set(self.misses) - {"u"})


AFTER = {CONTACT: (0.1, 1.0), RELAY: (0.1, 6.0), LATER: (0.3, 4.0), BRAKE: (0.02, 0.2)}
"""From the beginning of a phase to the onset, in s; at rest a tenth of it."""


def trial(fault, phase, joint, seed=1):
    """Run a campaign that a fault befalls, and judge it."""
    rng = np.random.default_rng([seed, *f"{fault.name}{phase}{joint}".encode()])
    body, limit = JOINTS[joint]
    body = Joint(*(value * rng.uniform(1 - _UNKNOWN, 1 + _UNKNOWN) for value in body))
    about = {"joint": body, "limit": limit, "noise": 2e-4, "delay": 0.004}
    about |= {"polarity": int(rng.choice([-1, 1])), "limits": dict(fault.options)}
    after = rng.uniform(*AFTER.get(phase, (0.5, 3.0)))
    with tempfile.TemporaryDirectory() as name:
        folder, begun = Path(name, "campaign"), process_time()
        motor = FaultyMotor(fault, phase, folder, after=after, **about)
        ending, error, misses = _ended(motor, joint, fault.options)
        logs, cpu = motor.logs, process_time() - begun
        changed = any(logs.get(key) != digest for key, digest in motor.logs_then.items())
        resumed = ""
        if logs and motor.acted and not fault.harmless and not set(misses) & set("Tu"):
            sound = FaultyMotor(FAULTS[0], LATER, folder, after=math.inf, **about)
            sound.is_taken_up = True
            resumed, _, stopped = _ended(sound, joint, {})
            kept = sound.logs
            changed |= any(kept.get(key) != digest for key, digest in logs.items())
            misses += "R" if set(stopped) & set("WT") else ""
    return Trial(
        fault=fault.name,
        phase=phase,
        joint=joint,
        misses="".join(_measured(motor)) + misses + ("L" if changed else ""),
        begun=motor.begun if motor.acted else None,
        is_by_limit=not (fault.frozen or fault.evident),
        beyond=motor.beyond,
        driven=motor.driven,
        farthest=motor.farthest,
        lasted=motor.clock - (motor.begun or 0.0),
        ending=ending,
        resumed=resumed,
        runs=len(logs),
        error=error,
        cpu=cpu,
    )


def _measured(motor):
    """Yield the letters of what a motor went through."""
    fault = motor.fault
    IndependentMotor.advance(motor, motor.delay + AT_ONCE)  # what was commanded last arrives
    early = motor.phase in {START, CONTACT}
    period = math.tau / math.sqrt(
        max(motor.truth.gravity, motor.truth.inertia) / motor.truth.inertia
    )
    most = (RAMP if early else BLIND + period) if fault.frozen else AT_ONCE
    if (motor.driven if fault.frozen or fault.evident else motor.beyond) > most + 0.01:
        yield "B"
    if motor.farthest > FARTHEST * ANGLE and not (fault.frozen and early):
        yield "A"
    if (motor.enabled and (fault.released or motor.applied)) or (fault.refused and motor.starts):
        yield "E"


def _ended(motor, joint, options):
    """Return how a campaign with a motor ended in words, the largest error, and letters."""
    given = {"command": motor.limit, "angle": ANGLE, "out": motor.folder} | options
    if joint == "held by nothing":
        given |= {"known": {"p4": motor.truth.gain}}
    else:
        masses = (NO_ADDED_MASS.mass, _MASS.mass)
        given |= {"masses": masses, "arm": _MASS.arm, "change": motor.carry}
    fault = motor.fault
    try:
        with bounded(COMPUTED):
            found = bf.campaign(motor, **given)
    except OutOfTime:
        return f"still going on at {motor.clock:.0f} s", None, "u"
    except Endless:
        return f"still computing at {motor.clock:.0f} s", None, "T"
    except BaseException as error:  # whatever comes is what is counted
        return f"{type(error).__name__}: {error}", None, _of_error(error, fault)
    misses = "W" if fault.refused else ""
    ending = str(found.content["ending"])
    if not found.content["reached"]:
        return ending, None, misses + ("" if _is_sentence(ending) else "W")
    error = largest_error(found.identification.estimate.named, motor.truth, motor.limit)
    return ending, error, misses + ("C" if error > WRONG else "")


def _of_error(error, fault):
    """Return the letter of an error that ended a campaign."""
    if isinstance(error, ButterflyError):
        return "S" if fault.harmless else "" if _is_sentence(str(error)) else "W"
    ends = isinstance(error, KeyboardInterrupt | SystemExit) and fault.interrupts
    return "" if ends or isinstance(error, GoesOn) else "W"


def largest_error(values, joint, limit):
    """Return the largest error of a campaign's values, over what each one matters beside."""
    return max(errors(values, joint, limit).values())


def errors(values, joint, limit):
    """Return the errors of a campaign's values over the truth, by name.

    Where friction is below 1 % of the largest torque, over this torque; where gravity is, too. That
    of viscous friction counts at the speed with which the joint swings through a radian.
    """
    largest = joint.gain * limit
    pace = math.sqrt(max(joint.gravity, joint.inertia) / joint.inertia)
    truths = {
        "p1": (joint.inertia, 0.0),
        "p2": (joint.viscous, largest / pace if joint.viscous * pace < 0.01 * largest else 0.0),
        "p3": (joint.gravity, largest if joint.gravity < 0.01 * largest else 0.0),
        "p4": (joint.gain, 0.0),
        "coulomb": (joint.coulomb, largest if joint.coulomb < 0.01 * largest else 0.0),
    }
    return {
        name: abs(values[name] - truths[name][0]) / max(truths[name])
        for name in OF_GOAL
        if name in values
    }


def _is_sentence(text):
    """Return whether a text says something to a person."""
    strange = ("nan ", "inf ", "Traceback", " object at 0x", "\n")
    return 10 < len(text) < 500 and not any(each in text for each in strange)


@contextmanager
def bounded(seconds):
    """Raise `Endless` after some s of CPU; SIGTERM ends as Ctrl-C does, as in the program."""

    def end(*_):
        raise Endless

    kept = [(each, signal.getsignal(each)) for each in (signal.SIGPROF, signal.SIGTERM)]
    signal.signal(signal.SIGPROF, end)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for each, handler in kept:
            signal.signal(each, handler)


def main(arguments=None):
    """Try, print a line as each ends, and a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[], help="words of faults' names")
    parser.add_argument("--joint", nargs="*", choices=JOINTS, default=list(JOINTS))
    parser.add_argument("--phase", nargs="*", help="of the campaign; default: another by joint")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, help="file that gets a line as each trial ends")
    asked = parser.parse_args(arguments)
    jobs = [
        (number, phase, joint, asked.seed)
        for number, fault in enumerate(FAULTS)
        if not asked.only or any(each in fault.name for each in asked.only)
        for place, joint in enumerate(JOINTS)
        if joint in asked.joint
        for phase in asked.phase or [fault.phases[(place + asked.seed) % len(fault.phases)]]
        if phase in fault.phases
    ]
    trials = tried(_trial, jobs, asked, _line)
    print(report(trials))
    return sum(each.is_missed for each in trials)


def tried(function, jobs, asked, line):
    """Return what a function makes of jobs, printed and written as each ends."""
    results = []
    if asked.json:
        asked.json.parent.mkdir(parents=True, exist_ok=True)
        asked.json.write_text("", encoding="utf-8")
    with ProcessPoolExecutor(asked.workers) as pool:
        for done, future in enumerate(
            as_completed([pool.submit(function, job) for job in jobs]), 1
        ):
            results.append(result := future.result())
            print(f"{done}/{len(jobs)} {line(result)}", flush=True)
            if asked.json:
                with asked.json.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(result)) + "\n")
    return results


def _trial(job):
    number, *about = job
    return trial(FAULTS[number], *about)


def _line(each):
    begun = "never begun" if each.begun is None else f"{each.begun:.1f} s"
    return (
        f"{each.fault} ({each.phase}), {each.joint}: {each.misses or 'ok'}; {begun}, beyond "
        f"{each.beyond:.2f} s, driven {each.driven:.2f} s, {each.farthest:.2f} rad, "
        f"{each.cpu:.1f} s CPU: {each.ending}" + (f" | {each.resumed}" if each.resumed else "")
    )


def report(trials):
    """Return a table of faults and joints, and a line that counts."""
    joints = [name for name in JOINTS if any(each.joint == name for each in trials)]
    lines = [f"| fault | {' | '.join(joints)} |", "|---" * (1 + len(joints)) + "|"]
    for fault in (each.name for each in FAULTS):
        some = [each for each in trials if each.fault == fault]
        row = [", ".join(_cell(each) for each in some if each.joint == joint) for joint in joints]
        if some:
            lines.append(f"| {fault} | {' | '.join(row)} |")
    begun = [each for each in trials if each.begun is not None]
    missed = [each for each in begun if each.is_missed]
    counts = {
        letter: sum(letter in each.misses for each in begun)
        for letter in "BAEWLRCSTu"
        if any(letter in each.misses for each in begun)
    }
    kinds = len({each.fault for each in trials})
    lines.append(
        f"\n{kinds} faults, {len(trials)} trials, {len(trials) - len(begun)} never begun; "
        f"{len(missed)} missed: {', '.join(f'{n} {k}' for k, n in counts.items()) or 'no letters'}"
    )
    return "\n".join(lines)


def _cell(each):
    """Return letters, and what was measured where it was too much."""
    if each.begun is None:
        return f"{each.phase}: –"
    if not each.misses:
        return f"{each.phase}: ok"
    if not each.is_missed:
        return f"{each.phase}: goes on"
    parts = [f"{each.phase}: **{each.misses}**"]
    measured = each.beyond if each.is_by_limit else each.driven
    parts += [f"{measured:.2g} s"] if "B" in each.misses else []
    parts += [f"{each.farthest:.3g} rad"] if "A" in each.misses else []
    return " ".join(parts)


if __name__ == "__main__":
    sys.exit(main() > 0 and os.EX_SOFTWARE)
