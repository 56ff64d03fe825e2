"""Design of the next experiment: runs that reach a goal, ranked by the robot time that they cost.

Each run is simulated with the estimate, and its rows are added to those of the logs so far as often
as it is played. The intervals that then follow are those of the inference: standard errors by the
inverse of the information (Walter & Pronzato, Identification of Parametric Models from Experimental
Data, 1997, ch. 6), times the quantile of Student's t with the degrees of freedom of these clusters.
So repeating a run helps most where a parameter rests on few. Errors are scaled to give the logs so
far the intervals that they show. For a servo, set-points are planned, and falls with its torque
off: it takes no other input.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, Generic, TypeVar

import numpy as np

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import IdentifiabilityError, require_number, require_room
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.forecast import IntervalForecast, largest_motion, largest_torque
from butterfly.identification.free_run import Setting
from butterfly.identification.segments import LONGEST_STEP, driven
from butterfly.identification.simulation import Simulation
from butterfly.logs.clock import Regime
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.linear import LARGEST_SWING, resonance_frequency
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.model.terms import PARAMETERS
from butterfly.progress import Track, in_threads, out_of_time, untracked
from butterfly.signals.excitations import Excitation, FreeDecay, Multisine, initial_angle

_FOLLOWS = 0.5  # share of its set-point that a servo reaches at least
_UNSURE = 0.5  # of a swing, by which its prediction is uncertain at most

OF_GOAL = tuple(name for name in PARAMETERS if name != "delay")
"""Parameters that a goal concerns: the half-widths of their 95 % intervals over their values."""

MOST_RUNS = 50
"""Largest number of runs alike in a plan."""

_PAUSE = 3.0  # s of robot time between two runs
_SWINGS = (0.15, 0.4)  # target swings of the amplitudes, over the allowed one
# harmonics of a base, of a multisine or one sine each, and the one at the resonance
_HARMONICS, _RESONANCE = (10, 15, 18, 20, 22, 27, 40), 20
_PACE = 2.0  # rad/s, of a joint that nothing brings back, at least
_FASTEST = math.pi / (10 * LONGEST_STEP)  # where ten steps are a period of the last harmonic
_OF_FRICTION = 4 / math.pi  # amplitude of the first harmonic of dry friction, over its torque

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan(Generic[_T]):
    """A run, to be played some times: what that costs, and what is known afterwards."""

    recipe: _T  # what is played
    duration: float  # of one run in s
    # from which what is wanted is reached; of the least cost if `MOST_RUNS` do not reach it
    runs: int
    change: float  # s that a change of mass before them costs; 0 without one
    expected: tuple[float, float]  # largest half-width over the wanted: after one run, after all
    errors: Samples  # (n,) standard errors after one run, over those before
    spread: float  # rms in rad by which its motion is uncertain

    @property
    def seconds(self) -> float:
        """Robot time of all runs, the change of mass included."""
        return self.runs * (self.duration + _PAUSE) + self.change

    @property
    def cost(self) -> float:
        """Robot time in s, times the square of how far it falls short of what is wanted."""
        return self.seconds * max(self.expected[1], 1.0) ** 2


def wanted(
    estimate: Estimate, logs: Sequence[Log], goal: float, *, scale_open: bool = False
) -> Samples:
    """Return (n,) half-widths that a goal asks for, infinite where it asks for none.

    A torque that by its whole interval is below the goal's share of the largest torque is known
    well enough: friction that is hardly there, the gravity moment of a balanced joint. While the
    scale is open, half-widths are half as large: it follows from two configurations, whose errors
    add.
    """
    values = np.abs(estimate.values)
    sizes = np.maximum(values, ROUNDING * estimate.upper)
    most, units = largest_torque(estimate.parameters, logs), largest_motion(logs)
    for k, name in enumerate(estimate.names):
        if name not in OF_GOAL:
            sizes[k] = math.inf
        elif name in units:
            sizes[k] = max(sizes[k], most / units[name] - values[k] / goal)
    return goal * sizes / (1 + scale_open)


def plans(
    data: DataSet,
    estimate: Estimate,
    recipes: Sequence[tuple[_T, Log]],
    aim: Samples,
    *,
    mounted: AddedMass,
    price: float,
    track: Track = untracked,
) -> list[Plan[_T]]:
    """Plan each of some runs until the (n,) half-widths ``aim`` are reached.

    ``recipes``: what is played, and its log as it is expected, which begins at rest; ``price``: of
    another mass than the ``mounted`` one, in s of robot time.
    """
    parameters = estimate.parameters
    rest = Setting(parameters=parameters, zero=0.0, velocity=0.0)
    settings = [data.simulations.setting(k, estimate) for k in range(len(data.logs))]
    so_far = [
        _rows(data.simulations.simulation(k, setting), estimate.names, setting)
        for k, setting in enumerate(settings)
    ]
    forecast = IntervalForecast(estimate, so_far)

    def planned(pair: tuple[_T, Log]) -> Plan[_T]:
        recipe, log = pair
        rows = _rows(Simulation(log, parameters), estimate.names, rest)
        more = forecast.log(rows)

        @cache
        def share(runs: int) -> float:
            return float(np.max(forecast.half_widths(more, runs) / aim))

        uncertain = float(np.trace(estimate.covariance @ rows.T @ rows))
        duration = log.time.size * log.mean_step
        other = log.added_mass.inertia_and_moment != mounted.inertia_and_moment
        errors, spread = forecast.errors(more), math.sqrt(max(uncertain, 0.0) / duration)

        def repeated(runs: int) -> Plan[_T]:
            return Plan(
                recipe=recipe,
                duration=duration,
                runs=runs,
                change=price * other,
                expected=(share(1), share(runs)),
                errors=errors,
                spread=spread,
            )

        # doubled, as one run more may widen intervals: from some logs on, not their parts count
        tried = [*(2**k for k in range(MOST_RUNS.bit_length())), MOST_RUNS]
        for before, last in pairwise([0, *tried]):
            if share(last) <= 1:
                some = range(before + 1, last)
                fewer = bisect_left(some, True, key=lambda runs: share(runs) <= 1)
                return repeated(before + 1 + fewer)
        return min(map(repeated, tried), key=lambda plan: plan.cost)

    return in_threads(planned, recipes, track, "Rating candidates")


def _rows(simulation: Simulation, names: Sequence[str], setting: Setting) -> Samples:
    """Return (m, n) derivatives of a log by n parameters, scaled, 0 if the simulation diverges.

    The sum of their squares is the integral of the squared derivatives over time.
    """
    parameters, zero, velocity = setting.parameters, setting.zero, setting.velocity
    with np.errstate(all="ignore"):
        _, rows = simulation.linearised(names, parameters, zero, velocity)
        rows = rows * math.sqrt(float(np.ptp(simulation.log.time)) / len(rows))
        finite = np.isfinite(rows.T @ rows).all()
    return rows if finite else np.zeros_like(rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A candidate for the next experiment."""

    signal: Excitation  # the input, as an experiment can be driven with it: a servo's set-point
    log: Log  # as it is expected
    warning: str = ""  # why that is unreliable; empty if it is not

    @property
    def swing(self) -> float:
        """Largest angle in rad predicted, on a slide way in m."""
        return float(np.max(np.abs(self.log.angle)))

    @property
    def servo(self) -> ServoLoop | None:
        """The loop of a closed-loop experiment."""
        return self.log.servo

    @property
    def what(self) -> str:
        """The input, in words."""
        if self.servo is None:
            return self._input
        if isinstance(self.signal, FreeDecay):
            return f"release from {self.signal.angle:g} rad with the torque off"
        gains = ((name, getattr(self.servo, name).value) for name in ("kp", "ki", "kd"))
        listed = ", ".join(f"{name} {gain:g}" for name, gain in gains if gain)
        unit = "rad/s" if self.servo.of_speed else "rad"
        return f"set-point: {self._input} {unit} ({listed})"

    @property
    def _input(self) -> str:
        if isinstance(self.signal, Sine):
            return f"sine of {self.signal.omega:g} rad/s, amplitude {self.signal.amplitude:g}"
        if isinstance(self.signal, Multisine):
            lines = ", ".join(map(str, self.signal.harmonics))
            return (
                f"multisine, base {self.signal.base:g} rad/s, harmonics {lines}, "
                f"peak {self.signal.peak:g}"
            )
        return f"free decay from {initial_angle(self.signal):g} rad"


