"""Control, log, re-calibrate, control again, until the hand moves as it should; try the model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial

from butterfly.arrays import Samples
from butterfly.errors import InputError, require_number
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.physical import judge_fit
from butterfly.identification.trust import Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.orbit.controller import Dithered, EnergyShaping, Target, VelocityEstimator, gain_for
from butterfly.orbit.online import (
    ChangeDetector,
    OnlineRecalibration,
    SelfTuning,
    Watched,
    WatchPlan,
)
from butterfly.orbit.recalibration import (
    LoopEquations,
    Recalibration,
    RecalibrationOptions,
    recalibrate,
)
from butterfly.plant.motor import CommandPath, ControlLaw
from butterfly.plant.sensors import FilteredDifference
from butterfly.progress import Track, phase, untracked

PERIODS = 5
"""Length of the free runs that are compared, in periods of the orbit."""

_SETTLED = 0.5  # share of a run after which its amplitude or mean speed is measured
_TOP = 0.25  # share of a half swing, either side of its middle, to which a turning point is fitted
_FEWEST = 10  # samples of a half swing
_BESIDE = 1.08  # amplitude over the orbit's, at which a held-out run starts
_DITHER = 0.2  # of a held-out run
_HANGING = 1e-3  # rad, of a swing as long as that of a hand that begins where it hangs
_AROUND = (1.0, 0.8, 1.2)  # amplitudes over the orbit's, at which runs for its calibration start


RunLaw = Callable[..., Log]
"""Runs a control law on a robot, from rest at an angle in rad, for so many s, carrying a mass.

`butterfly.plant.rig.Rig.run` does, its ``rng`` given; a robot that cannot be held at an angle may
start from where it hangs. A planned ``change`` of the robot is passed on to it."""


@dataclass(frozen=True, kw_only=True)
class OrbitSchedule:
    """An orbit to hold, and what each round of re-calibration next to it does."""

    target: Target
    # of parameters, and the encoder reading in rad of the hanging hand
    velocity: Callable[[LumpedParameters, float], VelocityEstimator] = lambda *_: (
        FilteredDifference()
    )
    multiplier: float = 0.5  # share of a perturbation that is left after one period; sets gamma
    duration: float = 20.0  # of each run in s
    starts: tuple[float, ...]  # rad, a run from each; what the first one comes to is measured
    orbits: tuple[float, ...] = ()  # amplitudes in rad of further orbits, held in a run each
    dither: float = 0.0  # share of the control's rms added to all runs but the first, at random
    # each run is made with each of them, the first is the one that the controller is for; with two
    # different ones the scale becomes known
    added_masses: tuple[AddedMass, ...] = (NO_ADDED_MASS,)
    kick: float = 0.0  # see `EnergyShaping`
    rounds: int = 4  # at most
    amplitude_tolerance: float = 3.5e-3  # rad off, below which the loop ends; of a hand that turns
    speed_tolerance: float = 0.02  # over rad/s of its mean speed; it ends, too,
    parameter_tolerance: float = 1e-3  # when no parameter changes by more than this share
    recalibration: RecalibrationOptions = RecalibrationOptions()
    also: Target | None = None  # another orbit, calibrated on its own; estimates are compared
    cross_check: tuple[float, ...] = ()  # amplitudes in rad; each one's model is tried at all
    watch: WatchPlan | None = None  # a run at the end, in which changes are noticed

    def __post_init__(self) -> None:
        tolerances = ("amplitude_tolerance", "speed_tolerance", "parameter_tolerance")
        for name in ("dither", "kick", *tolerances):
            require_number("OrbitSchedule", **{name: getattr(self, name)})
        require_number("OrbitSchedule", positive=True, duration=self.duration, rounds=self.rounds)
        require_number(
            "OrbitSchedule",
            positive=True,
            starts=len(self.starts),
            added_masses=len(self.added_masses),
        )
        if not 0 < self.multiplier < 1:
            raise InputError("OrbitSchedule", "multiplier", self.multiplier, "between 0 and 1")

    def law(self, orbit: Orbit, zero: float) -> EnergyShaping:
        """Return a fresh controller for an orbit, its encoder reading ``zero`` rad at angle 0."""
        gamma, velocity = gain_for(orbit, self.multiplier), self.velocity(orbit.parameters, zero)
        return EnergyShaping(orbit, gamma, zero=zero, velocity=velocity, kick=self.kick)


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """One turn of the loop."""

    believed: LumpedParameters  # of the hand with what it carries, that the controller went by
    orbit: Orbit  # its target,
    gamma: float  # and gain
    logs: tuple[Log, ...]  # what it recorded, the nominal run first
    starts: int  # how many of them, from the first on, hold the target's orbit
    reached: float  # `Orbit.size` that the nominal run came to; NaN if it moved otherwise
    recalibration: Recalibration  # from the logs

    @property
    def error(self) -> float:
        """What was reached less the size of the target."""
        return self.reached - self.orbit.size


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What the loop came to: its rounds in order, and why it ended, in words."""

    rounds: tuple[Round, ...]
    ending: str
    reached: bool  # whether the last round's orbit is within its bound of the target

    @property
    def parameters(self) -> LumpedParameters:
        """What the last round's logs say of the hand with what it carries."""
        last = self.rounds[-1]
        return last.recalibration.loaded(last.logs[0].added_mass, last.believed.p1)


