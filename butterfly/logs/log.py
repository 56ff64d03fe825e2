"""The one form in which recorded and simulated experiments reach identification."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from pathlib import PurePath
from types import NoneType
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest, require_number
from butterfly.logs.regimes import Regime, between_regimes
from butterfly.logs.units import AS_IS, ColumnReading, Heading, Units, read_unit
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind
from butterfly.model.prior import Known, known_of
from butterfly.model.servo import ServoLoop

MIN_SAMPLES = 16
"""Fewest samples that make a log."""

_MOST = 0.9
_MOST_OF_NOISE = 4.029  # that quantile of its second differences, over its standard deviation

_SPAN = 0.05  # s, over which an angle advances by more than noise
_REACH = 0.7  # rad of the motion's own phase, over which a cubic follows it
_WIDE = 1.0  # rad, beyond which a wider motion is no slower
_FEWEST = 12  # samples that a cubic is fitted to
_SURE = 6.0  # standard errors from 0 at which a velocity counts as one
_SETTLED = 0.3  # share by which half as many samples may give another velocity
_NOTABLE = 0.1  # share of the rms velocity, from which on a beginning is in motion

_NO_NUMBERS = "mMc"  # kinds of NumPy's: spans of time, dates, complex numbers

SAMPLED = ("time", "input", "angle", "velocity")
"""The sampled columns of a log; one of the last two may be missing."""

OF_SERVO = ("setpoint", "supply", "enabled")
"""The sampled columns that a servo may have besides."""

_MEASURED_IN = {"supply": "voltage"}

_NOT_RECORDED: Samples = np.empty(0)


class InputKind(StrEnum):
    """What the input column commands."""

    VOLTAGE = "voltage"
    TORQUE = "torque"
    CURRENT = "current"
    DUTY = "duty"  # the share of its supply that a voltage drive passes on
    SETPOINT = "setpoint"  # what a servo is to follow, by a loop of its own
    NONE = "none"  # nothing drives: a joint that swings freely needs no such column

    @property
    def unit(self) -> str:
        """What p4 is per unit of."""
        units = {InputKind.VOLTAGE: "V", InputKind.CURRENT: "A", InputKind.DUTY: "duty"}
        return units.get(self, "unit")


class Intersample(StrEnum):
    """What the input does between its samples."""

    ZERO_ORDER_HOLD = "zero_order_hold"
    FIRST_ORDER_HOLD = "first_order_hold"


@dataclass(frozen=True, kw_only=True)
class Sine:
    """The input A sin(w t): ``omega`` w in rad/s, ``amplitude`` A in units of the input."""

    omega: float
    amplitude: float

    def __post_init__(self) -> None:
        require_number("excitation", positive=True, omega=self.omega, amplitude=self.amplitude)

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) input at (n,) instants in s."""
        return np.asarray(self.amplitude * np.sin(self.omega * time))


@dataclass(frozen=True, kw_only=True, eq=False)
class Lead:
    """What was commanded before a log begins, which is then a piece of a longer recording."""

    time: Samples  # (n,) increasing stamps in s, before the log's first one
    input: Samples  # the command at each
    setpoint: Samples | None = None  # of a servo in its loop


class InitialState(NamedTuple):
    """Angle in rad, from the encoder's zero, and velocity in rad/s at the first sample of a log."""

    angle: float
    velocity: float


@dataclass(frozen=True, kw_only=True)
class FileReading:
    """How a file was read, where it is not as the project writes it."""

    layout: tuple[str, ...] = ()  # of its text: delimiters, decimal commas, lines without samples
    cut_lines: int = 0  # last lines that were cut off in writing, and dropped
    columns: Mapping[str, ColumnReading] = field(default_factory=dict)  # by field


AS_WRITTEN = FileReading()
"""Of a file as the project writes it, and of a log from no file."""

LONGEST_LEAD = 2.0
"""Of what was commanded before a log, in s: longer than any delay."""

