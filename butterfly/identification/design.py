"""Design of the next experiment: candidates ranked by their information.

Each candidate is simulated with the estimate; the sensitivities of its angle to the parameters are
its information, weighted by the misfit that the model has shown so far (Walter & Pronzato,
Identification of Parametric Models from Experimental Data, 1997, ch. 6). A servo is planned
set-points, and falls with its torque off: it takes no other input.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, require_number
from butterfly.identification.data import DataSet
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.levels import LOST, MATTERS
from butterfly.identification.segment import LONGEST_STEP
from butterfly.identification.servo_drive import driven
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.linear import LARGEST_SWING, resonance_frequency
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.progress import Track, in_threads, out_of_time, untracked
from butterfly.signals.excitations import Excitation, FreeDecay, Multisine, initial_angle

DURATION = 40.0
"""Length of a run in s."""

HELPS = 1 - MATTERS
"""Standard errors over the present ones, in the mean, up to which an experiment helps."""

_INDEPENDENT = 2  # independent numbers that a run determines for certain: gain and phase
_SWINGS = (0.15, 0.4)  # target swings of the amplitudes, over the allowed one
# harmonics of a base, of a multisine or one sine each, and the one at the resonance
_HARMONICS, _RESONANCE = (10, 15, 18, 20, 22, 27, 40), 20
_OF_FRICTION = 4 / math.pi  # amplitude of the first harmonic of dry friction, over its torque


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A candidate for the next experiment and its predicted information."""

    added_mass: AddedMass  # what the hand carries
    signal: Excitation  # the input, as an experiment can be driven with it: a servo's set-point
    swing: float  # largest angle in rad predicted, on a slide way in m
    errors: Samples  # (n,) standard errors expected after it, over those before
    warning: str = ""  # why its prediction is unreliable; empty if it is not
    servo: ServoLoop | None = None  # of a closed-loop experiment

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

    @property
    def score(self) -> float:
        """Geometric mean of `errors`: the smaller the better."""
        return float(np.exp(np.mean(np.log(self.errors))))


def rank_experiments(
    estimate: Estimate,
    masses: Sequence[AddedMass],
    misfit: float,
    *,
    largest_swing: float = LARGEST_SWING,
    servos: Sequence[Log] = (),
    track: Track = untracked,
) -> list[Candidate]:
    """Rank sines, multisines and free decays on each added mass by the uncertainty after them.

    Candidates with a warning come last: they swing too far, friction may hold them, or their angle
    depends so much on uncertain parameters that it is not predictable. ``misfit``:
    1 - FIT/100 of the logs so far; ``largest_swing``: allowed, in rad; ``servos``: logs in whose
    loops, and as long, runs are planned.
    """
    require_number("design", positive=True, unit="rad", swing=largest_swing)
    if not np.isfinite(estimate.covariance).all():
        raise IdentifiabilityError(
            f"the method {estimate.method!r} gives no covariance, which a design needs"
        )
    jobs: list[tuple[AddedMass, Excitation, Log | None]] = [
        (mass, each, None)
        for mass in ([] if servos else masses)
        for each in _inputs(estimate.parameters, mass, largest_swing)
    ]
    jobs += [
        (mass, each, log)
        for mass in masses
        for log in servos
        for each in _setpoints(
            estimate.parameters.with_added_mass(mass),
            log,
            math.sqrt(2) * max(each.rms_speed for each in servos),
            min(largest_swing, LARGEST_SWING),
            fall=log is servos[0],
        )
    ]

    def judge(job: tuple[AddedMass, Excitation, Log | None]) -> Candidate | None:
        mass, signal, log = job
        if mass != masses[0] and out_of_time("candidates with some of the added masses"):
            return None
        limits = {"misfit": misfit, "limit": largest_swing}
        return judged_candidate(estimate, mass, signal, log, **limits)

    judged = in_threads(judge, jobs, track, "Rating candidates")
    candidates = (each for each in judged if each is not None)
    return sorted(candidates, key=lambda c: (bool(c.warning), c.score))


def next_experiments(
    data: DataSet,
    estimate: Estimate,
    *,
    largest_swing: float | None = None,
    track: Track = untracked,
) -> list[Candidate]:
    """Rank next experiments with the added masses of a data set (see `rank_experiments`).

    ``largest_swing``: in rad or m; by default `LARGEST_SWING`, or the largest one logged of slides
    and servos.
    """
    estimate.parameters.require_gain("design")
    servos = [*{log.servo: log for log in data.logs if log.closed}.values()]
    if largest_swing is None:
        logged = max(float(np.ptp(log.angle)) / 2 for log in data.logs)
        largest_swing = logged if servos or data.joint is JointKind.SLIDE else LARGEST_SWING
    misfit = 1 - float(np.median(data.simulations.fits(estimate))) / 100
    masses = masses_at_hand(data)
    return rank_experiments(
        estimate, masses, misfit, largest_swing=largest_swing, servos=servos, track=track
    )


def masses_at_hand(data: DataSet) -> list[AddedMass]:
    """Return the added masses of a data set, and none; those that load alike count once."""
    bare = AddedMass(joint=data.joint, gravity=data.logs[0].added_mass.gravity)
    return sorted({mass.inertia_and_moment: mass for mass in (bare, *data.masses)}.values())