def calibrate(
    rig: RunLaw,
    believed: LumpedParameters,
    zero: float,
    schedule: OrbitSchedule,
    *,
    plants: tuple[RunLaw, RunLaw] | None = None,
    rng: np.random.Generator,
    track: Track = untracked,
) -> Calibration:
    """Hold the orbit, re-calibrate next to it, and hold it better.

    ``believed`` are parameters of the bare hand to begin with, from small swings say, ``zero`` is
    the encoder reading in rad of the hanging hand; the dither is drawn from ``rng``. ``plants`` are
    a simulated rig solved roughly and finely, with the same random numbers: the intervals then
    include the simulator's error, which is the change of the estimate between them.
    """
    require_number("believed parameters", positive=True, p1=believed.p1, p4=believed.p4)
    loaded = {mass: believed.with_added_mass(mass) for mass in schedule.added_masses}
    rounds: list[Round] = []
    ending, reached = f"all {schedule.rounds} rounds are done", False
    for number in track(range(schedule.rounds), "Calibrating"):
        with phase(f"Round {number}: holding the orbit"):
            logs = _runs(rig, loaded, zero, schedule, rng)
        before = loaded[schedule.added_masses[0]]
        orbit, recalibration = (
            schedule.target(before),
            recalibrate(logs, zero, schedule.recalibration),
        )
        turns, settled = orbit.direction != 0, _settled(logs[0])
        last = Round(
            believed=before,
            orbit=orbit,
            gamma=gain_for(orbit, schedule.multiplier),
            logs=tuple(logs),
            starts=len(schedule.starts),
            reached=(mean_speed if turns else swing)(logs[0], zero, settled),
            recalibration=recalibration,
        )
        rounds.append(last)
        loaded = {mass: recalibration.loaded(mass, before.p1) for mass in schedule.added_masses}
        bound = schedule.speed_tolerance if turns else schedule.amplitude_tolerance
        if reached := abs(last.error) <= bound:
            ending = f"the {'speed' if turns else 'amplitude'} error is within its bound"
            break
        after = loaded[schedule.added_masses[0]]
        old, new = (np.array([p.p2, p.p3, p.p4, p.coulomb]) / p.p1 for p in (before, after))
        larger = np.maximum(np.maximum(np.abs(new), np.abs(old)), 1e-12)
        if np.max(np.abs(new - old) / larger) <= schedule.parameter_tolerance:
            ending = "the parameters have converged"
            break
    if plants is not None:
        recalibration = rounds[-1].recalibration
        of_plants = (_runs(p, loaded, zero, schedule, np.random.default_rng(0)) for p in plants)
        with phase("Holding the orbit in coarser and in finer steps of the simulation"):
            equations = [LoopEquations(logs, zero, schedule.recalibration) for logs in of_plants]
        rough, fine = (loop.fit(recalibration.estimate.names)[0].values for loop in equations)
        recalibration = replace(
            recalibration, estimate=recalibration.estimate.resting_on(fine - rough)
        )
        rounds[-1] = replace(rounds[-1], recalibration=recalibration)
    return Calibration(rounds=tuple(rounds), ending=ending, reached=reached)


