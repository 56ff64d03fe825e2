"""Re-calibrate while the loop runs, by recursive least squares with forgetting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear

from butterfly.errors import InputError, require_number
from butterfly.identify.weak_signals import SPACING, weak_signals
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.controller import gain_for
from butterfly.orbit.recalibration import RecalibrationOptions
from butterfly.orbit.regression import BASE, least
from butterfly.plant.motor import CommandPath

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.orbit.controller import EnergyShaping, Target
    from butterfly.plant.bench import ControlLaw
    from butterfly.plant.motor import Reading

_FEWEST = 20  # readings in a test function
_MARGIN = 3  # readings by which the buffer is longer than a test function


class OnlineRecalibration:
    """Ratios p_i/p1 by the weak form, updated twice in each half-width of its test functions.

    The recursion keeps the normal equations, old ones fading as exp(-age/memory), and solves them
    under the constraints p2, p4, friction >= 0; without constraints this is recursive least
    squares with forgetting (Ljung, System Identification, 2nd ed., 11.2).

    Parameters
    ----------
    zero
        Encoder reading in rad of the hanging hand.
    terms
        Estimated besides p2, p3, p4.
    memory
        Time in s over which the past fades.
    options
        For balance, half-width, delay and cogging periods; its candidates are not used.
    """

    def __init__(
        self,
        zero: float = 0.0,
        *,
        terms: tuple[str, ...] = ("coulomb",),
        memory: float = 20.0,
        options: RecalibrationOptions = RecalibrationOptions(),
    ) -> None:
        require_number("OnlineRecalibration", positive=True, memory=memory)
        if "compression" in terms:
            raise InputError("OnlineRecalibration", "terms", "compression", "terms linear in u")
        self._zero = zero
        self._options = options
        self._names = (*BASE[1:], *terms)
        self._keep = math.exp(-SPACING * options.half_width / memory)
        self._information = np.zeros((len(self._names), len(self._names)))
        self._moment = np.zeros(len(self._names))
        self._samples: list[tuple[float, float, float]] = []
        self._rows = 0

    def observe(self, reading: Reading, command: float) -> bool:
        """Take in a reading and the command that followed it; return whether a row was added.

        After a pause of the loop it begins with an empty window.
        """
        if self._samples and reading.time - self._samples[-1][0] > self._options.half_width:
            self._samples.clear()
        self._samples.append((reading.time, command, reading.angle - self._zero))
        needed = 2 * (self._options.half_width + self._options.delay)
        enough = len(self._samples) >= _FEWEST
        if not enough or reading.time - self._samples[_MARGIN][0] < needed:
            return False
        added = self._add_row()
        start = self._samples[0][0] + SPACING * self._options.half_width
        self._samples = [sample for sample in self._samples if sample[0] >= start]
        return added

    def _add_row(self) -> bool:
        options = self._options
        time, inputs, angle = (np.array(column) for column in zip(*self._samples, strict=True))
        log = Log(
            time=time,
            input=inputs,
            angle=angle,
            input_kind=InputKind.TORQUE,
            intersample=Intersample.ZERO_ORDER_HOLD,
            source="control loop",
        )
        signals = weak_signals(
            log,
            0.0,
            options.half_width,
            options.delay,
            balance=options.balance,
            cogging_periods=options.cogging_periods,
        )
        if not signals.moving[0]:
            return False
        row = np.array([signals.mean[name][0] for name in self._names])
        self._information = self._keep * self._information + np.outer(row, row)
        self._moment = self._keep * self._moment - row * signals.mean["p1"][0]
        self._rows += 1
        return True

    @property
    def is_ready(self) -> bool:
        """Whether there is twice as much data as unknowns."""
        return self._rows >= 2 * len(self._names)

    def ratios(self) -> NDArray[np.float64]:
        """(n,) current p2/p1, p3/p1, p4/p1 and terms over p1."""
        scale = np.sqrt(np.diag(self._information))
        scale[scale == 0] = 1.0  # a column of zeros stays without effect
        values, axes = np.linalg.eigh(self._information / np.outer(scale, scale))
        root = np.sqrt(np.maximum(values, values[-1] * 1e-14))
        rows, target = (axes * root).T, (axes / root).T @ (self._moment / scale)
        bounds = (least(self._names), np.inf)
        return np.asarray(lsq_linear(rows, target, bounds, method="bvls").x / scale)

    def parameters(self, inertia: float = 1.0) -> LumpedParameters:
        """Return the current parameters of the hand with what it carries, p1 = ``inertia``."""
        scaled = dict(zip(self._names, (inertia * self.ratios()).tolist(), strict=True))
        return LumpedParameters(p1=inertia, **scaled, cogging_periods=self._options.cogging_periods)


class SelfTuning:
    """An energy-shaping law that replaces its beliefs by on-line estimates as it runs.

    Parameters
    ----------
    law
        To be retuned.
    online
        The estimator.
    target
        Orbit of given parameters that is to be held.
    multiplier
        Wanted Floquet multiplier, for gamma.
    inertia
        p1 of the hand with what it carries, which sets the scale.
    every
        Time in s between two retunings.
    commands
        What makes the commands of ``law``, such as `Dithered` about it; the law itself if not
        given. The estimator must see the commands that are set, so a dither belongs in here.
    path
        That saturates and rounds the commands, so that the estimator sees them as they are set.
    """

    def __init__(
        self,
        law: EnergyShaping,
        online: OnlineRecalibration,
        target: Target,
        *,
        multiplier: float,
        inertia: float,
        every: float,
        commands: ControlLaw | None = None,
        path: CommandPath = CommandPath(),
    ) -> None:
        require_number("SelfTuning", positive=True, every=every, inertia=inertia)
        self._law, self._online, self._target = law, online, target
        self._commands, self._path = commands or law, path
        self._multiplier, self._inertia, self._every = multiplier, inertia, every
        self._next = every

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        if reading.time >= self._next and self._online.is_ready:
            self._next = reading.time + self._every
            believed = self._online.parameters(self._inertia)
            if believed.p3 > 0 and believed.p4 > 0:
                orbit = self._target(believed)
                self._law.retune(orbit, gain_for(orbit, self._multiplier))
        command = self._commands(reading)
        self._online.observe(reading, self._path.shape(command))
        return command
