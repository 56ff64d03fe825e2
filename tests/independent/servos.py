"""Random table-top servos, each with what its owner says of it in a manifest.

`draw` makes servo ``number`` of a law; `RandomServo.write` writes its logs and manifest, as a servo
with its loop, as a voltage or torque drive with what the firmware sent, or with a slip (`SLIPS`).
Nothing of the program is used.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.independent.bodies import GRAVITY, Body, Mass, entry_of, write_set
from tests.independent.drives import clock, log_uniform, multisine, steps
from tests.independent.integrator import Joint
from tests.independent.servo import CASCADE, DAMPED, PID, VELOCITY, Firmware, run

DURATION = 8.0
"""Of a log, in s."""

_COUNTS = 4096 / (2 * math.pi)
_RPM = 0.229 * 2 * math.pi / 60  # rad/s, a Dynamixel's unit of velocity
_GUESS = 1.3  # what an owner who does not know a gain says it is, over what it is
_WIDEST = 2.5  # rad, beyond which a servo is drawn again
_LEAST = 0.05  # rad rms


@dataclass(frozen=True, kw_only=True)
class Identifiability:
    """What the owner of a servo sets and says: a law, and what one unit of each gain is worth."""

    law: str
    kind: int
    p: float = 1.0
    i: float = 1.0
    d: float = 1.0
    limit: float = 1.0


LAWS = {
    "dynamixel-x": Identifiability(
        law="dynamixel-x",
        kind=PID,
        p=_COUNTS / (128 * 885),
        i=_COUNTS / (65536 * 885) / 1e-3,
        d=_COUNTS / (16 * 885) * 1e-3,
    ),
    "dynamixel-x-velocity": Identifiability(
        law="dynamixel-x-velocity",
        kind=VELOCITY,
        p=1 / (_RPM * 128 * 885),
        i=1 / (_RPM * 65536 * 885) / 1e-3,
    ),
    "feetech-sts": Identifiability(law="feetech-sts", kind=DAMPED, p=0.166, limit=0.97),
    "odrive": Identifiability(law="odrive", kind=CASCADE, i=1 / (2 * np.pi), d=1 / (2 * np.pi)),
    "moteus": Identifiability(law="moteus", kind=DAMPED, p=1 / (2 * np.pi), d=1 / (2 * np.pi)),
}

SLIPS = ("voltage", "constant", "gear")
"""Goals told as voltages or torques; a law whose P is worth half as much; an encoder before a gear
of a ratio that nobody tells."""


@dataclass(frozen=True)
class Recording:
    """(n,) stamps in s, goals and readings in rad, mean drives, supplies in V, 1 where enabled."""

    time: np.ndarray
    goal: np.ndarray
    angle: np.ndarray
    drive: np.ndarray
    supply: np.ndarray
    enabled: np.ndarray
    gains: tuple[float, float, float]  # as set, in the law's units
    mass: Mass


@dataclass(frozen=True, kw_only=True)
class RandomServo:
    """What was drawn."""

    law: str
    number: int
    truth: dict[str, float]  # by the program's names, in SI units
    heaviest: float  # N m, largest added gravity moment
    firmware: Firmware
    told: dict[str, Any]  # of the loop, besides its gains
    known: dict[str, float]
    gain_told: bool  # whether the owner knows the P gain
    ratio: float  # of the gear, which a slip forgets
    recordings: tuple[Recording, ...]

    @property
    def gains(self) -> dict[str, float]:
        """Gains of the loop over those that are told, by the program's names."""
        true = dict.fromkeys(("loop_kp", "loop_ki", "loop_kd"), 1.0)
        return true if self.gain_told else true | {f"loop_{_main_gain(self)}": 1.0 / _GUESS}

    @property
    def electric(self) -> bool:
        """Whether the firmware sends a duty, not a torque."""
        return self.firmware.supply > 0.0

    def write(self, folder: Path, way: str = "setpoint") -> None:
        """Write logs and manifest (YAML that is JSON) with ``setpoint``, ``drive`` or a slip."""
        kept = [each for each in self.recordings if way != "drive" or each.enabled.all()]
        turn = self.ratio if way == "gear" else 1.0
        scale = turn if self.firmware.law != VELOCITY else 1.0
        tables = []
        for each in kept:
            driven = each.drive if way == "drive" else each.goal * scale
            columns = {"time": each.time, "input": driven, "angle": each.angle * turn}
            if way not in {"drive", "voltage"}:
                columns |= {"enabled": each.enabled}
                columns |= {"supply": each.supply} if self.electric else {}
            tables.append(columns)
        write_set(folder, manifest_of(self, kept, way), tables, "%.9g")


