"""The one form of recorded and simulated experiments for identification."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from pathlib import PurePath
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest, require_number
from butterfly.logs.clock import (
    Regime,
    between_regimes,
    clock_reading,
    interval_reading,
    with_clock,
    with_stamps,
)
from butterfly.logs.initial_state import InitialState, initial_state_of
from butterfly.logs.units import AS_IS, ColumnReading, Heading, Units, apportioned, read_unit
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind
from butterfly.model.prior import Known, known_of
from butterfly.model.servo import ServoLoop

MIN_SAMPLES = 16
"""Fewest samples that make a log."""

_SPAN = 0.05  # s in which an angle changes by more than noise

_NO_NUMBERS = "mMc"  # kinds of NumPy's: spans of time, dates, complex numbers

SAMPLED = ("time", "input", "angle", "velocity")
"""The sampled columns of a log; one of the last two may be missing."""

OF_SERVO = ("setpoint", "supply", "enabled")
"""Further sampled columns of a servo."""

_MEASURED_IN = {"supply": "voltage"}

_NOT_RECORDED: Samples = np.empty(0)


class InputKind(StrEnum):
    """What the input column commands."""

    VOLTAGE = "voltage"
    TORQUE = "torque"
    CURRENT = "current"
    DUTY = "duty"  # the fraction of the supply that a voltage drive applies
    SETPOINT = "setpoint"  # what a servo follows, in its own loop
    NONE = "none"  # a joint that swings freely, without an input column

    @property
    def unit(self) -> str:
        """The unit of the input in the unit of p4."""
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
    """The command before a log that is a piece of a longer recording."""

    time: Samples  # (n,) increasing timestamps in s, before the log's first one
    input: Samples  # the command at each
    setpoint: Samples | None = None  # of a servo in its loop


@dataclass(frozen=True, kw_only=True)
class FileReading:
    """How a file was read, where it differs from the project's own format."""

    layout: tuple[str, ...] = ()  # of a text: delimiters, decimal commas, lines without samples
    cut_lines: int = 0  # incomplete last lines, dropped
    unclear: str = ""  # what its numbers may mean instead
    columns: Mapping[str, ColumnReading] = field(default_factory=dict)  # by field


AS_WRITTEN = FileReading()
"""Of a file in the project's own format, and of a log without a file."""

LONGEST_LEAD = 2.0
"""Seconds of command kept before a log: longer than any delay."""

