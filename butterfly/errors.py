"""The errors that butterfly raises on purpose; everything else is a bug."""

from __future__ import annotations

import math
from collections.abc import Iterable
from difflib import get_close_matches
from numbers import Real


class ButterflyError(Exception):
    """Base of every error that the user can do something about."""


class InputError(ButterflyError, ValueError):
    """Something the user handed in is not usable.

    A ValueError too, so that a schema that builds the object can add where the value stood.

    Parameters
    ----------
    source
        The file (or object) that holds the bad value.
    field
        Which field, column or variable of it.
    value
        What was found there.
    expected
        What should have been there, in words.
    """

    def __init__(self, source: object, field: str, value: object, expected: str) -> None:
        self.source = str(source)
        self.field = field
        self.value = value
        self.expected = expected
        where, wanted = shown(source, 4 * _LONGEST), shown(expected, 4 * _LONGEST)
        super().__init__(f"{where}: {shown(field)}: got {shown(value)}; expected {wanted}")


class IdentifiabilityError(ButterflyError):
    """The data cannot determine what was asked for, however good they are."""


class UnusableError(ButterflyError):
    """Values were found, but no joint has them, and nothing can be made of them.

    Parameters
    ----------
    said
        The verdict on them.
    reasons
        Why it is no better.
    """

    def __init__(self, said: str, reasons: tuple[str, ...] = ()) -> None:
        self.reasons = reasons
        super().__init__(said)


class StoppedError(ButterflyError):
    """A sweep was interrupted; what is done is kept, and the same command goes on."""


_LONGEST = 300  # characters of what a message repeats


def shown(text: object, most: int = _LONGEST) -> str:
    """Return a text as a message shows it: in one line, no longer than need be, and harmless.

    `text`: Whatever a file may hold, controls of terminals included.
    """
    said = str(text)
    if len(said) > most:
        said = f"{said[:most]}... ({len(said)} characters)"
    return "".join(each if each.isprintable() else repr(each)[1:-1] for each in said)


def require_number(source: str, *, positive: bool = False, unit: str = "", **values: float) -> None:
    """Raise InputError unless each value is finite and not negative (or strictly positive)."""
    sign = "positive" if positive else "non-negative"
    for field, value in values.items():
        number = isinstance(value, Real)
        if not (number and math.isfinite(value) and (value > 0 or (value == 0 and not positive))):
            expected = f"a finite {sign} number" + (f" of {unit}" if unit else "")
            raise InputError(source, field, value, expected)


def nearest(name: str, valid: Iterable[str]) -> str:
    """Name the valid choices, the one most like ``name`` first."""
    choices = list(valid)
    close = get_close_matches(name, choices, n=1)
    hint = f"{close[0]!r} (did you mean that?)" if close else ""
    listing = ", ".join(repr(choice) for choice in choices)
    return f"{hint}; valid names: {listing}" if hint else f"one of {listing}"
