"""A joint's gravity and friction, cancelled: C99 or Python, by the law of `law`.

Friction is compensated to the lower ends of its intervals, so that what is left still brakes: more
than the joint has would drive it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from butterfly.errors import InputError
from butterfly.identification.free_run import FreeRun
from butterfly.identification.levels import FEW, SPREADS
from butterfly.identification.sensor_errors import SensorErrors
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.twin.c import explained, fields_of, rendered
from butterfly.twin.forms import Options
from butterfly.twin.languages import C, Python
from butterfly.twin.law import NEUTRAL, Law, limited, steady_torque, unlimited
from butterfly.twin.plain import effort_unit
from butterfly.twin.reduced import NUMBER, Fields
from butterfly.twin.translate import Translator
from butterfly.twin.twin import Twin, Written, unheard

_ANGLES, _SPEEDS = 25, 5  # at which errors are computed
_STATES = ("base_compliance", "bristle_stiffness", "time_constant")  # that add a state
_SETTINGS = {
    "zero": ("way", "reading of the encoder where the joint hangs (the model's angle 0)"),
    "dry": ("1", "share of dry friction that is compensated"),
    "damping": ("1", "share of viscous friction, back EMF and drag that is compensated"),
    "smoothing": ("way/s", "speed from which on friction has the velocity's sign"),
    "limit": ("unit", "largest command in both directions"),
}


class _Seen(NamedTuple):
    """What logs show: ranges of angle and speed, zeros, error of a velocity."""

    low: float = -math.pi
    high: float = math.pi
    speed: float = 0.0
    zeros: tuple[float, ...] = (0.0,)
    blur: float | None = None

    @classmethod
    def of(cls, twin: Twin) -> _Seen:
        """Return what the logs of a twin show; the angle all round where there are none."""
        recorded = [(log.opened, setting) for log, setting in twin.recorded()]
        if not recorded:
            return cls()
        some = recorded[:: max(len(recorded) // FEW, 1)]
        runs = [setting.run(setting.simulation(log)) for log, setting in some]
        return cls(
            low=float(min((log.angle - setting.zero).min() for log, setting in recorded)),
            high=float(max((log.angle - setting.zero).max() for log, setting in recorded)),
            speed=max(log.top_speed for log, _ in recorded),
            zeros=tuple(setting.zero for _, setting in recorded),
            blur=float(np.median([_blur(run) for run in runs])),
        )


def _blur(run: FreeRun) -> float:
    """Return the error of a velocity of a log in rad/s, at 95 %.

    It is recorded, or the difference of two readings, so far apart that noise and delay add least.
    """
    log = run.log
    error = SPREADS * SensorErrors.of(log.measured, run.simulated).spread
    if log.integrated:
        return error
    error, acceleration = math.sqrt(2) * error, log.rms_speed**2 / log.rms_motion
    apart = max(log.mean_step, math.sqrt(2 * error / acceleration))
    return error / apart + acceleration * apart / 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Compensation:
    """The law of a joint, set for use, and where it was seen to move."""

    twin: Twin
    law: Law
    seen: _Seen

    @classmethod
    def of(cls, twin: Twin, options: Options) -> Compensation:
        """Return it, as a user asks or the logs show; InputError for what neither says."""
        seen = _Seen.of(twin)
        if not (smoothing := options.smoothing or seen.blur):
            expected = "a speed in rad/s (there are no logs to tell it)"
            raise InputError("export", "--smoothing", "missing", expected)
        law = Law.of(twin, zero=float(np.median(seen.zeros)), smoothing=smoothing)
        law = law.having(dry=_certain(law, seen, _dry), damping=_certain(law, seen, _damping))
        made = cls(twin=twin, law=law, seen=seen)
        limit = options.command_limit or min(twin.limit, made.most)
        return replace(made, law=law.having(limit=limit))

    def error(self, angle: float, velocity: float, direction: float) -> tuple[float, float]:
        """Return how far a command may be off: what is withheld, and an interval's half-width."""
        at, whole = (angle, velocity, direction), self.law.having(dry=1.0, damping=1.0)
        withheld = unlimited(*at, whole.constants) - unlimited(*at, self.law.constants)
        return abs(withheld), whole.half_width(lambda c: float(unlimited(*at, c)))

    @property
    def turn(self) -> tuple[float, float]:
        """All angles of a hinge in rad; the places in m where a slide was seen."""
        slides = self.twin.joint is JointKind.SLIDE
        return (self.seen.low, self.seen.high) if slides else (-math.pi, math.pi)

    @property
    def everywhere(self) -> Iterator[tuple[float, float, float]]:
        """Encoder's readings, velocities and directions of any motion as fast as was seen."""
        for angle, velocity in _places(*self.turn, self.seen.speed):
            yield angle + self.law.numbers["zero"], velocity, math.copysign(1.0, velocity)

    @property
    def most(self) -> float:
        """The largest command without a limit."""
        at = self.everywhere
        return max(abs(float(unlimited(*each, self.law.constants))) for each in at)