def manifest_of(servo: RandomServo, logs: list[Recording], way: str) -> dict[str, Any]:
    """Return what the owner says of some logs."""
    told = {"name": f"{servo.law} {servo.number}", "known": servo.known}
    entries: list[dict[str, Any]] = []
    for k, each in enumerate(logs):
        entry: dict[str, Any] = {"file": f"{k}.csv", **entry_of(each.mass)}
        if way not in {"drive", "voltage"}:
            entry["loop"] = loop_of(servo, each, way)
        entries.append(entry)
    if way in {"drive", "voltage"}:
        told["input"] = "voltage" if servo.electric else "torque"
    else:
        columns = {name: name for name in ("time", "input", "angle", "enabled")}
        told |= {"input": "setpoint", "columns": columns}
        if servo.electric:
            columns["supply"] = "supply"
    return told | {"logs": entries}


def loop_of(servo: RandomServo, log: Recording, way: str) -> dict[str, Any]:
    """Return what the owner says of the loop of a log."""
    gains = dict(zip(("kp", "ki", "kd"), log.gains, strict=True))
    if way == "constant":
        gains["kp"] *= 2.0
        if servo.firmware.law == CASCADE:
            gains |= {name: 2.0 * gains[name] for name in ("ki", "kd")}
    told = {"law": servo.law, **servo.told, **{k: v for k, v in gains.items() if v}}
    if not servo.gain_told:
        name = _main_gain(servo)
        told[name] = {"value": _GUESS * told[name], "uncertainty": _GUESS * told[name]}
    return told


def _main_gain(servo):
    return "kd" if servo.firmware.law == CASCADE else "kp"


def draw(law: str, number: int, seed: int = 1) -> RandomServo:
    """Return a servo that these alone determine."""
    rng = np.random.default_rng([seed, list(LAWS).index(law), number, 29])
    while (drawn := _drawn(rng, law, number)) is None:
        pass
    return drawn


def _drawn(rng, law, number):
    rule, weighed = LAWS[law], number % 2 == 1
    servo, strength, volts = _motor(rng, rule)
    firmware, gains = _loop(rng, rule, servo, strength, volts)
    masses = [Mass()]
    if weighed:
        arm = rng.uniform(0.08, 0.2)
        masses += [Mass(rng.uniform(0.15, 0.35) * strength / (GRAVITY * arm), arm)]
        own = rng.uniform(0.05, 0.2)
    else:
        masses *= 2
        own = rng.uniform(0.15, 0.5)
    servo = servo._replace(gravity=own * strength)
    body = Body(joint=servo, masses=tuple(masses), pace=1.0)
    softer = 1.0 if weighed else rng.uniform(0.3, 0.6)
    recordings = []
    for condition, mass in enumerate(masses):
        share = 1.0 if condition == 0 else softer
        own_gains = _register(rule, [share * gain for gain in gains])
        set_firmware = _with_gains(firmware, rule, own_gains)
        for plan in (_waves, _levels if condition == 0 else _sweep, _lift_and_drop):
            seen = _recorded(
                rng, body.carrying(mass), set_firmware, plan, gains=own_gains, mass=mass
            )
            angle = seen.angle - firmware.zero
            if np.abs(angle).max() > _WIDEST or angle.std() < _LEAST:
                return None
            recordings.append(seen)
    truth = {
        "p1": servo.inertia,
        "p2": servo.viscous + servo.back_emf,
        "p3": servo.gravity,
        "p4": servo.gain,
        "coulomb": servo.coulomb,
        # The wait for the next look, and what it takes to act, count as delay
        "delay": firmware.delay + firmware.period / 2 + firmware.late,
        "latency": firmware.late,
        "back_emf": servo.back_emf,
        "stribeck": servo.excess,
        **({"stribeck_velocity": servo.excess_velocity} if servo.excess else {}),
        "motor_friction": servo.motor_friction,
        "load_friction": servo.load_friction,
    }
    told = {"clock": firmware.period, "limit": firmware.limit}
    if firmware.law == CASCADE:
        told["speed_limit"] = firmware.speed_limit
    if firmware.dead_zone:
        told["dead_band"] = firmware.dead_zone
    return RandomServo(
        law=law,
        number=number,
        truth={name: float(value) for name, value in truth.items()},
        heaviest=body.heaviest,
        firmware=firmware,
        told=told,
        known={} if weighed else {"p3": float(servo.gravity)},
        gain_told=number % 4 != 2,
        ratio=float(rng.choice([3.0, 5.0, 10.0, 50.0])),
        recordings=tuple(recordings),
    )