_KINDS: tuple[tuple[str, type | tuple[type, ...], str], ...] = (
    ("added_mass", AddedMass, "an AddedMass"),
    ("excitation", (Sine, NoneType), "a Sine, or None"),
    ("lead", (Lead, NoneType), "a Lead, or None"),
    ("servo", (ServoLoop, NoneType), "a ServoLoop, or None"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """One experiment: what was commanded and what the encoder saw.

    Columns may be anything that NumPy makes arrays of; see `from_frame` for tables.

    Parameters
    ----------
    time
        (n,) stamps in s, as recorded (see `butterfly.logs.health` for repeated or backward ones).
    input
        (n,) command at each stamp: V, A, units of torque command, a duty from -1 to 1, or what a
        servo is to follow, in rad or rad/s; 0 where nothing drives.
    angle
        (n,) rad, from the encoder's own zero. Without one it is the integral of the velocity, which
        does where no gravity acts.
    velocity
        (n,) rad/s, or None. Beside an angle it is kept for display.
    setpoint, supply, enabled
        Of a servo, or None: (n,) what it follows, where the input is its drive; its supply in V;
        and whether it is driven, 0 or 1.
    servo
        The loop in which it is simulated, by the set-point; None for one that its input drives.
    input_kind, intersample
        What the command means, and how it is held between stamps.
    added_mass
        What the hand carried.
    excitation
        The sinusoid that was commanded, or None for any other input.
    zero
        The encoder's reading in rad where the model's angle is 0, if it is known: a number, or a
        pair of a value and its standard uncertainty.
    lead
        What was commanded before, of a piece of a longer recording, which begins in motion; None
        for a recording from its own beginning, at rest unless its first samples say otherwise.
    source
        File or plant that the log came from, for messages.
    name
        What distinguishes the log from the others of its data set (see `with_unique_names`).
    reading
        How its file was read.
    integrated, rebuilt
        Whether the angle was not recorded, and is the integral of the velocity; and whether the
        input was not, and is what the servo's law made of its set-point.
    regimes
        Of its clock, where its mean interval switches (see `butterfly.logs.regimes`): `examine` of
        `butterfly.logs.health` finds them.
    """

    time: Samples
    input: Samples = field(default_factory=lambda: _NOT_RECORDED)
    angle: Samples = field(default_factory=lambda: _NOT_RECORDED)
    velocity: Samples | None = None
    _: KW_ONLY
    setpoint: Samples | None = None
    supply: Samples | None = None
    enabled: Samples | None = None
    servo: ServoLoop | None = None
    input_kind: InputKind = InputKind.VOLTAGE
    intersample: Intersample = Intersample.ZERO_ORDER_HOLD
    added_mass: AddedMass = NO_ADDED_MASS
    excitation: Sine | None = None
    zero: Known | None = None
    lead: Lead | None = None
    source: str = "log"
    name: str = ""
    reading: FileReading = AS_WRITTEN
    integrated: bool = False
    rebuilt: bool = False
    regimes: tuple[Regime, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "integrated", self.integrated or self.angle is _NOT_RECORDED)
        for name in (*SAMPLED, *OF_SERVO):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._column(name))
        for name, kind in (("input_kind", InputKind), ("intersample", Intersample)):
            object.__setattr__(self, name, self._choice(name, kind))
        for name, kinds, expected in _KINDS:
            if not isinstance(getattr(self, name), kinds):
                raise InputError(self.source, name, getattr(self, name), expected)
        if self.zero is not None:
            object.__setattr__(self, "zero", known_of(self.zero, self.source, "zero"))
        self._declare_input()
        if self.input_kind is InputKind.SETPOINT and self.servo is None:
            expected = "its loop, such as {law: dynamixel-x, kp: 400}"
            raise InputError(self.source, "servo", "nothing, under a set-point", expected)
        self._require_lengths()
        if self.integrated:
            if self.velocity is None:
                raise InputError(self.source, "angle", "nothing", "an angle, or a velocity")
            object.__setattr__(self, "angle", _integral(self.time, self.velocity))

    def _declare_input(self) -> None:
        """Set the input of a joint that swings freely to 0; refuse one that says otherwise."""
        free = self.input_kind is InputKind.NONE
        if self.input is _NOT_RECORDED:
            if not free:
                expected = "an input, or the kind of input none where nothing drives the joint"
                raise InputError(self.source, "input", "nothing", expected)
            object.__setattr__(self, "input", np.zeros(self.time.size))
        elif free and np.any(self.input):
            found = f"{self.input[np.flatnonzero(self.input)[0]]:g}"
            raise InputError(self.source, "input", found, "0 throughout, where nothing drives")

    def _require_lengths(self) -> None:
        n = self.time.size
        for name, column in self.columns().items():
            if column.shape != (n,):
                raise InputError(self.source, name, f"shape {column.shape}", f"shape ({n},)")
        if n < MIN_SAMPLES:
            raise InputError(self.source, "time", f"{n} samples", f"at least {MIN_SAMPLES}")

    @classmethod
    def from_frame(
        cls,
        frame: Mapping[str, Any],
        *,
        time: str = "time",
        input: str | None = "input",  # noqa: A002 - the column's name in a log
        angle: str | None = "angle",
        velocity: str | None = None,
        units: Mapping[str, str | float] | None = None,
        **properties: Any,  # noqa: ANN401 - the other fields of the class
    ) -> Log:
        """Make a log of the columns of a pandas frame, or of anything that has columns by name.

        Parameters
        ----------
        frame
            The table.
        time, input, angle, velocity
            Names of its columns; None of one that it lacks.
        units
            Of the columns (see `butterfly.logs.units`), besides what their names say in brackets.
        properties
            The other fields.

        Raises
        ------
        InputError
            If there is no such column, one holds no numbers, or a unit is none of its column.
        """
        named = {"time": time, "input": input, "angle": angle, "velocity": velocity}
        columns = {}
        for column, name in named.items():
            if name is None:
                continue
            try:
                columns[column] = frame[name]
            except (KeyError, IndexError, ValueError, TypeError):
                raise InputError("frame", column, name, "the name of a column") from None
        headings = {column: Heading(name=str(named[column])) for column in columns}
        own = {"source": "frame", **properties}
        return cls.of_columns(columns, headings, Units.of(units, "frame"), **own)

    @classmethod
    def of_columns(
        cls,
        columns: Mapping[str, Any],
        headings: Mapping[str, Heading],
        units: Units = AS_IS,
        *,
        unasked: Collection[str] = (),
        **properties: Any,  # noqa: ANN401 - the other fields of the class
    ) -> Log:
        """Make a log of columns in their units (see `read_unit`); all readers end here.

        Of those ``unasked`` for, one in a unit that is not known is left out.
        """
        log = cls(**columns, **properties)
        layout, found = list(log.reading.layout), {}
        for name, heading in headings.items():
            if name == "enabled":  # yes or no
                continue
            told = name == "input" and log.input_kind is InputKind.SETPOINT
            field = "setpoint" if told else name
            try:
                found[name] = read_unit(log.source, field, heading, units, log.quantities(name))
            except InputError as error:
                if name not in unasked:
                    raise
                layout.append(f"{name} left out: {error.value} is not known")
        reading = replace(log.reading, layout=tuple(layout), columns=found)
        changed: dict[str, Any] = dict.fromkeys(unasked)
        for name, each in found.items():
            own = getattr(log, name)
            changed[name] = own if each.factor == 1.0 else own * each.factor
        return replace(log, **changed, reading=reading)

    def quantities(self, name: str) -> tuple[str, ...]:
        """Return what a sampled column may measure, the project's own unit of it first."""
        turns = self.added_mass.joint is JointKind.HINGE
        own = {InputKind.VOLTAGE: "voltage", InputKind.CURRENT: "current", InputKind.DUTY: "share"}
        if name == "setpoint" or (name == "input" and self.input_kind is InputKind.SETPOINT):
            name = "velocity" if self.servo and self.servo.of_speed else "angle"
        if name == "input" and self.input_kind is InputKind.NONE:
            return ("voltage", "torque", "force", "current", "share")
        if name == "input" and self.input_kind in own:
            return (own[self.input_kind],)
        if name == "input":
            return ("torque" if turns else "force", "current", "share")
        kinds = {"angle": ("angle", "length"), "velocity": ("rate", "speed")}
        return (kinds[name][not turns],) if name in kinds else (_MEASURED_IN.get(name, name),)

    def at_joint(self, ratio: float) -> Log:
        """Return the log of an encoder on the motor, so many turns of which are one of the joint.

        A set-point, and the loop that follows it, are the motor's too.
        """
        columns = ["angle", "velocity", "setpoint"]
        columns += ["input"] if self.input_kind is InputKind.SETPOINT else []
        told = {name: getattr(self, name) for name in columns}
        own = {name: each / ratio for name, each in told.items() if each is not None}
        zero = None if self.zero is None else self.zero.times(1 / ratio)
        servo = None if self.servo is None else self.servo.at_joint(ratio)
        return replace(self, **own, zero=zero, servo=servo)

    def timed(self, factor: float) -> Log:
        """Return the log with its stamps multiplied by a factor, by which speeds are divided."""
        lead, velocity = self.lead, self.velocity
        return replace(
            self,
            time=factor * self.time,
            velocity=None if velocity is None else velocity / factor,
            lead=None if lead is None else replace(lead, time=factor * lead.time),
            regimes=tuple(Regime(factor * each, factor * step) for each, step in self.regimes),
        )

    def tuned(self, factor: float) -> Log:
        """Return the log with its sine's omega multiplied by a factor."""
        sine = self.excitation
        sine = None if sine is None else replace(sine, omega=factor * sine.omega)
        return replace(self, excitation=sine)

    def _column(self, name: str) -> Samples:
        try:
            column = getattr(self, name)
            given = np.asarray(column)
            if given.dtype.kind in _NO_NUMBERS:
                raise TypeError
            if isinstance(column, np.ma.MaskedArray):  # what is masked is missing
                given = np.where(np.ma.getmaskarray(column), np.nan, given)
            return given.astype(np.float64, copy=False)
        except (TypeError, ValueError):
            raise InputError(self.source, name, "values that are no numbers", "numbers") from None

    def _choice(self, name: str, kind: type[StrEnum]) -> StrEnum:
        value, known = getattr(self, name), [str(each) for each in kind]
        if value not in known:
            raise InputError(self.source, name, value, nearest(str(value), known))
        return kind(value)

    def __repr__(self) -> str:
        return (
            f"Log({self.name or self.source!r}, {self.label}: {self.time.size} samples in "
            f"{self.time[-1] - self.time[0]:.4g} s, {self.input_kind})"
        )

    def columns(self) -> dict[str, Samples]:
        """Return the sampled columns that were recorded, by name."""
        values = {name: getattr(self, name) for name in (*SAMPLED, *OF_SERVO)}
        if self.integrated:
            del values["angle"]
        return {name: value for name, value in values.items() if value is not None}

    def take(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Log:
        """Return the log of the samples selected by a mask, or by their numbers."""
        taken: dict[str, Any] = {name: column[rows] for name, column in self.columns().items()}
        return replace(self, **taken)

    def piece(self, first: int, last: int) -> Log:
        """Return the log of the samples from number ``first`` to before number ``last``.

        Unless it is the beginning, it begins in motion, with what was commanded before.
        """
        cut = self.take(np.arange(first, last))
        if first == 0:
            return cut
        time, inputs = self.command
        begin = time.size - self.time.size + first
        earliest = int(np.searchsorted(time, self.time[first] - LONGEST_LEAD))
        own = slice(min(earliest, begin), begin)
        setpoint = None if self.setpoint is None else self.goal[1][own]
        return replace(cut, lead=Lead(time=time[own], input=inputs[own], setpoint=setpoint))

    @property
    def command(self) -> tuple[Samples, Samples]:
        """(n,) stamps in s and commands, those before the first sample included."""
        if self.lead is None:
            return self.time, self.input
        time = np.concatenate([self.lead.time, self.time])
        return time, np.concatenate([self.lead.input, self.input])

    @property
    def goal(self) -> tuple[Samples, Samples]:
        """(n,) stamps in s and set-points; before the first one a servo holds where it is told."""
        assert self.setpoint is not None  # noqa: S101 - of a servo
        if self.lead is None or self.lead.setpoint is None:
            return self.held("setpoint")
        time = np.concatenate([self.lead.time, self.time])
        return time, np.concatenate([self.lead.setpoint, self.setpoint])

    def held(self, name: str) -> tuple[Samples, Samples]:
        """(n + 1,) stamps in s and values of a column, whose first one was there before."""
        column = getattr(self, name)
        return np.append(self.time[0] - LONGEST_LEAD, self.time), np.append(column[0], column)

    def is_slow(self, limit: float) -> NDArray[np.bool_]:
        """(n,) whether the mean interval of its clock is above a limit in s at each command."""
        time, regimes = self.command[0], self.clock_regimes
        last = np.searchsorted([each.begin for each in regimes], time, side="right") - 1
        return np.array([0 < limit < each.interval for each in regimes])[np.maximum(last, 0)]

    def arrivals(self, late: float, limit: float) -> Samples:
        """(n,) stamps in s of `command`, ``late`` by so many s where the clock `is_slow`."""
        time = self.command[0]
        return np.maximum.accumulate(time + late * self.is_slow(limit)) if late else time

    @property
    def clock_regimes(self) -> tuple[Regime, ...]:
        """Regimes of its clock, one at least."""
        return self.regimes or (Regime(float(self.time[0]), self.mean_step),)

    @property
    def closed(self) -> bool:
        """Whether it is simulated in a servo's loop."""
        return self.servo is not None and self.setpoint is not None

    @property
    def opened(self) -> Log:
        """The log as its drive alone moves the joint."""
        return replace(self, servo=None)

    @property
    def measures(self) -> str:
        """Name of the column that says how it moves: the angle, or else the velocity."""
        return "velocity" if self.integrated else "angle"

    @property
    def measured(self) -> Samples:
        """(n,) what that column holds."""
        return np.asarray(getattr(self, self.measures))

    @property
    def unit(self) -> str:
        """Unit of what was measured."""
        return self.added_mass.joint.way + ("/s" if self.integrated else "")

    def moving_so(self, measured: Samples) -> Log:
        """Return the log of another motion: (n,) of what was `measured`."""
        moved: dict[str, Any] = {"velocity": None, self.measures: measured}
        return replace(self, **moved)

    @cached_property
    def rms_measured(self) -> float:
        """Rms of what was measured about its mean."""
        return float(np.std(self.measured))

    @cached_property
    def rms_motion(self) -> float:
        """Rms angle in rad about its mean."""
        return float(np.std(self.angle))

    @cached_property
    def _velocities(self) -> Samples:
        """Velocities in rad/s over spans that are long against noise."""
        every = min(max(1, round(_SPAN / self.mean_step)), self.time.size // 2)
        return np.diff(self.angle[::every]) / np.diff(self.time[::every])

    @cached_property
    def rms_speed(self) -> float:
        """Rms velocity in rad/s."""
        return float(np.std(self._velocities))

    @property
    def lag_per_play(self) -> float:
        """Delay in s/rad that is most like staying behind by as much, whichever way it moves."""
        speeds = abs(self._velocities - self._velocities.mean())
        return float(speeds.mean() / np.mean(speeds**2)) if self.rms_speed else 0.0

    @cached_property
    def initial_state(self) -> InitialState:
        """How it begins: a piece of a longer recording in motion, as its first samples say.

        These are followed by the cubic that fits them best. A whole log begins at rest at its first
        sample, unless they say otherwise (see `_moves`).
        """
        time, angle, rest = self.time, self.angle, InitialState(float(self.angle[0]), 0.0)
        if not self.rms_speed > 0:
            return rest
        span = _REACH * min(self.rms_motion, _WIDE) / self.rms_speed
        count = max(int(np.searchsorted(time, time[0] + span, "right")), _FEWEST)
        time, angle = time[:count], angle[:count]
        if self.lead is None and not _moves(time, angle, self.rms_speed):
            return rest
        return _fitted(time, angle, 3)[0]

    @cached_property
    def roughness(self) -> float:
        """Share of the input's rms value that is noise from sample to sample; rare steps are not.

        Of white noise it is its standard deviation, by the 90 % quantile of its second differences:
        the noise of an encoder of coarse steps is not there most of the time.
        """
        size = float(np.sqrt(np.mean(self.input**2)))
        if size == 0.0:
            return 0.0
        most = np.quantile(np.abs(np.diff(self.input, 2)), _MOST)
        return float(most) / (_MOST_OF_NOISE * size)

    @property
    def mean_step(self) -> float:
        """Mean sampling period in s."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    @property
    def label(self) -> str:
        """Short name for tables and figures."""
        if self.excitation is None:
            return f"{1e3 * self.added_mass.mass:g} g, {PurePath(self.source).name}"
        return f"{1e3 * self.added_mass.mass:g} g, {self.excitation.omega:g} rad/s"


def slow_interval(logs: Sequence[Log]) -> float:
    """Return the sampling interval in s above which clocks are slow; 0 where none switches."""
    ends = [float(log.time[-1]) for log in logs]
    return between_regimes([log.clock_regimes for log in logs], ends)


def _integral(time: Samples, velocity: Samples) -> Samples:
    """Return (n,) angles in rad, the first 0, of (n,) velocities in rad/s."""
    with np.errstate(over="ignore", invalid="ignore"):  # of stamps and samples not looked at yet
        steps = np.diff(time) * (velocity[1:] + velocity[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(steps)])


def _moves(time: Samples, angle: Samples, speed: float) -> bool:
    """Whether (n,) first samples move at once: ever fewer of them have one velocity, and no noise.

    Of a joint that starts from rest half as long a stretch gives a quarter, or half, of it; if not
    while it already runs evenly, then as soon as stretches are short beside its spin-up.
    """
    steps = np.abs(np.diff(angle))
    finest = float(np.min(steps, where=steps > 0, initial=np.ptp(angle)))  # an encoder's step
    before, moves = abs(_fitted(time, angle, 2)[0].velocity), False
    while time.size > _FEWEST or not moves:
        count = max(time.size // 2, _FEWEST)
        time, angle = time[:count], angle[:count]
        found, error = _fitted(time, angle, 2, finest)
        if _SURE * error >= before:
            break
        velocity = abs(found.velocity)
        if velocity < _NOTABLE * speed or abs(velocity - before) > _SETTLED * velocity:
            return False
        before, moves = velocity, True
    return moves


def _fitted(
    time: Samples, angle: Samples, order: int, finest: float = 0.0
) -> tuple[InitialState, float]:
    """Fit a polynomial to (n,) first samples; return its beginning, and its velocity's error.

    The error is no less than that of readings in steps as fine as the ``finest`` in rad.
    """
    span = float(time[-1] - time[0])
    columns = polynomial.polyvander((time - time[0]) / span, order)
    coefficients, *_ = np.linalg.lstsq(columns, angle, rcond=None)
    left = angle - columns @ coefficients
    variance = max(float(left @ left) / max(angle.size - order - 1, 1), finest**2 / 12)
    spread = np.linalg.inv(columns.T @ columns)[1, 1]
    value, slope = coefficients[:2].tolist()
    return InitialState(value, slope / span), float(np.sqrt(variance * spread)) / span
