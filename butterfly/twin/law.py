"""The law of compensation: the command that holds a joint in steady motion, and what it is off by.

It is written once, of the kernel's own functions, and translated to C and Python (`translate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from butterfly.errors import InputError
from butterfly.identification.levels import ROUNDING, SPREADS
from butterfly.model.kernel.equation import friction_level, pull
from butterfly.model.parameters import LumpedParameters
from butterfly.twin.twin import Twin

_ROUNDS = 30  # in a gear, whose friction grows with the torque that overcomes it
NEUTRAL = {"zero": 0.0, "dry": 1.0, "damping": 1.0, "smoothing": 1.0, "limit": math.inf}
"""How a law is used: the encoder's zero, shares of friction, smoothing, largest command."""


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
        motor = torque - c.back_emf * velocity
        torque = steady + c.dry * sign * friction_level(angle, velocity, sign, motor, load, c)
        if c.geared == 0.0:
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
class Law:
    """The numbers of a law, and (n, m) steps of these as large as the intervals of an estimate."""

    numbers: Mapping[str, float]  # of the loaded joint, by name, and how it is used
    geared: bool
    steps: tuple[Mapping[str, float], ...]  # along independent errors; none if all is exact

    @classmethod
    def of(cls, twin: Twin, **settings: float) -> Law:
        """Return the law of a joint with what it carries; InputError if errors are unknown."""
        twin.parameters.require_gain("export")
        estimate = twin.estimate
        steps: list[dict[str, float]] = []
        nominal = _loaded(twin, {})
        if estimate is not None:
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
                step = {k: (each - nominal[k]) / ROUNDING for k, each in moved.items()}
                steps.append({k: each for k, each in step.items() if each})
        numbers = nominal | NEUTRAL | settings
        return cls(numbers=numbers, geared=twin.loaded.geared, steps=tuple(steps))

    def having(self, **settings: float) -> Law:
        """Return the law with other settings."""
        return Law(numbers={**self.numbers, **settings}, geared=self.geared, steps=self.steps)

    @cached_property
    def constants(self) -> SimpleNamespace:
        """The numbers as the functions of this module take them."""
        return SimpleNamespace(**self.numbers, geared=float(self.geared))

    def half_width(self, of: Callable[[Any], float]) -> float:
        """Return the half-width, to first order, of the interval of a function of the constants."""
        value, squares = of(self.constants), 0.0
        for step in self.steps:
            moved = {name: self.numbers[name] + ROUNDING * each for name, each in step.items()}
            change = of(self.having(**moved).constants) - value
            squares += (change / ROUNDING) ** 2
        return math.sqrt(squares)


def _loaded(twin: Twin, moved: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of the loaded joint by name, those of the bare joint moved."""
    p = twin.parameters
    p = replace(p, **{name: getattr(p, name) + each for name, each in moved.items()})
    p = p.with_added_mass(twin.added)
    return {each.name: float(getattr(p, each.name)) for each in fields(LumpedParameters)}
