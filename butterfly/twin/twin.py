"""The identified joint for other programs, and how far it moves as our own simulation does."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import NamedTuple, TypeAlias

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.identified import Identified
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.linear import LinearJoint, resonance_frequency
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    JointKind,
    LumpedParameters,
)
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.servo import ServoLoop
from butterfly.model.terms import TERMS, Term
from butterfly.plant.robot import Robot, Shape
from butterfly.progress import in_threads, out_of_time, untracked
from butterfly.signals import hold

NO_DELAY = 1e-5  # s, in which no joint of up to 10 rad/s moves by 1e-4 rad


class Body(NamedTuple):
    """What swings with all that it carries, as one rigid body."""

    mass: float  # In kg, on which no motion of a hinge depends
    offset: float  # Distance in m of its centre of mass from the axis, towards positive angles
    below: float  # and downwards, at angle 0
    inertia: float  # About the centre of mass in kg m²


@dataclass(frozen=True, kw_only=True)
class Twin:
    """A joint to export: its parameters, what it carries, and logs that show how it moves."""

    name: str = "joint"  # of the data set or experiment
    parameters: LumpedParameters  # of the bare joint, those of its command included
    added: AddedMass = NO_ADDED_MASS  # what it carries
    joint: JointKind = JointKind.HINGE
    kind: InputKind = InputKind.VOLTAGE  # what the command means
    limit: float = math.inf  # saturation, in units of the command
    resolution: float = 0.0  # step to which a command is rounded; 0 for none
    servo: ServoLoop | None = None  # the loop in which it was identified
    known: Prior = NO_PRIOR  # what was known of it
    ratios: bool = False  # whether the parameters are ratios to p1
    robot: Robot | None = None  # that of an experiment, whose shape is known, not its motion alone
    holds: str = ""  # over which time simulations stay near its logs, where that is not all of them
    zeros: tuple[float, ...] = ()  # readings in rad of the logs' encoders at angle 0
    mass: float | None = None  # in kg, on which no motion depends; a possible one if None
    # whether what swings across the ground's gravity is drawn as the Butterfly robot's hand
    is_butterfly: bool = False
    # whose covariance says how well its parameters are known; None if they are exact
    estimate: Estimate | None = field(default=None, compare=False)
    source: Identified | None = field(default=None, compare=False)  # that it is the twin of
    # returns logs of its motion, and what each is simulated with
    recorded: Callable[[], Sequence[tuple[Log, Setting]]] = field(default=tuple, compare=False)

    @classmethod
    def identified(
        cls, identified: Identified, added: AddedMass = NO_ADDED_MASS, mass: float | None = None
    ) -> Twin:
        """Return the twin of what was learnt, with a load and a mass in kg."""
        estimate, origin = identified.estimate, identified.origin

        def recorded() -> Sequence[tuple[Log, Setting]]:
            try:
                logs = identified.data
            except ButterflyError:
                return ()
            settings = (logs.simulations.setting(k, estimate) for k in range(len(logs.logs)))
            return tuple(zip(logs.logs, settings, strict=True))

        joint = JointKind(origin.get("joint", JointKind.HINGE))
        gravity, manifest = float(origin.get("gravity", GRAVITY)), origin["manifest"] or {}
        loop = manifest.get("loop", {}) | ((manifest.get("logs") or [{}])[0].get("loop") or {})
        return cls(
            name=origin["name"],
            parameters=estimate.parameters,
            estimate=estimate,
            source=identified,
            added=replace(added, gravity=gravity, joint=joint),
            joint=joint,
            kind=InputKind(origin["input"]),
            servo=ServoLoop.of(loop, whole=False) if loop else None,
            known=Prior.of(origin.get("known", {})),
            ratios=estimate.ratios,
            holds=identified.fit.holds,
            zeros=tuple(identified.zeros.values()),
            mass=mass,
            is_butterfly=manifest.get("shape") == "butterfly",
            recorded=recorded,
        )

    def judging(self) -> Sequence[tuple[Log, Setting]]:
        """Return the logs that judge (see `Simulations.judging`), and what each is run with."""
        recorded = self.recorded()
        if self.source is None or not recorded:
            return recorded
        data = self.source.data
        judging = data.simulations.judging(self.source.estimate)
        names = {data.logs[number].name for number in judging}
        others = {log.name for log in data.logs} - names
        return [(log, setting) for log, setting in recorded if log.name not in others]

    @cached_property
    def loaded(self) -> LumpedParameters:
        """The parameters of the joint with what it carries."""
        return self.parameters.with_added_mass(self.added)

    @property
    def shape(self) -> Shape:
        """What it looks like."""
        return self.built[0].shape

    @cached_property
    def built(self) -> tuple[Robot, AddedMass]:
        """The robot that moves so, and what that carries besides."""
        if self.robot is not None:
            return self.robot, self.added
        driven = replace(self.parameters, p4=self.parameters.p4 or 1.0)
        robot, added = Robot.of_loaded(driven, self.added, self.mass)
        if self.is_butterfly and self.added.gravity == GRAVITY:
            robot = replace(robot, shape=Shape.BUTTERFLY)
        return robot, added

    @cached_property
    def body(self) -> Body:
        """What swings, as one rigid body; that of a slide weighs p1."""
        robot, added = self.built
        hand, p1 = robot.hand, robot.loaded(added).p1
        if robot.shape is Shape.SLIDE:
            return Body(p1, 0.0, 0.0, p1)
        mass = hand.mass + added.mass
        offset = hand.mass * hand.com_offset / mass
        below = (hand.mass * hand.com_distance + added.mass * added.arm) / mass
        return Body(mass, offset, below, p1 - mass * (offset**2 + below**2))

    @property
    def log_lines(self) -> tuple[str, ...]:
        """Say over which time it follows its logs, and how the encoder's angle follows from its."""
        held = (self.holds,) if self.holds else ()
        if not self.zeros:
            return held
        ends = dict.fromkeys(f"{round(extreme(self.zeros), 4) + 0.0:g}" for extreme in (min, max))
        text = f"Encoder's angle = angle here + zero; zero = {' to '.join(ends)} rad in the logs."
        return *held, text

    @property
    def identifier(self) -> str:
        """Its name as an identifier of C, Python and XML: lower case, digits, underscores."""
        plain = re.sub(r"[^a-z0-9]+", "_", self.name.lower()).strip("_")
        return plain if plain and not plain[0].isdigit() else f"joint_{plain}".rstrip("_")