_KINDS: tuple[tuple[str, type | tuple[type, ...], str], ...] = (
    ("added_mass", AddedMass, "an AddedMass"),
    ("excitation", (Sine, NoneType), "a Sine, or None"),
    ("lead", (Lead, NoneType), "a Lead, or None"),
    ("servo", (ServoLoop, NoneType), "a ServoLoop, or None"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """One experiment: the input and the measured motion.

    Columns may be anything that NumPy converts to arrays; see `from_frame` for tables.

    Parameters
    ----------
    time
        (n,) timestamps in s, as recorded (`butterfly.logs.health` treats repeated or backward
        ones).
    input
        (n,) command at each timestamp: V, A, units of torque command, a duty from -1 to 1, or the
        setpoint of a servo in rad or rad/s; 0 if nothing drives the joint.
    angle
        (n,) rad, from the encoder zero. If missing, the integral of the velocity, which suffices
        without gravity.
    velocity
        (n,) rad/s, or None. Beside an angle it is only displayed.
    setpoint, supply, enabled
        Of a servo, or None: (n,) setpoint, if the input is its drive; its supply in V; and whether
        it is driven, 0 or 1.
    servo
        The loop that is simulated from the setpoint; None if the input drives the joint.
    input_kind, intersample
        What the command means, and what it does between timestamps: zero_order_hold or
        first_order_hold; None if unknown: a fit by output error compares both.
    added_mass
        Mass added to the joint.
    excitation
        The commanded sine, or None for any other input.
    zero
        The encoder's reading in rad at model angle 0, if known: a number, or a pair of a value and
        its standard uncertainty.
    lead
        The command before a piece of a longer recording, which begins in motion; None for a whole
        recording, which begins at rest unless its first samples show motion.
    source
        File or plant of the log, for messages.
    name
        Name of the log in its data set (see `with_unique_names`).
    reading
        How its file was read.
    integrated, rebuilt
        Whether the angle is the integral of the recorded velocity; whether the input is computed
        from the setpoint by the servo's law.
    regimes
        Of its clock, if its mean interval switches (see `butterfly.logs.clock`); found by
        `butterfly.logs.health.examine`.
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
    intersample: Intersample | None = None
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
            expected = "the loop that follows the setpoint, such as {law: dynamixel-x, kp: 400}"
            raise InputError(self.source, "servo", "nothing", expected)
        self._require_lengths()
        if self.integrated:
            if self.velocity is None:
                raise InputError(self.source, "angle", "nothing", "an angle or a velocity")
            with np.errstate(over="ignore", invalid="ignore"):  # of numbers not checked yet
                steps = np.diff(self.time) * (self.velocity[1:] + self.velocity[:-1]) / 2
                object.__setattr__(self, "angle", np.concatenate([[0.0], np.cumsum(steps)]))

    def _declare_input(self) -> None:
        """Set the input of a free joint to 0; refuse a nonzero one."""
        free = self.input_kind is InputKind.NONE
        if self.input is _NOT_RECORDED:
            if not free:
                expected = "an input, or the input kind none if nothing drives the joint"
                raise InputError(self.source, "input", "nothing", expected)
            object.__setattr__(self, "input", np.zeros(self.time.size))
        elif free and np.any(self.input):
            value = f"{self.input[np.flatnonzero(self.input)[0]]:g}"
            raise InputError(self.source, "input", value, "0 throughout, for the input kind none")

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
        """Make a log from the columns of a pandas frame, or of anything with named columns.

        Parameters
        ----------
        frame
            The table.
        time, input, angle, velocity
            Names of its columns; None for a missing one.
        units
            Of the columns (see `butterfly.logs.units`), besides units in brackets in their names.
        properties
            The other fields.

        Raises
        ------
        InputError
            If a column is missing or not numeric, or a unit does not fit its column.
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
        fields = {"source": "frame", **properties}
        return cls.of_columns(columns, headings, Units.of(units, "frame"), **fields)

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
        """Make a log from columns in their units (see `read_unit`); all readers end here.

        A column ``unasked`` for is ignored if its unit is unknown. ``interval`` in s is a clock.
        """
        interval = properties.pop("interval", None)
        columns, headings = with_stamps(properties.get("source", ""), columns, headings)
        columns, headings, start = with_clock(columns, headings, interval)
        log = cls(**columns, **properties)
        layout, readings = list(log.reading.layout), {}
        heads = {name: head for name, head in headings.items() if name != "enabled"}  # yes or no
        for name, heading in apportioned(
            heads, {column: log.quantities(column) for column in heads}
        ).items():
            is_setpoint = name == "input" and log.input_kind is InputKind.SETPOINT
            field = "setpoint" if is_setpoint else name
            try:
                readings[name] = read_unit(log.source, field, heading, units, log.quantities(name))
            except InputError as error:
                if name not in unasked:
                    raise
                layout.append(f"{name} ignored: {error.value} is unknown")
        if "time" in readings:
            readings["time"], start = clock_reading(log.source, readings["time"], start, log.time)
        reading = replace(log.reading, layout=tuple(layout), columns=readings)
        changed: dict[str, Any] = dict.fromkeys(unasked)
        for name, conversion in readings.items():
            values, (scale, offset) = getattr(log, name), headings[name].scale
            values = values - start if name == "time" and start else values
            values = values if (scale, offset) == (1.0, 0.0) else values * scale + offset
            changed[name] = values if conversion.factor == 1.0 else values * conversion.factor
        log = replace(log, **changed, reading=reading)
        _refuse_percents(log)
        if interval is not None:
            readings["time"] = interval_reading(
                log.source, interval, readings.get("time"), log.time
            )
        return log

    @property
    def between_samples(self) -> Intersample:
        """What the input does between timestamps: it is held, unless something else is known."""
        return self.intersample or Intersample.ZERO_ORDER_HOLD

    def quantities(self, name: str) -> tuple[str, ...]:
        """Return the quantities that a sampled column may hold, the project's own unit first."""
        turns = self.added_mass.joint is JointKind.HINGE
        drives = {
            InputKind.VOLTAGE: "voltage",
            InputKind.CURRENT: "current",
            InputKind.DUTY: "share",
        }
        if name == "setpoint" or (name == "input" and self.input_kind is InputKind.SETPOINT):
            name = "velocity" if self.servo and self.servo.of_speed else "angle"
        if name == "input" and self.input_kind is InputKind.NONE:
            return ("voltage", "torque", "force", "current", "share")
        if name == "input" and self.input_kind in drives:
            return (drives[self.input_kind],)
        if name == "input":
            return ("torque" if turns else "force", "current", "share")
        kinds = {"angle": ("angle", "length"), "velocity": ("rate", "speed")}
        return (kinds[name][not turns],) if name in kinds else (_MEASURED_IN.get(name, name),)

    def at_joint(self, ratio: float) -> Log:
        """Return the log and its loop at the joint, ``ratio`` turns of the encoder per turn."""
        columns = ["angle", "velocity", "setpoint"]
        columns += ["input"] if self.input_kind is InputKind.SETPOINT else []
        values = {name: getattr(self, name) for name in columns}
        scaled = {name: column / ratio for name, column in values.items() if column is not None}
        zero = None if self.zero is None else self.zero.times(1 / ratio)
        servo = None if self.servo is None else self.servo.at_joint(ratio)
        return replace(self, **scaled, zero=zero, servo=servo)

    def timed(self, factor: float) -> Log:
        """Return the log with its timestamps multiplied by a factor, and speeds divided by it."""
        lead, velocity = self.lead, self.velocity
        return replace(
            self,
            time=factor * self.time,
            velocity=None if velocity is None else velocity / factor,
            lead=None if lead is None else replace(lead, time=factor * lead.time),
            regimes=tuple(Regime(factor * begin, factor * step) for begin, step in self.regimes),
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
            raise InputError(self.source, name, "values that are not numbers", "numbers") from None

    def _choice(self, name: str, kind: type[StrEnum]) -> StrEnum | None:
        value, known = getattr(self, name), [str(member) for member in kind]
        if value is None and name == "intersample":
            return None
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

    def take(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Log:
        """Return the log of the samples selected by a mask, their numbers, or as views a slice."""
        taken: dict[str, Any] = {name: column[rows] for name, column in self.columns().items()}
        return replace(self, **taken)

    def piece(self, first: int, last: int) -> Log:
        """Return samples ``first`` to before ``last``, as views, with the command before."""
        if (first, last) == (0, self.time.size):
            return self
        cut = self.take(slice(first, last))
        if first == 0:
            return cut
        time, inputs = self.command
        begin = time.size - self.time.size + first
        rows = slice(min(int(np.searchsorted(time, self.time[first] - LONGEST_LEAD)), begin), begin)
        setpoint = None if self.setpoint is None else self.goal[1][rows]
        return replace(cut, lead=Lead(time=time[rows], input=inputs[rows], setpoint=setpoint))

    @property
    def command(self) -> tuple[Samples, Samples]:
        """(n,) timestamps in s and commands, including those before the first sample."""
        if self.lead is None:
            return self.time, self.input
        time = np.concatenate([self.lead.time, self.time])
        return time, np.concatenate([self.lead.input, self.input])

    @property
    def goal(self) -> tuple[Samples, Samples]:
        """(n,) timestamps in s and setpoints; a servo held the first one before the log."""
        assert self.setpoint is not None  # noqa: S101 - of a servo
        if self.lead is None or self.lead.setpoint is None:
            return self.held("setpoint")
        return self.command[0], np.concatenate([self.lead.setpoint, self.setpoint])

    def held(self, name: str) -> tuple[Samples, Samples]:
        """(n + 1,) timestamps in s and values of a column, the first value also before the log."""
        column = getattr(self, name)
        return np.append(self.time[0] - LONGEST_LEAD, self.time), np.append(column[0], column)

    def is_slow(self, limit: float) -> NDArray[np.bool_]:
        """(n,) whether the mean interval of the clock is above a limit in s at each command."""
        time, regimes = self.command[0], self.clock_regimes
        last = np.searchsorted([regime.begin for regime in regimes], time, side="right") - 1
        return np.array([0 < limit < regime.interval for regime in regimes])[np.maximum(last, 0)]

    def arrivals(self, late: float, limit: float) -> Samples:
        """(n,) timestamps in s of `command`, shifted by ``late`` s where the clock `is_slow`."""
        time = self.command[0]
        return np.maximum.accumulate(time + late * self.is_slow(limit)) if late else time

    @property
    def clock_regimes(self) -> tuple[Regime, ...]:
        """Regimes of its clock, at least one."""
        return self.regimes or (Regime(float(self.time[0]), self.mean_step),)

    @property
    def closed(self) -> bool:
        """Whether it is simulated in a servo loop."""
        return self.servo is not None and self.setpoint is not None

    @property
    def opened(self) -> Log:
        """The log without its servo loop: the input drives the joint."""
        return replace(self, servo=None)

    @property
    def measures(self) -> str:
        """Name of the measured column: the angle, or else the velocity."""
        return "velocity" if self.integrated else "angle"

    @property
    def measured(self) -> Samples:
        """(n,) values of that column."""
        return np.asarray(getattr(self, self.measures))

    @property
    def unit(self) -> str:
        """Unit of what was measured."""
        return self.added_mass.joint.way + ("/s" if self.integrated else "")

    def with_measurement(self, measured: Samples) -> Log:
        """Return the log with other (n,) `measured` values."""
        moved: dict[str, Any] = {"velocity": None, self.measures: measured}
        return replace(self, **moved)

    @cached_property
    def rms_measured(self) -> float:
        """Rms of the measured values about their mean."""
        return float(np.std(self.measured))

    @cached_property
    def rms_motion(self) -> float:
        """Rms angle in rad about its mean."""
        return float(np.std(self.angle))

    @cached_property
    def _velocities(self) -> Samples:
        """Velocities in rad/s over spans long enough to exceed noise."""
        every = min(max(1, round(_SPAN / self.mean_step)), self.time.size // 2)
        return np.diff(self.angle[::every]) / np.diff(self.time[::every])

    @cached_property
    def rms_speed(self) -> float:
        """Rms velocity in rad/s."""
        return float(np.std(self._velocities))

    @property
    def top_speed(self) -> float:
        """Largest speed in rad/s."""
        return float(np.abs(self._velocities).max())

    @property
    def lag_per_play(self) -> float:
        """Delay in s per rad of lag (play): the delay that resembles that lag most."""
        speeds = abs(self._velocities - self._velocities.mean())
        return float(speeds.mean() / np.mean(speeds**2)) if self.rms_speed else 0.0

    @cached_property
    def initial_state(self) -> InitialState:
        """Initial state (see `initial_state_of`)."""
        return initial_state_of(
            self.time,
            self.angle,
            motion=self.rms_motion,
            speed=self.rms_speed,
            omega=self.excitation.omega if self.excitation else None,
            free=not self.input.any(),
            cut=self.lead is not None,
        )

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


def _refuse_percents(log: Log) -> None:
    """Refuse a duty above 1 whose unit nobody gave."""
    read = log.reading.columns.get("input")
    if log.input_kind is InputKind.DUTY and read is not None and read.assumed:
        largest = np.nanmax(np.abs(log.input), initial=0.0)
        if largest > 1:
            how = "--units input=%, or units: {input: '%'} in the manifest"
            expected = f"at most 1, or its unit: {how}"
            raise InputError(log.source, read.name, f"a duty of {largest:g}", expected)


def slow_interval(logs: Sequence[Log]) -> float:
    """Return the sampling interval in s above which clocks are slow; 0 if none switches."""
    ends = [float(log.time[-1]) for log in logs]
    return between_regimes([log.clock_regimes for log in logs], ends)
