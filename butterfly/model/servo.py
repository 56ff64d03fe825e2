"""The loops of servos: a table of the laws of their firmware.

A law computes an output from setpoint r, angle th and velocity, with gains in the units of its
maker; the table has the SI value of one unit of each gain.

    pid      output = kp e + ki int e dt - kd thd,               e = r - th
             (or + kd de/dt, for some laws)
    cascade  output = kd f + ki int f dt,     f = clip(kp e, speed limit) - thd
    speed    output = kp f + ki int f dt,                        f = r - thd

The output is clipped, and the integral does not grow meanwhile. The firmware samples the joint at
its clock and holds its output in between.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any

from butterfly.errors import InputError, nearest
from butterfly.model.prior import Known, known_of

_SLOWEST = 5e-4  # s, between two updates of a simulated loop whose own clock is faster


class Output(StrEnum):
    """Output of a law, the command of the drive."""

    DUTY = "duty"
    VOLTAGE = "voltage"
    CURRENT = "current"
    TORQUE = "torque"


class LawStructure(StrEnum):
    """Structure of a law."""

    PID = "pid"
    CASCADE = "cascade"
    SPEED = "speed"


@dataclass(frozen=True, kw_only=True)
class Law:
    """A row of the table: how firmware uses its gains."""

    structure: LawStructure
    output: Output
    kp: float = 1.0  # worth of one unit of each gain
    ki: float = 1.0
    kd: float = 1.0
    on_error: bool = False  # whether kd acts on the rate of the error, not of the joint
    rate_lag: float = 0.0  # s by which firmware measures velocity later than angle
    limit: float = math.inf  # of the output
    clock: float = 1e-3  # s
    source: str = ""


_COUNTS = 4096 / (2 * math.pi)  # of an encoder, per rad
_TURN = 1 / (2 * math.pi)  # of the joint, per rad
_RATE = 60 / (2 * math.pi * 0.229)  # units of velocity of a Dynamixel, per rad/s
_FULL = 885  # full supply in units of a Dynamixel

# fmt: off
_MAKERS = {
    "dynamixel-x": Law(
        structure=LawStructure.PID, output=Output.DUTY, limit=1.0, on_error=True,
        kp=_COUNTS / (128 * _FULL), ki=_COUNTS / (65.536 * _FULL), kd=_COUNTS / (16e3 * _FULL),
        source="ROBOTIS e-Manual, X series, Position PID Gain(80, 82, 84); sums at 1 kHz assumed"),
    "dynamixel-xl330": Law(
        structure=LawStructure.PID, output=Output.DUTY, limit=1.0, on_error=True,
        kp=_COUNTS / (256 * _FULL), ki=_COUNTS / (65.536 * _FULL), kd=_COUNTS / (16e3 * _FULL),
        source="as dynamixel-x, with the divisor 256 that Rhoban/bam measured of its P gain"),
    "dynamixel-x-velocity": Law(
        structure=LawStructure.SPEED, output=Output.DUTY, limit=1.0,
        kp=_RATE / (128 * _FULL), ki=_RATE / (65.536 * _FULL),
        source="ROBOTIS e-Manual, X series, Velocity PI Gain(76, 78); sums at 1 kHz assumed"),
    "feetech-sts": Law(
        structure=LawStructure.PID, output=Output.DUTY, limit=0.97, kp=0.166,
        source="Rhoban/bam, feetech/actuator.py, by oscilloscope; the effect of D is unpublished: "
               "here it damps, in s/rad"),
    "odrive": Law(
        structure=LawStructure.CASCADE, output=Output.TORQUE, ki=_TURN, kd=_TURN, clock=1 / 8000,
        rate_lag=2 / 1000,
        source="odriverobotics/ODrive f9b5419, Controller::update; kp pos_gain, kd vel_gain, "
               "ki vel_integrator_gain; its encoder's PLL of 1000 rad/s"),
    "odrive-velocity": Law(
        structure=LawStructure.SPEED, output=Output.TORQUE, kp=_TURN, ki=_TURN, clock=1 / 8000,
        rate_lag=2 / 1000, source="the same without pos_gain; kp vel_gain, ki vel_integrator_gain"),
    "moteus": Law(
        structure=LawStructure.PID, output=Output.TORQUE, kp=_TURN, ki=_TURN, kd=_TURN,
        clock=1 / 30000, rate_lag=2 * _TURN / 400,
        source="mjbots/moteus db1a762, PID::Apply; its encoder's PLL of 400 Hz"),
}
# fmt: on

LAWS = _MAKERS | {
    f"{structure}-{output}": Law(
        structure=structure, output=output, limit=1.0 if output is Output.DUTY else math.inf
    )
    for structure in LawStructure
    for output in Output
}
"""The laws by name: those of makers, and those in SI units by structure and output."""

_GAINS = ("kp", "ki", "kd")
_NONE = Known(value=0.0)


@dataclass(frozen=True, kw_only=True)
class ServoLoop:
    """The loop that drives a joint.

    Parameters
    ----------
    law
        Of `LAWS`.
    kp, ki, kd
        Gains in the units of the law; with an uncertainty (large for a guess) they are identified
        as factors on the given values.
    limit
        Of the output: duty from 0 to 1, V, A or N m; default: that of the law.
    speed_limit
        In rad/s (m/s for a slide): of a cascade, or of the setpoint of a PID law.
    dead_band
        Of the error, in rad (rad/s for a speed law), within which the error counts as 0.
    slew
        Largest change of the output per second.
    clock
        Sampling period in s; default: that of the law.
    supply
        In V, for a duty without a supply column. Without either, the duty itself is the command.
    current_limit, resistance, back_emf_constant, torque_constant
        In A, Ohm, V s/rad and N m/A at the joint: they limit the current of a duty or voltage law,
        and, with ``supply``, the output of a current or torque law.
    """

    law: str
    kp: Known = _NONE
    ki: Known = _NONE
    kd: Known = _NONE
    limit: float | None = None
    speed_limit: float = math.inf
    dead_band: float = 0.0
    slew: float = math.inf
    clock: float | None = None
    supply: float | None = None
    current_limit: float = math.inf
    resistance: float = 0.0
    back_emf_constant: float = 0.0
    torque_constant: float = 1.0

    @classmethod
    def of(
        cls, given: Mapping[str, Any], source: object = "loop", *, whole: bool = True
    ) -> ServoLoop:
        """Read the loop of a manifest; InputError if invalid.

        If not ``whole``, the gains may come from single logs.
        """
        if "law" not in given:
            expected = "the servo's law, such as {law: dynamixel-x, kp: 400}"
            raise InputError(str(source), "loop.law", "nothing", expected)
        known = [field.name for field in fields(cls)]
        values = dict(given)
        for name, value in given.items():
            if name not in known:
                expected = nearest(name, known)
                raise InputError(str(source), f"loop.{name}", "an unknown name", expected)
            if name in _GAINS:
                values[name] = known_of(value, source, f"loop.{name}")
            elif name != "law" and isinstance(value, str):  # of a command line
                values[name] = known_of(value, source, f"loop.{name}").value
        loop = cls(**values)
        loop._require_possible(str(source))
        needed = "kd" if loop.rule.structure is LawStructure.CASCADE else "kp"
        if whole and not getattr(loop, needed).value:
            expected = f"a gain, such as loop: {{{needed}: 400}} of the data set or of the log"
            raise InputError(str(source), f"loop.{needed}", "nothing", expected)
        return loop

    def _require_possible(self, source: str) -> None:
        """Raise InputError for an unknown law, and for values below 0."""
        if str(self.law) not in LAWS:
            raise InputError(source, "loop.law", self.law, nearest(str(self.law), LAWS))
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "law" or value is None:
                continue
            least = value.value if isinstance(value, Known) else value
            if isinstance(least, bool) or not (isinstance(least, int | float) and least >= 0):
                raise InputError(source, f"loop.{field.name}", value, "a number, 0 or more")
            if isinstance(value, Known) and value.uncertainty and not least:
                raise InputError(
                    source,
                    f"loop.{field.name}",
                    value,
                    "a value above 0, since it has an uncertainty",
                )
        if self.clock == 0:
            raise InputError(source, "loop.clock", 0, "more than 0 s")
        if math.isfinite(self.current_limit) and not self.resistance:
            expected = "resistance and back_emf_constant too, to limit the current"
            raise InputError(source, "loop.current_limit", self.current_limit, expected)

    @property
    def rule(self) -> Law:
        """The row of the table."""
        return LAWS[self.law]

    @property
    def of_speed(self) -> bool:
        """Whether the setpoint is a velocity."""
        return self.rule.structure is LawStructure.SPEED

    @property
    def period(self) -> float:
        """Clock of the firmware in s."""
        return self.rule.clock if self.clock is None else self.clock

    @property
    def clock_assumed(self) -> bool:
        """Whether the firmware's clock is unknown: neither given nor documented by the maker."""
        return self.clock is None and not self.rule.source

    @property
    def uncertain(self) -> dict[str, Known]:
        """Priors of the gains to identify, as factors on the given values."""
        priors = {}
        for name in _GAINS:
            gain = getattr(self, name)
            if gain.uncertainty:
                priors[f"loop_{name}"] = Known(value=1.0, uncertainty=gain.uncertainty / gain.value)
        return priors

    def __str__(self) -> str:
        values = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        usual = {field.name: field.default for field in fields(self)}
        texts = (f"{name} {value}" for name, value in values.items() if value != usual[name])
        return ", ".join([self.law, *texts])

    def at_joint(self, ratio: float) -> ServoLoop:
        """Return the loop at the joint of an encoder that turns ``ratio`` times as fast."""
        return replace(
            self,
            kp=self.kp.times(1.0 if self.rule.structure is LawStructure.CASCADE else ratio),
            ki=self.ki.times(ratio),
            kd=self.kd.times(ratio),
            speed_limit=self.speed_limit / ratio,
            dead_band=self.dead_band / ratio,
        )

    @property
    def gains_si(self) -> tuple[float, float, float]:
        """Gains kp, ki and kd in SI units."""
        kp, ki, kd = (getattr(self.rule, name) * getattr(self, name).value for name in _GAINS)
        return kp, ki, kd

    @property
    def kick(self) -> float:
        """Largest setpoint step whose D response stays within the output limit."""
        limit, kd = self.rule.limit if self.limit is None else self.limit, self.gains_si[2]
        return limit * self.period / kd if self.rule.on_error and kd else math.inf

    @property
    def reach(self) -> tuple[float, float]:
        """Bound on the command around a multiple of the speed: that multiple, and the bound."""
        amperes = {Output.CURRENT: 1.0, Output.TORQUE: self.torque_constant}
        if self.rule.output not in amperes:
            if not math.isfinite(self.current_limit):
                return 0.0, math.inf
            return self.back_emf_constant, self.current_limit * self.resistance
        if not self.resistance or self.supply is None:
            return 0.0, math.inf
        worth = amperes[self.rule.output] / self.resistance
        return -self.back_emf_constant * worth, self.supply * worth

    def updates(self, longest: float) -> tuple[float, int]:
        """Return the step of a simulation grid in s, and the number of steps per update."""
        period = self.period
        if period < _SLOWEST:
            period *= max(1, int(_SLOWEST / period))
        every = max(1, math.ceil(period / longest))
        return period / every, every