def _runs(
    rig: RunLaw,
    loaded: dict[AddedMass, LumpedParameters],
    zero: float,
    schedule: OrbitSchedule,
    rng: np.random.Generator,
) -> list[Log]:
    """Run the controller from every start, on every orbit, with every added mass."""
    logs: list[Log] = []
    for added, model in loaded.items():
        runs = [(start, schedule.target(model)) for start in schedule.starts]
        runs += [(amplitude, Orbit.of_amplitude(model, amplitude)) for amplitude in schedule.orbits]
        for start, orbit in runs:
            law: ControlLaw = schedule.law(orbit, zero)
            if schedule.dither > 0 and logs:
                law = Dithered(law, schedule.dither, 2 * math.pi / orbit.period, rng)
            logs.append(rig(law, start, schedule.duration, added))
    return logs


def swing(log: Log, zero: float, since: float) -> float:
    """Return half the mean peak-to-peak swing in rad, from ``since`` s on; NaN if it turned."""
    rows = log.time >= since
    time, angle = log.time[rows], log.angle[rows] - zero
    if np.abs(angle).max() > math.pi:
        return math.nan
    upper, lower = (_turning_points(time, sign * angle) for sign in (1, -1))
    return float(np.mean(upper) + np.mean(lower)) / 2 if upper and lower else 0.0


def mean_speed(log: Log, zero: float, since: float) -> float:
    """Return the mean speed in rad/s of whole turns, from ``since`` s on; NaN if it made none."""
    rows = log.time >= since
    time, turns = log.time[rows], (log.angle[rows] - zero) / (2 * math.pi)
    whole = np.floor(turns)
    ends = np.flatnonzero(np.diff(whole))[[0, -1]] if np.ptp(whole) > 1 else np.array([0, 0])
    level = np.maximum(whole[ends], whole[ends + 1])  # where it hangs
    if level[0] == level[1]:
        return math.nan
    share = (level - turns[ends]) / (turns[ends + 1] - turns[ends])
    passed = time[ends] + share * (time[ends + 1] - time[ends])
    return float(2 * math.pi * (level[1] - level[0]) / (passed[1] - passed[0]))


def _settled(log: Log) -> float:
    """Return the time in s from which on a run is on its orbit."""
    return float(log.time[0] + _SETTLED * (log.time[-1] - log.time[0]))


def _turning_points(time: Samples, angle: Samples) -> list[float]:
    """Heights of the maxima above 0, each the top of a quartic through the samples about it."""
    above = np.concatenate([[False], angle > 0, [False]])
    edges = np.flatnonzero(np.diff(above.astype(int)))
    heights = []
    for start, end in edges.reshape(-1, 2).tolist():
        if start == 0 or end == angle.size or end - start < _FEWEST:
            continue  # cut off by the ends of the log, or noise about 0
        middle = 0.5 * (time[start] + time[end - 1])
        top = np.abs(time - middle) < _TOP * (time[end - 1] - time[start])
        fit = Polynomial.fit(time[top] - middle, angle[top], 4)
        fine = np.linspace(float(fit.domain[0]), float(fit.domain[1]), 201)
        heights.append(float(fit(fine).max()))
    return heights


@dataclass(frozen=True, kw_only=True, eq=False)
class OrbitStudy:
    """A calibration, and how well its model predicts runs that it has not seen."""

    name: str
    description: str
    zero: float  # encoder reading in rad of the hanging hand
    calibration: Calibration
    held_out: Log  # a run next to the orbit that was used for nothing else
    estimate: Estimate  # of the last round, with what its free run of that log says
    small_swings: Estimate | None  # that it began with; None if parameters were given
    errors: dict[str, float]  # rms in rad over `PERIODS`, by model: "generic", "re-calibrated"
    also: Calibration | None  # another one, on its own
    amplitudes: tuple[float, ...]  # (n,) in rad, of the orbits of the next
    cross: Samples  # (n, n) rms in rad of the row's model at the column's orbit
    watched: Watched | None  # a run at the end that was watched for changes


