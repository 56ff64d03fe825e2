"""The command that holds a joint in steady motion, as C99 or Python, or as gains of WPILib.

Its law is written once, of the kernel's own functions, and translated (`translate`). Friction is
compensated to the lower ends of its intervals, so that what is left still brakes: more than the
joint has would drive it.

An arm's voltage in WPILib is kS sgn(w) + kG cos(a) + kV w + kA w', its angle a from the horizontal:
ours, from hanging, less a quarter of a turn (and what its centre of mass is off).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from butterfly.arrays import ROUNDING
from butterfly.errors import InputError
from butterfly.files import json_text
from butterfly.identification.free_run import FreeRun
from butterfly.identification.sensor_errors import SensorErrors
from butterfly.identification.trust import FEW, unit_of
from butterfly.logs.log import InputKind
from butterfly.model.kernel.equation import friction_level, pull
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import STATES
from butterfly.twin.c import explained, fields_of, rendered
from butterfly.twin.forms import Options
from butterfly.twin.languages import C, Python
from butterfly.twin.plain import left_out
from butterfly.twin.translate import NUMBER, Fields, Translator
from butterfly.twin.twin import Twin, Written, unheard
from butterfly.verdict import SPREADS

_ANGLES, _SPEEDS = 13, 5  # at which errors are computed
_CREEPS = 0.05  # rad/s, the smoothing speed where no log tells it
_ROUNDS = 30  # in a gear, whose friction grows with the torque that overcomes it
_SHARES = ("dry", "excess", "damping")
"""Shares that are compensated: of dry friction, of what it has more near rest, of damping."""

_NEUTRAL = {"zero": 0.0} | dict.fromkeys(_SHARES, 1.0) | {"smoothing": 1.0, "limit": math.inf}
"""How a law is used: the encoder's zero, shares, the smoothing speed, the largest command."""


def unlimited(angle: Any, velocity: Any, direction: Any, c: Any) -> Any:  # noqa: ANN401 - numbers
    """Return the command that cancels gravity and friction, without a limit."""
    sign = sense(velocity, direction, c)
    wanted = steady_torque(angle - c.zero, velocity, sign, c) / c.p4
    return undelivered(wanted, c)


def sense(velocity: Any, direction: Any, c: Any) -> Any:  # noqa: ANN401
    """Return the direction of sliding: that of the velocity, near standstill the wanted one."""
    sure = max(-1.0, min(1.0, velocity / c.smoothing))
    return sure + (1.0 - abs(sure)) * direction


def steady_torque(angle: Any, velocity: Any, sign: Any, c: Any) -> Any:  # noqa: ANN401
    """Return the motor's torque at which the velocity stays, with shares of friction."""
    load = pull(angle, c)
    torque = c.damping * (c.p2 + c.drag * abs(velocity)) * velocity - load
    steady = torque
    for _ in range(_ROUNDS):
        before, motor = torque, torque - c.back_emf * velocity
        sliding = friction_level(angle, math.inf, sign, motor, load, c)
        more = friction_level(angle, velocity, sign, motor, load, c) - sliding
        torque = steady + sign * (c.dry * sliding + c.excess * more)
        if c.geared == 0.0 or torque == before:
            break
    return torque


def undelivered(wanted: Any, c: Any) -> Any:  # noqa: ANN401
    """Return the command for which the drive delivers what is wanted."""
    room = 1.0 - c.compression * abs(wanted)
    given = wanted / room if room > 0.0 else np.sign(wanted) * math.inf
    return given + c.dead_zone * np.sign(wanted)


def limited(asked: Any, c: Any) -> Any:  # noqa: ANN401
    """Return a command within the limit."""
    return np.clip(asked, -c.limit, c.limit)


