"""What is asked for must fit into memory: that is checked before it is begun."""

from __future__ import annotations

import os

from butterfly.errors import InputError

_ASSUMED = 8 << 30  # bytes, of a machine that does not say
_PACKED = 64  # times its size that a file of logs may hold
_FREE = 256 << 20  # bytes that any may
_PREFIXES = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


def require_room(source: object, field: str, value: object, size: float) -> None:
    """Raise InputError if a value asks for more bytes than the machine has memory."""
    there = memory()
    if not size <= there:
        room = f"less: it takes {said(size)} of memory, of which there are {said(there)}"
        raise InputError(source, field, value, room)


def most_in(packed: int) -> int:
    """Return how many bytes a packed file of so many may hold: more is damage, or worse."""
    return max(_FREE, _PACKED * packed)


def memory() -> int:
    """Return the bytes of memory that the machine has; 8 GiB where it does not say."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return _ASSUMED


def said(size: float) -> str:
    """Return a number of bytes as one reads it, such as 1.9 TB."""
    for prefix in _PREFIXES:
        if size < 1000 or prefix == _PREFIXES[-1]:  # noqa: PLR2004 - of one prefix in the next
            return f"{size:.0f} {prefix}" if prefix == _PREFIXES[0] else f"{size:.1f} {prefix}"
        size /= 1000
    raise AssertionError