def next_experiments(
    data: DataSet,
    estimate: Estimate,
    aim: Samples,
    *,
    duration: float,
    price: float,
    command: float | None = None,
    swing: float | None = None,
    track: Track = untracked,
) -> list[Plan[Candidate]]:
    """Rank sines, multisines and free decays on each added mass by what they cost (see `plans`).

    Candidates with a warning come last: they swing too far, friction may hold them, or their angle
    depends so much on uncertain parameters that it is not predictable. ``command``: largest input,
    by default of the logs; ``swing``: in rad or m, by default `LARGEST_SWING`, or the largest one
    logged of slides and servos, in whose loops, and no longer than their logs, runs are planned.
    An inertia that is open is planned at its limit: a run that shows that much lowers the limit.
    """
    estimate.parameters.require_gain("design")
    if not np.isfinite(estimate.covariance).all():
        raise IdentifiabilityError(
            f"the method {estimate.method!r} gives no covariance, which a design needs"
        )
    servos = [*{log.servo: log for log in data.logs if log.closed}.values()]
    if swing is None:
        logged = max(float(np.ptp(log.angle)) / 2 for log in data.logs)
        swing = logged if servos or data.joint is JointKind.SLIDE else LARGEST_SWING
    if command is None:
        command = max(float(np.max(np.abs(log.input))) for log in data.logs)
    require_number("design", positive=True, unit="rad", swing=swing)
    require_number("design", positive=True, command=command, duration=duration)
    require_number("design", price=price)
    require_room("design", "duration", f"{duration:g} s", 8 * duration / LONGEST_STEP)
    planned = estimate.at_limit
    mounted, widest = data.logs[-1].added_mass, min(swing, LARGEST_SWING)
    fastest = math.sqrt(2) * max((log.rms_speed for log in servos), default=0.0)
    recipes: list[tuple[Candidate, Log]] = []
    for mass in masses_at_hand(data):
        if recipes and out_of_time("candidates with some of the added masses"):
            break
        loaded = planned.parameters.with_added_mass(mass)
        jobs: list[tuple[Excitation, Log | None]] = [
            (excitation, log)
            for log in servos
            for excitation in _setpoints(loaded, log, fastest, widest, fall=log is servos[0])
        ]
        if not servos:
            way = swing if data.joint is JointKind.SLIDE else widest
            pace = _PACE
            if estimate.open:  # where inertia takes as much torque as viscous friction
                pace = min(max(_PACE, loaded.p2 / loaded.p1), _FASTEST)
            jobs = [(excitation, None) for excitation in _inputs(loaded, way, command, pace)]
        for signal, servo in jobs:
            log = expected_log(data, planned.parameters, mass, signal, duration, servo=servo)
            recipes.append((Candidate(signal=signal, log=log), log))
    every = plans(data, planned, recipes, aim, mounted=mounted, price=price, track=track)
    ranked = [
        replace(plan, recipe=replace(plan.recipe, warning=_warning(plan, planned, swing)))
        for plan in every
    ]
    return sorted(ranked, key=lambda p: (bool(p.recipe.warning), p.cost, p.expected[1]))


