"""What stands between the joint and the log: the encoder and the controller's clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SHORTEST = 0.1  # an interval is never shorter than this share of the nominal one


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """An incremental encoder.

    Parameters
    ----------
    steps
        Per turn.
    noise
        Standard deviation in rad of white noise added before rounding to a step.
    """

    steps: int = 32768
    noise: float = 0.0

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise InputError("Encoder", "steps", self.steps, "a positive number of steps per turn")
        if not (math.isfinite(self.noise) and self.noise >= 0):
            raise InputError("Encoder", "noise", self.noise, "a finite non-negative number of rad")

    def read(self, angle: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the (n,) readings in rad of (n,) true angles in rad."""
        step = 2 * np.pi / self.steps
        noisy = angle + self.noise * rng.standard_normal(angle.size)
        return np.asarray(step * np.round(noisy / step))


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The controller's cycle: it reads the angle, sets the input and holds it until the next one.

    Parameters
    ----------
    step
        Mean cycle time in s.
    jitter
        Standard deviation in s of each cycle time, normal, cut at a tenth of ``step``.
    """

    step: float = 0.001
    jitter: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.step) and self.step > 0):
            raise InputError("Clock", "step", self.step, "a finite positive number of s")
        if not (math.isfinite(self.jitter) and 0 <= self.jitter <= self.step / 2):
            raise InputError("Clock", "jitter", self.jitter, "between 0 and half the step, in s")

    def stamps(self, duration: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return increasing stamps in s from 0 on, about ``duration`` s of them."""
        count = round(duration / self.step)
        steps = self.step + self.jitter * rng.standard_normal(count)
        return np.concatenate([[0.0], np.cumsum(np.maximum(steps, _SHORTEST * self.step))])
