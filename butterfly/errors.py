"""The errors that butterfly raises on purpose, and checks that do; any other error is a bug."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
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
    """Return any text as a message shows it: in one line, not too long, without controls."""
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


_ASSUMED = 8 << 30  # bytes, of a machine that does not say
_PREFIXES = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


def require_room(source: object, field: str, value: object, size: float) -> None:
    """Raise InputError if a value asks for more bytes than the machine has memory."""
    there = memory()
    if not size <= there:
        room = f"less: it takes {size_text(size)} of memory, of which there are {size_text(there)}"
        raise InputError(source, field, value, room)


def memory() -> int:
    """Return the bytes of memory that the machine has; 8 GiB where it does not say."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return _ASSUMED


def size_text(size: float) -> str:
    """Return a number of bytes as one reads it, such as 1.9 TB."""
    thousands = 0
    while size >= 1000 and thousands < len(_PREFIXES) - 1:  # noqa: PLR2004 - of one in the next
        size /= 1000
        thousands += 1
    number = f"{size:.{min(thousands, 1)}f}" if size < 1000 else f"{size:.1e}"  # noqa: PLR2004
    return f"{number} {_PREFIXES[thousands]}"


def nearest(name: str, valid: Iterable[str]) -> str:
    """Name the valid choices, the one most like ``name`` first."""
    choices = list(valid)
    close = get_close_matches(name, choices, n=1)
    hint = f"{close[0]!r} (did you mean that?)" if close else ""
    listing = ", ".join(repr(choice) for choice in choices)
    return f"{hint}; valid names: {listing}" if hint else f"one of {listing}"


def listed(names: Sequence[str], most: int = 4) -> str:
    """Name a few of a list, and count the others."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