def masses_at_hand(data: DataSet) -> list[AddedMass]:
    """Return the added masses of a data set, and none; those that load alike count once."""
    bare = AddedMass(joint=data.joint, gravity=data.logs[0].added_mass.gravity)
    return sorted({mass.inertia_and_moment: mass for mass in (bare, *data.masses)}.values())


def _inputs(loaded: LumpedParameters, widest: float, most: float, pace: float) -> list[Excitation]:
    """Propose inputs up to a command, around the resonance of the hand with its added mass.

    ``pace``: in its place in rad/s, where nothing brings the hand back.
    """
    swings = [widest * swing for swing in _SWINGS]
    resonance = resonance_frequency(loaded)
    if resonance == 0.0:
        # Without a restoring moment any frequency will do that friction lets pass.
        resonance = (abs(loaded.p3) / loaded.p1) ** 0.5 or pace
    inputs: list[Excitation] = []
    for harmonic in _HARMONICS:
        omega = harmonic / _RESONANCE * resonance
        for swing in swings:
            stiffness = abs(loaded.p3 - loaded.p1 * omega**2) * swing
            damping = loaded.p2 * omega * swing + _OF_FRICTION * loaded.coulomb
            amplitude = float(f"{np.hypot(stiffness, damping) / abs(loaded.p4):.2g}")
            inputs.append(Sine(omega=float(f"{omega:.3g}"), amplitude=min(amplitude, most)))
    torque = (loaded.p1 * resonance**2 * swings[0] + 2 * loaded.coulomb) / abs(loaded.p4)
    base, peak = float(f"{resonance / _RESONANCE:.3g}"), min(float(f"{torque:.2g}"), most)
    inputs.append(Multisine(base=base, harmonics=_HARMONICS, peak=peak))
    if loaded.p3 != 0.0:  # which restores it
        inputs.append(FreeDecay(angle=widest))
    return [*dict.fromkeys(inputs)]


