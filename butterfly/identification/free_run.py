"""Free-run simulation of logs and its FIT: of whole logs, or over a joint's own time.

A joint that nothing holds, such as a cart, an arm without gravity in somebody's loop, or a hand
about the upright, integrates twice whatever its simulation lacks: after a minute little is left to
see of its inertia. Its own time is the period of its motion, or the time in which its speed
settles, or half a period of small swings, in which an error about the upright grows e^pi-fold: the
shortest of these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from butterfly.arrays import ROUNDING, Samples
from butterfly.identification.estimate import Estimate
from butterfly.identification.segments import grid_step
from butterfly.identification.simulation import Simulation, segment_length
from butterfly.identification.test_functions import HALF_WIDTH, VELOCITY_SHARE, half_width_of
from butterfly.identification.trust import LOST
from butterfly.identification.weak_regression import reading_of
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.progress import current_search
from butterfly.signals.frequency_response import (
    dominant_period,
    resample,
    uniform_grid,
    white_variance,
)
from butterfly.signals.hold import slope

LEAST_FIT = 100 * (1 - LOST)
"""FIT in per cent below which a simulation does not follow a log."""

_UPRIGHT = 0.9 * math.pi  # rad from the rest angle


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRun:
    """A log and its simulation with the recorded input, from the first sample on or in segments."""

    log: Log
    simulated: Samples  # (n,) at its stamps, as it measures: rad from the encoder's zero, or rad/s
    horizon: float = math.inf  # longest segment in s, each with a fitted start

    @classmethod
    def of(cls, log: Log, setting: Setting) -> FreeRun:
        """Simulate a log with increasing stamps."""
        return setting.run(setting.simulation(log))

    @cached_property
    def fit(self) -> float:
        """FIT = 100 (1 - |q - qhat| / |q - mean q|) in per cent, over the whole log."""
        return fit_of(self.rms, self.log.rms_measured)

    @cached_property
    def velocity_fit(self) -> float:
        """FIT in per cent of the velocity: that of a growing angle hardly depends on inertia."""
        if self.log.integrated:
            return self.fit
        error, motion, _ = self._velocity
        return fit_of(error, motion)

    @cached_property
    def followed(self) -> float:
        """How well the log is followed: the lower FIT in per cent beyond noise (see `fit_of`).

        It is that of angle or velocity; of the angle where noise alone loses the velocity.
        """
        angle = fit_of(self.rms, self.log.rms_measured, self.noise)
        if self.log.integrated:
            return angle
        error, motion, noise = self._velocity
        return angle if noise > LOST * motion else min(angle, fit_of(error, motion, noise))

    @cached_property
    def noise(self) -> float:
        """White noise of the readings in rad or rad/s, by what neighbours have not in common.

        Errors of the model are smooth, and so is most of the motion: the lower of both is taken.
        """
        readings = (self.log.measured, self.log.measured - self.simulated)
        with np.errstate(over="ignore", invalid="ignore"):
            variances = np.array([white_variance(series) for series in readings])
        return math.sqrt(float(np.nanmin(variances)))

    @cached_property
    def _velocity(self) -> tuple[float, float, float]:
        """Rms error, motion and noise of the velocity in rad/s, by local slopes of the angle."""
        grid = uniform_grid(self.log.time)
        step = float(grid[1] - grid[0])
        window = VELOCITY_SHARE * min(HALF_WIDTH, half_width_of(self.log))
        half = min(max(round(window / step), 2), (grid.size - 1) // 2)
        angles = (self.log.angle, self.simulated - self.log.angle)
        with np.errstate(over="ignore", invalid="ignore"):
            measured, error = (
                slope(resample(self.log.time, angle, grid), half, 2, step) for angle in angles
            )
            rms = float(np.sqrt(np.mean(error**2)))
        impulse = np.zeros(6 * half + 1)
        impulse[3 * half] = 1.0
        by_noise = float(np.linalg.norm(slope(impulse, half, 2, step)))  # of noise of 1 rad
        return rms, float(np.std(measured)), by_noise * self.noise

    @cached_property
    def rms(self) -> float:
        """Rms error, in rad or rad/s."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that diverged
            error = self.simulated - self.log.measured
            return float(np.sqrt(error @ error / error.size))


