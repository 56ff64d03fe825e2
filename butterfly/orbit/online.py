"""Re-calibrate while the loop runs, by least squares that forgets, and watch for changes."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import KW_ONLY, dataclass

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError, require_number
from butterfly.identification.estimate import Estimate
from butterfly.identification.findings import FindingKind
from butterfly.identification.linearisation import Regression
from butterfly.identification.test_functions import SPACING
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.change_detection import ChangeDetector
from butterfly.orbit.controller import EnergyShaping, Target, gain_for
from butterfly.orbit.recalibration import (
    BASE,
    LEAST,
    SEGMENT,
    RecalibrationOptions,
    estimate_of,
    from_ratios,
)
from butterfly.plant.motor import CommandPath, ControlLaw, Reading
from butterfly.plant.robot import RobotChange

_FEWEST = 20  # readings in a test function
_MARGIN = 3  # readings by which the buffer is longer than a test function
_FORGOTTEN = 12.0  # memories after which a row, its weight e^-12, is thrown away


class OnlineRecalibration:
    """Ratios p_i/p1 by the weak form, updated twice in each half-width of its test functions.

    The rows of the past fade as exp(-age/memory) and are solved under the constraints p2, p4,
    friction >= 0; without constraints this is recursive least squares with forgetting (Ljung,
    System Identification, 2nd ed., 11.2). ``terms`` are estimated besides p2, p3, p4, not those
    that the options have as candidates. What was before a change that the ``detector`` notices is
    forgotten.
    """

    def __init__(
        self,
        zero: float = 0.0,
        *,
        terms: tuple[str, ...] = ("coulomb",),
        memory: float = 20.0,
        options: RecalibrationOptions = RecalibrationOptions(),
        detector: ChangeDetector | None = None,
    ) -> None:
        require_number("OnlineRecalibration", positive=True, memory=memory)
        if "compression" in terms:
            raise InputError("OnlineRecalibration", "terms", "compression", "terms linear in u")
        self._zero, self._options, self._detector = zero, options, detector
        self._names = (*BASE[1:], *terms)
        self._keep = math.exp(-SPACING * options.half_width / memory)
        longest = math.ceil(_FORGOTTEN / -math.log(self._keep))
        self._rows: deque[tuple[int, float, Samples]] = deque(maxlen=longest)
        self._samples: list[tuple[float, float, float]] = []
        self._count = 0

    def observe(self, reading: Reading, command: float) -> bool:
        """Take in a reading and the command that followed it; return whether a row was added."""
        if self._samples and reading.time - self._samples[-1][0] > self._options.half_width:
            self._samples.clear()
        self._samples.append((reading.time, command, reading.angle - self._zero))
        needed = 2 * (self._options.half_width + self._options.delay)
        if len(self._samples) < _FEWEST or reading.time - self._samples[_MARGIN][0] < needed:
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
        names = ("p1", *self._names)
        signals = options.averaging(log, 0.0).signals(names, delay=options.delay)
        if not signals.moving[0]:
            return False
        middle, terms = float(signals.time[0]), {name: signals.mean[name][0] for name in names}
        self._rows.append((self._count, middle, np.array([*terms.values()])))
        self._count += 1
        if self._detector is not None and self._detector.add(middle, terms):
            changed = self._detector.alarms[-1].since[1]
            while self._rows and self._rows[0][1] <= changed:
                self._rows.popleft()
        return True

    @property
    def is_ready(self) -> bool:
        """Whether there is twice as much data as unknowns."""
        return len(self._rows) >= 2 * len(self._names)

    def ratios(self) -> Samples:
        """(n,) current p2/p1, p3/p1, p4/p1 and terms over p1."""
        return self._regression().solve().values

    def parameters(self, inertia: float = 1.0) -> LumpedParameters:
        """Return the current parameters of the hand with what it carries, p1 = ``inertia``."""
        ratios = dict(zip(self._names, self.ratios().tolist(), strict=True))
        return from_ratios(ratios, inertia, self._options.cogging_periods)

    def estimate(self) -> Estimate:
        """Return the current ratios to p1, and how far to trust them."""
        count = len(self._rows)
        if count <= 2 * SEGMENT:
            moving = f"{count * SPACING * self._options.half_width:.3g} s of motion"
            raise IdentifiabilityError(f"{moving} are too short for standard errors")
        regression, run = self._regression(), np.zeros(count, dtype=np.intp)
        return estimate_of(regression, run, regression.solve(), "on-line", FindingKind.RATIOS)

    def _regression(self) -> Regression:
        """Put the rows together, each fading with its age, p1 counting as 1."""
        numbers = np.array([number for number, *_ in self._rows])
        rows = np.array([row for *_, row in self._rows])
        rows *= self._keep ** (0.5 * (numbers[-1] - numbers))[:, None]
        return Regression(
            names=self._names,
            rows=rows[:, 1:],
            target=-rows[:, 0],
            cluster=numbers // SEGMENT,
            least=LEAST,
        )


@dataclass(eq=False)
class SelfTuning:
    """An energy-shaping law that replaces its beliefs by on-line estimates as it runs.

    Every so many s it is retuned to the target orbit of the present estimates, p1 = ``inertia`` of
    the hand with what it carries. The estimator must see the commands as they are set: a dither
    (`Dithered` about the law) belongs into ``commands``; the ``path`` saturates and rounds them.
    """

    law: EnergyShaping
    online: OnlineRecalibration
    target: Target
    _: KW_ONLY
    multiplier: float
    inertia: float
    every: float
    commands: ControlLaw | None = None
    path: CommandPath = CommandPath()

    def __post_init__(self) -> None:
        require_number("SelfTuning", positive=True, every=self.every, inertia=self.inertia)
        self._next = self.every

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        if reading.time >= self._next and self.online.is_ready:
            self._next = reading.time + self.every
            believed = self.online.parameters(self.inertia)
            if believed.p3 > 0 and believed.p4 > 0:
                orbit = self.target(believed)
                self.law.retune(orbit, gain_for(orbit, self.multiplier))
        command = (self.commands or self.law)(reading)
        self.online.observe(reading, self.path.shape(command))
        return command


@dataclass(frozen=True, kw_only=True)
class WatchPlan:
    """How a self-tuning loop is watched; the dither separates p2, p4 and friction."""

    duration: float  # in s
    dither: float = 0.3  # share of the control's rms
    memory: float = 20.0  # of the estimates, in s
    every: float = 1.0  # s between retunings
    false_alarms_every: float = 3600.0  # s
    change: RobotChange | None = None  # of a simulated robot, to be noticed

    def __post_init__(self) -> None:
        require_number("watch", dither=self.dither, memory=self.memory, every=self.every)
        require_number("watch", positive=True, duration=self.duration)
        ChangeDetector(false_alarms_every=self.false_alarms_every)  # or it is refused


@dataclass(frozen=True, kw_only=True, eq=False)
class Watched:
    """A run that was watched."""

    log: Log
    orbit: Orbit  # that was to be held at first
    detector: ChangeDetector  # with what it noticed
    change: RobotChange | None  # what was to be noticed