def _places(low: float, high: float, speed: float) -> Iterator[tuple[float, float]]:
    """Yield angles and velocities."""
    yield from product(
        np.linspace(low, high, _ANGLES).tolist(), np.linspace(-speed, speed, _SPEEDS).tolist()
    )


def _certain(law: Law, seen: _Seen, part: Callable[[float, float, Any], float]) -> float:
    """Return the share of a part of the command that is certain wherever the joint was seen."""
    shares = [1.0]
    for at in _places(seen.low, seen.high, seen.speed):
        of = partial(part, *at)
        if size := abs(of(law.constants)):
            shares.append(1.0 - law.half_width(of) / size)
    return max(min(shares), 0.0)


def _dry(angle: float, velocity: float, c: Any) -> float:  # noqa: ANN401
    """Return what a command has for dry friction."""
    one, none = (steady_torque(angle, velocity, sign, c) for sign in (1.0, 0.0))
    return float((one - none) / c.p4)


def _damping(angle: float, velocity: float, c: Any) -> float:  # noqa: ANN401
    """Return what a command has for friction that grows with the speed."""
    moving, resting = (steady_torque(angle, each, 0.0, c) for each in (velocity, 0.0))
    return float((moving - resting) / c.p4)


def as_compensation(twin: Twin, options: Options) -> Written:
    """Return the compensation of a joint as a C header or a Python module."""
    made = Compensation.of(twin, options)
    left_out, said = tuple(_left_out(twin)), tuple(_said(made))
    python = options.ending == ".py"
    numbers, steps = made.law.numbers, made.law.steps
    present = {name for each in (numbers, *steps) for name, value in each.items() if value}
    kinds: dict[str, Any] = {each.name: 0.0 for each in fields(LumpedParameters)}
    kinds |= dict.fromkeys({*present, *NEUTRAL}, NUMBER) | {"geared": float(made.law.geared)}
    translator, c = Translator({}), Fields(kinds)
    law = translator.function(unlimited, NUMBER, NUMBER, NUMBER, c)
    within = translator.function(limited, NUMBER, c)
    functions = [*(law.called | within.called)]
    read = [name for name in numbers if name in {*fields_of(functions), *NEUTRAL}]
    name = f"{twin.identifier}_compensation"
    language = Python("", functions) if python else C(name, functions)
    given = {each: each for each in law.arguments} | {"asked": "asked", "c": "p"}
    text = rendered(
        "compensation.py" if python else "compensation.h",
        twin=twin,
        n=name,
        parameters=[(each, repr(numbers[each]), _explained(each, twin)) for each in read],
        steps=[[repr(step.get(each, 0.0)) for each in read] for step in steps],
        functions=language.text(),
        unlimited=language.call(law, given | {"c": "p"}),
        moved=language.call(law, given | {"c": "q" if python else "&q"}),
        limited=language.call(within, given),
        said=(*said, *left_out),
    )
    about = f"{'a Python module' if python else f'{name}.h, a C99 header'}, in {twin.kind.unit}"
    return Written(text=text, about=about, left_out=left_out, title="Compensation", said=said)


def _explained(name: str, twin: Twin) -> str:
    """Return unit and meaning of a number."""
    if name not in _SETTINGS:
        return explained(name, twin)
    unit, meaning = _SETTINGS[name]
    return f"{unit.replace('way', twin.joint.way).replace('unit', twin.kind.unit)}: {meaning}"


def _said(made: Compensation) -> Iterator[str]:
    """Say what is compensated, and how far it may be off."""
    twin, seen, numbers = made.twin, made.seen, made.law.numbers
    unit, way = twin.kind.unit, twin.joint.way
    yield (
        f"Cancels gravity, {100 * numbers['dry']:.3g} % of dry friction and "
        f"{100 * numbers['damping']:.3g} % of damping: the lower ends of their intervals."
    )
    withheld, half = max((made.error(*at) for at in made.everywhere), key=sum)
    error, shown = withheld + half, f"the logs show {seen.low:.3g} to {seen.high:.3g} {way}"
    torque = "" if twin.ratios else f" ({abs(numbers['p4']) * error:.2g} {effort_unit(twin)})"
    yield (
        f"Off by at most {error:.2g} {unit}{torque} of up to {made.most:.2g} {unit}, up to "
        f"{seen.speed:.3g} {way}/s ({shown}); {withheld:.2g} {unit} of it is friction withheld."
    )
    yield (
        f"Below {numbers['smoothing']:.2g} {way}/s friction has the wanted direction (--smoothing)"
        f"; commands end at {numbers['limit']:.4g} {unit} (--command-limit)."
    )
    if np.ptp(seen.zeros) > 0:
        yield (
            f"The encoder's zero was {min(seen.zeros):.4g} to {max(seen.zeros):.4g} {way}; set it."
        )


def _left_out(twin: Twin) -> Iterator[str]:
    """Name what such a command cannot cancel."""
    p = twin.loaded
    if names := [name for name in _STATES if getattr(p, name)]:
        yield f"Holds in steady motion: {', '.join(names)} is not compensated."
    yield from unheard(twin)
