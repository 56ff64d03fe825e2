"""Re-calibrate while the loop runs, by least squares that forgets, and notice changes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import fdtrc, ndtr, stdtrit

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError, require_number
from butterfly.identification.estimate import Estimate
from butterfly.identification.linearisation import Regression
from butterfly.identification.test_functions import HALF_WIDTH, SPACING
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import LumpedParameters
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
from butterfly.verdict import CONFIDENCE

_FEWEST_TO_DETECT = 20  # stretches of a reference
_LIKELY = 3.84  # drop of a squared statistic within which an instant is as likely, at 95 %
_THRESHOLDS = (1.0, 30.0)  # between which one is looked for
_LEAST = float(np.finfo(float).eps)  # of a sum of squares that is 1 over all of a reference
_ROOT = math.sqrt(2 * math.pi)


@dataclass(frozen=True)
class Cause:
    """One parameter that alone may have changed: its ratio to p1, or p1 over that before."""

    name: str
    before: float
    after: float
    lower: float  # lower, upper: the value before with the 95 % interval of its relative change
    upper: float
    probability: float = 1.0  # of so much that it leaves unexplained, if it changed alone

    @property
    def possible(self) -> bool:
        """Whether the data allow that it changed alone."""
        return self.probability >= 1 - CONFIDENCE


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """A change that was noticed, all times in s."""

    time: float  # when it was noticed
    since: tuple[float, float]  # it happened between
    statistic: float  # largest, above its threshold
    # what single parameters' changes would be, the likeliest first; none until a stretch follows
    causes: tuple[Cause, ...] = ()
    ratios: tuple[Cause, ...] = ()  # changes of all ratios to p1 together

    @property
    def possible(self) -> tuple[Cause, ...]:
        """Parameters that may each have changed alone; none if several have."""
        return tuple(cause for cause in self.causes if cause.possible)


class ChangeDetector:
    """Generalised likelihood ratio of a change of one parameter, p1 or a ratio to it.

    It tests whether the rows since any instant in the last ``window`` s have other parameters than
    the ``reference`` before them, given by its least and its greatest length in s. The statistic is
    the largest score in standard errors. On a sound robot it exceeds the threshold once in
    ``false_alarms_every`` s by Siegmund & Venkatraman's rate (Annals of Statistics 23, 1995) and
    Bonferroni's inequality. What follows a change is the next reference.
    """

    def __init__(
        self,
        *,
        reference: tuple[float, float] = (60.0, 300.0),
        window: float = 30.0,
        false_alarms_every: float = 3600.0,
        half_width: float = HALF_WIDTH,
    ) -> None:
        least, most = reference
        require_number("ChangeDetector", positive=True, window=window, half_width=half_width)
        require_number("ChangeDetector", positive=True, false_alarms_every=false_alarms_every)
        length = SEGMENT * SPACING * half_width
        if not _FEWEST_TO_DETECT * length <= least <= most < math.inf:
            expected = (
                f"two times in s, the shorter first and {_FEWEST_TO_DETECT * length:g} or more"
            )
            raise InputError("ChangeDetector", "reference", reference, expected)
        counts = (math.ceil(duration / length) for duration in (least, most, window))
        self._least, self._most, self._window = counts
        self._rate, self._half_width = length / false_alarms_every, half_width
        self._names: tuple[str, ...] = ()
        self._rows: list[tuple[float, list[float]]] = []  # of the next stretch
        self._stretches: list[_Stretch] = []  # of the reference and since
        self._before: _Reference | None = None  # the latest alarm
        self.threshold = math.nan
        self.alarms: list[Alarm] = []
        self.history: list[tuple[float, float]] = []  # instants in s and statistics

    def add(self, time: float, terms: Mapping[str, float]) -> bool:
        """Take in a row about an instant in s: what p1 and each of n parameters multiplies.

        Return whether a change is noticed.
        """
        if not self._names:
            self._names = tuple(name for name in terms if name != "p1")
            rate, window = self._rate / len(terms), self._window
            self.threshold = brentq(lambda limit: false_alarms(limit, window) - rate, *_THRESHOLDS)
        self._rows.append((time, [*(terms[name] for name in self._names), -terms["p1"]]))
        if len(self._rows) < SEGMENT:
            return False
        table = np.array([row for _, row in self._rows])
        self._stretches.append(_Stretch(self._rows[0][0], time, table.T @ table))
        self._rows = []
        del self._stretches[: -self._most - self._window]
        return self._judge()

    def _judge(self) -> bool:
        """Test the latest stretches, or say more of the change before them."""
        late = self._stretches
        if len(late) <= self._least:
            if self._before is not None and late:
                alone, together = self._before.causes(late)
                self.alarms[-1] = replace(self.alarms[-1], causes=alone, ratios=together)
            return False
        begin = max(self._least, len(late) - self._window)
        reference, tested = _Reference(self._names, late[:begin]), late[begin:]
        statistics = reference.statistics(tested)
        largest = float(statistics.max())
        self.history.append((tested[-1].end, largest))
        if largest <= self.threshold:
            return False
        likely = np.flatnonzero(statistics**2 > largest**2 - _LIKELY)
        first, last = int(likely[0]), int(likely[-1])
        since = tested[first].begin, tested[last].end
        now = tested[-1].end + self._half_width
        self.alarms.append(Alarm(time=now, since=since, statistic=largest))
        self._before, self._stretches = reference, tested[last + 1 :]
        self._judge()
        return True


class _Stretch(NamedTuple):
    """Rows between two instants in s: (n + 1, n + 1) sums of products of x and y."""

    begin: float
    end: float
    sums: Samples


class _Reference:
    """Stretches of a sound robot: (n,) ratios to p1, and the scatter of scores about them.

    Unknowns are in units that make their sums of squares 1. Directions of change are that of p1,
    along the ratios, and those of each ratio; a score's variance goes with the sum of squares of
    its direction.
    """

    def __init__(self, names: tuple[str, ...], stretches: list[_Stretch]) -> None:
        self._names = names
        self._scale = np.sqrt(np.diag(np.sum([s.sums for s in stretches], axis=0)))
        self._scale[self._scale == 0] = self._scale[-1] = 1.0
        self._values, self._freedom = np.zeros(len(names)), len(stretches) - len(names)
        squares, products = self._sums(stretches)
        self._total = squares.sum(axis=0)
        self._values = np.linalg.lstsq(self._total, products.sum(axis=0), rcond=None)[0]
        self._directions = np.column_stack([self._values, np.eye(len(names))])
        _, scores = self._sums(stretches)
        standard = scores @ self._directions / np.sqrt(self._powers(squares))
        self._scatter = standard.T @ standard / self._freedom
        inverse = np.linalg.pinv(self._total, hermitian=True)
        self._variances = np.diag(inverse @ self._covariance(self._total) @ inverse) / 2

    def _sums(self, stretches: list[_Stretch]) -> tuple[Samples, Samples]:
        """Return the (k, n, n) A and (k, n) scores of k stretches."""
        sums = np.array([s.sums for s in stretches]) / np.outer(self._scale, self._scale)
        squares = sums[:, :-1, :-1]
        return squares, sums[:, :-1, -1] - squares @ self._values

    def _powers(self, squares: Samples) -> Samples:
        """(..., n + 1) sums of squares along each direction, of (..., n, n) A."""
        powers = np.einsum("ih,...ij,jh->...h", self._directions, squares, self._directions)
        return np.asarray(np.maximum(powers, _LEAST))

    def _spreads(self, squares: Samples) -> Samples:
        """(..., n + 1) factors of the scores' variances, the error of the ratios included."""
        powers = self._powers(squares)
        return powers * (1 + powers / self._powers(self._total))

    def _covariance(self, square: Samples) -> Samples:
        """(n, n) covariance of the scores of an A."""
        root = np.sqrt(self._spreads(square)[1:])
        return np.asarray(self._scatter[1:, 1:] * np.outer(root, root))

    def statistics(self, stretches: list[_Stretch]) -> Samples:
        """(k,) largest statistic of a change at the beginning of each stretch."""
        squares, scores = (np.cumsum(a[::-1], axis=0)[::-1] for a in self._sums(stretches))
        variances = self._spreads(squares) * np.maximum(np.diag(self._scatter), _LEAST)
        squared = np.max((scores @ self._directions) ** 2 / variances, axis=1)
        # a normal deviate as improbable as Student's t (Wallace, Ann. Math. Stat. 30, 1959)
        freedom = self._freedom
        factor = (8 * freedom + 1) / (8 * freedom + 3)
        return np.asarray(factor * np.sqrt(freedom * np.log1p(squared / freedom)))

    def causes(self, stretches: list[_Stretch]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
        """Say what a change of each parameter alone would be, and that of all ratios together.

        The likeliest parameter comes first. As the covariance is estimated, what a parameter does
        not explain makes less certain what it does (Kelly, IEEE Trans. AES 22, 1986).
        """
        square, score = (stack.sum(axis=0) for stack in self._sums(stretches))
        covariance = self._covariance(square)
        precision = np.linalg.pinv(covariance, hermitian=True)
        moved = square @ self._directions
        known = np.maximum(np.einsum("ih,ij,jh->h", moved, precision, moved), _LEAST)
        sizes = moved.T @ precision @ score / known
        whole = float(score @ precision @ score)
        rest = np.maximum(whole - sizes**2 * known, 0.0)
        others, freedom = score.size - 1, self._freedom - score.size + 1
        fits = fdtrc(others, freedom + 1, rest / self._freedom * (freedom + 1) / others)
        variances = (self._freedom + rest) / freedom / known
        alone = [*map(self._cause, ("p1", *self._names), sizes, variances, fits.tolist())]
        inverse = np.linalg.pinv(square, hermitian=True)
        spread = np.diag(inverse @ covariance @ inverse)
        together = map(self._cause, self._names, inverse @ score, spread)
        return tuple(alone[k] for k in np.argsort(rest).tolist()), tuple(together)

    def _cause(self, name: str, size: float, variance: float, fit: float = 1.0) -> Cause:
        """Return a change of a scaled ratio, or of all by a factor, with its interval."""
        k = -1 if name == "p1" else self._names.index(name)
        if k >= 0 and self._values[k]:
            variance += (size / self._values[k]) ** 2 * self._variances[k]
        reach = float(stdtrit(self._freedom, 0.5 + CONFIDENCE / 2)) * math.sqrt(variance)
        sizes = np.array([size, size - reach, size + reach])
        before, values = 1.0, 1 / (1 + sizes)
        if k >= 0:
            before = float(self._values[k] / self._scale[k])
            values = before + sizes / self._scale[k]
        after, *limits = values.tolist()
        return Cause(name, before, after, min(limits), max(limits), fit)


def false_alarms(threshold: float, window: int) -> float:
    """Return how often a statistic's absolute value exceeds a threshold, per stretch."""
    lengths = np.arange(1, window + 1)
    half = threshold / np.sqrt(lengths) / 2
    overshoot = (ndtr(half) - 0.5) / half / (half * ndtr(half) + np.exp(-(half**2) / 2) / _ROOT)
    density = math.exp(-(threshold**2) / 2) / _ROOT
    return float(0.5 * threshold**3 * density * np.sum((overshoot / lengths) ** 2))


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
