"""A joint's gravity and friction, cancelled: C99 or Python, by the law of `compensation_law`.

Friction is compensated to the lower ends of its intervals, so that what is left still brakes: more
than the joint has would drive it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

import numpy as np

from butterfly.identification.free_run import FreeRun
from butterfly.identification.levels import FEW, SPREADS
from butterfly.identification.sensor_errors import SensorErrors
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.twin.c import explained, fields_of, rendered
from butterfly.twin.compensation_law import NEUTRAL, SHARES, CompensationLaw, limited, unlimited
from butterfly.twin.forms import Options
from butterfly.twin.languages import C, Python
from butterfly.twin.plain import effort_unit
from butterfly.twin.reduced import NUMBER, Fields
from butterfly.twin.translate import Translator
from butterfly.twin.twin import Twin, Written, unheard

_ANGLES, _SPEEDS = 13, 5  # at which errors are computed
_CREEPS = 0.05  # rad/s, the smoothing speed where no log tells it
_STATES = ("base_compliance", "bristle_stiffness", "time_constant")  # that add a state


@dataclass(frozen=True, kw_only=True, eq=False)
class Compensation:
    """The law of a joint, and where logs show that it moves; all round, to 1 rad/s, without any."""

    twin: Twin
    law: CompensationLaw
    low: float = -math.pi
    high: float = math.pi
    speed: float = 1.0
    zeros: tuple[float, ...] = (0.0,)

    @classmethod
    def of(cls, twin: Twin) -> Compensation:
        """Return it, with the shares of friction that are certain."""
        made, smoothing = cls(twin=twin, law=CompensationLaw.of(twin)), _CREEPS
        if recorded := [(log.opened, each) for log, each in twin.recorded() if log.rms_speed]:
            some = recorded[:: max(len(recorded) // FEW, 1)]
            blurs = [_blur(setting.run(setting.simulation(log))) for log, setting in some]
            smoothing = float(np.median(blurs))
            made = replace(
                made,
                low=float(min((log.angle - setting.zero).min() for log, setting in recorded)),
                high=float(max((log.angle - setting.zero).max() for log, setting in recorded)),
                speed=max(log.top_speed for log, _ in recorded),
                zeros=tuple(setting.zero for _, setting in recorded),
            )
        seen = [*made.places(made.low, made.high)]
        shares = {each: min(made.law.certain(each, *at) for at in seen) for each in SHARES}
        settings = {"zero": float(np.median(made.zeros)), "smoothing": smoothing, **shares}
        made = replace(made, law=made.law.having(**settings))
        return replace(made, law=made.law.having(limit=min(twin.limit, made.most)))

    def places(self, low: float, high: float) -> Iterator[tuple[float, float]]:
        """Yield angles between limits, and velocities as fast as was seen."""
        speeds = np.linspace(-self.speed, self.speed, _SPEEDS)
        yield from product(np.linspace(low, high, _ANGLES).tolist(), speeds.tolist())

    @property
    def slides(self) -> bool:
        """Whether the joint is a slide."""
        return self.twin.joint is JointKind.SLIDE

    @property
    def everywhere(self) -> Iterator[tuple[float, float, float]]:
        """Yield readings, velocities and directions: at all angles of a hinge."""
        ends = (self.low, self.high) if self.slides else (-math.pi, math.pi)
        for angle, velocity in self.places(*ends):
            yield angle + self.law.numbers["zero"], velocity, math.copysign(1.0, velocity)

    @property
    def most(self) -> float:
        """The largest command without a limit."""
        return max(abs(float(unlimited(*at, self.law.constants))) for at in self.everywhere)

    @property
    def worst(self) -> tuple[float, float]:
        """The largest error of a command, and what of it is withheld."""
        withheld, half = max((self.law.error(*at) for at in self.everywhere), key=sum)
        return withheld + half, withheld


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


def as_compensation(twin: Twin, options: Options) -> Written:
    """Return the compensation of a joint as a C header or a Python module."""
    made = Compensation.of(twin)
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
        parameters=[(each, repr(numbers[each]), explained(each, twin)) for each in read],
        steps=[[repr(step.get(each, 0.0)) for each in read] for step in steps],
        functions=language.text(),
        unused=[each for each in ("angle", "velocity", "direction") if each not in law.arguments],
        unlimited=language.call(law, given | {"c": "p"}),
        moved=language.call(law, given | {"c": "q" if python else "&q"}),
        limited=language.call(within, given),
        said=(*said, *left_out),
    )
    about = f"{'a Python module' if python else f'{name}.h, a C99 header'}, in {twin.kind.unit}"
    return Written(text=text, about=about, left_out=left_out, title="Compensation", said=said)


def _said(made: Compensation) -> Iterator[str]:
    """Say what is compensated, and how far it may be off."""
    numbers, unit, way = made.law.numbers, made.twin.kind.unit, made.twin.joint.way
    parts = {each: f"{100 * numbers[each]:.3g} %" for each in SHARES}
    more = f" (of its Stribeck excess {parts['excess']})" if numbers["stribeck"] else ""
    if made.twin.estimate is None:
        yield "Cancels gravity and all friction: its values are taken as exact."
    else:
        yield (
            f"Cancels gravity, {parts['dry']} of dry friction{more} and {parts['damping']} of "
            "damping: the lower ends of their intervals."
        )
        error, withheld = made.worst
        torque = f"{abs(numbers['p4']) * error:.2g} {effort_unit(made.twin)}"
        shown = f"{made.low:.3g} to {made.high:.3g} {way}"
        where = f"at {shown}" if made.slides else f"at any angle (the logs show {shown})"
        yield (
            f"Off by at most {error:.2g} {unit} ({torque}) of up to {made.most:.2g} {unit} {where} "
            f"and up to {made.speed:.3g} {way}/s; {withheld:.2g} {unit} of it is friction withheld."
        )
    yield (
        f"Below {numbers['smoothing']:.2g} {way}/s (smoothing) friction has the wanted direction; "
        f"commands end at {numbers['limit']:.4g} {unit} (limit)."
    )
    if np.ptp(made.zeros) > 0:
        low, high = min(made.zeros), max(made.zeros)
        yield f"The encoder's zero was {low:.4g} to {high:.4g} {way}: set it (zero)."


def _left_out(twin: Twin) -> Iterator[str]:
    """Name what such a command cannot cancel."""
    if names := [name for name in _STATES if getattr(twin.loaded, name)]:
        yield f"Holds in steady motion: {', '.join(names)} is not compensated."
    yield from unheard(twin)
