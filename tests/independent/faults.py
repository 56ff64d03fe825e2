"""What can be wrong with a drive, its encoder, its clock, a joint, or the person beside it.

A fault takes the place of methods of an `IndependentMotor` from its onset on. Its functions get the
motor, then what the method gets; ``memory`` of the motor is theirs, ``since`` the s from the onset.
"""

import math
import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from butterfly.logs.log import InputKind
from butterfly.plant.motor import Reading
from tests.independent.motors import under_mass

START, CONTACT, RELAY, LATER, BRAKE, REST = "start", "contact", "relay", "later", "brake", "rest"
"""Phases of a campaign in which a fault begins: before all; while it pushes until the joint moves;
in the first relay; in a later run; while the joint is brought home; at rest between two runs."""

BLIND = 1.0
"""Time in s, and a period of the joint, for which a frozen encoder may be driven."""

AT_ONCE = 0.2
"""Time in s for which the drive may push on beyond a limit."""

RAMP = 10.0
"""Time in s in which contact has to see motion; until its end a frozen encoder looks like rest."""


@dataclass(frozen=True)
class Fault:
    """Something wrong from an onset on."""

    name: str
    phases: tuple[str, ...]
    does: Mapping[str, Callable[..., Any]] = field(default_factory=dict)  # by method
    onset: Callable[[Any], None] | None = None  # what happens at once
    options: Mapping[str, Any] = field(default_factory=dict)  # of the campaign
    evident: bool = False  # in every reading or call: to be off AT_ONCE, whatever the angle
    frozen: bool = False  # to be off after BLIND s and a period
    harmless: bool = False  # to be borne
    interrupts: bool = False  # somebody ends it: no sentence is asked for
    kind: InputKind = InputKind.TORQUE
    refused: bool = False  # before the drive is started
    released: bool = True  # whether `stop` can succeed


def _ignored(_, value):
    return value


def _raising(error, *, times=math.inf):
    """Return a method that raises an error for so many calls, then works."""

    def method(motor, *given):
        count = motor.memory[error] = motor.memory.get(error, 0) + 1
        if count <= times:
            raise type(error)(*error.args)
        return motor.sound(*given)

    return method


def _returning(answer):
    """Return a command that is obeyed and answered by what ``answer`` makes of it."""
    return lambda motor, value: answer(motor.drive(value))


def _sensing(change):
    """Return a reading changed by a function of motor, time, angle and current."""
    return lambda motor: Reading(*change(motor, *motor.sense()))


def _of_angle(change):
    """Return a reading whose angle a function of motor and angle changes."""
    return _sensing(lambda m, time, angle, current: (time, change(m, angle), current))


def _of_time(change):
    """Return a reading whose time a function of motor and time changes."""
    return _sensing(lambda m, time, angle, current: (change(m, time), angle, current))


def _constant(**values):
    """Return a reading with some fields constant."""
    return lambda motor: motor.sense()._replace(**values)


def _frozen(motor, angle):
    return motor.memory.setdefault("angle", angle)


def _losing(motor, angle):
    """Return an angle that lost a twentieth of its increments in one direction."""
    last, read = motor.memory.get("last", (angle, angle))
    read += (angle - last) * (0.95 if angle > last else 1.0)
    motor.memory["last"] = angle, read
    return read


def _wrapped(_, angle):
    return math.remainder(angle + math.pi - 0.2, math.tau)


def _spike(motor, angle):
    first = motor.memory.setdefault("clock", motor.clock)
    return angle + 2.0 if motor.clock == first else angle


def _intermittent(motor, value):
    return motor.drive(value if motor.since % 0.2 < 0.1 else 0.0) and value


def _runaway(motor, value):
    """Return a command whose integral the drive gives: 0.1 s of it is the whole."""
    given = motor.memory.get("given", 0.0) + 0.02 * value
    motor.memory["given"] = given
    motor.drive(given)
    return value


def _late(motor, duration):
    """Let 0.3 s more pass once."""
    late = 0.0 if motor.memory.setdefault("late", False) else 0.3
    motor.memory["late"] = True
    motor.advance(duration + late)


def _pushed(motor, duration):
    """Push from outside, as hard as half the drive can, for 0.15 s."""
    motor.push = 0.5 * motor.joint.gain * motor.limit if motor.since < 0.15 else 0.0
    motor.advance(duration)


def _standing(_, duration):
    """Return at once: no time passes."""


def _altered(**values):
    """Return an onset that changes what a joint is, with whatever mass."""

    def onset(motor):
        motor.bare, motor.joint = (each._replace(**values) for each in (motor.bare, motor.joint))

    return onset


def _stronger(motor):
    _altered(gain=3 * motor.bare.gain)(motor)