def _inputs(parameters: LumpedParameters, mass: AddedMass, limit: float) -> list[Excitation]:
    """Propose inputs around the resonance of the hand with its added mass."""
    widest = limit if mass.joint is JointKind.SLIDE else min(limit, LARGEST_SWING)
    swings = [widest * swing for swing in _SWINGS]
    loaded = parameters.with_added_mass(mass)
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
            inputs.append(Sine(omega=float(f"{omega:.3g}"), amplitude=amplitude))
    torque = (loaded.p1 * resonance**2 * swings[0] + 2 * loaded.coulomb) / abs(loaded.p4)
    base, peak = float(f"{resonance / _RESONANCE:.3g}"), float(f"{torque:.2g}")
    inputs.append(Multisine(base=base, harmonics=_HARMONICS, peak=peak))
    if loaded.p3 != 0.0:  # which restores it
        inputs.append(FreeDecay(angle=widest))
    return inputs


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


def judged_candidate(
    estimate: Estimate,
    mass: AddedMass,
    signal: Excitation,
    servo: Log | None = None,
    *,
    misfit: float,
    limit: float,
) -> Candidate:
    """Return a candidate with its predicted information and warning; in a ``servo``'s loop."""
    parameters = estimate.parameters
    respond = _responder(parameters, mass, signal, servo)
    angle = respond(parameters)
    loop = None if servo is None else servo.servo
    errors = estimate.standard_errors
    columns = []
    for name, error in zip(estimate.names, errors.tolist(), strict=True):
        moved = replace(parameters, **{name: getattr(parameters, name) + error})
        columns.append(respond(moved) - angle)
    jacobian = np.column_stack(columns)  # per standard error
    motion = max(float(np.std(angle)), 1e-9)
    correlation = estimate.covariance / np.outer(errors, errors)
    information = jacobian.T @ jacobian * _INDEPENDENT / (angle.size * (misfit * motion) ** 2)
    after = updated(correlation, information)
    spread = float(np.sqrt(np.trace(correlation @ jacobian.T @ jacobian) / angle.size)) / motion
    swing = float(np.max(np.abs(angle)))
    drive = abs(parameters.p4) * _peak(signal)
    friction = parameters.with_added_mass(mass).coulomb
    warning = ""
    if swing > limit:
        warning = f"swings too wide: {swing:.2g} {mass.joint.way}"
    elif loop is not None and not loop.of_speed and swing < LOST * _peak(signal) < math.inf:
        warning = f"reaches only {100 * swing / _peak(signal):.0f} % of its set-point"
    elif loop is None and drive < _OF_FRICTION * friction:
        warning = "the drive hardly exceeds Coulomb friction"
    elif spread > LOST:
        warning = f"hypersensitive: its angle is uncertain by {100 * spread:.0f} % of its swing"
    return Candidate(
        added_mass=mass,
        signal=signal,
        swing=swing,
        errors=np.sqrt(np.diag(after)),
        warning=warning,
        servo=loop,
    )


def updated(covariance: Samples, information: Samples) -> Samples:
    """Return an (n, n) covariance after an independent (n, n) information; singular ones too."""
    sizes, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    inner = np.eye(len(root)) + root.T @ information @ root
    return np.asarray(root @ np.linalg.solve(inner, root.T))


def _peak(signal: Excitation) -> float:
    """Return the largest value of an input; infinite for a free decay, which needs no drive."""
    if isinstance(signal, Sine):
        return signal.amplitude
    return signal.peak if isinstance(signal, Multisine) else math.inf


def _responder(
    parameters: LumpedParameters, mass: AddedMass, signal: Excitation, servo: Log | None
) -> Callable[[LumpedParameters], Samples]:
    """Return the simulation of a candidate, open-loop or in a servo's loop as long as its log."""
    if servo is None:
        return partial(_respond, mass=mass, signal=signal)
    time = np.arange(0.0, min(float(np.ptp(servo.time)), DURATION), servo.mean_step)
    every, start = np.ones(time.size), initial_angle(signal)
    planned = Log(
        time,
        input=signal.sample(time),
        angle=start * every,
        input_kind=InputKind.SETPOINT,
        intersample=servo.intersample,
        servo=servo.servo,
        supply=None if servo.supply is None else servo.supply.mean() * every,
        enabled=0 * every if isinstance(signal, FreeDecay) else None,
        added_mass=mass,
    )
    simulation = Simulation(driven(planned), parameters)
    far = 1e3 * LARGEST_SWING

    def respond(moved: LumpedParameters) -> Samples:
        with np.errstate(all="ignore"):  # of a loop that is not stable
            angle = simulation.run(moved, 0.0, 0.0).at(time)
        return np.clip(np.nan_to_num(angle, nan=far), -far, far)

    return respond


def _respond(parameters: LumpedParameters, *, mass: AddedMass, signal: Excitation) -> Samples:
    """Simulate a candidate from rest without bias; a clock of two regimes is slow at its end."""
    time = np.arange(0.0, DURATION, LONGEST_STEP)
    instants = np.column_stack([time[:-1], time[:-1] + LONGEST_STEP / 2, time[1:]])
    slow = (instants > DURATION / 2) & (parameters.slow_interval > 0)
    late = instants - parameters.delay - parameters.slow_delay * slow
    inputs = np.where(late < 0, 0.0, signal.sample(late.ravel()).reshape(late.shape))
    angle, _ = simulate(parameters.with_added_mass(mass), time, inputs, initial_angle(signal))
    return angle