def study_orbit(
    rig: RunLaw,
    believed: LumpedParameters,
    zero: float,
    schedule: OrbitSchedule,
    *,
    small_swings: Estimate | None = None,
    plants: tuple[RunLaw, RunLaw] | None = None,
    path: CommandPath = CommandPath(),
    rng: np.random.Generator,
    name: str = "orbit",
    description: str = "",
    track: Track = untracked,
) -> OrbitStudy:
    """Calibrate, compare free runs, and do what else is planned; a watched run takes the ``path``.

    The other calibration shares nothing with the first but what was believed.
    """
    calibration = calibrate(rig, believed, zero, schedule, plants=plants, rng=rng, track=track)
    carried, amplitudes = schedule.added_masses[0], schedule.cross_check
    final = calibration.parameters

    def run(orbit: Orbit, start: float) -> Log:
        law = Dithered(schedule.law(orbit, zero), _DITHER, 2 * np.pi / orbit.period, rng)
        return rig(law, start, schedule.duration, carried)

    last, generic = calibration.rounds[-1], calibration.rounds[0].believed
    nominal = last.orbit.of_same_size(final)
    angle = schedule.starts[0] if nominal.direction else _BESIDE * nominal.upper
    held_out = run(nominal, angle)
    before, after = (beside_orbit(held_out, model, zero, nominal) for model in (generic, final))
    followed = Finding(FindingKind.FOLLOWED, number=1 - after.fit / 100)
    judged = judge_fit(np.array([after.followed]))
    fresh, models_at = [], []
    for amplitude in track(amplitudes, "Cross-checking orbits"):
        orbit = Orbit.of_amplitude(final, amplitude)
        fresh.append(run(orbit, _BESIDE * amplitude))
        logs = [run(orbit, share * amplitude) for share in _AROUND]
        recalibration = recalibrate(logs, zero, schedule.recalibration)
        models_at.append(recalibration.loaded(carried, final.p1))
    other = watched = None
    if schedule.also is not None:
        plan = replace(schedule, target=schedule.also)
        other = calibrate(rig, believed, zero, plan, plants=plants, rng=rng, track=track)
    if schedule.watch is not None:
        watched = watch(rig, schedule.watch, final, zero, schedule, path=path, rng=rng)
    return OrbitStudy(
        name=name,
        description=description,
        zero=zero,
        calibration=calibration,
        held_out=held_out,
        estimate=last.recalibration.estimate.with_findings(followed, *judged),
        small_swings=small_swings,
        errors={"generic": before.rms, "re-calibrated": after.rms},
        also=other,
        amplitudes=amplitudes,
        cross=np.array(
            [[beside_orbit(log, model, zero).rms for log in fresh] for model in models_at]
        ).reshape(len(amplitudes), len(amplitudes)),
        watched=watched,
    )


def watch(
    rig: RunLaw,
    plan: WatchPlan,
    model: LumpedParameters,
    zero: float,
    schedule: OrbitSchedule,
    *,
    path: CommandPath = CommandPath(),
    rng: np.random.Generator,
) -> Watched:
    """Hold the orbit of a loaded model, self-tuning and dithered, and watch the innovations."""
    orbit, options = schedule.target(model), schedule.recalibration
    every, width = plan.false_alarms_every, options.half_width
    detector = ChangeDetector(false_alarms_every=every, half_width=width)
    law = schedule.law(orbit, zero)
    tuned = SelfTuning(
        law,
        OnlineRecalibration(zero, memory=plan.memory, options=options, detector=detector),
        schedule.target,
        multiplier=schedule.multiplier,
        inertia=model.p1,
        every=plan.every,
        commands=Dithered(law, plan.dither, 2 * math.pi / orbit.period, rng),
        path=path,
    )
    changed = {} if plan.change is None else {"change": plan.change}
    log = rig(tuned, orbit.upper, plan.duration, schedule.added_masses[0], **changed)
    return Watched(log=log, orbit=orbit, detector=detector, change=plan.change)


def beside_orbit(
    log: Log, loaded: LumpedParameters, zero: float, orbit: Orbit | None = None
) -> FreeRun:
    """Return a free run of `PERIODS` from the first sample of a log, where the hand is at rest.

    For an ``orbit`` that turns over it begins where the log is settled on it: the speed over a top
    that is hardly reached cannot be predicted.
    """
    setting = Setting(parameters=loaded, zero=zero)
    if orbit is not None and orbit.direction:
        ends = _settled(log) + np.array([0, PERIODS]) * orbit.period
        cut = log.piece(*np.searchsorted(log.time, ends).tolist())
    else:
        start, setting = max(abs(log.angle[0] - zero), _HANGING), replace(setting, velocity=0.0)
        period = Orbit.of_amplitude(replace(loaded, p3_offset=0.0, bias=0.0), start).period
        cut = log.take(log.time - log.time[0] <= PERIODS * period)
    return FreeRun.of(replace(cut, added_mass=NO_ADDED_MASS), setting)