def _half_as_heavy(motor):
    """Let the added mass fall, or half of a joint that carries none."""
    if motor.joint == motor.bare:
        motor.joint = under_mass(motor.bare, 0.0, 0.0)._replace(inertia=motor.bare.inertia / 2)
    else:
        motor.joint = motor.bare


def _stopped_at(angle):
    def onset(motor):
        motor.end_stop = max(angle, abs(motor.angle))

    return onset


def _terminated(motor, *given):
    """End the process as an operating system does, once."""
    if not motor.memory.setdefault("terminated", False):
        motor.memory["terminated"] = True
        os.kill(os.getpid(), signal.SIGTERM)
    return motor.sound(*given)


def _terminated_again(motor):
    """Get the second signal while the drive is switched off."""
    if not motor.memory.setdefault("again", False):
        motor.memory["again"] = True
        os.kill(os.getpid(), signal.SIGTERM)
    motor.release()


def _numpy_reading(motor):
    time, angle, _ = motor.sense()
    return Reading(np.float64(time), np.array(angle), np.float32(0))


def _stood(motor, time):
    return motor.memory.setdefault("time", time)


def _interrupted(times=1):
    """Return a method in which somebody presses Ctrl-C so many times."""
    return _raising(KeyboardInterrupt("Ctrl-C"), times=times)


def _dead(message="the cable is out"):
    """Return methods of a drive that answers no call but holds its last command."""
    error = OSError(message)
    return {"read": _raising(error), "command": _raising(error)}


