"""What is neither an answer nor a line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.errors import ButterflyError

if TYPE_CHECKING:
    from collections.abc import Callable

LONGEST_LINE = 2000


def escape_of(read: Callable[[], object]) -> str:
    """Read, and tell what escapes; nothing if it ends in an answer or in a line."""
    try:
        read()
    except ButterflyError as error:
        length = len(str(error))
        return f"a message of {length} characters" if length > LONGEST_LINE else ""
    except Exception as escape:  # it is counted, not hidden
        return f"{type(escape).__name__}: {escape}"
    return ""
