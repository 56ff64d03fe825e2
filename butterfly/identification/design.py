"""Design of the next experiment: runs that reach a goal, ranked by the robot time that they cost.

Each is simulated with the estimate. Its information is the integral of J' J over time (Walter &
Pronzato, Identification of Parametric Models from Experimental Data, 1997, ch. 6), in units in
which the logs so far have the information that their intervals show: so whatever errors are not
white, or rest on something else, counts as often as it did before. A servo is planned set-points,
and falls with its torque off: it takes no other input.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, require_number
from butterfly.identification.data import DataSet
from butterfly.identification.free_run import Setting
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.levels import LOST, PRECISE, ROUNDING, SPREADS
from butterfly.identification.segment import LONGEST_STEP
from butterfly.identification.servo_drive import driven
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.logs.regimes import Regime
from butterfly.model.linear import LARGEST_SWING, resonance_frequency
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.model.terms import PARAMETERS
from butterfly.progress import Track, in_threads, out_of_time, untracked
from butterfly.signals.excitations import Excitation, FreeDecay, Multisine, initial_angle

OF_GOAL = tuple(name for name in PARAMETERS if name != "delay")
"""Parameters that a goal concerns: the half-widths of their 95 % intervals over their values."""

MOST_RUNS = 50
"""Largest number of runs alike in a plan."""

_PAUSE = 3.0  # s of robot time between two runs
_SWINGS = (0.15, 0.4)  # target swings of the amplitudes, over the allowed one
# harmonics of a base, of a multisine or one sine each, and the one at the resonance
_HARMONICS, _RESONANCE = (10, 15, 18, 20, 22, 27, 40), 20
_OF_FRICTION = 4 / math.pi  # amplitude of the first harmonic of dry friction, over its torque

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan(Generic[_T]):
    """A run, to be played some times: what that costs, and what is known afterwards."""

    recipe: _T  # what is played
    duration: float  # of one run in s
    runs: int  # from which what is wanted is reached, at most `MOST_RUNS`
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

    Of friction that may be 0 the share in all friction counts. While the scale is open, they are
    half as large: it follows from two configurations, whose errors add.
    """
    speed = float(np.median([log.rms_speed for log in logs]))
    friction = abs(estimate.parameters.p2) * speed + estimate.parameters.coulomb
    least = {"p2": PRECISE * friction / speed, "coulomb": PRECISE * friction}
    sizes = np.abs(estimate.values)
    for k, name in enumerate(estimate.names):
        if name not in OF_GOAL:
            sizes[k] = math.inf
        elif estimate.lower[k] <= 0:
            sizes[k] = max(sizes[k], least.get(name, ROUNDING * estimate.upper[k]))
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
    covariance = estimate.interval_covariance
    if not np.isfinite(covariance).all():
        covariance = estimate.covariance
    errors = np.sqrt(np.diag(covariance))
    units = np.outer(errors, errors)
    settings = [data.simulations.setting(k, estimate) for k in range(len(data.logs))]
    so_far = sum(
        _information(data.simulations.simulation(k, each), estimate.names, each)
        for k, each in enumerate(settings)
    )
    worth = float(np.exp(2 * np.mean(np.log(_errors(so_far * units)))))  # as intervals show
    sizes, axes = np.linalg.eigh(covariance / units)
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    counts, parameters = np.arange(1, MOST_RUNS + 1), estimate.parameters
    rest = Setting(parameters=parameters, zero=0.0, velocity=0.0)

    def planned(each: tuple[_T, Log]) -> Plan[_T]:
        recipe, log = each
        found = _information(Simulation(log, parameters), estimate.names, rest)
        gains, turns = np.linalg.eigh(root.T @ (worth * found * units) @ root)
        after = 1 / (1 + np.outer(np.maximum(gains, 0.0), counts))
        left = np.sqrt((root @ turns) ** 2 @ after)  # errors after each number of runs, over now's
        shares = np.max((SPREADS * errors / aim)[:, None] * left, axis=0)
        runs = int(np.argmax(np.append(shares[:-1] <= 1, True))) + 1
        duration = log.time.size * log.mean_step
        other = log.added_mass.inertia_and_moment != mounted.inertia_and_moment
        return Plan(
            recipe=recipe,
            duration=duration,
            runs=runs,
            change=price * other,
            expected=(float(shares[0]), float(shares[runs - 1])),
            errors=left[:, 0],
            spread=math.sqrt(max(np.trace(estimate.covariance @ found), 0.0) / duration),
        )

    return in_threads(planned, recipes, track, "Rating candidates")