def unheard(twin: Twin) -> Iterator[str]:
    """Name what a format that takes the drive's command does not include."""
    p = twin.loaded
    if twin.servo is not None:
        yield (
            f"The servo's loop ({twin.servo.law}) is not included: the command is the drive's (as "
            "set by the firmware), not a set-point."
        )
        if p.back_emf:
            yield "The back EMF brakes even with the torque off."
    if p.slow_delay:
        yield (
            f"The delay is {1e3 * p.delay:.3g} ms, that of fast sampling; in slow sampling it is "
            f"{1e3 * (p.delay + p.slow_delay):.3g} ms."
        )
    if p.delay < -NO_DELAY:
        yield f"The delay of {1e3 * p.delay:.3g} ms is not included: a delay cannot be negative."


def beyond(p: LumpedParameters, held: Collection[str]) -> list[Term]:
    """Return the active terms of a joint that a format cannot represent."""
    rows = (TERMS[term.name] for term in fields(p) if term.name in TERMS.keys() - held)
    idle = {term.name: term.default for term in fields(p)}
    return [
        row
        for row in rows
        if getattr(p, row.name) != idle[row.name]
        and (not row.follows or any(getattr(p, name) for name in row.follows))
    ]


def listed(p: LumpedParameters, rows: Iterable[Term], unit: str) -> str:
    """Return terms with their values; ``unit`` is the command's."""
    units = {"–": ""}
    texts = (
        f"{row.name} {getattr(p, row.name):.4g} {units.get(row.unit, row.unit)}" for row in rows
    )
    return ", ".join(text.strip().replace("unit", unit) for text in texts)


def told_of(servo: ServoLoop, held: Collection[str]) -> list[str]:
    """Return the facts of a servo's loop that a format does not hold."""
    return [
        f"{setting.name} {value.value if isinstance(value, Known) else value}"
        for setting in fields(servo)
        if setting.name not in held and (value := getattr(servo, setting.name)) != setting.default
    ]


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Error of a twin against our own simulation of the same inputs."""

    errors: dict[str, float]  # largest error in each log, in rad (m for a slide), by the log's name
    unit: str  # unit of the errors
    besides: int = 0  # number of logs not compared: near the upright, or for lack of time

    @property
    def worst(self) -> float:
        """The largest error."""
        return max(self.errors.values())

    @property
    def sentence(self) -> str:
        """One sentence for people."""
        errors = [*self.errors.values()]
        text = f"Largest error against our own simulation: {self.worst:.2g} {self.unit}"
        if len(errors) > 1:
            middle = f"(median {np.median(errors):.2g} {self.unit})"
            text += f" in {len(errors)} logs, each with its own mass {middle}"
        few = f"{self.besides} more log{'s' * (self.besides > 1)}"
        more = f"; {few} not compared" if self.besides else ""
        return f"{text}{more}."

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines for a file: the sentence, and each log."""
        errors = (f"{name}: {error:.2g} {self.unit}" for name, error in self.errors.items())
        return self.sentence, *(errors if len(self.errors) > 1 else ())


@dataclass(frozen=True, kw_only=True)
class Written:
    """A twin in one format."""

    text: str  # the file's text
    about: str  # a short description
    # sentences on what the format cannot represent; the file contains them too
    left_out: tuple[str, ...] = ()
    # error against our own simulation; None for a format without simulation
    accuracy: Accuracy | None = None
    title: str = "Twin"  # what it is
    notes: tuple[str, ...] = ()  # sentences on its use