def _motor(rng, rule):
    """Draw a joint without gravity, the torque in N m that it can hold, and its supply in V."""
    inertia = log_uniform(rng, 4e-3, 0.1)
    lag = log_uniform(rng, 0.04, 0.2)  # s, inertia over damping
    damping, fastest = inertia / lag, rng.uniform(6.0, 20.0)  # N m s/rad, rad/s
    strength, electric = damping * fastest, rule.law not in {"odrive", "moteus"}
    volts = float(rng.choice([5.0, 7.4, 12.0, 24.0])) if electric else 0.0
    share = rng.uniform(0.6, 0.95) if electric else 0.0
    dry = rng.uniform(0.0, 0.04) * strength
    servo = Joint(
        inertia=float(inertia),
        viscous=float((1.0 - share) * damping if electric else 0.3 * damping),
        back_emf=float(share * damping),
        gravity=0.0,
        gain=float(strength / volts if electric else rng.uniform(0.85, 1.15)),
        coulomb=float(dry),
        excess=float(rng.choice([0.0, rng.uniform(0.005, 0.02) * strength])),
        excess_velocity=float(rng.uniform(0.05, 0.3)),
        motor_friction=float(rng.uniform(0.0, 0.3)),
        load_friction=float(rng.uniform(0.0, 0.3)),
    )
    return servo, float(strength), volts


def _loop(rng, rule, servo, strength, volts):
    """Draw a firmware without gains, and gains in its own units that keep it stable."""
    damping = servo.viscous + servo.back_emf
    lag, drive = servo.inertia / damping, servo.gain * (volts or 1.0)  # N m per duty or torque
    fine = rule.law in {"odrive", "moteus"}
    # a loop of P alone is damped by the motor: 0.15 to 0.5 of critical
    pace = min(1.0 / (2.0 * rng.uniform(0.15, 0.5) * lag), 40.0)
    stiff = servo.inertia * pace**2 / drive
    if rule.kind == PID:
        p, i, d = stiff, rng.choice([0.0, 0.3 * stiff * pace / 4]), 0.0
        d = rng.choice([0.0, 0.1 * stiff / pace])
    elif rule.law == "feetech-sts":
        p, i, d = stiff, 0.0, float(rng.choice([0.0, 0.2 * stiff / pace]))
    elif rule.kind == DAMPED:
        pace = rng.uniform(8.0, 20.0)
        p, i = servo.inertia * pace**2, 0.0
        d = rng.uniform(0.6, 1.4) * servo.inertia * pace
    elif rule.kind == CASCADE:
        p, fast = rng.uniform(4.0, 10.0), rng.uniform(15.0, 30.0)
        d = fast * servo.inertia
        i = rng.uniform(0.0, 0.2) * fast * d
    else:
        fast = rng.uniform(10.0, 25.0)
        p, d = fast * servo.inertia / drive, 0.0
        i = rng.uniform(0.1, 0.4) * fast * p
    worth = (rule.p, rule.i, rule.d)
    gains = [float(g / w) for g, w in zip((p, i, d), worth, strict=True)]
    counts = 4096 if not fine else 2 ** int(rng.integers(14, 17))
    period = {"odrive": 1 / 8000, "moteus": 1 / 30000}.get(rule.law, 1e-3)
    if rule.law == "feetech-sts":
        period = float(rng.choice([1e-3, 2e-3]))
    count = 2 * math.pi / counts
    firmware = Firmware(
        law=rule.kind,
        limit=rule.limit if volts else float(rng.uniform(0.6, 1.0) * strength),
        speed_limit=float(rng.uniform(3.0, 8.0)),
        dead_zone=count if rule.law == "feetech-sts" else 0.0,
        period=period,
        phase=float(rng.uniform(0.0, period)),
        late=float(rng.uniform(0.0, 0.5) * period),
        delay=float(rng.uniform(0.0, 6e-3)),
        count=count,
        zero=float(rng.uniform(-0.3, 0.3)),
        bandwidth={"odrive": 1000.0, "moteus": 2 * math.pi * 400}.get(rule.law, 0.0),
        supply=volts,
        sag=float(rng.uniform(0.0, 0.12) * volts / strength),
    )
    return firmware, gains