def _information(simulation: Simulation, names: Sequence[str], setting: Setting) -> Samples:
    """Return the (n, n) integral of J' J over time, of a log by n parameters; 0 if it diverges."""
    parameters, zero, velocity = setting.parameters, setting.zero, setting.velocity
    with np.errstate(all="ignore"):
        _, rows = simulation.linearised(names, parameters, zero, velocity)
        counts, *_ = simulation.averages(parameters)
        found = np.asarray(rows.T @ (rows * counts[:, None]) * simulation.log.mean_step)
    return found if np.isfinite(found).all() else np.zeros_like(found)


def _errors(information: Samples) -> Samples:
    """Return (n,) standard errors of an (n, n) information."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 1e-300)) / scale)


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
    mounted, widest = data.logs[-1].added_mass, min(swing, LARGEST_SWING)
    fastest = math.sqrt(2) * max((log.rms_speed for log in servos), default=0.0)
    recipes: list[tuple[Candidate, Log]] = []
    for mass in masses_at_hand(data):
        if recipes and out_of_time("candidates with some of the added masses"):
            break
        loaded = estimate.parameters.with_added_mass(mass)
        jobs: list[tuple[Excitation, Log | None]] = [
            (each, log)
            for log in servos
            for each in _setpoints(loaded, log, fastest, widest, fall=log is servos[0])
        ]
        if not servos:
            way = swing if data.joint is JointKind.SLIDE else widest
            jobs = [(each, None) for each in _inputs(loaded, way, command)]
        for signal, servo in jobs:
            log = expected_log(data, estimate.parameters, mass, signal, duration, servo=servo)
            recipes.append((Candidate(signal=signal, log=log), log))
    every = plans(data, estimate, recipes, aim, mounted=mounted, price=price, track=track)
    ranked = [
        replace(each, recipe=replace(each.recipe, warning=_warning(each, estimate, swing)))
        for each in every
    ]
    return sorted(ranked, key=lambda p: (bool(p.recipe.warning), p.cost, p.expected[1]))


def masses_at_hand(data: DataSet) -> list[AddedMass]:
    """Return the added masses of a data set, and none; those that load alike count once."""
    bare = AddedMass(joint=data.joint, gravity=data.logs[0].added_mass.gravity)
    return sorted({mass.inertia_and_moment: mass for mass in (bare, *data.masses)}.values())


def _inputs(loaded: LumpedParameters, widest: float, most: float) -> list[Excitation]:
    """Propose inputs up to a command, around the resonance of the hand with its added mass."""
    swings = [widest * swing for swing in _SWINGS]
    resonance = resonance_frequency(loaded)
    if resonance == 0.0:
        # Without a restoring moment any frequency will do that friction lets pass.
        resonance = (abs(loaded.p3) / loaded.p1) ** 0.5 or 2.0
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
        own: dict[str, Any] = {"input_kind": InputKind.SETPOINT, "servo": servo.servo}
        supply = None if servo.supply is None else servo.supply.mean() * every
        off = 0 * every if isinstance(signal, FreeDecay) else None
        log = driven(replace(log, **own, intersample=servo.intersample, supply=supply, enabled=off))
    if data.logs[0].integrated:
        log = replace(log, integrated=True, velocity=0 * every)
    far = 1e3 * LARGEST_SWING
    with np.errstate(all="ignore"):  # of a loop that is not stable
        measured = Simulation(log, parameters).run(parameters, 0.0, 0.0).at(time)
    return log.moving_so(np.clip(np.nan_to_num(measured, nan=far), -far, far))


def _warning(plan: Plan[Candidate], estimate: Estimate, limit: float) -> str:
    """Say why the prediction of a candidate is unreliable, if it is."""
    signal, log, swing = plan.recipe.signal, plan.recipe.log, plan.recipe.swing
    loaded, loop = estimate.parameters.with_added_mass(log.added_mass), log.servo
    peak, doubt = _peak(signal), plan.spread / max(float(np.std(log.measured)), 1e-9)
    if swing > limit:
        return f"swings too wide: {swing:.2g} {log.added_mass.joint.way}"
    if loop is not None and not loop.of_speed and swing < LOST * peak < math.inf:
        return f"reaches only {100 * swing / peak:.0f} % of its set-point"
    if loop is None and abs(loaded.p4) * peak < _OF_FRICTION * loaded.coulomb:
        return "the drive hardly exceeds Coulomb friction"
    if doubt > LOST:
        return f"hypersensitive: its angle is uncertain by {100 * doubt:.0f} % of its swing"
    return ""


def _peak(signal: Excitation) -> float:
    """Return the largest value of an input; infinite for a free decay, which needs no drive."""
    if isinstance(signal, Sine):
        return signal.amplitude
    return signal.peak if isinstance(signal, Multisine) else math.inf