_MINUTE = 60.0  # s
_SWING = 0.15  # rad, of each of the sines that stand for logs where there are none
_TONES = (0.7, 1.3)  # their frequencies, over that of the resonance,
_PACE = 3.0  # or in its place, in rad/s, where there is none
_SOME = 3  # logs by which the form of a twin is chosen,
_TRIED = 20.0  # and how much of each, in s
_FINE = 1e-3  # s, longest step of our own simulation here: what is left of it is 1e-6 rad
_EARLIER = 2  # steps more than the delay before a log, whose commands are told


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A log cut in steps: (n,) commands, the start, and (n + 1,) angles of our own simulation."""

    name: str
    twin: Twin
    past: Samples  # commands of some earlier steps, which a delay lets act later
    commands: Samples
    angle: float
    velocity: float
    simulated: Samples

    @classmethod
    def of(cls, twin: Twin, log: Log, setting: Setting, step: float) -> Case:
        """Simulate a log as the twin that carries its added mass, and cut its input in steps."""
        log = log.opened
        carrying = replace(twin, added=log.added_mass)
        p = carrying.parameters
        simulation = Simulation(log, p, longest=_FINE)
        angle, velocity = simulation.given_start(setting.velocity)
        motion = simulation.run(p, setting.zero, setting.velocity)
        length = min(log.time[-1] - log.time[0], setting.horizon)
        instants = log.time[0] + step * np.arange(max(int(length / step + 1e-9), 1) + 1)
        earlier = math.ceil(max(p.delay, 0.0) / step) + _EARLIER
        edges = np.concatenate([instants[0] - step * np.arange(earlier, 0, -1), instants])
        stamps, commands = log.command
        means = hold.mean(stamps, p.drive.delivered(commands), edges, log.between_samples)
        return cls(
            name=log.name,
            twin=carrying,
            past=means[:earlier],
            commands=means[earlier:],
            angle=angle - setting.zero,
            velocity=velocity,
            simulated=motion.at(instants) - setting.zero,
        )

    def error(self, move: Mover, most: int | None = None) -> float:
        """Return the largest difference of a motion over so many steps."""
        moved = move(replace(self, commands=self.commands[:most]))
        with np.errstate(invalid="ignore"):
            error = float(np.abs(moved - self.simulated[: moved.size]).max())
        return error if np.isfinite(error) else np.inf


Mover: TypeAlias = Callable[[Case], Samples]
"""Moves a case's twin by its commands: (n + 1,) angles."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Yardstick:
    """Our own simulations of a twin's logs at a step in s, to compare its motion with."""

    cases: Sequence[Case]
    step: float
    besides: int

    @classmethod
    def of(cls, twin: Twin, step: float) -> Yardstick:
        """Simulate a twin's logs; where there are none, a minute of two sines."""
        recorded = twin.judging() or [_minute(twin)]
        cases: list[Case] = []
        for log, setting in recorded:
            if cases and out_of_time("the comparison with some logs"):
                break
            cases.append(Case.of(twin, log, setting, step))
        return cls(cases=cases, step=step, besides=max(len(twin.recorded()), 1) - len(cases))

    def worst_of_some(self, move: Mover) -> float:
        """Return the largest error over some of the logs."""
        numbers = np.linspace(0, len(self.cases) - 1, min(_SOME, len(self.cases)))
        some = [self.cases[int(number)] for number in numbers]
        most = int(_TRIED / self.step)
        return max(in_threads(partial(Case.error, move=move, most=most), some, untracked, ""))

    def accuracy(self, move: Mover) -> Accuracy:
        """Return the errors of all logs."""
        errors = in_threads(partial(Case.error, move=move), self.cases, untracked, "")
        names = [case.name or f"log {k}" for k, case in enumerate(self.cases, 1)]
        named, unit = dict(zip(names, errors, strict=True)), self.cases[0].twin.joint.way
        return Accuracy(errors=named, unit=unit, besides=self.besides)


def _minute(twin: Twin) -> tuple[Log, Setting]:
    """Return a minute of two sines that move the joint; of one without a drive, a free decay."""
    time = 1e-3 * np.arange(int(1e3 * _MINUTE) + 1, dtype=np.float64)
    loaded = twin.loaded
    pace = resonance_frequency(loaded) or _PACE
    inputs, start = np.zeros(time.size), 0.0 if loaded.p4 else _SWING
    for tone in _TONES if loaded.p4 else ():
        omega = tone * pace
        gain = abs(complex(LinearJoint.of(loaded).response(omega)))
        inputs += (_SWING / gain + loaded.holding / loaded.p4) * np.sin(omega * time)
    log = Log(
        time,
        input=inputs,
        angle=np.full(time.size, start),
        added_mass=twin.added,
        intersample=Intersample.FIRST_ORDER_HOLD,
        name="a minute of two sines",
    )
    return log, Setting(parameters=twin.parameters, zero=0.0, velocity=0.0)
