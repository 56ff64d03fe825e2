"""The weak form's regression: averages over test functions, solved about delay and drive.

The encoder's reading at model angle 0, of each log, and how it was found.

It is given; or it is the middle of the steady swings of sines with the same added mass; or the
motion determines it; or it is a guess. Readings that differ by whole turns are the same.

From the motion, it follows from the weak form of logs with one added mass, whatever their inputs.
Of unit inertia, as no scale is needed, it yields the two parts of gravity, and

    p3 sin th + p3_offset cos th = sqrt(p3^2 + p3_offset^2) sin(th - z),  z = -atan2(p3_offset, p3).

A constant torque is fitted too where it differs clearly from 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.consistency import is_driven
from butterfly.identification.fit import MOST, Fit
from butterfly.identification.limits import (
    WEIGHED,
    Conditioning,
    cluster_covariance,
    independent_cells_of,
)
from butterfly.identification.linearisation import Linearisation, Regression
from butterfly.identification.segments import LONGEST_STEP
from butterfly.identification.stagewise import STRIBECK, stribeck_velocity
from butterfly.identification.test_functions import (
    HALF_WIDTH,
    LEAST_SAMPLES,
    Averaging,
    half_width_of,
)
from butterfly.identification.trust import CLEARLY, SHOWS, Ending
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.prior import Known, Penalty, Prior
from butterfly.model.terms import (
    DRIVE,
    IDEAL,
    OF_GRAVITY,
    OF_INPUT,
    PARAMETERS,
    PLAIN,
    SETTINGS,
    TERMS,
    DriveTerms,
    FrictionTerms,
)
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.verdict import CONFIDENCE, SPREADS

_RESTING = 0.5  # share of the windows in motion, below which a joint rests between its moves

_SETTINGS = {"delay", *DRIVE, *SETTINGS}  # without columns, if known
_BY_MASS = "mass_inertia"
_LATEST = 0.25  # of the shortest log, for a delay
_LEAST = np.finfo(float).tiny


def averaging_of(
    log: Log, zero: float, half_width: float | None = None, periods: float = 1.0
) -> Averaging:
    """Return averages of a log about a zero in rad, over its own half-width if none is given.

    A joint that rests between its moves has short windows, whatever its noise.
    """
    width, settings = half_width_of(log), FrictionTerms(cogging_periods=periods)
    averages = Averaging(log, zero, width if half_width is None else half_width, settings)
    short = max(HALF_WIDTH, LEAST_SAMPLES * log.mean_step)
    if half_width is None and width > short and np.mean(averages.moving(0.0)) < _RESTING:
        return Averaging(log, zero, short, settings)
    return averages


@dataclass(frozen=True, kw_only=True, eq=False)
class About:
    """The test functions of logs, and the linearisation point of their equations."""

    windows: Sequence[Averaging] = ()
    # (m,) mask of the test functions of each log to use; if (), those where the joint moves
    use: Sequence[NDArray[np.bool_]] = ()
    names: tuple[str, ...]  # of the parameters to be found
    known: Prior  # of the robot; exactly known parameters are not among the names
    slow: float = FrictionTerms.stribeck_velocity  # in rad/s
    periods: float = 1.0  # of cogging in a turn
    delay: float = 0.0  # from input to torque, in s
    drive: DriveTerms = IDEAL  # model of the delivered input
    gain: float  # p4, 0 if unknown
    equal_logs: bool = True  # whether each log has the same weight, or else each acceleration
    variance: float = 1.0  # of a row, relative to which priors are weighted

    def regression(self) -> Regression:
        """Return the regression of all logs."""
        use = self.use or [window.moving(self.delay) for window in self.windows]
        equations = [self._of_log(*pair) for pair in zip(self.windows, use, strict=True)]
        parts, targets = zip(*equations, strict=True)
        rows = np.concatenate(parts)
        if not self.gain:  # p4 is found first
            rows[:, [TERMS[name].of_gain for name in self.names]] = 0.0
        known, about = self.known.parameters, {"delay": self.delay}
        return Regression(
            names=self.names,
            rows=rows,
            target=np.concatenate(targets),
            cluster=np.repeat(np.arange(len(targets)), [target.size for target in targets]),
            about=about | vars(self.drive),
            least=self.known.lower,
            gain=self.gain,
            prior=Penalty.of(self.names, known, self.variance, about),
        )

    def _of_log(self, window: Averaging, used: NDArray[np.bool_]) -> tuple[Samples, Samples]:
        """(m, n) regressors and (m,) targets where used, the inertial term scaled to norm 1."""
        given = {name: value for name, value in self.known.fixed.items() if name not in _SETTINGS}
        signals = window.signals(
            [name for name in (*self.names, *given, "p1", "p3") if name != _BY_MASS],
            delay=self.delay,
            drive=self.drive,
            stribeck_velocity=self.slow,
        )
        mean = {name: column[used] for name, column in signals.mean.items()}
        mean[_BY_MASS] = window.added.swung * mean["p1"]
        size = (float(np.linalg.norm(mean["p1"])) if self.equal_logs else 0.0) or 1.0
        torque = window.added.inertia * mean["p1"] + window.added.gravity_moment * mean["p3"]
        for name, value in given.items():
            torque = torque + value * mean[name]
        return np.column_stack([mean[name] for name in self.names]) / size, -torque / size

    @property
    def latest(self) -> float:
        """Largest delay in s that the shortest log allows."""
        return _LATEST * min(window.duration for window in self.windows)

    def moved(self, values: Samples, latest: float, variance: float) -> About:
        """Return the linearisation point at (n,) values, with the delay limited to ``latest`` s."""
        named = self.known.fixed | dict(zip(self.names, values.tolist(), strict=True))
        drive = DriveTerms(**{name: named[name] for name in DRIVE if name in named})
        delay = min(max(named["delay"], -latest), latest)
        return replace(self, delay=delay, gain=named["p4"], drive=drive, variance=variance)

    def near(self, other: About) -> bool:
        """Whether delay and drive are nearly those of another point."""
        mine, theirs = vars(self.drive), vars(other.drive)
        still = all(abs(mine[n] - theirs[n]) <= SHOWS * mine[n] for n in DRIVE)
        return still and abs(self.delay - other.delay) < SHOWS * LONGEST_STEP


@dataclass(frozen=True, kw_only=True, eq=False)
class WeakFit:
    """A solution, and the equations about it."""

    about: About  # linearisation point of the equations
    regression: Regression  # regression, fit: the equations, and the solution
    fit: Fit

    @classmethod
    def of(
        cls,
        windows: Sequence[Averaging],
        names: tuple[str, ...],
        known: Prior,
        periods: float = 1.0,
    ) -> WeakFit:
        """Return the likelier fit, uncertain values held or free, as delays may diverge."""
        exact = known.fixed
        about = About(
            windows=windows,
            names=names,
            known=known,
            slow=stribeck_velocity(max(window.fastest for window in windows), known),
            periods=periods,
            delay=exact.get("delay", 0.0),
            gain=exact.get("p4", 0.0),
            drive=DriveTerms(**{name: exact[name] for name in DRIVE if name in exact}),
        )
        held = cls.converged(about)
        if not known.uncertain:
            return held
        free = cls.converged(replace(about, variance=0.0))
        if not 0 <= free.about.delay < about.latest:
            return held
        weighed = cls.converged(replace(free.about, variance=free.solved.realised_variance))
        rows = weighed.cost / max(weighed.about.variance, _LEAST)  # worth as many independent ones
        return min(
            (held, weighed), key=lambda fit: rows * math.log(fit.cost or _LEAST) + fit.penalty
        )

    @classmethod
    def converged(cls, about: About) -> WeakFit:
        """Solve, and again about the solution, until delay, drive and scatter converge."""
        weighs, latest = bool(about.known.uncertain and about.variance), about.latest
        cells, settled = independent_cells_of(len(about.windows), len(about.names)), False
        step, share, values = 0.0, 1.0, np.zeros(len(about.names))
        for _ in range(MOST):
            regression = about.regression()
            solution = regression.solve()
            moved, values = solution.values - values, solution.values
            solved = regression.linearised(solution, cells=cells) if weighs else None
            variance = about.variance if solved is None else solved.realised_variance
            before, about = about, about.moved(solution.values, latest, variance)
            if step * (about.delay - before.delay) < 0:  # it oscillates
                share /= 2
            step = share * (about.delay - before.delay)
            about = replace(about, delay=before.delay + step)
            still = abs(variance - before.variance) <= WEIGHED * variance
            settled = bool(about.near(before) and still)
            if settled or abs(about.delay) == latest:
                about = replace(about, variance=before.variance)
                break
        solved = solved or regression.linearised(solution, cells=cells)
        fit = Fit(linearisation=solved)
        if not settled:
            fit = replace(fit, ending=Ending.STOPPED, unsettled=moved)
        return cls(about=about, regression=regression, fit=fit)

    @property
    def solved(self) -> Linearisation:
        """The equations about the solution."""
        return self.fit.linearisation

    @property
    def cost(self) -> float:
        """Sum of the squared residuals."""
        return float(np.sum(self.solved.residuals**2))

    @property
    def penalty(self) -> float:
        """Sum of the penalties of the uncertain known values (see `Known.penalty`)."""
        return sum(prior.penalty(self.values[n]) for n, prior in self.about.known.uncertain.items())

    @property
    def values(self) -> dict[str, float]:
        """Values by name, exactly known ones included."""
        return self.about.known.fixed | self.solved.named

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values that were fitted."""
        return self.solved.names

    @property
    def settings(self) -> dict[str, float]:
        """What its terms were taken at."""
        scale = {"stribeck_velocity": self.about.slow} if STRIBECK in self.about.names else {}
        return scale | {"cogging_periods": self.about.periods}

    @property
    def parameters(self) -> LumpedParameters:
        """All parameters of the bare hand."""
        return LumpedParameters(**self.settings | self.values)