class WholeRuns(NamedTuple):
    """Runs of whole logs from their start alone, where these are simulated in segments."""

    fit: float  # median FIT in per cent
    longest: float  # in s

    @classmethod
    def of(cls, runs: Sequence[tuple[Log, Setting]]) -> WholeRuns | None:
        """Simulate whole logs with their settings; None where all these are of whole logs."""
        if all(math.isinf(setting.horizon) for _, setting in runs):
            return None
        whole = [FreeRun.of(log, replace(setting, horizon=math.inf)) for log, setting in runs]
        longest = max(float(np.ptp(log.time)) for log, _ in runs)
        return cls(float(np.median([run.fit for run in whole])), longest)


def over_segments(horizon: float | None) -> str:
    """Return the text on a horizon in s, to follow what is over it; empty for whole logs."""
    return f" over segments of {horizon:g} s" if horizon and math.isfinite(horizon) else ""


@dataclass(frozen=True)
class FitSummary:
    """Median, mean and worst FIT over a set of logs, in per cent."""

    median: float
    mean: float
    worst: float
    horizon: float | None = None  # longest segment in s simulated at a time; None for whole logs
    # median FIT of runs of whole logs from their start alone, where others are over segments, and
    # the length of the longest in s
    whole: float | None = None
    longest: float | None = None

    @classmethod
    def of(
        cls, fits: Samples, horizon: float | None = None, whole: WholeRuns | None = None
    ) -> FitSummary:
        """Summarise the (n,) FIT values of n logs; an infinite horizon is one of whole logs."""
        finite = horizon if horizon is not None and math.isfinite(horizon) else None
        of_whole = (None, None) if finite is None or whole is None else whole
        return cls(float(np.median(fits)), float(fits.mean()), float(fits.min()), finite, *of_whole)

    @property
    def over(self) -> str:
        """Text on the horizon, to follow the word FIT; empty for whole logs."""
        return over_segments(self.horizon)

    @property
    def holds(self) -> str:
        """A sentence on the time over which simulations stay near logs; empty for whole logs."""
        if self.whole is None or self.longest is None:
            return ""
        fit = f"median FIT {self.whole:.1f} %" if math.isfinite(self.whole) else "they diverge"
        runs = f"Whole runs of up to {self.longest:.3g} s, from their start alone,"
        if self.whole >= LEAST_FIT:
            return f"{runs} follow too ({fit})."
        near = f"over {self.horizon:g} s at a time the median FIT is {self.median:.1f} %"
        return f"{runs} drift away ({fit}); {near}."

    def numbers(self) -> dict[str, float]:
        """Return it for programs."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Parameters and start with which a log is simulated."""

    parameters: LumpedParameters  # of the bare hand
    zero: float  # reading of the encoder in rad where the model's angle is 0
    velocity: float | None = None  # at the first sample, in rad/s; None: as the log begins
    horizon: float = math.inf  # longest stretch in s that is simulated at a time

    def simulation(self, log: Log, first: int = 0) -> Simulation:
        """Return the simulation of a log; errors count from the sample numbered ``first`` on."""
        return Simulation(log, self.parameters, first, self.segment_length(log, first))

    def segment_length(self, log: Log, first: int = 0) -> float | None:
        """Return the longest segment with fitted starts in s (see `segment_length`)."""
        known = self.velocity is not None
        return segment_length(log, self.parameters, self.horizon, first=first, velocity_known=known)

    def run(self, simulation: Simulation) -> FreeRun:
        """Simulate a log."""
        motion = simulation.run(self.parameters, self.zero, self.velocity)
        current_search().steps += simulation.spend()
        simulated = motion.at(simulation.log.time)
        return FreeRun(log=simulation.log, simulated=simulated, horizon=self.horizon)


