"""The errors that butterfly raises on purpose, and checks; any other error is a bug."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from numbers import Real


class ButterflyError(Exception):
    """Base of all errors that the user can fix."""


class InputError(ButterflyError, ValueError):
    """An input is not usable: data, an option or its value, a saved result, a file to write.

    Also a ValueError, so a schema that builds the object can add the place of the value.

    Parameters
    ----------
    source
        The file or object with the bad value.
    field
        Its field, column or variable.
    value
        The value found.
    expected
        The value expected, in words.
    """

    def __init__(self, source: object, field: str, value: object, expected: str) -> None:
        self.source = str(source)
        self.field = field
        self.value = value
        self.expected = expected
        where, wanted = shown(source, 4 * _LONGEST), shown(expected, 4 * _LONGEST)
        super().__init__(f"{where}: {shown(field)}: got {shown(value)}; expected {wanted}")


class IdentifiabilityError(ButterflyError):
    """The data do not determine what is asked for.

    Parameters are not identifiable, or their covariance is missing, or nothing can be held out.
    """


class UnusableError(ButterflyError):
    """The estimated values are impossible for any joint, so nothing can be made with them.

    Parameters
    ----------
    verdict
        The verdict.
    reasons
        Its reasons.
    """

    def __init__(self, verdict: str, reasons: tuple[str, ...] = ()) -> None:
        self.reasons = reasons
        super().__init__(verdict)


class StoppedError(ButterflyError):
    """A sweep was interrupted; finished runs are kept, and the same command continues it."""


_LONGEST = 300  # characters of a value in a message


def shown(text: object, most: int = _LONGEST) -> str:
    """Return a text for a message: one line, shortened, without control characters."""
    line = str(text)
    if len(line) > most:
        line = f"{line[:most]}... ({len(line)} characters)"
    return visible(line, allowed="")


def visible(text: str, allowed: str = "\n\t") -> str:
    """Return a text for a terminal or XML: escapes for unprintable characters not ``allowed``."""
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() or character in allowed else repr(character)[1:-1]
        for character in text
    )


def require_number(source: str, *, positive: bool = False, unit: str = "", **values: float) -> None:
    """Raise InputError unless each value is finite and not negative (or strictly positive)."""
    sign = "positive" if positive else "non-negative"
    for field, value in values.items():
        number = isinstance(value, Real)
        if not (number and math.isfinite(value) and (value > 0 or (value == 0 and not positive))):
            expected = f"a finite {sign} number" + (f" of {unit}" if unit else "")
            raise InputError(source, field, value, expected)


_ASSUMED = 8 << 30  # bytes, if unknown
_PREFIXES = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


def require_room(source: object, field: str, value: object, size: float) -> None:
    """Raise InputError if a value needs more bytes than the machine has memory."""
    there = memory()
    if not size <= there:
        room = f"less: it needs {size_text(size)} of memory, more than the {size_text(there)} here"
        raise InputError(source, field, value, room)


def memory() -> int:
    """Return the memory of the machine in bytes; 8 GiB if unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return _ASSUMED


def size_text(size: float) -> str:
    """Return a readable number of bytes, such as 1.9 TB."""
    thousands = 0
    while size >= 1000 and thousands < len(_PREFIXES) - 1:  # noqa: PLR2004 - of one in the next
        size /= 1000
        thousands += 1
    number = f"{size:.{min(thousands, 1)}f}" if size < 1000 else f"{size:.1e}"  # noqa: PLR2004
    return f"{number} {_PREFIXES[thousands]}"


def nearest(name: str, valid: Iterable[str]) -> str:
    """Name the valid choices, the one closest to ``name`` first."""
    choices = list(valid)
    close = get_close_matches(name, choices, n=1)
    hint = f"{close[0]!r} (did you mean that?)" if close else ""
    listing = ", ".join(repr(choice) for choice in choices)
    return f"{hint}; valid names: {listing}" if hint else f"one of {listing}"


def listed(names: Sequence[str], most: int = 4) -> str:
    """Name the first few of a list, and count the others."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def require_names(method: str, field: str, names: tuple[str, ...], valid: tuple[str, ...]) -> None:
    """Raise InputError unless all names are valid, and each is given once."""
    for name in names:
        if name not in valid:
            raise InputError(method, field, name, nearest(name, valid))
        if names.count(name) > 1:
            raise InputError(method, field, f"{name} twice", "each name once")