class OffsetKind(StrEnum):
    """How a zero was found."""

    GIVEN = "given"
    SWING = "steady swing"
    FIT = "from the motion"
    GUESS = "guess"


@dataclass(frozen=True, kw_only=True)
class EncoderOffset:
    """An encoder reading in rad where the model's angle is 0, and its standard uncertainty."""

    value: float  # value, uncertainty: in rad; of a steady swing's middle no uncertainty is stated
    uncertainty: float = 0.0
    kind: OffsetKind  # how it was found

    def __str__(self) -> str:
        doubt = f" ± {self.uncertainty:.1g}" if self.uncertainty else ""
        return f"{round(self.value, 4) + 0.0:.4f}{doubt} rad ({self.kind})"


def near(reading: float, home: float) -> float:
    """Return the reading in rad plus the whole turns that bring it nearest to another."""
    return home + math.remainder(reading - home, 2 * math.pi)


def reading_of(log: Log, zeros: Mapping[AddedMass, float]) -> float:
    """Return a log's zero in rad: the known one, or that of its added mass."""
    return zeros[log.added_mass] if log.zero is None else log.zero.value


def encoder_offsets(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None]
) -> tuple[EncoderOffset, ...]:
    """Find the zero of each of n logs, with increasing stamps."""
    unknown: dict[AddedMass, list[tuple[Log, ResponsePoint | None]]] = {}
    for log, point in zip(logs, points, strict=True):
        if log.zero is None:
            unknown.setdefault(log.added_mass, []).append((log, point))
    zeros: dict[AddedMass, EncoderOffset] = {}
    if unknown:
        home = _guess([log for log in logs if log.zero is None]).value
        zeros = _together({mass: _of_mass(pairs, home) for mass, pairs in unknown.items()})
    kind = OffsetKind.GIVEN
    return tuple(
        zeros[log.added_mass]
        if log.zero is None
        else EncoderOffset(value=log.zero.value, uncertainty=log.zero.uncertainty, kind=kind)
        for log in logs
    )