class Simulations:
    """Simulates the logs of a data set with any parameters; caches what does not depend on them.

    Each is simulated about the encoder's zero that an estimate has for it, or else that of
    ``zeros`` in rad by added mass; the logs with indices ``counted`` determine the horizon.
    """

    def __init__(
        self, logs: Sequence[Log], zeros: Mapping[AddedMass, float], counted: Sequence[int]
    ) -> None:
        self._logs, self._zeros, self._counted = logs, zeros, counted
        self._simulations: dict[int, tuple[tuple[float, float, float | None], Simulation]] = {}
        self._horizons: dict[LumpedParameters, float] = {}
        self._runs: dict[int, tuple[Setting, FreeRun]] = {}

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle without the caches."""
        return type(self), (self._logs, self._zeros, self._counted)

    def setting(self, number: int, estimate: Estimate) -> Setting:
        """Return the setting of an estimate for one log, by its index."""
        log = self._logs[number]
        parameters, local = estimate.applied(log)
        zero = local["zero"] if "zero" in local else reading_of(log, self._zeros)
        return Setting(
            parameters=parameters,
            zero=zero,
            velocity=local.get("velocity"),
            horizon=self.horizon(estimate),
        )

    def horizon(self, estimate: Estimate) -> float:
        """Return the longest stretch in s over which logs are simulated with an estimate."""
        if estimate.horizon is not None:
            return estimate.horizon
        parameters = estimate.parameters
        if parameters not in self._horizons:
            logs = [self._logs[k] for k in self._counted]
            self._horizons[parameters] = horizon_of(logs, parameters, self._zeros)
        return self._horizons[parameters]

    def with_horizon(self, estimate: Estimate) -> Estimate:
        """Return the estimate with the horizon over which these logs are simulated, if finite."""
        horizon = self.horizon(estimate)
        return replace(estimate, horizon=horizon) if math.isfinite(horizon) else estimate

    def judging(self, estimate: Estimate) -> list[int]:
        """Return the indices of the logs that judge an estimate: all, where segments follow them.

        Where the hand passes the upright no free run of a whole log stays near: such logs count
        only if all do.
        """
        segmented = estimate.horizon is not None and math.isfinite(estimate.horizon)
        return [*range(len(self._logs))] if segmented else [*self._counted]

    def run(self, number: int, estimate: Estimate) -> FreeRun:
        """Simulate one log, by its index, with an estimate."""
        return self._run(number, self.setting(number, estimate))

    def followed(self, estimate: Estimate, numbers: Iterable[int]) -> Samples:
        """(n,) how well some logs are followed with an estimate (see `FreeRun.followed`)."""
        return np.array([self.run(number, estimate).followed for number in numbers])

    def fits(self, estimate: Estimate, numbers: Iterable[int] | None = None) -> Samples:
        """(n,) FIT in per cent of all logs, or some, with an estimate."""
        chosen = range(len(self._logs)) if numbers is None else numbers
        return np.array([self.run(number, estimate).fit for number in chosen])

    def fits_with(self, parameters: LumpedParameters, horizon: float = math.inf) -> Samples:
        """(n,) FIT in per cent of all logs with parameters of the bare hand, over a horizon."""
        zeros = (reading_of(log, self._zeros) for log in self._logs)
        settings = (Setting(parameters=parameters, zero=zero, horizon=horizon) for zero in zeros)
        return np.array([self._run(number, setting).fit for number, setting in enumerate(settings)])

    def simulation(self, number: int, setting: Setting) -> Simulation:
        """Return the simulation of one log, by its index; the latest of each is cached."""
        log = self._logs[number]
        p = setting.parameters
        key = grid_step(log, p), p.delay, setting.segment_length(log)
        latest = self._simulations.get(number)
        if latest is None or latest[0] != key:
            self._simulations[number] = latest = key, setting.simulation(log)
        return latest[1]

    def _run(self, number: int, setting: Setting) -> FreeRun:
        """Simulate one log, by its index; the latest free run of each is cached."""
        latest = self._runs.get(number)
        if latest is None or latest[0] != setting:
            run = setting.run(self.simulation(number, setting))
            self._runs[number] = latest = setting, run
        return latest[1]


def fit_of(error: float, motion: float, noise: float = 0.0) -> float:
    """Return FIT in per cent of rms error and motion; -inf of no motion or a diverging one.

    With the rms noise that is in both it is FIT beyond noise: of the motion and error less that.
    """
    if not (math.isfinite(error) and motion > noise):
        return -math.inf
    misfit, moved = (math.sqrt(max(rms**2 - noise**2, 0.0)) for rms in (error, motion))
    return 100 * (1 - misfit / moved)


def turns_over(log: Log, zero: float) -> bool:
    """Whether a hand passes near the upright, from where gravity does not bring it back.

    ``zero``: reading of the encoder in rad where the hand hangs.
    """
    angle = log.angle - zero
    turned = 2 * math.pi * round(float(np.median(angle)) / (2 * math.pi))
    return bool(np.max(np.abs(angle - turned)) > _UPRIGHT)


def falls(log: Log, joint: LumpedParameters, zero: float) -> bool:
    """Whether gravity drives the errors of a loaded joint apart, as it does about the upright.

    It does too where a loop that the log does not have holds the joint in its upper half: there
    gravity's stiffness p3 cos(angle - zero) is negative on average.
    """
    if log.closed or not joint.p3 > 0:
        return False
    return turns_over(log, zero) or float(np.mean(np.cos(log.angle - zero))) < 0


def is_held(log: Log, joint: LumpedParameters, zero: float) -> bool:
    """Whether a servo's loop, or gravity within the log, brings a loaded joint back."""
    if log.closed:
        return True
    if not (joint.p3 > 0 and joint.p1 > 0) or falls(log, joint, zero):
        return False
    back = 2 * math.pi * max(math.sqrt(joint.p1 / joint.p3), joint.p2 / joint.p3)
    return back < float(log.time[-1] - log.time[0])