def _setpoints(
    loaded: LumpedParameters, log: Log, fastest: float, limit: float, *, fall: bool
) -> list[Excitation]:
    """Propose set-points in the loop of a log, from slow ones to the ``fastest``, and a fall."""
    of_speed = log.servo is not None and log.servo.of_speed
    inputs: list[Excitation] = []
    for swing in (limit * share for share in _SWINGS):
        for omega in (float(f"{fastest / swing / 4**k:.3g}") for k in range(4)):
            peak = float(f"{swing * (omega if of_speed else 1):.2g}")
            inputs.append(Sine(omega=omega, amplitude=peak))
    base = float(f"{fastest / limit / _RESONANCE:.3g}")
    peak = float(f"{(fastest if of_speed else limit) / 2:.2g}")
    inputs.append(Multisine(base=base, harmonics=_HARMONICS, peak=peak))
    if fall and loaded.p3 != 0.0:  # without gravity it does not fall
        inputs.append(FreeDecay(angle=limit))
    return inputs


def expected_log(
    data: DataSet,
    parameters: LumpedParameters,
    mass: AddedMass,
    signal: Excitation,
    duration: float,
    *,
    servo: Log | None = None,
) -> Log:
    """Return the log of some s from rest, as it is expected; of a servo no longer than its.

    A clock of two regimes is slow at its end.
    """
    step = LONGEST_STEP
    if servo is not None:
        duration, step = min(duration, float(np.ptp(servo.time))), servo.mean_step
    time = np.arange(0.0, duration, step)
    every, start = np.ones(time.size), initial_angle(signal)
    log = Log(
        time,
        input=signal.sample(time),
        angle=start * every,
        input_kind=data.input_kind,
        intersample=Intersample.FIRST_ORDER_HOLD,
        added_mass=mass,
        source="design",
        regimes=(Regime(0.0, 0.0), Regime(duration / 2, 2 * parameters.slow_interval)),
    )
    if servo is not None:
        loop: dict[str, Any] = {"input_kind": InputKind.SETPOINT, "servo": servo.servo}
        supply = None if servo.supply is None else servo.supply.mean() * every
        off = 0 * every if isinstance(signal, FreeDecay) else None
        log = driven(
            replace(log, **loop, intersample=servo.intersample, supply=supply, enabled=off)
        )
    if data.logs[0].integrated:
        log = replace(log, integrated=True, velocity=0 * every)
    far = 1e3 * LARGEST_SWING
    with np.errstate(all="ignore"):  # of a loop that is not stable
        measured = Simulation(log, parameters).run(parameters, 0.0, 0.0).at(time)
    return log.with_measurement(np.clip(np.nan_to_num(measured, nan=far), -far, far))


def _warning(plan: Plan[Candidate], estimate: Estimate, limit: float) -> str:
    """Say why the prediction of a candidate is unreliable, if it is."""
    signal, log, swing = plan.recipe.signal, plan.recipe.log, plan.recipe.swing
    loaded, loop = estimate.parameters.with_added_mass(log.added_mass), log.servo
    peak, doubt = _peak(signal), plan.spread / max(float(np.std(log.measured)), 1e-9)
    if swing > limit:
        return f"swings too wide: {swing:.2g} {log.added_mass.joint.way}"
    if loop is not None and not loop.of_speed and swing < _FOLLOWS * peak < math.inf:
        return f"reaches only {100 * swing / peak:.0f} % of its set-point"
    if loop is None and abs(loaded.p4) * peak < _OF_FRICTION * loaded.coulomb:
        return "the drive hardly exceeds Coulomb friction"
    if doubt > _UNSURE:
        return f"hypersensitive: its angle is uncertain by {100 * doubt:.0f} % of its swing"
    return ""


def _peak(signal: Excitation) -> float:
    """Return the largest value of an input; infinite for a free decay, which needs no drive."""
    if isinstance(signal, Sine):
        return signal.amplitude
    return signal.peak if isinstance(signal, Multisine) else math.inf