def offset_errors(zeros: Sequence[EncoderOffset] | Sequence[Known]) -> Samples:
    """(k, n) standard uncertainties in rad of k independent errors in the zeros of n logs."""
    uncertain = sorted({zero for zero in zeros if zero.uncertainty}, key=lambda zero: zero.value)
    rows = [[source.uncertainty * (zero == source) for zero in zeros] for source in uncertain]
    return np.array(rows, dtype=float).reshape(len(uncertain), len(zeros))


def _turns(log: Log) -> bool:
    return float(np.ptp(log.angle)) > 2 * np.pi


def _of_mass(pairs: Sequence[tuple[Log, ResponsePoint | None]], home: float) -> EncoderOffset:
    """Return the zero that logs with one added mass share, within half a turn of ``home`` rad."""
    middles = [near(point.angle.offset, home) for log, point in pairs if point and not _turns(log)]
    if middles:
        return EncoderOffset(value=float(np.median(middles)), kind=OffsetKind.SWING)
    logs = [log for log, _ in pairs]
    best, fitted = _guess(logs), fitted_offset(logs)
    if fitted is not None and fitted.uncertainty <= best.uncertainty:
        best = fitted
    return replace(best, value=near(best.value, home))


def _guess(logs: Sequence[Log]) -> EncoderOffset:
    """Return a guess: the mean of the log that moves least, or its beginning if it turns."""
    still = min(logs, key=lambda log: log.rms_motion)
    if _turns(still):
        value, uncertainty = float(still.angle[0]), math.pi / math.sqrt(3)
    else:
        value, uncertainty = float(np.mean(still.angle)), still.rms_motion
    return EncoderOffset(value=value, uncertainty=uncertainty, kind=OffsetKind.GUESS)


