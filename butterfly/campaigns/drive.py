"""A motor that can always be switched off, and whose answers are checked before they are used."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from numbers import Real
from time import sleep
from types import FrameType
from typing import Any

import numpy as np

from butterfly.errors import ButterflyError, InputError
from butterfly.logs.log import InputKind
from butterfly.plant.motor import Motor, Reading

_METHODS = ("start", "stop", "command", "read", "wait")
_TRIES = 5  # of switching off
_PAUSE = 0.05  # s after the first of them, twice as long after each
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")  # that end or halt a program


class SafetyStop(ButterflyError):  # noqa: N818 - it is what happens, not only an error
    """The drive was switched off: the joint, its drive or its encoder is not as it should be."""


class TimeUsed(SafetyStop):
    """The robot time is used up."""


class DriveFault(SafetyStop):
    """The drive raised an error, or answered with what is no number."""


class LeftOnError(DriveFault):
    """The drive could not be switched off."""


class Drive:
    """A `Motor` with checked answers: whatever goes wrong is a `DriveFault` with one sentence.

    It is enabled by `start` and until `switch_off`. Meanwhile signals that end or halt a program
    raise KeyboardInterrupt; while the drive is being stopped they wait until it is off.
    """

    def __init__(self, motor: Motor) -> None:
        self.input_kind = require_drive(motor)
        self._motor, self._enabled = motor, False
        self._ending = self._waiting = False  # no signal may interrupt; one did not
        self._handlers: dict[int, Any] = {}

    @property
    def is_enabled(self) -> bool:
        """Whether it was started, and not yet switched off."""
        return self._enabled

    def start(self) -> None:
        """Enable the drive, with command 0."""
        if self._enabled:
            return
        self._enabled, self._ending = True, False  # half a start is a start
        try:
            self._take_signals()
            self._motor.start()
        except BaseException as error:
            failed = error if _is_interrupt(error) else _fault("start()", error)
            try:
                self.switch_off()
            except LeftOnError as left_on:
                raise LeftOnError(f"{failed or 'interrupted'}; {left_on}") from error
            raise failed from error

    def command(self, value: float) -> float:
        """Set the command; return it as the drive set it."""
        try:
            given = self._motor.command(value)
        except Exception as error:
            raise _fault("command()", error) from error
        number = _number(given, "command()", "the command as it was set")
        if not math.isfinite(number):
            raise DriveFault(f"command() of the drive returned {number}: expected a finite number")
        return number

    def read(self) -> Reading:
        """Read clock and sensors now."""
        try:
            given: Any = self._motor.read()
        except Exception as error:
            raise _fault("read()", error) from error
        time, angle, current = _three_numbers(given)
        if not math.isfinite(angle):
            raise DriveFault("the encoder gives no number: check its cable")
        if not math.isfinite(time):
            raise DriveFault(f"the drive's clock gives {time}: check the source of its time")
        self._require_no_signal()
        return Reading(time, angle, current)

    def wait(self, duration: float) -> None:
        """Let some s pass."""
        try:
            self._motor.wait(duration)
        except Exception as error:
            raise _fault("wait()", error) from error

    def switch_off(self) -> None:
        """Set the command to 0 and stop the drive, whatever is raised meanwhile; try again.

        Afterwards what interrupted it is raised: a second Ctrl-C, or that `stop` never succeeded.
        """
        if not self._enabled:
            return
        interrupt: BaseException | None = None
        for attempt in range(_TRIES):
            unsent = _attempt(lambda: self._motor.command(0.0))  # which a signal may end
            self._ending = True  # from here on signals wait
            failure = _attempt(self._motor.stop)
            for error in (unsent, failure):
                interrupt = error if _is_interrupt(error) else interrupt
            if failure is None:
                break
            _attempt(partial(sleep, _PAUSE * 2**attempt))
        self._enabled = False
        self._give_signals_back()
        if failure is not None:
            raise LeftOnError(
                "THE DRIVE COULD NOT BE SWITCHED OFF: cut its supply now "
                f"(stop() raised {_reason(failure)})"
            ) from failure
        waiting, self._waiting = self._waiting, False
        if interrupt is not None or waiting:
            raise interrupt or KeyboardInterrupt

    def _take_signals(self) -> None:
        """Let signals that ask the program to end raise once, and then wait."""
        if threading.current_thread() is not threading.main_thread():
            return  # where Python delivers none
        for name in _SIGNALS:
            if (number := getattr(signal, name, None)) is not None:
                self._handlers[number] = signal.getsignal(number)
                signal.signal(number, self._interrupted)

    def _give_signals_back(self) -> None:
        """Restore what handled signals before."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        self._handlers.clear()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        """Raise KeyboardInterrupt, unless the drive is already being switched off."""
        self._waiting = True
        if not self._ending:
            raise KeyboardInterrupt

    def _require_no_signal(self) -> None:
        """Raise KeyboardInterrupt if a signal came whose interrupt a motor did not let through."""
        if self._waiting:
            raise KeyboardInterrupt


@contextmanager
def signals_wait() -> Iterator[None]:
    """Let signals that end or halt a program wait for the end of a block, and then interrupt."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    before = [signal.signal(number, lambda number, _: came.append(number)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        if came:
            raise KeyboardInterrupt