FAULTS = (
    Fault("nothing", (START,), harmless=True),
    # the drive
    Fault("drive holds its last command", (CONTACT, RELAY, LATER, BRAKE), {"command": _ignored}),
    Fault(
        "drive at its largest command",
        (CONTACT, RELAY, LATER, BRAKE, REST),
        {"command": _ignored},
        lambda motor: motor.drive(motor.limit),
    ),
    Fault(
        "drive at its largest command, speed limited",
        (RELAY, LATER),
        {"command": _ignored},
        lambda motor: motor.drive(motor.limit),
        options={"speed": 8.0},
    ),
    Fault(
        "supply gone",
        (START, CONTACT, RELAY, LATER),
        {"command": _ignored},
        lambda motor: motor.drive(0.0),
    ),
    Fault(
        "command changes sign",
        (CONTACT, RELAY, LATER, BRAKE),
        {"command": lambda m, v: -m.drive(-v)},
    ),
    Fault("drive goes one way", (START, LATER), {"command": lambda m, v: m.drive(abs(v)) and v}),
    Fault("drive is intermittent", (LATER,), {"command": _intermittent}),
    Fault("drive integrates its command", (RELAY, LATER, BRAKE), {"command": _runaway}),
    Fault(
        "drive is 50 ms later", (RELAY, LATER), {}, lambda m: setattr(m, "delay", m.delay + 0.05)
    ),
    Fault(
        "gain grows threefold",
        (RELAY, LATER, BRAKE),
        {},
        _stronger,
    ),
    Fault("drive of set-points", (START,), kind=InputKind.SETPOINT, refused=True),
    # the encoder
    Fault(
        "encoder changes sign",
        (RELAY, LATER, BRAKE, REST),
        {"read": _of_angle(lambda _, angle: -angle)},
    ),
    Fault(
        "encoder is frozen",
        (START, CONTACT, RELAY, LATER, BRAKE),
        {"read": _of_angle(_frozen)},
        frozen=True,
    ),
    Fault("encoder jumps", (RELAY, LATER, REST), {"read": _of_angle(lambda _, angle: angle + 0.3)}),
    Fault("encoder loses counts", (RELAY, LATER), {"read": _of_angle(_losing)}),
    Fault("encoder halves", (RELAY, LATER), {"read": _of_angle(lambda _, angle: angle / 2)}),
    Fault("encoder wraps", (START,), {"read": _of_angle(_wrapped)}),
    Fault("one reading is far off", (RELAY, BRAKE), {"read": _of_angle(_spike)}),
    Fault(
        "angle is NaN", (CONTACT, RELAY, REST), {"read": _constant(angle=math.nan)}, evident=True
    ),
    Fault("angle is infinite", (BRAKE,), {"read": _constant(angle=math.inf)}, evident=True),
    Fault("angle is None", (LATER,), {"read": _constant(angle=None)}, evident=True),
    Fault("angle is text", (RELAY,), {"read": _constant(angle="0.1")}, evident=True),
    Fault("angle is an array", (LATER,), {"read": _constant(angle=np.zeros(2))}, evident=True),
    Fault("reading is None", (RELAY,), {"read": lambda _: None}, evident=True),
    Fault("reading has two fields", (LATER,), {"read": lambda m: m.sense()[:2]}, evident=True),
    Fault(
        "current beyond its limit",
        (CONTACT, RELAY, REST),
        {"read": _constant(current=-50.0)},
        options={"current": 10.0},
        evident=True,
    ),
    Fault("current is None", (RELAY,), {"read": _constant(current=None)}, evident=True),
    # the clock
    Fault("clock stands", (RELAY, REST), {"read": _of_time(_stood)}, evident=True),
    Fault("clock is NaN", (CONTACT, LATER), {"read": _constant(time=math.nan)}, evident=True),
    Fault(
        "clock runs back",
        (LATER,),
        {"read": _of_time(lambda m, time: time - 2 * m.since)},
        evident=True,
    ),
    Fault("clock at half speed", (START,), {"read": _of_time(lambda _, time: time / 2)}),
    Fault("clock at double speed", (START,), {"read": _of_time(lambda _, time: 2 * time)}),
    Fault(
        "clock slows to half speed",
        (LATER,),
        {"read": _of_time(lambda m, time: time - 0.5 * m.since)},
    ),
    Fault("0.3 s pass once", (RELAY, REST, BRAKE), {"wait": _late}),
    Fault("wait returns at once", (RELAY,), {"wait": _standing}, evident=True),
    # what raises, and what is returned
    Fault(
        "read raises OSError",
        (RELAY, BRAKE),
        {"read": _raising(OSError("no device"))},
        evident=True,
    ),
    Fault(
        "read raises ValueError",
        (LATER,),
        {"read": _raising(ValueError("not enough values"))},
        evident=True,
    ),
    Fault(
        "read raises RuntimeError",
        (CONTACT,),
        {"read": _raising(RuntimeError("bus off"))},
        evident=True,
    ),
    Fault("read raises KeyError", (REST,), {"read": _raising(KeyError("position"))}, evident=True),
    Fault(
        "command raises OSError",
        (CONTACT, LATER),
        {"command": _raising(OSError("no device"))},
        evident=True,
    ),
    Fault(
        "command raises ValueError",
        (BRAKE,),
        {"command": _raising(ValueError("refused"))},
        evident=True,
    ),
    Fault("command returns None", (RELAY,), {"command": _returning(lambda _: None)}, evident=True),
    Fault(
        "command returns NaN", (LATER,), {"command": _returning(lambda _: math.nan)}, evident=True
    ),
    Fault(
        "command returns text", (CONTACT,), {"command": _returning(lambda _: "ok")}, evident=True
    ),
    Fault(
        "command returns raw counts",
        (RELAY,),
        {"command": _returning(lambda value: value + 2048.0)},
        evident=True,
    ),
    Fault("wait raises", (LATER,), {"wait": _raising(RuntimeError("overrun"))}, evident=True),
    Fault("start raises OSError", (START,), {"start": _raising(OSError("refused"))}),
    Fault("start raises ValueError", (START,), {"start": _raising(ValueError("bad port"))}),
    Fault("a second start raises", (LATER,), {"start": _raising(OSError("busy"))}),
    Fault(
        "cable is out, and stop fails once",
        (RELAY, LATER),
        _dead() | {"stop": _raising(OSError("again"), times=1)},
        evident=True,
    ),
    Fault(
        "stop always fails",
        (LATER,),
        {"read": _constant(angle=math.nan), "stop": _raising(OSError("never"))},
        evident=True,
        released=False,
    ),
    # the joint
    Fault("pushed from outside", (RELAY, BRAKE, REST), {"wait": _pushed}),
    Fault("end stop", (START, LATER), {}, _stopped_at(0.06)),
    Fault("load falls off", (LATER,), {}, _half_as_heavy),
    Fault("joint is locked", (START, RELAY, LATER), {}, _altered(coulomb=1e4)),
    # the person beside it
    Fault("mass is not changed", (START,), {"carry": lambda _motor, _mass: None}),
    Fault("Ctrl-C in read", (RELAY,), {"read": _interrupted()}, interrupts=True),
    Fault("Ctrl-C in command", (CONTACT,), {"command": _interrupted()}, interrupts=True),
    Fault("Ctrl-C in wait", (LATER,), {"wait": _interrupted()}, interrupts=True),
    Fault(
        "Ctrl-C in wait, twice in stop",
        (LATER, RELAY),
        {"wait": _interrupted(), "stop": _interrupted(2)},
        interrupts=True,
    ),
    Fault("SIGTERM", (RELAY,), {"wait": _terminated}, interrupts=True),
    Fault(
        "SIGTERM, again in stop",
        (LATER,),
        {"wait": _terminated, "stop": _terminated_again},
        interrupts=True,
    ),
    # what a drive may do
    Fault("numbers of NumPy", (START,), {"read": _numpy_reading}, harmless=True),
    Fault("whole numbers", (START,), {"read": _constant(current=0)}, harmless=True),
    Fault(
        "command returns a number of NumPy",
        (START,),
        {"command": _returning(np.float32)},
        harmless=True,
    ),
)