def _together(zeros: Mapping[AddedMass, EncoderOffset]) -> dict[AddedMass, EncoderOffset]:
    """Return the zeros, fitted ones averaged if they agree, and guesses replaced by the best."""
    joint = dict(zeros)
    fitted = {mass: zero for mass, zero in zeros.items() if zero.kind is OffsetKind.FIT}
    if fitted:
        home = min(zero.value for zero in fitted.values())
        values = np.array([near(zero.value, home) for zero in fitted.values()])
        weights = np.array([zero.uncertainty for zero in fitted.values()]) ** -2.0
        mean, error = float(np.average(values, weights=weights)), float(weights.sum() ** -0.5)
        if (np.abs(values - mean) * np.sqrt(weights) <= CLEARLY).all():
            one = EncoderOffset(value=mean, uncertainty=error, kind=OffsetKind.FIT)
            joint |= dict.fromkeys(fitted, one)
    best = min(joint.values(), key=lambda zero: (zero.kind is OffsetKind.GUESS, zero.uncertainty))
    return {mass: best if z.kind is OffsetKind.GUESS else z for mass, z in joint.items()}


def fitted_offset(logs: Sequence[Log]) -> EncoderOffset | None:
    """Return the zero in rad by the motion of logs with one added mass; None if undetermined."""
    middle, windows = float(np.median(logs[0].angle)), []
    for log in logs:
        bare = replace(log, added_mass=NO_ADDED_MASS)
        averages = averaging_of(bare, near(middle, float(np.median(log.angle))))
        with suppress(InputError):  # of a log that is too short
            if averages.moving(0.0).any():
                windows.append(averages)
    if not windows:
        return None
    known = Prior.of({"p1": 1.0} | ({} if is_driven(logs) else dict.fromkeys(OF_INPUT, 0.0)))
    last = "bias"
    others = dict.fromkeys((*OF_GRAVITY, *PARAMETERS, *PLAIN))
    names = known.open(name for name in others if name != last)
    about = About(windows=windows, names=names, known=known, gain=1.0, equal_logs=False)
    return _offset(replace(about, names=(*names, last)), middle) or _offset(about, middle)


def _offset(about: About, middle: float) -> EncoderOffset | None:
    """Return the zero in rad by a fit; None if that is singular, or has a bias that may be 0."""
    try:
        solved = WeakFit.converged(about).solved
    except (IdentifiabilityError, InputError):
        return None
    few = np.count_nonzero(solved.rows.any(axis=1)) <= len(solved.names)
    if few or Conditioning.of(solved.rows, solved.names).singular:
        return None
    covariance, freedom = cluster_covariance(*solved.stack)
    covariance *= np.square(stdtrit(freedom.min(), 0.5 + CONFIDENCE / 2) / SPREADS)
    if abs(solved.named.get("bias", np.inf)) <= CLEARLY * math.sqrt(covariance[-1, -1]):
        return None
    sine, cosine = solved.values[:2].tolist()
    across = np.array([cosine, -sine]) / (sine**2 + cosine**2)
    return EncoderOffset(
        value=middle - math.atan2(cosine, sine),
        uncertainty=math.sqrt(across @ covariance[:2, :2] @ across) or np.finfo(float).eps,
        kind=OffsetKind.FIT,
    )