def require_drive(motor: object) -> InputKind:
    """Return the kind of a motor's command; InputError unless it can be commanded directly."""
    missing = [name for name in _METHODS if not callable(getattr(motor, name, None))]
    name = type(motor).__name__
    if missing:
        expected = f"a Motor, which has the methods {', '.join(_METHODS)} (docs/hardware.md)"
        raise InputError("campaign", "robot", f"{name} without {', '.join(missing)}", expected)
    kinds = ", ".join(f"'{kind}'" for kind in InputKind if kind is not InputKind.NONE)
    try:
        kind = InputKind(motor.input_kind)  # type: ignore[attr-defined]
    except Exception as error:
        raise InputError(f"campaign: {name}", "input_kind", _reason(error), kinds) from None
    if kind is InputKind.NONE:
        raise InputError(f"campaign: {name}", "input_kind", kind.value, kinds)
    if kind is InputKind.SETPOINT:
        expected = (
            "a drive that takes torque, current or voltage: a campaign closes its own loop. Switch "
            "it to torque, current or PWM mode (of a Dynamixel: operating mode 0 or 16; CiA 402: "
            "mode 10, cyclic synchronous torque); in its own loop, record set-points instead and "
            "`butterfly identify` them with --loop"
        )
        raise InputError(f"campaign: {name}", "input_kind", "a drive of set-points", expected)
    return kind


def _fault(call: str, error: BaseException) -> DriveFault:
    """Return what a drive raised as a fault of its own."""
    what = "the drive no longer answers" if isinstance(error, OSError) else "the drive fails"
    return DriveFault(f"{what}: {call} raised {_reason(error)}")


def _attempt(act: Callable[[], object]) -> BaseException | None:
    """Return what an act raises, if anything."""
    try:
        act()
    except BaseException as error:
        return error
    return None


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether an error asks the program to end."""
    return error is not None and not isinstance(error, Exception)


def _reason(error: BaseException) -> str:
    """Return an error in one line."""
    text = " ".join(str(error).split())
    name = type(error).__name__
    return f"{name} ({text[:200]})" if text else name


def _number(given: Any, call: str, expected: str) -> float:  # noqa: ANN401 - what a drive returned
    """Return a scalar as a float; `DriveFault` for anything else."""
    if type(given) is float:
        return given
    if isinstance(given, Real | np.generic | np.ndarray) and np.ndim(given) == 0:  # type: ignore[arg-type]
        with suppress(TypeError, ValueError):
            return float(given)
    raise DriveFault(f"{call} of the drive returned {_short(given)}: expected {expected}")


def _three_numbers(given: Any) -> tuple[float, float, float]:  # noqa: ANN401 - what a drive returned
    """Return time, angle and current of a reading; `DriveFault` for anything else."""
    try:
        time, angle, current = given
        if float is type(time) is type(angle) is type(current):
            return time, angle, current
    except (TypeError, ValueError):
        raise DriveFault(
            f"read() of the drive returned {_short(given)}: expected Reading(time, angle, current)"
        ) from None
    return (
        _number(time, "time that read()", "s"),
        _number(angle, "angle that read()", "rad"),
        _number(current, "current that read()", "A, NaN if none is measured"),
    )


def _short(given: object) -> str:
    """Return what a drive returned, in one short line."""
    return " ".join(repr(given).split())[:80]