def _register(rule, gains):
    """Gains as they are set: a Dynamixel's, and a Feetech's P, are whole numbers."""
    p, i, d = gains
    if rule.law.startswith("dynamixel"):
        return round(p), round(i), round(d)
    return (round(p) if rule.law == "feetech-sts" else round(p, 4)), round(i, 4), round(d, 6)


def _with_gains(firmware, rule, gains):
    p, i, d = (gain * worth for gain, worth in zip(gains, (rule.p, rule.i, rule.d), strict=True))
    return firmware._replace(p=p, i=i, d=d)


def _recorded(rng, servo, firmware, plan, **condition):
    """What the host sees; it reads the supply in steps of 0.1 V or 0.01 V."""
    stamps = clock(rng, DURATION, rng.uniform(4e-3, 8e-3), rng.uniform(0.0, 0.1))
    goals, enabled = plan(rng, stamps, firmware.law == VELOCITY)
    if firmware.law != VELOCITY:
        goals = goals + firmware.zero
    angle, drive, supply, _ = run(servo, firmware, (stamps, goals, enabled))
    step = float(rng.choice([0.1, 0.01]))
    supply = step * np.round(supply / step)
    return Recording(stamps, goals, angle, drive, supply, enabled, **condition)


def _waves(rng, time, of_speed):
    pace = rng.uniform(3.0, 6.0)
    wave, most = multisine(pace, 1.0, rng)
    size = rng.uniform(1.0, 2.0) / most * (pace if of_speed else 1.0)
    return size * (wave(time) - (0.0 if of_speed else wave(np.zeros(1)))), np.ones(time.size)


def _levels(rng, time, of_speed):
    levels, _ = steps(rng.uniform(4.0, 8.0), rng.uniform(0.6, 1.2), rng)
    if of_speed:  # back where it came from, time after time
        half = rng.uniform(0.5, 1.0)
        return rng.uniform(0.8, 2.0) * np.sign(np.sin(np.pi * time / half)), np.ones(time.size)
    return levels(time), np.ones(time.size)


def _sweep(rng, time, of_speed):
    first, last = rng.uniform(0.5, 2.0), rng.uniform(8.0, 20.0)
    phase = first * time + 0.5 * (last - first) * time**2 / time[-1]
    size = rng.uniform(0.3, 0.7)
    return size * np.sin(phase) * (3.0 if of_speed else 1.0), np.ones(time.size)


def _lift_and_drop(rng, time, of_speed):
    """Up, held, let fall, and once more the other way."""
    half, high = time[-1] / 2, rng.uniform(0.8, 1.4)
    within, way = time % half, np.where(time < half, 1.0, -1.0)
    rise = 0.3 * half
    goals = way * high * np.minimum(within / rise, 1.0)
    if of_speed:
        goals = way * high / rise * (within < rise)
    return goals, (within < 0.6 * half).astype(float)