def own_time(log: Log, joint: LumpedParameters) -> float:
    """Return the own time in s of a loaded joint in a log."""
    times = [dominant_period(log.time, log.angle)]
    if joint.p2 > 0:
        times.append(2 * math.pi * joint.p1 / joint.p2)
    if joint.p3 > 0:
        times.append(math.pi * math.sqrt(max(joint.p1, 0.0) / joint.p3))
    return float(f"{min(time for time in times if time > 0):.2g}")  # which hardly depends on values


def first_horizon(
    logs: Sequence[Log], parameters: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> float:
    """Return the time in s over which a fit begins: whole logs, unless errors are driven apart.

    A fit of whole logs is lost there, but not where errors only add up.
    """
    unstable = _driven_apart(logs, parameters, zeros)
    return _least_own_time(logs, parameters, zeros) if unstable else math.inf


def horizon_of(
    logs: Sequence[Log], parameters: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> float:
    """Return the longest time in s over which parameters are judged; infinite for whole logs.

    Whole logs where their free runs follow them; else, of joints that nothing holds, their own
    time (see `own_time`). Over that, gravity moves a hand whatever else the parameters are: they
    are judged so only if they leave hardly more than noise.
    """
    horizon = _least_own_time(logs, parameters, zeros)
    if math.isinf(horizon) or not _driven_apart(logs, parameters, zeros):
        return horizon
    runs = [
        FreeRun.of(
            log, Setting(parameters=parameters, zero=reading_of(log, zeros), horizon=horizon)
        )
        for log in logs
    ]
    noisy = np.median(
        [
            run.rms / max(run.noise, ROUNDING * log.rms_measured)
            for run, log in zip(runs, logs, strict=True)
        ]
    )
    return horizon if noisy <= 1 / LOST else math.inf


def _least_own_time(
    logs: Sequence[Log], parameters: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> float:
    """Return the least own time in s of joints that nothing holds, if no run follows these."""
    followed, least = list[float](), math.inf
    for log in logs:
        joint, zero = parameters.with_added_mass(log.added_mass), reading_of(log, zeros)
        if not is_held(log, joint, zero):
            least = min(least, own_time(log, joint))
            followed.append(FreeRun.of(log, Setting(parameters=parameters, zero=zero)).followed)
    return least if followed and np.median(followed) < LEAST_FIT else math.inf


def _driven_apart(
    logs: Sequence[Log], parameters: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> bool:
    """Whether gravity drives errors apart in any log."""
    joints = [(log, parameters.with_added_mass(log.added_mass)) for log in logs]
    return any(falls(*pair, reading_of(pair[0], zeros)) for pair in joints)