@dataclass(frozen=True, kw_only=True, eq=False)
class Compensation:
    """The law of a joint, and the range of its logs; without any a whole turn, to 1 rad/s."""

    twin: Twin
    numbers: Mapping[str, float]  # of the loaded joint, by name, and how it is used
    # of these, as large as the intervals of an estimate, along independent errors
    steps: Sequence[Mapping[str, float]]
    low: float = -math.pi
    high: float = math.pi
    speed: float = 1.0
    zeros: tuple[float, ...] = (0.0,)

    @classmethod
    def whole(cls, twin: Twin) -> Compensation:
        """Return it with all friction, as used without logs; InputError if errors are unknown."""
        twin.parameters.require_gain("export")
        steps, nominal = [], _loaded(twin, {})
        if (estimate := twin.estimate) is not None:
            covariance = estimate.interval_covariance
            if not np.isfinite(covariance).all():
                expected = "an estimate with intervals; identify from more logs"
                raise InputError("export", "parameters", "without standard errors", expected)
            errors = np.sqrt(np.diag(covariance))
            scale = np.where(errors > 0, errors, 1.0)
            sizes, ways = np.linalg.eigh(covariance / np.outer(scale, scale))
            for size, way in zip(np.sqrt(np.maximum(sizes, 0.0)), ways.T, strict=True):
                error = SPREADS * ROUNDING * size * way * scale
                moved = _loaded(twin, dict(zip(estimate.names, error.tolist(), strict=True)))
                step = {k: (value - nominal[k]) / ROUNDING for k, value in moved.items()}
                steps.append({k: change for k, change in step.items() if change})
        numbers = nominal | _NEUTRAL | {"geared": float(twin.loaded.geared)}
        return cls(twin=twin, numbers=numbers, steps=steps)

    @classmethod
    def of(cls, twin: Twin) -> Compensation:
        """Return it with the shares of friction that are certain."""
        made, smoothing, zeros = cls.whole(twin), _CREEPS, twin.zeros
        if recorded := [(log.opened, setting) for log, setting in twin.recorded() if log.rms_speed]:
            some = recorded[:: max(len(recorded) // FEW, 1)]
            blurs = [_blur(setting.run(setting.simulation(log))) for log, setting in some]
            smoothing, zeros = float(np.median(blurs)), zeros or tuple(s.zero for _, s in recorded)
            angles = [log.angle - setting.zero for log, setting in recorded]
            low, high = (float(extreme(map(extreme, angles))) for extreme in (min, max))
            speed = max(log.top_speed for log, _ in recorded)
            made = replace(made, low=low, high=high, speed=speed)
        made = replace(made, zeros=zeros or made.zeros)
        seen = [*made.places(made.low, made.high)]
        shares = {share: min(made.certain(share, *at) for at in seen) for share in _SHARES}
        made = made.having(zero=float(np.median(made.zeros)), smoothing=smoothing, **shares)
        return made.having(limit=min(twin.limit, made.most))

    def having(self, **settings: float) -> Compensation:
        """Return it with other numbers."""
        return replace(self, numbers={**self.numbers, **settings})

    @cached_property
    def constants(self) -> SimpleNamespace:
        """The numbers as the functions of this module take them."""
        return SimpleNamespace(**self.numbers)

    def places(self, low: float, high: float) -> Iterator[tuple[float, float]]:
        """Yield angles between limits, and velocities as fast as was seen."""
        speeds = np.linspace(-self.speed, self.speed, _SPEEDS)
        yield from product(np.linspace(low, high, _ANGLES).tolist(), speeds.tolist())

    @property
    def everywhere(self) -> Iterator[tuple[float, float, float]]:
        """Yield readings, velocities and directions: at all angles of a hinge."""
        slides = self.twin.joint is JointKind.SLIDE
        ends = (self.low, self.high) if slides else (-math.pi, math.pi)
        for angle, velocity in self.places(*ends):
            yield angle + self.numbers["zero"], velocity, math.copysign(1.0, velocity)

    @property
    def most(self) -> float:
        """The largest command without a limit."""
        return max(abs(float(unlimited(*at, self.constants))) for at in self.everywhere)

    @property
    def worst(self) -> tuple[float, float]:
        """The largest error of a command, and what of it is withheld."""
        withheld, half = max((self.error(*at) for at in self.everywhere), key=sum)
        return withheld + half, withheld

    def error(self, angle: float, velocity: float, direction: float) -> tuple[float, float]:
        """Return how far a command may be off: what is withheld, and an interval's half-width."""
        at, whole = (angle, velocity, direction), self.having(**dict.fromkeys(_SHARES, 1.0))
        withheld = unlimited(*at, whole.constants) - unlimited(*at, self.constants)
        return abs(withheld), whole.half_width(lambda c: float(unlimited(*at, c)))

    def certain(self, share: str, angle: float, velocity: float) -> float:
        """Return the share of a part of friction that is certain at an angle and a velocity."""

        def part(c: Any) -> float:  # noqa: ANN401
            none = vars(c) | dict.fromkeys(_SHARES, 0.0)
            one, rest = (
                steady_torque(angle, velocity, 1.0, SimpleNamespace(**constants))
                for constants in (none | {share: 1.0}, none)
            )
            return float((one - rest) / c.p4)

        size = abs(part(self.constants))
        return max(1.0 - self.half_width(part) / size, 0.0) if size else 1.0

    def half_width(self, of: Callable[[Any], float]) -> float:
        """Return the half-width, to first order, of the interval of a function of the constants."""
        value, squares = of(self.constants), 0.0
        for step in self.steps:
            moved = {name: self.numbers[name] + ROUNDING * change for name, change in step.items()}
            squares += ((of(self.having(**moved).constants) - value) / ROUNDING) ** 2
        return math.sqrt(squares)


def _loaded(twin: Twin, moved: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of the loaded joint by name, those of the bare joint moved."""
    p = twin.parameters
    p = replace(p, **{name: getattr(p, name) + change for name, change in moved.items()})
    p = p.with_added_mass(twin.added)
    return {field.name: float(getattr(p, field.name)) for field in fields(LumpedParameters)}


def _blur(run: FreeRun) -> float:
    """Return the error of a velocity of a log in rad/s, at 95 %.

    A velocity is recorded, or the difference of two readings over the interval of least error.
    """
    log = run.log
    error = SPREADS * SensorErrors.of(log.measured, run.simulated).spread
    if log.integrated:
        return error
    error, acceleration = math.sqrt(2) * error, log.rms_speed**2 / log.rms_motion
    interval = max(log.mean_step, math.sqrt(2 * error / acceleration))
    return error / interval + acceleration * interval / 2


def as_compensation(twin: Twin, options: Options) -> Written:
    """Return the compensation of a joint as a C header or a Python module."""
    made, python, missing = Compensation.of(twin), options.ending == ".py", [*unheard(twin)]
    if names := [name for name in STATES if getattr(twin.loaded, name)]:
        missing.insert(0, f"Holds in steady motion: {', '.join(names)} is not compensated.")
    numbers, steps, lines = made.numbers, made.steps, tuple(_said(made))
    present = {name for values in (numbers, *steps) for name, value in values.items() if value}
    kinds: dict[str, Any] = {
        parameter: NUMBER if parameter in present else 0.0 for parameter in numbers
    }
    kinds |= dict.fromkeys(_NEUTRAL, NUMBER) | {"geared": numbers["geared"]}
    translator, c = Translator({}), Fields(kinds)
    law = translator.function(unlimited, NUMBER, NUMBER, NUMBER, c)
    within = translator.function(limited, NUMBER, c)
    functions = [*(law.called | within.called)]
    read = [name for name in numbers if name in {*fields_of(functions), *_NEUTRAL}]
    name = f"{twin.identifier}_compensation"
    language = Python("", functions) if python else C(name, functions)
    given = {argument: argument for argument in law.arguments} | {"asked": "asked", "c": "p"}
    text = rendered(
        "compensation.py" if python else "compensation.h",
        twin=twin,
        n=name,
        parameters=[
            (parameter, repr(numbers[parameter]), explained(parameter, twin)) for parameter in read
        ],
        steps=[[repr(step.get(parameter, 0.0)) for parameter in read] for step in steps],
        functions=language.text(),
        unused=[
            argument
            for argument in ("angle", "velocity", "direction")
            if argument not in law.arguments
        ],
        unlimited=language.call(law, given),
        moved=language.call(law, given | {"c": "q" if python else "&q"}),
        limited=language.call(within, given),
        notes=(*lines, *missing),
    )
    what = "a Python module" if python else f"a C99 header with {name}_command"
    return Written(
        text=text,
        about=f"{what}, in {twin.kind.unit}",
        left_out=tuple(missing),
        title="Compensation",
        notes=lines,
    )


def _said(made: Compensation) -> Iterator[str]:
    """Say what is compensated, and how far it may be off."""
    numbers, unit, way = made.numbers, made.twin.kind.unit, made.twin.joint.way
    parts = {share: f"{100 * numbers[share]:.3g} %" for share in _SHARES}
    more = f" (of its Stribeck excess {parts['excess']})" if numbers["stribeck"] else ""
    if made.twin.estimate is None:
        yield "Cancels gravity and all friction: its values are taken as exact."
    else:
        yield (
            f"Cancels gravity, {parts['dry']} of dry friction{more} and {parts['damping']} of "
            "damping: the lower ends of their intervals."
        )
        error, withheld = made.worst
        torque = f"{abs(numbers['p4']) * error:.2g} {unit_of('coulomb', joint=made.twin.joint)}"
        where = f"{made.low:.3g} to {made.high:.3g} {way}"
        if made.twin.joint is JointKind.HINGE:
            where = f"any angle (the logs show {where})"
        yield (
            f"Error at most {error:.2g} {unit} ({torque}) of up to {made.most:.2g} {unit} at "
            f"{where} and up to {made.speed:.3g} {way}/s; {withheld:.2g} {unit} of it is "
            "uncompensated friction."
        )
    yield (
        f"Below {numbers['smoothing']:.2g} {way}/s (smoothing) friction takes the wanted "
        f"direction; commands are limited to {numbers['limit']:.4g} {unit} (limit)."
    )
    if any(made.zeros):
        ends = " to ".join(dict.fromkeys(f"{extreme(made.zeros):.4g}" for extreme in (min, max)))
        yield f"Angles are the encoder's; its zero was {ends} {way} in the logs: set yours (zero)."


def as_wpilib(twin: Twin, options: Options) -> Written:  # noqa: ARG001 - every form takes them
    """Return the gains of a joint that a voltage drives, with their 95 % intervals, as JSON."""
    if twin.kind is not InputKind.VOLTAGE:
        raise InputError("export", "input", str(twin.kind), "voltage (WPILib's gains are in V)")
    law, way, name, lines = Compensation.whole(twin), twin.joint.way, "SimpleMotorFeedforward", []
    made: dict[str, tuple[str, Callable[[Any], float]]] = {
        "kS": ("V", lambda c: c.coulomb / c.p4),
        "kV": (f"V s/{way}", lambda c: c.p2 / c.p4),
        "kA": (f"V s²/{way}", lambda c: c.p1 / c.p4),
    }
    p3, offset, arm = law.numbers["p3"], law.numbers["p3_offset"], []
    if p3 or offset:
        name = "ArmFeedforward"
        made["kG"] = ("V", lambda c: math.hypot(c.p3, c.p3_offset) / c.p4)
        quarter = math.pi / 2 - math.atan2(offset, p3)
        arm = [
            "An arm's angle (0 at the horizontal) equals the angle here (0 hanging) less "
            f"{quarter:.6g} rad."
        ]
    elif twin.joint is JointKind.SLIDE:
        name = "ElevatorFeedforward"
        made["kG"] = ("V", lambda c: -c.bias / c.p4)
    gains = {}
    for gain, (unit, formula) in made.items():
        value, half = formula(law.constants), law.half_width(formula)
        gains[gain] = {"value": value, "lower": value - half, "upper": value + half, "unit": unit}
        lines.append(f"{gain} {value:.5g} ± {half:.2g} {unit}.")
    missing = tuple(left_out(twin, "A feedforward of WPILib"))
    notes = [*arm, *twin.log_lines, *missing]
    return Written(
        text=json_text({"name": twin.name, "class": name, "gains": gains, "notes": notes}),
        about=f"{name} of WPILib, with 95 % intervals",
        left_out=missing,
        title="Gains",
        notes=(*lines, *arm),
    )
