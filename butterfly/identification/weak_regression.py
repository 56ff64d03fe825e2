"""The weak form's regression: averages over test functions, solved about delay and drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.findings import Ending
from butterfly.identification.fit import Fit
from butterfly.identification.inference.limits import independent_cells_of
from butterfly.identification.inference.stagewise import STRIBECK, stribeck_velocity
from butterfly.identification.levels import MOST, SHOWS, WEIGHED
from butterfly.identification.linearisation import Linearisation, Regression
from butterfly.identification.segments import LONGEST_STEP
from butterfly.identification.test_functions import (
    HALF_WIDTH,
    LEAST_SAMPLES,
    Averaging,
    half_width_of,
)
from butterfly.logs.log import Log
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Penalty, Prior
from butterfly.model.terms import DRIVE, IDEAL, SETTINGS, TERMS, DriveTerms, FrictionTerms

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
